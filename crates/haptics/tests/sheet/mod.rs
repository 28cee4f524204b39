//! A flat sheet of springs under a ball, as a patch: what tests of ticks on patches need.
#![allow(dead_code)] // each test file uses its part

use nalgebra::{Isometry3, Vector3};
use palpate_collision::shape::ToolShape;
use palpate_collision::{ContactKind, DetectionConfig, PatchConfig, PatchGathering, SurfaceGeometry};
use palpate_constraints::law::{Coulomb, Signorini};
use palpate_haptics::coupling::{CouplingConfig, Spring};
use palpate_haptics::device::{DeviceSample, DeviceSpec, TickTime};
use palpate_haptics::record::TickRecord;
use palpate_haptics::snapshot::HapticSnapshot;
use palpate_haptics::tick::{PatchTickConfig, Tick, TickConfig, TickState, TickWorkspace};

/// Distance of the sheet's nodes (m), and how many there are along each side.
pub(crate) const SPACING: f64 = 6e-3;
pub(crate) const SIDE: u32 = 9;

/// Node in the middle of the sheet, which is the origin.
pub(crate) const MIDDLE: u32 = SIDE * SIDE / 2;

/// What the sheet is made of.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sheet {
    /// Compliance of each node (m/N), in all directions.
    pub(crate) compliance: f64,
    /// Share of it that a neighbour at `SPACING` feels, falling off exponentially.
    pub(crate) coupling: f64,
    pub(crate) friction: f64,
    /// Where the sheet lies (m).
    pub(crate) lift: Vector3<f64>,
    /// Whether its nodes can move.
    pub(crate) movable: bool,
    /// Nodes that the patch may have.
    pub(crate) max_nodes: usize,
    /// Whether edges and triangles are numbered in another order, as after a cut.
    pub(crate) renumbered: bool,
}

impl Sheet {
    pub(crate) fn springs(compliance: f64) -> Self {
        let (lift, max_nodes) = (Vector3::zeros(), 40);
        Self { compliance, coupling: 0.0, friction: 0.0, lift, movable: true, max_nodes, renumbered: false }
    }

    pub(crate) fn node(self, name: u32) -> Vector3<f64> {
        let half = f64::from(SIDE / 2);
        let (i, j) = (f64::from(name % SIDE) - half, f64::from(name / SIDE) - half);
        Vector3::new(i * SPACING, j * SPACING, 0.0) + self.lift
    }

    pub(crate) fn surface(self) -> (SurfaceGeometry, Vec<Vector3<f64>>) {
        let nodes: Vec<_> = (0..SIDE * SIDE).map(|n| self.node(n)).collect();
        let corner = |i: u32, j: u32| j * SIDE + i;
        let cells = (0..SIDE - 1).flat_map(|j| (0..SIDE - 1).map(move |i| (i, j)));
        let triangles = cells.flat_map(|(i, j)| {
            let (a, b, c, d) = (corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1));
            [[a, b, c], [a, c, d]]
        });
        let mut triangles: Vec<_> = triangles.collect();
        if self.renumbered {
            triangles.reverse();
        }
        (SurfaceGeometry::new(triangles, &nodes).expect("a sheet"), nodes)
    }

    /// Fills the snapshot of a step with the sheet around the ball at `pose`.
    pub(crate) fn fill(self, snapshot: &mut HapticSnapshot, step: u64, ball: &Ball, pose: &Isometry3<f64>) {
        let (surface, nodes) = self.surface();
        snapshot.clear();
        let mut gathering = PatchGathering::new(&surface);
        let config = PatchConfig { margin: ball.detection.margin, travel: ball.travel, side: Some(Vector3::z()) };
        let patch = &mut snapshot.patch;
        let report =
            gathering.gather(&surface, &nodes, (&ball.shape, pose), &config, |_| self.movable, patch.skin_mut());
        for k in 0..patch.len() {
            patch.q_free_mut()[k] = nodes[patch.skin().nodes()[k] as usize];
        }
        patch.force_mut().fill(Vector3::zeros());
        let names = patch.skin().nodes()[..patch.skin().movable()].to_vec();
        let n = patch.degrees_of_freedom();
        let c = patch.compliance_mut();
        c.fill(0.0);
        for (a, &name) in names.iter().enumerate() {
            for (b, &other) in names.iter().enumerate() {
                let steps = (self.node(name) - self.node(other)).norm() / SPACING;
                let share = if a == b { 1.0 } else { self.coupling * (1.0 - steps).exp() };
                (0..3).for_each(|k| c[(3 * b + k) * n + 3 * a + k] = self.compliance * share);
            }
        }
        let friction = self.friction;
        patch.relieve();
        patch.law = if friction > 0.0 { Coulomb { friction }.into() } else { Signorini.into() };
        (patch.valid, patch.left_out) = (true, report.left_out as u32);
        snapshot.numbering = u32::from(self.renumbered);
        (snapshot.step, snapshot.dt, snapshot.valid, snapshot.tool_pose) = (step, 1.0 / 30.0, true, *pose);
    }

    pub(crate) fn snapshot(self, step: u64, ball: &Ball, pose: &Isometry3<f64>) -> HapticSnapshot {
        let mut snapshot = HapticSnapshot::with_patch(ball.detection.max_contacts, self.max_nodes);
        self.fill(&mut snapshot, step, ball, pose);
        snapshot
    }
}

/// The tool, and how it finds contacts.
#[derive(Clone, Debug)]
pub(crate) struct Ball {
    pub(crate) shape: ToolShape,
    pub(crate) detection: DetectionConfig,
    pub(crate) travel: f64,
}

impl Ball {
    pub(crate) fn at_nodes(radius: f64) -> Self {
        let detection = DetectionConfig { kind: ContactKind::Nodes, max_contacts: 40, ..DetectionConfig::default() };
        Self { shape: ToolShape::sphere(radius).expect("positive"), detection, travel: 10e-3 }
    }

    pub(crate) fn at_faces(radius: f64) -> Self {
        let mut ball = Self::at_nodes(radius);
        ball.detection.kind = ContactKind::Faces;
        ball
    }
}

/// Stiffness of the coupling (N/m).
pub(crate) const STIFFNESS: f64 = 1000.0;

/// A tick on patches with its state, on a device that only the scene limits.
pub(crate) struct Bench {
    pub(crate) tick: Tick,
    pub(crate) state: TickState,
    pub(crate) ws: TickWorkspace,
    pub(crate) index: u64,
}

impl Bench {
    pub(crate) fn new(ball: &Ball, hand_over: f64, change: impl FnOnce(&mut TickConfig)) -> Self {
        let spec = DeviceSpec { max_force: 1e3, max_torque: 1e2, ..DeviceSpec::virtual_device(0.0) };
        let mut config = TickConfig::for_device(&spec);
        (config.limits.stale_after, config.limits.stale_zero) = (1e3, 2e3);
        (config.tolerance, config.sweeps) = (1e-9, 200);
        config.coupling.translation.stiffness = STIFFNESS;
        change(&mut config);
        let patch = PatchTickConfig {
            tool: ball.shape.clone().into(),
            detection: ball.detection,
            max_nodes: 40,
            max_bodies: 4,
            hand_over,
        };
        let tick = Tick::new(&config, &spec).and_then(|tick| tick.on_patches(patch)).expect("valid configuration");
        let contacts = ball.detection.max_contacts;
        Self { state: tick.state(contacts), ws: tick.workspace(contacts), tick, index: 0 }
    }

    pub(crate) fn tick(&mut self, snapshot: &HapticSnapshot, sample: &DeviceSample) -> TickRecord {
        let time = TickTime::regular(self.index, 1e-3);
        self.index += 1;
        self.tick.tick(&mut self.state, snapshot, sample, time, &mut self.ws)
    }

    pub(crate) fn at(&mut self, snapshot: &HapticSnapshot, position: Vector3<f64>) -> TickRecord {
        self.tick(snapshot, &at(position))
    }

    /// Ticks until the coupling's damper has died down.
    pub(crate) fn rest(&mut self, snapshot: &HapticSnapshot, position: Vector3<f64>) -> TickRecord {
        (0..200).map(|_| self.at(snapshot, position)).last().expect("ticks")
    }

    /// Takes `new` over from `old` as a run does.
    pub(crate) fn swap(&mut self, old: &HapticSnapshot, new: &HapticSnapshot, position: Vector3<f64>) -> TickRecord {
        self.tick.weigh_outgoing(&mut self.state, old, &at(position), &mut self.ws);
        self.at(new, position)
    }
}

pub(crate) fn at(position: Vector3<f64>) -> DeviceSample {
    DeviceSample::at_rest(0.0, Isometry3::translation(position.x, position.y, position.z))
}

pub(crate) fn pose(position: Vector3<f64>) -> Isometry3<f64> {
    Isometry3::translation(position.x, position.y, position.z)
}

/// A change of the tick after which the tool follows the device.
pub(crate) fn stiff(config: &mut TickConfig) {
    config.coupling = CouplingConfig { translation: Spring { stiffness: 1e7, damping: 0.0 }, rotation: None };
}

/// The number of the node in the middle.
pub(crate) fn middle(snapshot: &HapticSnapshot) -> usize {
    snapshot.patch.skin().nodes().iter().position(|node| *node == MIDDLE).expect("in reach")
}
