//! The part of the rigid bodies in a step: their free motion, what contact forces do to them, and where they are.

use std::ops::Range;

use nalgebra::Vector3;
use palpate_constraints::body::{Body, RigidBodies, RigidInverse};
use palpate_constraints::rows::{ContactRows, RigidSide, Twist};
use palpate_rigid::{FreeMotion, RigidState, advance, free_motion};

use super::{StepState, StepWorkspace};
use crate::world::World;

/// Scratch of the rigid bodies.
pub(super) struct RigidStage {
    pub(super) inverse: Vec<RigidInverse>,
    free: Vec<FreeMotion>,
    /// `Δv` and `Δω` of the contact forces, or of those that are not carried by the free motion.
    pub(super) correction: Vec<Twist>,
    /// The same of forces that Newton's method carries.
    pub(super) carried: Vec<Twist>,
    /// `A⁻¹ Hᵀ` of one row.
    pub(super) sample: Vec<Twist>,
    /// Blocks of each pair.
    pub(super) blocks: Vec<Range<usize>>,
    /// Number of blocks of the tool on the skin: the first of all.
    pub(super) skin_blocks: usize,
    /// The same with those of the tool on rigid bodies, which follow.
    pub(super) tool_blocks: usize,
    /// Gaps of the tool's rows if nothing but the other contacts touched (m).
    pub(super) tool_delta: Vec<f64>,
}

impl RigidStage {
    pub(super) fn new(world: &World) -> Self {
        let twists = vec![Twist::default(); world.bodies().rigid.len()];
        let pairs = world.bodies().pairs.len();
        Self {
            inverse: Vec::with_capacity(twists.len()),
            free: Vec::with_capacity(twists.len()),
            correction: twists.clone(),
            carried: twists.clone(),
            sample: twists,
            blocks: Vec::with_capacity(pairs),
            skin_blocks: 0,
            tool_blocks: 0,
            tool_delta: Vec::with_capacity(super::workspace::ROWS * world.contact_capacity()),
        }
    }

    /// No pair has a block.
    pub(super) fn clear_blocks(&mut self) {
        self.blocks.clear();
        (self.skin_blocks, self.tool_blocks) = (0, 0);
    }

    pub(super) fn side(&self, body: usize, state: &[RigidState]) -> Option<RigidSide> {
        let (free, carried) = (self.free.get(body)?, self.carried.get(body)?);
        let centre = state.get(body)?.pose.translation.vector;
        let linear = free.velocity + carried.linear;
        Some(RigidSide {
            body: body as u32,
            centre,
            free: Twist { linear, angular: free.angular_velocity + carried.angular },
        })
    }

    /// Lets the next free motion carry these forces.
    pub(super) fn carry(&mut self, rows: &ContactRows, lambda: &[f64], dt: f64) {
        RigidBodies { inverse: &self.inverse, correction: &mut self.carried }.correct(rows, lambda, dt);
    }

    /// `Δv = h A⁻¹ Hᵀ λ` of all rigid bodies.
    pub(super) fn correct(&mut self, rows: &ContactRows, lambda: &[f64], dt: f64) -> bool {
        RigidBodies { inverse: &self.inverse, correction: &mut self.correction }.correct(rows, lambda, dt)
    }
}
/// The free motion of the rigid bodies, and their `A⁻¹`.
pub(super) fn rigid_motion(world: &World, state: &StepState, ws: &mut StepWorkspace) {
    let gravity = world.model().gravity();
    ws.rigid.inverse.clear();
    ws.rigid.free.clear();
    for (body, state) in world.bodies().rigid.iter().zip(&state.rigid) {
        let inertia = state.inverse_inertia(&body.model);
        ws.rigid.inverse.push(RigidInverse { mass: 1.0 / body.model.mass(), inertia });
        ws.rigid.free.push(free_motion(&body.model, state, gravity, ws.dt));
    }
}

/// Numbers that tell where a rigid body is: origin of its shape (m), its orientation `[x, y, z, w]`, velocity of the centre
/// of mass (m/s), angular velocity (rad/s).
pub(crate) type Placement = ([f64; 3], [f64; 4], [f64; 3], [f64; 3]);

/// Where every rigid body is, in the order of the scene.
pub(crate) fn placements(world: &World, rigid: &[RigidState]) -> impl Iterator<Item = Placement> {
    world.bodies().rigid.iter().zip(rigid).map(|(body, state)| {
        let pose = body.shape_pose(state);
        let rotation = pose.rotation.coords.into();
        let angular = state.angular_velocity(&body.model);
        (pose.translation.vector.into(), rotation, state.velocity.into(), angular.into())
    })
}

/// The digest of placements (FNV-1a over their bits); 0 where there are none.
pub(crate) fn digest(placements: impl Iterator<Item = Placement>) -> u64 {
    let mut hash = 0;
    for (position, orientation, velocity, angular) in placements {
        for x in position.iter().chain(&orientation).chain(&velocity).chain(&angular) {
            for byte in x.to_bits().to_le_bytes() {
                hash = (hash ^ u64::from(byte) ^ 0xcbf2_9ce4_8422_2325).wrapping_mul(0x0100_0000_01b3);
            }
        }
    }
    hash
}

/// Moves the rigid bodies to the end of the step; false where a number is not finite.
pub(super) fn advance_rigid(world: &World, state: &mut StepState, ws: &StepWorkspace, touched: bool) -> bool {
    let none = Vector3::zeros();
    let mut finite = true;
    for (k, (body, state)) in world.bodies().rigid.iter().zip(&mut state.rigid).enumerate() {
        let Some(free) = ws.rigid.free.get(k) else { continue };
        let added = |twists: &[Twist]| twists.get(k).map_or((none, none), |t| (t.linear, t.angular));
        let (carried, corrected) = (added(&ws.rigid.carried), added(&ws.rigid.correction));
        let (v, w) = if touched { (carried.0 + corrected.0, carried.1 + corrected.1) } else { (none, none) };
        advance(&body.model, state, free, &v, &w, ws.dt);
        finite &= state.is_finite();
    }
    finite
}
