//! A stated number of the contacts under the ball, as the stages of the step and the tick take them.

use nalgebra::DMatrix;
use palpate::fem::nodal_rows::NodalRows;
use palpate::haptics::snapshot::{HapticSnapshot, SnapshotContact};
use palpate::simulation::Simulation;
use palpate::solver::problem::ConstraintProblem;

/// Some contacts of a simulation's last step: those with the most force, then those nearest to touching.
pub(crate) struct Patch {
    /// Their rows of the tissue.
    pub(crate) rows: NodalRows,
    /// Their part of the contact problem.
    pub(crate) problem: ConstraintProblem,
    /// The same for the tick.
    pub(crate) snapshot: HapticSnapshot,
    /// How many of them carry force in the whole problem's solution.
    pub(crate) active: usize,
}

impl Patch {
    /// `contacts` of the contacts, or all where there are fewer.
    pub(crate) fn of(simulation: &Simulation<'_>, contacts: usize) -> Self {
        let (all, forces) = (simulation.snapshot(), simulation.forces());
        let tissue = &simulation.workspace().rows().tissue;
        let normal = |k: usize| (forces[all.blocks()[k].start], all.delta_free()[all.blocks()[k].start]);
        let mut chosen: Vec<usize> = (0..all.contacts()).collect();
        chosen.sort_by(|&a, &b| normal(b).0.total_cmp(&normal(a).0).then(normal(a).1.total_cmp(&normal(b).1)));
        chosen.truncate(contacts);
        let active = chosen.iter().filter(|&&k| normal(k).0 > 0.0).count();
        chosen.sort_unstable();

        let lines: Vec<usize> = chosen
            .iter()
            .flat_map(|&k| (0..all.blocks()[k].law.rows()).map(move |c| all.blocks()[k].start + c))
            .collect();
        let m = lines.len();
        let w = DMatrix::from_fn(m, m, |i, j| all.compliance()[lines[i] + all.rows() * lines[j]]);

        let mut rows = NodalRows::with_capacity(m, 3);
        let mut problem = ConstraintProblem::with_capacity(m);
        let mut snapshot = HapticSnapshot::new(chosen.len());
        problem.reset(m).expect("it was made for as many rows");
        for (to, &from) in lines.iter().enumerate() {
            rows.push_row(tissue.row(from));
            problem.delta_free_mut()[to] = all.delta_free()[from];
        }
        problem.compliance_mut().copy_from(&w);
        for &k in &chosen {
            let block = all.blocks()[k];
            problem.push_block(block.law);
            let range = block.start..block.start + block.law.rows();
            snapshot.push(&SnapshotContact {
                law: block.law,
                feature: all.features()[k],
                tool_rows: &all.tool_rows()[range.clone()],
                delta_free: &all.delta_free()[range.clone()],
                lambda: &all.lambda()[range],
            });
        }
        snapshot.compliance_mut().copy_from_slice(w.as_slice());
        (snapshot.step, snapshot.time, snapshot.dt) = (all.step, all.time, all.dt);
        (snapshot.valid, snapshot.tool_pose) = (all.valid, all.tool_pose);
        Self { rows, problem, snapshot, active }
    }

    /// Number of contacts.
    pub(crate) fn contacts(&self) -> usize {
        self.snapshot.contacts()
    }
}
