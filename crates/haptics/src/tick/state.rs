//! What a tick remembers.

use nalgebra::{Isometry3, Vector3};

use super::jump::JumpState;
use super::patch::PatchMemory;
use super::warm_start::WarmStart;
use crate::coupling::CouplingState;
use crate::gripper::GripperState;
use crate::limits::LimitsState;
use crate::passivity::PassivityState;
use crate::wrench::Twist;

/// What a tick remembers: state.
#[derive(Clone, Debug)]
pub struct TickState {
    pub(super) coupling: CouplingState,
    pub(super) passivity: PassivityState,
    pub(super) jump: JumpState,
    pub(super) limits: LimitsState,
    pub(super) warm_start: WarmStart,
    /// For ticks on patches.
    pub(super) patch: Option<PatchMemory>,
    /// The step whose snapshot is in use.
    pub(super) step: Option<u64>,
    /// Whether its numbers are ones.
    pub(super) believed: bool,
    /// How that snapshot numbers features.
    pub(super) numbering: u32,
    pub(super) age: f64,
    /// Ticks in a row that came within no time.
    pub(super) in_no_time: u32,
    /// Contact force of the snapshot that is about to be replaced, at the pose of this tick \[N\].
    pub(super) outgoing: Option<Vector3<f64>>,
    pub(super) device_pose: Isometry3<f64>,
    pub(super) device_velocity: Twist,
    pub(super) gripper: GripperState,
    /// How far the device's gripper was open, 0 to 1.
    pub(super) device_gripper: f64,
}

impl TickState {
    /// The state before the first tick, for snapshots of up to `max_contacts` contacts.
    #[must_use]
    pub fn new(max_contacts: usize) -> Self {
        Self {
            coupling: CouplingState::default(),
            passivity: PassivityState::default(),
            jump: JumpState::default(),
            limits: LimitsState::default(),
            warm_start: WarmStart::new(max_contacts),
            patch: None,
            step: None,
            believed: false,
            numbering: 0,
            age: f64::INFINITY,
            in_no_time: 0,
            outgoing: None,
            device_pose: Isometry3::identity(),
            device_velocity: Twist::default(),
            gripper: GripperState::default(),
            device_gripper: 1.0,
        }
    }

    /// Takes the force off and forgets everything but the capacity: what follows is what would follow in a new state.
    pub fn reset(&mut self) {
        self.forget_patch();
        self.warm_start.clear();
        // Without memory of its own, so that nothing is allocated or freed.
        let nothing = Self::new(0);
        let (warm_start, patch) = (std::mem::replace(&mut self.warm_start, nothing.warm_start), self.patch.take());
        *self = Self { warm_start, patch, ..Self::new(0) };
    }

    /// Takes the force off at once, lets its return be a ramp, and forgets the stretch of the coupling.
    pub(crate) fn cut(&mut self) {
        self.coupling = CouplingState::default();
        self.gripper.cut();
        self.passivity.cut();
        self.limits.cut();
        self.forget_patch();
    }

    /// The next tick on a patch begins with the shape and the forces of the step.
    pub(super) fn forget_patch(&mut self) {
        self.patch.iter_mut().for_each(PatchMemory::forget);
    }
}
