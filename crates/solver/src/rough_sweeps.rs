//! Sweeps of block Gauss-Seidel in single precision, over the frictional contacts that carry force or need one.
//!
//! They find which contacts carry force and which of them slide, to two or three digits, where a sweep costs a
//! fraction of a Newton step and halves the residual, as a step far from the solution does. Contacts that the sweeps
//! would bring to touch are not among them; the steps behind find these. The local solve is that of `rough_contact`.
//!
//! What the sweeps leave is judged by the gap in double precision, which the caller forms anew, so that
//! their rounding harms nobody.

use crate::problem::{Block, ProblemView, gather, scatter};
use crate::rough_contact::RoughContact;
use crate::single::SingleCompliance;
use nalgebra::Vector3;
use palpate_constraints::law::{Law, LocalCompliance};
use pulp::{Arch, Simd, WithSimd};
use std::time::Instant;

/// Sweeps after which contacts that carry no force are left out, and part of the contacts that must be left for it to pay.
const SETTLING: u32 = 8;
const WORTHWHILE: f64 = 0.75;

/// Part of the square of the change before from which on a sweep gains nothing, and number of such sweeps in a row that
/// ends them: the forces creep along what the compliance hardly resists, by the same in every sweep, which a step ends
/// at once. With two, a flat tool on sixty faces takes 1.3 times as long: its changes are level for as long while it
/// finds its contacts.
const LEVEL: f64 = 0.98;
const LEVEL_SWEEPS: u32 = 3;

/// When to stop.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limits {
    /// Number of sweeps, one at least.
    pub(crate) sweeps: u32,
    /// Change of the forces in a sweep below which the next gains nothing: as the gap (m) that their own stiffness makes of
    /// it.
    pub(crate) change: f64,
    pub(crate) deadline: Option<Instant>,
}

/// Why the sweeps ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum End {
    /// The next gains nothing.
    Settled,
    /// There was no time for more, their number was reached, or the changes have ceased to fall: the compliance may be
    /// nearly singular.
    Limit,
    /// The changes have not fallen from the first sweep to the last: forces were left as they were.
    Refused,
}

/// Memory of the sweeps.
#[derive(Clone, Debug)]
pub(crate) struct RoughSweeps {
    contacts: Vec<RoughContact>,
    /// Gaps in the order of [`SingleCompliance`], m.
    gap: Vec<f32>,
    spare: Vec<f32>,
}

impl RoughSweeps {
    pub(crate) fn with_capacity(rows: usize) -> Self {
        let gap = || Vec::with_capacity(SingleCompliance::longest(rows));
        Self { contacts: Vec::with_capacity(rows), gap: gap(), spare: gap() }
    }

    /// Whether the sweeps can do for all blocks: whether all are frictional contacts.
    pub(crate) fn applies(view: &ProblemView<'_>) -> bool {
        view.blocks.iter().all(|block| matches!(block.law, Law::Coulomb(_)))
    }

    /// Sweeps from forces `lambda` (N) with the gap `delta` (m), and admits the contacts to `single`; returns how many
    /// sweeps were done, and why not more.
    pub(crate) fn run(
        &mut self,
        view: &ProblemView<'_>,
        local: &[LocalCompliance],
        delta: &[f64],
        single: &mut SingleCompliance,
        lambda: &mut [f64],
        limits: Limits,
    ) -> (u32, End) {
        let needs_force = |block: &&Block| {
            gather(lambda, block) != Vector3::zeros()
                || !block.law.needs_no_force(&gather(delta, block))
                || !block.law.needs_no_force(&gather(view.delta_free, block))
        };
        single.admit(view, view.blocks.iter().filter(needs_force));
        self.gap.clear();
        self.gap.resize(single.length(), 0.0);
        self.contacts.clear();
        for (number, (block, local)) in view.blocks.iter().zip(local).enumerate() {
            let (Law::Coulomb(law), Some(place), false) = (block.law, single.place(block), local.is_rigid()) else {
                continue;
            };
            let (gap, force) = (gather(delta, block), gather(lambda, block));
            for (to, from) in self.gap[place..].iter_mut().zip(gap.iter()) {
                *to = *from as f32;
            }
            let force = [force.x as f32, force.y as f32, force.z as f32, 0.0];
            self.contacts.push(RoughContact::new(
                place,
                &single.diagonal_block(place, 3),
                law.friction as f32,
                force,
                number,
            ));
        }
        let (mut done, mut first, mut last, mut level) = (0, 0.0, 0.0, 0);
        while done < limits.sweeps {
            done += 1;
            let before = last;
            last = f64::from(Arch::new().dispatch(Sweep { single, contacts: &mut self.contacts, gap: &mut self.gap }));
            if done == 1 {
                first = last;
            }
            let out_of_time = || limits.deadline.is_some_and(|deadline| Instant::now() >= deadline);
            // Also ends for numbers that are not finite.
            let goes_on = last > limits.change * limits.change && last < f64::INFINITY;
            level = if last > LEVEL * before { level + 1 } else { 0 };
            if !goes_on || level == LEVEL_SWEEPS || out_of_time() {
                break;
            }
            if done == SETTLING {
                self.leave_out(view, single);
            }
        }
        if last > first || !last.is_finite() {
            return (done, End::Refused);
        }
        lambda.fill(0.0);
        for contact in &self.contacts {
            let Some(block) = view.blocks.get(contact.number) else { continue };
            let force = Vector3::new(contact.force[0], contact.force[1], contact.force[2]).map(f64::from);
            scatter(&block.law.project(&force), block, lambda);
        }
        (done, if last > limits.change * limits.change { End::Limit } else { End::Settled })
    }

    /// The gaps (m) of all rows as the sweeps left them, of single precision; `false` where they do not know all.
    pub(crate) fn gap_into(&self, view: &ProblemView<'_>, single: &SingleCompliance, delta: &mut [f64]) -> bool {
        if 3 * self.contacts.len() != view.rows() {
            return false;
        }
        for block in view.blocks {
            let Some(gap) = single.place(block).and_then(|place| self.gap.get(place..)) else { return false };
            for (to, from) in delta.iter_mut().skip(block.start).zip(gap).take(3) {
                *to = f64::from(*from);
            }
        }
        true
    }

    /// Leaves out the contacts that are open without force, if they are many: columns that end sooner are summed sooner,
    /// here and in the steps behind.
    fn leave_out(&mut self, view: &ProblemView<'_>, single: &mut SingleCompliance) {
        let Self { contacts, gap, spare } = self;
        let carries = |contact: &RoughContact, gap: &[f32]| {
            contact.force[0] > 0.0 || gap.get(contact.place).is_some_and(|normal| *normal < 0.0)
        };
        let left = contacts.iter().filter(|contact| carries(contact, gap)).count();
        if left as f64 > WORTHWHILE * contacts.len() as f64 {
            return;
        }
        contacts.retain(|contact| carries(contact, gap));
        single.begin(view.rows());
        single.admit(view, contacts.iter().filter_map(|contact| view.blocks.get(contact.number)));
        spare.clear();
        spare.resize(single.length(), 0.0);
        for contact in contacts {
            let Some(place) = view.blocks.get(contact.number).and_then(|block| single.place(block)) else { continue };
            for (to, from) in spare[place..].iter_mut().zip(gap[contact.place..].iter()).take(3) {
                *to = *from;
            }
            contact.place = place;
        }
        std::mem::swap(gap, spare);
    }
}

/// One sweep; the sum of the squares of the changes over their stiffness, m².
struct Sweep<'a> {
    single: &'a SingleCompliance,
    contacts: &'a mut [RoughContact],
    gap: &'a mut [f32],
}

impl WithSimd for Sweep<'_> {
    type Output = f32;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f32 {
        let Self { single, contacts, gap } = self;
        let mut squared = 0.0;
        for contact in contacts {
            let [x, y, z, ..] = gap.get(contact.place..).unwrap_or(&[]) else { continue };
            let force = contact.resolve(&[*x, *y, *z, 0.0]);
            let mut change = [0.0; 4];
            for i in 0..4 {
                change[i] = force[i] - contact.force[i];
            }
            contact.force = force;
            let size = change[0] * change[0] + change[1] * change[1] + change[2] * change[2];
            if size != 0.0 {
                squared += size * contact.normal[0] * contact.normal[0];
                single.add(simd, contact.place, 3, &change, gap);
            }
        }
        squared
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gauss_seidel::{GaussSeidelConfig, GaussSeidelWorkspace, prepare, solve};
    use crate::problem::ConstraintProblem;
    use nalgebra::{DMatrix, DVector};
    use palpate_constraints::law::Coulomb;

    /// Contacts side by side whose coupling falls off with their distance. One in three is pressed deep, which opens
    /// those beside it again.
    fn problem(compliance: f64) -> ConstraintProblem {
        const CONTACTS: usize = 12;
        let matrix = DMatrix::from_fn(3 * CONTACTS, 3 * CONTACTS, |i, j| {
            let (distance, row, column) = ((i / 3).abs_diff(j / 3) as f64, i % 3, j % 3);
            let within = if row == column { 1.0 } else { 0.1 * (distance + 1.0) };
            compliance * within / (1.0 + 2.0 * distance * distance)
        });
        let gap = |i: usize| match (i % 3, i / 3 % 3) {
            (0, 0) => -1.0 + 0.3 * (i as f64).cos(),
            (0, _) => -0.02,
            _ => 0.2 * (i as f64).sin(),
        };
        let delta_free = DVector::from_fn(3 * CONTACTS, |i, _| 1e-3 * gap(i));
        ConstraintProblem::new(matrix, delta_free, [Law::Coulomb(Coulomb { friction: 0.2 }); CONTACTS])
            .expect("the sizes agree")
    }

    fn sweep(problem: &ConstraintProblem, lambda: &mut [f64], limits: Limits) -> (u32, End) {
        let view = problem.view();
        let mut ws = GaussSeidelWorkspace::with_capacity(view.rows());
        prepare(&view, lambda, &mut ws).expect("the sizes agree");
        let mut single = SingleCompliance::with_capacity(view.rows());
        single.begin(view.rows());
        RoughSweeps::with_capacity(view.rows()).run(&view, &ws.local, &ws.delta, &mut single, lambda, limits)
    }

    const MANY: Limits = Limits { sweeps: 60, change: 0.0, deadline: None };

    #[test]
    fn sweeps_go_to_the_solution_of_exact_ones() {
        let problem = problem(1e-4);
        let rows = problem.rows();
        let (mut rough, mut exact) = (vec![0.0; rows], vec![0.0; rows]);
        assert_ne!(sweep(&problem, &mut rough, MANY).1, End::Refused);
        let config = GaussSeidelConfig { tolerance: 1e-12, ..GaussSeidelConfig::default() };
        solve(&problem.view(), &mut exact, &config, &mut GaussSeidelWorkspace::with_capacity(rows));
        let slides = |a: usize| {
            exact[3 * a] > 0.0 && exact[3 * a + 1].hypot(exact[3 * a + 2]) > 0.2 * exact[3 * a] * (1.0 - 1e-9)
        };
        let sliding = (0..rows / 3).filter(|a| slides(*a)).count();
        let carrying = (0..rows / 3).filter(|a| exact[3 * a] > 0.0).count();
        assert!((carrying as f64) < WORTHWHILE * (rows / 3) as f64, "{carrying} carry force: some are to be left out");
        assert!(0 < sliding && sliding < carrying, "{sliding} of {carrying} slide: the others are to stick");
        // Single precision, times the condition of the matrix.
        let largest = exact.iter().fold(0.0_f64, |largest, force| largest.max(force.abs()));
        for (rough, exact) in rough.iter().zip(&exact) {
            assert!((rough - exact).abs() < 1e-5 * largest, "{rough} N for {exact} N");
        }
    }

    #[test]
    fn forces_stay_where_single_precision_has_no_number_for_the_compliance() {
        let problem = problem(1e-60);
        let mut lambda = vec![0.0; problem.rows()];
        assert_eq!(sweep(&problem, &mut lambda, MANY).1, End::Refused);
        assert!(lambda.iter().all(|force| *force == 0.0));
    }

    #[test]
    fn sweeps_tell_whether_they_have_settled() {
        let problem = problem(1e-4);
        let end =
            |sweeps| sweep(&problem, &mut vec![0.0; problem.rows()], Limits { sweeps, change: 1e-6, deadline: None });
        let (done, settled) = end(60);
        assert!(settled == End::Settled && done < 60, "{done} sweeps");
        assert_eq!(end(done - 1), (done - 1, End::Limit));
    }

    /// Two contacts on one point whose gaps do not agree: what one gives up the other takes, sweep by sweep.
    #[test]
    fn sweeps_end_where_forces_creep() {
        let matrix = DMatrix::from_fn(6, 6, |i, j| match (i % 3 == j % 3, i == j) {
            (true, true) => 1e-4,
            (true, false) => (1.0 - 1e-7) * 1e-4,
            _ => 0.0,
        });
        let delta_free = DVector::from_row_slice(&[-1e-3, 0.0, 0.0, -1.01e-3, 0.0, 0.0]);
        let problem = ConstraintProblem::new(matrix, delta_free, [Law::Coulomb(Coulomb { friction: 0.2 }); 2])
            .expect("the sizes agree");
        let mut lambda = [0.0; 6];
        // The first contact carries its own 10 N; of those the second takes 0.1 N in each sweep after it.
        let (done, end) = sweep(&problem, &mut lambda, Limits { sweeps: 60, change: 1e-9, deadline: None });
        assert_eq!((done, end), (2 + LEVEL_SWEEPS, End::Limit), "{lambda:?}");
    }
}
