//! The tissue around the tool, as the step hands it to the tick: skin, shape and compliance, in memory of fixed size.
//!
//! ```text
//! x = q_free + d + e + C f           m, position of the nodes under nodal contact forces f (N), a step h after the step
//! C = h² S A⁻¹ Sᵀ                    m/N, 3 × 3 blocks; S picks the patch's nodes; zero for nodes that are held fixed
//! ```
//! d + e is how far the tissue would go without the tool until the next step: a step ends in motion, and what moves
//! already needs no force to be moved on. The drift d goes evenly with time, as mass does; the flow e and C f come as
//! `viscosity` β lets them (s; D = βK), in a step of backward Euler as much as that has: the tick knows them at other
//! times too.
//!
//! `force` is f of the tool as the step found it. `q_free` is where that leaves the nodes: the step's end less C f, so
//! that the patch is tangent to the step's own answer, whatever method and however old a factor gave C.
//!
//! Beside the skin a patch has contacts of fixed and rigid bodies ([`BodyContact`](crate::body_contact::BodyContact)).
//! C is over their coordinates u, three each, and then over the nodes; f has their forces, in the same order.
//!
//! Other rows of the scene that do not touch the tool are no part of a patch: their forces are in `q_free`, and those
//! that are closed are condensed into C ([`palpate_constraints::condensed`]).

use nalgebra::Vector3;
use palpate_collision::SkinPatch;
use palpate_constraints::law::{Law, Signorini};
use palpate_solver::vectors::add_scaled;

use crate::body_contact::BodyContacts;

/// Skin and compliance around a tool.
#[derive(Clone, Debug, PartialEq)]
pub struct HapticPatch {
    /// Whether the tick is to work on it; otherwise it has the snapshot's frozen rows.
    pub valid: bool,
    /// The law of every contact.
    pub law: Law,
    /// Triangles near the tool that found no room.
    pub left_out: u32,
    /// Contacts of fixed and rigid bodies.
    pub bodies: BodyContacts,
    skin: SkinPatch,
    q_free: Vec<Vector3<f64>>,
    q_end: Vec<Vector3<f64>>,
    /// β \[s\], ≥ 0: the damping is β times the stiffness. 0 lets the tissue follow forces at once.
    pub viscosity: f64,
    /// d, e \[m\].
    drift: Vec<Vector3<f64>>,
    flow: Vec<Vector3<f64>>,
    force: Vec<Vector3<f64>>,
    compliance: Vec<f64>,
}

impl HapticPatch {
    /// An empty patch, not valid, with room for `max_nodes` nodes and no contacts of bodies.
    #[must_use]
    pub fn new(max_nodes: usize) -> Self {
        Self::with_bodies(max_nodes, 0)
    }

    /// The same with room for so many contacts of fixed and rigid bodies.
    #[must_use]
    pub fn with_bodies(max_nodes: usize, max_bodies: usize) -> Self {
        let size = 3 * (max_nodes + max_bodies);
        Self {
            valid: false,
            law: Signorini.into(),
            left_out: 0,
            skin: SkinPatch::new(max_nodes),
            q_free: vec![Vector3::zeros(); max_nodes],
            q_end: vec![Vector3::zeros(); max_nodes],
            viscosity: 0.0,
            drift: vec![Vector3::zeros(); max_nodes],
            flow: vec![Vector3::zeros(); max_nodes],
            force: vec![Vector3::zeros(); max_nodes],
            compliance: vec![0.0; size * size],
            bodies: BodyContacts::new(max_bodies),
        }
    }

    /// Nodes there is room for; 0 where snapshots carry frozen rows only.
    #[must_use]
    pub fn max_nodes(&self) -> usize {
        self.q_free.len()
    }

    /// Takes everything out and marks the patch as not valid. What is gathered next does not drift until it is said to.
    pub fn clear(&mut self) {
        self.skin.clear();
        self.bodies.clear();
        (self.valid, self.law, self.left_out) = (false, Signorini.into(), 0);
        self.viscosity = 0.0;
        self.drift.fill(Vector3::zeros());
        self.flow.fill(Vector3::zeros());
    }

    /// Its triangles and nodes.
    #[must_use]
    pub fn skin(&self) -> &SkinPatch {
        &self.skin
    }

    /// The same, to be gathered anew; shape, forces, drift and compliance then hold old numbers and must be filled.
    pub fn skin_mut(&mut self) -> &mut SkinPatch {
        &mut self.skin
    }

    /// Nodes.
    #[must_use]
    pub fn len(&self) -> usize {
        self.skin.nodes().len().min(self.q_free.len())
    }

    /// Whether the skin is out of the tool's reach.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Positions without contact \[m\], one a node.
    #[must_use]
    pub fn q_free(&self) -> &[Vector3<f64>] {
        &self.q_free[..self.len()]
    }

    /// The same, to be filled; [`HapticPatch::relieve`] begins with the step's end in it.
    pub fn q_free_mut(&mut self) -> &mut [Vector3<f64>] {
        let nodes = self.len();
        &mut self.q_free[..nodes]
    }

    /// Where the step left the nodes \[m\]: `q_free + C force`, one a node.
    #[must_use]
    pub fn q_end(&self) -> &[Vector3<f64>] {
        &self.q_end[..self.len()]
    }

    /// d: even part of the motion without contact from the end of the step to that of the next \[m\], one a node.
    #[must_use]
    pub fn drift(&self) -> &[Vector3<f64>] {
        &self.drift[..self.len()]
    }

    /// The same, to be filled; zero after [`Self::clear`].
    pub fn drift_mut(&mut self) -> &mut [Vector3<f64>] {
        let nodes = self.len();
        &mut self.drift[..nodes]
    }

    /// e: the rest of that motion, which is held back by viscosity \[m\], one a node.
    #[must_use]
    pub fn flow(&self) -> &[Vector3<f64>] {
        &self.flow[..self.len()]
    }

    /// The same, to be filled; zero after [`Self::clear`].
    pub fn flow_mut(&mut self) -> &mut [Vector3<f64>] {
        let nodes = self.len();
        &mut self.flow[..nodes]
    }

    /// Nodal contact forces of the step \[N\], one a node.
    #[must_use]
    pub fn force(&self) -> &[Vector3<f64>] {
        &self.force[..self.len()]
    }

    /// The same, to be filled.
    pub fn force_mut(&mut self) -> &mut [Vector3<f64>] {
        let nodes = self.len();
        &mut self.force[..nodes]
    }

    /// Coordinates of the contacts of bodies that yield, and of the nodes that can move: the size of C.
    #[must_use]
    pub fn degrees_of_freedom(&self) -> usize {
        3 * (self.bodies.yielding() + self.skin.movable().min(self.len()))
    }

    /// Contacts of bodies that yield, and nodes: the places that forces act at.
    #[must_use]
    pub fn places(&self) -> usize {
        self.bodies.yielding() + self.len()
    }

    /// C \[m/N\] over the contacts of bodies that yield and the nodes that can move, by columns, without padding; symmetric.
    #[must_use]
    pub fn compliance(&self) -> &[f64] {
        let n = self.degrees_of_freedom();
        &self.compliance[..n * n]
    }

    /// The same, to be filled.
    pub fn compliance_mut(&mut self) -> &mut [f64] {
        let n = self.degrees_of_freedom();
        &mut self.compliance[..n * n]
    }

    /// `moved = C f` \[m\] for forces at all places \[N\]; those without force cost nothing. `sum` is scratch of three
    /// numbers a place.
    pub fn yielding(&self, force: &[Vector3<f64>], sum: &mut [f64], moved: &mut [Vector3<f64>]) {
        moved.fill(Vector3::zeros());
        let n = self.degrees_of_freedom().min(sum.len());
        if n == 0 {
            return;
        }
        let sum = &mut sum[..n];
        sum.fill(0.0);
        for (columns, f) in self.compliance().chunks_exact(3 * self.degrees_of_freedom()).zip(force) {
            if *f == Vector3::zeros() {
                continue;
            }
            let (x, rest) = columns.split_at(columns.len() / 3);
            let (y, z) = rest.split_at(rest.len() / 2);
            add_scaled(sum, [x, y, z], [f.x, f.y, f.z]);
        }
        for (to, sum) in moved.iter_mut().zip(sum.as_chunks::<3>().0) {
            *to = (*sum).into();
        }
    }

    /// `q_free -= C f`: from the step's end, the shape under the patch's own forces, to that without.
    pub fn relieve(&mut self) {
        let (n, nodes) = (self.degrees_of_freedom(), self.len());
        self.q_end[..nodes].copy_from_slice(&self.q_free[..nodes]);
        let yielding = self.bodies.yielding();
        for k in 0..n / 3 {
            let f = match self.bodies.all().get(k).filter(|_| k < yielding) {
                Some(body) => body.force,
                None => self.force[k - yielding],
            };
            if f == Vector3::zeros() {
                continue;
            }
            for (c, f) in f.iter().enumerate() {
                let column = &self.compliance[(3 * k + c) * n..(3 * k + c + 1) * n];
                let (of_bodies, of_nodes) = column.split_at(3 * yielding);
                for (q, w) in self.q_free.iter_mut().zip(of_nodes.chunks_exact(3)) {
                    *q -= Vector3::new(w[0], w[1], w[2]) * *f;
                }
                for (body, w) in self.bodies.all_mut().iter_mut().zip(of_bodies.chunks_exact(3)) {
                    body.free -= Vector3::new(w[0], w[1], w[2]) * *f;
                }
            }
        }
    }

    /// Makes this a copy of `other` without allocating. Returns false, and is left cleared, if `other` does not fit.
    pub fn copy_from(&mut self, other: &Self) -> bool {
        self.clear();
        if other.len() > self.max_nodes() || !self.skin.copy_from(&other.skin) || !self.bodies.copy_from(&other.bodies)
        {
            self.clear();
            return false;
        }
        (self.valid, self.law, self.left_out) = (other.valid, other.law, other.left_out);
        self.q_free_mut().copy_from_slice(other.q_free());
        self.viscosity = other.viscosity;
        self.drift_mut().copy_from_slice(other.drift());
        self.flow_mut().copy_from_slice(other.flow());
        self.force_mut().copy_from_slice(other.force());
        let nodes = self.len();
        self.q_end[..nodes].copy_from_slice(other.q_end());
        self.compliance_mut().copy_from_slice(other.compliance());
        true
    }
}
