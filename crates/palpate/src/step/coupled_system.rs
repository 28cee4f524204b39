//! Tissue and rigid bodies as one system, for the direct approaches of contact: every rigid body is two block rows behind those
//! of the tissue, its velocity and its angular velocity.
//!
//! ```text
//! A = [ A_tissue        ]     H = [ H_tissue  H_rigid ] ,    M = diag(m I, J) of each rigid body, in the world frame
//!     [            M    ]
//! ```
//!
//! A contact of a rigid body with another is a row like any other then, and a method that knows one body knows all of them.

use std::sync::Arc;

use nalgebra::Matrix3;
use palpate_constraints::body::RigidInverse;
use palpate_constraints::rows::ContactRows;
use palpate_fem::factor::SolveStatus;
use palpate_fem::nodal_rows::NodalRows;
use palpate_fem::pcg::PcgWorkspace;
use palpate_fem::preconditioner::Preconditioner;
use palpate_fem::sparse::{BlockPattern, SystemMatrix};

use super::preconditioner::StepPreconditioner;

/// Block rows of a rigid body.
const BLOCKS: usize = 2;

/// Numbers of a rigid body's motion.
const FREEDOMS: usize = 3 * BLOCKS;

/// The matrix and the rows of all bodies, refilled at every step.
pub(super) struct CoupledSystem {
    pub(super) matrix: SystemMatrix,
    pub(super) rows: NodalRows,
    /// Memory of linear solves with the matrix.
    pub(super) pcg: PcgWorkspace,
    /// Where each block of the tissue's matrix lies in that of all bodies.
    places: Vec<usize>,
    /// Free nodes of the tissue.
    tissue: usize,
}

impl CoupledSystem {
    /// Memory for the tissue of `system`, so many rigid bodies and so many rows. `joined` has room for blocks between rigid
    /// bodies and everything else, as a stiffness of contacts makes them.
    pub(super) fn new(system: &SystemMatrix, bodies: usize, rows: usize, joined: bool) -> Self {
        let (pattern, tissue) = (&system.pattern, system.pattern.rows());
        let all = tissue + BLOCKS * bodies;
        let of_tissue = (0..tissue)
            .flat_map(|i| pattern.row(i).map(move |p| (i as u32, p)))
            .map(|(i, p)| [i, pattern.columns()[p]]);
        let of_bodies = (tissue..all).flat_map(|i| {
            let from = if joined { 0 } else { i };
            (from..=i).map(move |j| [i as u32, j as u32])
        });
        let pairs: Vec<[u32; 2]> = of_tissue.chain(of_bodies).collect();
        let coupled = BlockPattern::from_cliques(all, pairs.iter().map(<[u32; 2]>::as_slice));
        let places = (0..tissue).flat_map(|i| coupled.row(i).take(pattern.row(i).len())).collect();
        Self {
            matrix: SystemMatrix::zeros(Arc::new(coupled)),
            // A face and two rigid bodies.
            rows: NodalRows::with_capacity(rows, 7),
            pcg: PcgWorkspace::new(all),
            places,
            tissue,
        }
    }

    /// Takes the matrix of the tissue, the masses of the rigid bodies and the contacts of this step.
    pub(super) fn fill(&mut self, system: &SystemMatrix, rigid: &[RigidInverse], rows: &ContactRows) {
        self.matrix.blocks.fill(Matrix3::zeros());
        for (&place, block) in self.places.iter().zip(&system.blocks) {
            self.matrix.blocks[place] = *block;
        }
        for (k, body) in rigid.iter().enumerate() {
            // Moments of inertia are positive, or the scene is refused.
            let inertia = body.inertia.try_inverse().unwrap_or_else(Matrix3::identity);
            for (c, block) in [Matrix3::identity() / body.mass, inertia].into_iter().enumerate() {
                let i = (self.tissue + BLOCKS * k + c) as u32;
                if let Some(place) = self.matrix.pattern.find(i, i) {
                    self.matrix.blocks[place] = block;
                }
            }
        }
        self.rows.clear();
        for r in 0..rows.len() {
            let of_bodies = rows.rigid.row(r).iter().flat_map(|(body, row)| {
                let i = (self.tissue + BLOCKS * *body as usize) as u32;
                [(i, row.force), (i + 1, row.torque)]
            });
            self.rows.push_row(rows.tissue.row(r).chain(of_bodies));
        }
    }

    /// Length of a motion of `tissue` free nodes and so many rigid bodies.
    pub(super) fn freedoms(tissue: usize, bodies: usize) -> usize {
        3 * tissue + FREEDOMS * bodies
    }
}

/// The step's preconditioner on the tissue, and the masses themselves on rigid bodies.
pub(super) struct CoupledPreconditioner<'a> {
    pub(super) tissue: StepPreconditioner<'a>,
    pub(super) rigid: &'a [RigidInverse],
}

impl Preconditioner for CoupledPreconditioner<'_> {
    fn apply(&mut self, r: &[f64], z: &mut [f64]) -> SolveStatus {
        let tissue = r.len().min(z.len()).saturating_sub(FREEDOMS * self.rigid.len());
        let ((r, loads), (z, motions)) = (r.split_at(tissue), z.split_at_mut(tissue));
        let bodies = loads.as_chunks::<FREEDOMS>().0.iter().zip(motions.as_chunks_mut::<FREEDOMS>().0);
        for ((load, motion), body) in bodies.zip(self.rigid) {
            let [x, y, z, torque @ ..] = *load;
            let turn = body.inertia * nalgebra::Vector3::from(torque);
            *motion = [body.mass * x, body.mass * y, body.mass * z, turn.x, turn.y, turn.z];
        }
        self.tissue.apply(r, z)
    }
}
