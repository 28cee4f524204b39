//! Where the bodies are, for a screen: the latest step's, handed over whole.

use nalgebra::Vector3;
use palpate_haptics::exchange::{Reader, Writer, latest};

use super::Session;
use crate::step::{StepState, placements};
use crate::world::{Change, World};

/// The bodies at the end of a step.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// Steps until then.
    pub steps: u64,
    /// Time (s).
    pub time: f64,
    /// Events and changes from outside that had happened by then: the body's triangles are [`Skins::of`](super::Skins::of)
    /// this number.
    pub phase: usize,
    /// Nodes of the soft body (m), inner ones too: triangles name them.
    pub positions: Vec<Vector3<f64>>,
    /// Origin of the shape of each rigid body (m), and its orientation `[x, y, z, w]`.
    pub rigid: Vec<([f64; 3], [f64; 4])>,
}

impl Session {
    /// Where the bodies are after the latest step. No thread waits for it.
    pub fn shape(&mut self) -> &Shape {
        self.shapes.latest()
    }

    /// Time of the scene's last event (s) where the latest step was before it: changes from outside are made from the body
    /// that it leaves, and wait for it. `None` where the next step takes them.
    pub fn changes_wait_until(&mut self) -> Option<f64> {
        let events = self.world.changes();
        let passed = self.shapes.latest().phase >= events.len();
        events.last().filter(|_| !passed).map(Change::time)
    }
}

/// The step's end of the hand-over. Fills in place: a screen that does not look costs the step a copy of its nodes, and
/// never a wait.
pub(crate) struct ShapeWriter(Writer<Shape>);

impl ShapeWriter {
    /// Both ends, with the bodies as they are.
    pub(crate) fn new(world: &World, state: &StepState) -> (Self, Reader<Shape>) {
        let rigid =
            placements(world, &state.rigid).map(|(position, orientation, ..)| (position, orientation)).collect();
        let positions = state.fem.q.clone();
        let (writer, reader) = latest(&Shape { steps: 0, time: 0.0, phase: state.phase(), positions, rigid });
        (Self(writer), reader)
    }

    /// Hands the bodies over as they are at `time` (s).
    pub(crate) fn send(&mut self, world: &World, state: &StepState, time: f64) {
        let shape = self.0.value_mut();
        (shape.steps, shape.time, shape.phase) = (state.step, time, state.phase());
        // Lengths are those of the set-up; what is more is left out.
        shape.positions.iter_mut().zip(&state.fem.q).for_each(|(to, q)| *to = *q);
        for (to, (position, orientation, ..)) in shape.rigid.iter_mut().zip(placements(world, &state.rigid)) {
            *to = (position, orientation);
        }
        self.0.publish();
    }
}
