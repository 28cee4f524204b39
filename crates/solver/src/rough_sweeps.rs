//! Sweeps of block Gauss-Seidel in single precision, over the frictional contacts that carry force or need one.
//!
//! They find which contacts carry force and which of them slide, to two or three digits, where a sweep costs a
//! fraction of a Newton step and halves the residual, as a step far from the solution does. Contacts that the sweeps
//! would bring to touch are not among them; the steps behind find these.
//!
//! The local solve is one step to the exact one. With `f = lambda - W_aa^-1 delta_a` the force of a contact that
//! sticks, `b` the gap without the block's own part and `S` the tangential block with the normal row eliminated,
//!
//! ```text
//! b_n >= 0                      lambda' = 0
//! f inside the cone             lambda' = f
//! else                          u = y / |y| ,   y = lambda_t - 2 / tr S (delta_t - w delta_n / W_nn)
//!                               lambda_n' = -b_n / (W_nn + mu w . u) ,   lambda_t' = mu lambda_n' u
//! ```
//!
//! of which exact local solutions are the fixed points: one root and two quotients instead of Newton's for the slip.
//! What the sweeps leave is judged by the gap in double precision, which the caller forms anew, so that
//! their rounding harms nobody.

use crate::coupled_block::{Columns, Quad, inverse, times};
use crate::problem::{Block, ProblemView, gather, scatter};
use crate::single::SingleCompliance;
use nalgebra::Vector3;
use palpate_constraints::law::{Law, LocalCompliance};
use pulp::{Arch, Simd, WithSimd};
use std::time::Instant;

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

/// A contact that takes part.
#[derive(Clone, Copy, Debug)]
struct Contact {
    /// First row in [`SingleCompliance`].
    place: usize,
    /// `W_aa^-1`, N/m.
    inverse: Columns,
    /// Its normal row, m/N.
    normal: Quad,
    /// `w / W_nn`, dimensionless.
    coupling: [f32; 2],
    /// `2 / tr S`, N/m.
    stiffness: f32,
    /// Friction coefficient.
    friction: f32,
    /// N.
    force: Quad,
    /// The block's number.
    number: usize,
}

/// Memory of the sweeps.
#[derive(Clone, Debug)]
pub(crate) struct RoughSweeps {
    contacts: Vec<Contact>,
    /// Gaps in the order of [`SingleCompliance`], m.
    gap: Vec<f32>,
}

impl RoughSweeps {
    pub(crate) fn with_capacity(rows: usize) -> Self {
        Self { contacts: Vec::with_capacity(rows), gap: Vec::with_capacity(SingleCompliance::longest(rows)) }
    }

    /// Whether the sweeps can do for all blocks: whether all are frictional contacts.
    pub(crate) fn applies(view: &ProblemView<'_>) -> bool {
        view.blocks.iter().all(|block| matches!(block.law, Law::Coulomb(_)))
    }

    /// Sweeps from forces `lambda` (N) with the gap `delta` (m), and admits the contacts to `single`; returns how many
    /// sweeps were done. Forces whose changes have not fallen from the first sweep to the last are left as they were.
    pub(crate) fn run(
        &mut self,
        view: &ProblemView<'_>,
        local: &[LocalCompliance],
        delta: &[f64],
        single: &mut SingleCompliance,
        lambda: &mut [f64],
        limits: Limits,
    ) -> u32 {
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
            self.contacts.push(Contact::new(
                place,
                &single.diagonal_block(place, 3),
                law.friction as f32,
                force,
                number,
            ));
        }
        let Self { contacts, gap } = self;
        let (mut done, mut first, mut last) = (0, 0.0, 0.0);
        while done < limits.sweeps {
            done += 1;
            last = f64::from(Arch::new().dispatch(Sweep { single, contacts, gap }));
            if done == 1 {
                first = last;
            }
            let out_of_time = || limits.deadline.is_some_and(|deadline| Instant::now() >= deadline);
            // Also ends for numbers that are not finite.
            let goes_on = last > limits.change * limits.change && last < f64::INFINITY;
            if !goes_on || out_of_time() {
                break;
            }
        }
        if last > first || !last.is_finite() {
            return done;
        }
        for contact in contacts.iter() {
            let Some(block) = view.blocks.get(contact.number) else { continue };
            let force = Vector3::new(contact.force[0], contact.force[1], contact.force[2]).map(f64::from);
            scatter(&block.law.project(&force), block, lambda);
        }
        done
    }
}

impl Contact {
    #[allow(non_snake_case)]
    fn new(place: usize, W: &Columns, friction: f32, force: Quad, number: usize) -> Self {
        let normal = [W[0][0], W[1][0], W[2][0], 0.0];
        let coupling = [normal[1] / normal[0], normal[2] / normal[0]];
        let trace = W[1][1] + W[2][2] - coupling[0] * normal[1] - coupling[1] * normal[2];
        Self { place, inverse: inverse(W), normal, coupling, stiffness: 2.0 / trace, friction, force, number }
    }

    /// The force for the gap that there is.
    #[inline(always)]
    fn resolve(&self, gap: &Quad) -> Quad {
        let (old, mu, n) = (&self.force, self.friction, &self.normal);
        let open = gap[0] - (n[0] * old[0] + n[1] * old[1] + n[2] * old[2]);
        if open >= 0.0 {
            return [0.0; 4];
        }
        let change = times(&self.inverse, gap);
        let stick = [old[0] - change[0], old[1] - change[1], old[2] - change[2], 0.0];
        if stick[0] > 0.0 && stick[1] * stick[1] + stick[2] * stick[2] <= mu * mu * stick[0] * stick[0] {
            return stick;
        }
        let y = old[1] - self.stiffness * (gap[1] - self.coupling[0] * gap[0]);
        let z = old[2] - self.stiffness * (gap[2] - self.coupling[1] * gap[0]);
        let shrink = mu / (y * y + z * z).sqrt();
        let (y, z) = (shrink * y, shrink * z);
        let normal = -open / (n[0] + n[1] * y + n[2] * z);
        // A coupling that separates what it presses: without friction then. False for NaN.
        if normal > 0.0 { [normal, normal * y, normal * z, 0.0] } else { [-open / n[0], 0.0, 0.0, 0.0] }
    }
}

/// One sweep; the sum of the squares of the changes over their stiffness, m².
struct Sweep<'a> {
    single: &'a SingleCompliance,
    contacts: &'a mut [Contact],
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

    /// Contacts side by side whose coupling falls off with their distance, pressed by as much as they are dragged.
    fn problem(compliance: f64) -> ConstraintProblem {
        const CONTACTS: usize = 6;
        let matrix = DMatrix::from_fn(3 * CONTACTS, 3 * CONTACTS, |i, j| {
            let (distance, row, column) = ((i / 3).abs_diff(j / 3) as f64, i % 3, j % 3);
            let within = if row == column { 1.0 } else { 0.1 * (distance + 1.0) };
            compliance * within / (1.0 + 2.0 * distance * distance)
        });
        let gap = |i: usize| if i.is_multiple_of(3) { -1.0 + 0.3 * (i as f64).cos() } else { 0.2 * (i as f64).sin() };
        let delta_free = DVector::from_fn(3 * CONTACTS, |i, _| 1e-3 * gap(i));
        ConstraintProblem::new(matrix, delta_free, [Law::Coulomb(Coulomb { friction: 0.2 }); CONTACTS])
            .expect("the sizes agree")
    }

    fn sweep(problem: &ConstraintProblem, lambda: &mut [f64]) -> u32 {
        let view = problem.view();
        let mut ws = GaussSeidelWorkspace::with_capacity(view.rows());
        prepare(&view, lambda, &mut ws).expect("the sizes agree");
        let mut single = SingleCompliance::with_capacity(view.rows());
        single.begin(view.rows());
        let limits = Limits { sweeps: 60, change: 0.0, deadline: None };
        RoughSweeps::with_capacity(view.rows()).run(&view, &ws.local, &ws.delta, &mut single, lambda, limits)
    }

    #[test]
    fn sweeps_go_to_the_solution_of_exact_ones() {
        let problem = problem(1e-4);
        let rows = problem.rows();
        let (mut rough, mut exact) = (vec![0.0; rows], vec![0.0; rows]);
        sweep(&problem, &mut rough);
        let config = GaussSeidelConfig { tolerance: 1e-12, ..GaussSeidelConfig::default() };
        solve(&problem.view(), &mut exact, &config, &mut GaussSeidelWorkspace::with_capacity(rows));
        let slides = |a: usize| exact[3 * a + 1].hypot(exact[3 * a + 2]) > 0.2 * exact[3 * a] * (1.0 - 1e-9);
        let sliding = (0..rows / 3).filter(|a| slides(*a)).count();
        assert!(0 < sliding && sliding < rows / 3, "{sliding} slide: the others are to stick");
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
        sweep(&problem, &mut lambda);
        assert!(lambda.iter().all(|force| *force == 0.0));
    }
}
