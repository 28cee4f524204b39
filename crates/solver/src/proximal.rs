//! Proximal points [Rockafellar 1976]: a chain of regularised problems, each around the answer of the one before.
//!
//! ```text
//! lambda_(k+1):  the law between  lambda  and  delta + (shift / rho_a) (lambda - lambda_k)_a
//! ```
//!
//! A regularised problem is well conditioned whatever `W` is, and every one of its solutions that is its own centre solves the
//! problem itself. Newton reduces the *regularised* residual: that of the problem may have to rise on the way along
//! directions that `W` hardly resists, where a search that asks for its fall takes no step. Even the regularised one may rise for
//! some steps while the active contacts are sought: giving up at once where it exceeds ten times its start takes more
//! steps than it saves. Where it is still a hundred times its start after [`LOST_STEPS`], the steps go to and fro between
//! wrong sets of contacts, and a larger shift finds the right one sooner. The centre moves when the
//! regularised problem is solved to [`CENTRED`] of what it began with; where that is easy the shift follows the residual down, so
//! that the end is as fast as Newton's; where it is hard the shift is raised.

use crate::problem::ProblemView;
use crate::residual::natural_map_scaled;
use palpate_constraints::law::LocalCompliance;

/// Shift relative to the residual at the centre, at first and at least. With a tenth the systems of nearly singular problems are
/// hard from the start, with ten times as much the last steps on well-conditioned ones are not quadratic.
const DAMPING: f64 = 0.3;

/// The same at first where sweeps have told of a nearly singular problem: they bring the residual down and leave what `W`
/// hardly resists, so that with less the steps of the first problem come to nothing.
const SINGULAR: f64 = 3.0;

/// Bounds of the shift, relative to the mean diagonal of `W_aa`. Rounding of a factorisation is 1e-16 times the growth of a
/// pivot or so: with the least shift a singular system is solved to about eight digits.
const LEAST_SHIFT: f64 = 1e-9;
const MOST_SHIFT: f64 = 0.3;

/// Part of the residual at the centre to which a regularised problem is solved.
const CENTRED: f64 = 0.1;

/// Fall of the problem's own residual with which the centre moves before that.
const ADVANCED: f64 = 0.3;

/// Newton steps for a centre up to which it was easy (the shift falls), and beyond which it was hard (it rises).
const EASY: u32 = 5;
const HARD: u32 = 9;

/// Part of the residual before from which on the chain is slow.
const SLOW: f64 = 0.5;

/// Newton steps after which a regularised problem is given up: most of those that are solved are so in ten, and with 20 a
/// settled skin of 150 contacts takes half as many steps again in the mean of several tolerances.
const MOST_STEPS: u32 = 14;

/// Newton steps after which a regularised problem is given up sooner, where its residual is more than so many times what
/// it began with: steps that find their contacts are back below that in five. With 2 steps, nearly singular problems take
/// more of them in all, with [`MOST_STEPS`] those of faces that lie closer together than the nodes.
const LOST_STEPS: u32 = 6;
const LOST: f64 = 100.0;

/// Factors of the damping after easy, hard and hopeless problems.
const EASED: f64 = 0.3;
const HARDENED: f64 = 3.0;
const REPEATED: f64 = 10.0;

/// Regularised problems without a fall of the residual, given up, after which the chain ends.
const PATIENCE: u32 = 3;

/// A regularised problem is not solved to less than this part of the tolerance.
const FINE: f64 = 0.3;

/// Fall of the residual that counts as progress of the chain.
const NOTABLE: f64 = 0.999;

/// What is to be done at the present forces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Course {
    /// A Newton step.
    Step,
    /// A Newton step from the centre, to which the forces are to go back.
    Repeat,
    /// The chain has come to nothing.
    End,
}

/// A centre and the state of the chain.
#[derive(Clone, Debug, Default)]
pub(crate) struct ProximalPoint {
    /// `lambda_k`, N.
    pub(crate) centre: Vec<f64>,
    /// Gap with the regularisation, m.
    pub(crate) gap: Vec<f64>,
    /// Relative to the mean diagonal of `W_aa`.
    pub(crate) shift: f64,
    /// Regularised residual at the present forces.
    pub(crate) residual: f64,
    /// Residual at the centre; none before the first.
    central: Option<f64>,
    damping: f64,
    /// Newton steps since the centre moved.
    steps: u32,
    /// Problems given up since the least residual fell.
    failures: u32,
    least: f64,
}

impl ProximalPoint {
    pub(crate) fn with_capacity(rows: usize) -> Self {
        Self { centre: Vec::with_capacity(rows), gap: Vec::with_capacity(rows), ..Self::default() }
    }

    /// Forgets the last problem; room for one of so many rows.
    pub(crate) fn begin(&mut self, rows: usize) {
        for vector in [&mut self.centre, &mut self.gap] {
            vector.clear();
            vector.resize(rows, 0.0);
        }
        self.damping = DAMPING;
        self.restart();
    }

    /// Begins with the shift of nearly singular problems.
    pub(crate) fn expect_singular(&mut self) {
        self.damping = SINGULAR;
    }

    /// A new chain from the next forces on.
    pub(crate) fn restart(&mut self) {
        self.central = None;
        self.failures = 0;
        self.least = f64::INFINITY;
    }

    /// What is to be done at forces with the residual `now`, where `tolerance` is asked for.
    pub(crate) fn course(&mut self, lambda: &[f64], now: f64, tolerance: f64) -> Course {
        let course = match self.central {
            Some(central) if self.residual > (CENTRED * central).max(FINE * tolerance) && now > ADVANCED * central => {
                let lost = self.steps >= LOST_STEPS && self.residual > LOST * central;
                if self.steps < MOST_STEPS && !lost {
                    Course::Step
                } else {
                    self.failures += 1;
                    self.damping *= REPEATED;
                    self.set_centre(central);
                    if self.failures < PATIENCE { Course::Repeat } else { Course::End }
                }
            }
            before => {
                if let Some(central) = before {
                    if self.steps > HARD {
                        self.damping *= HARDENED;
                    } else if self.steps <= EASY && now > SLOW * central {
                        // The shift itself is what is left of the residual: forces are large beside those of the scale.
                        self.damping *= EASED;
                    } else if self.steps <= EASY && self.damping > DAMPING {
                        self.damping = (EASED * self.damping).max(DAMPING);
                    }
                }
                if now < NOTABLE * self.least {
                    (self.least, self.failures) = (now, 0);
                }
                self.centre.copy_from_slice(lambda);
                self.set_centre(now);
                Course::Step
            }
        };
        self.steps += 1;
        course
    }

    fn set_centre(&mut self, residual: f64) {
        self.central = Some(residual);
        self.residual = residual;
        self.steps = 0;
        self.shift = (self.damping * residual).clamp(LEAST_SHIFT, MOST_SHIFT);
    }

    /// Forms the regularised gap from the gap `delta` (m) of forces (N).
    pub(crate) fn regularise(
        &mut self,
        view: &ProblemView<'_>,
        local: &[LocalCompliance],
        delta: &[f64],
        lambda: &[f64],
    ) {
        for (block, local) in view.blocks.iter().zip(local) {
            let (rows, softness) = (block.start..block.start + block.law.rows(), self.shift / local.rho());
            let (Some(to), Some(delta)) = (self.gap.get_mut(rows.clone()), delta.get(rows.clone())) else { return };
            let (Some(force), Some(centre)) = (lambda.get(rows.clone()), self.centre.get(rows)) else { return };
            for (i, to) in to.iter_mut().enumerate() {
                *to = delta[i] + softness * (force[i] - centre[i]);
            }
        }
    }

    /// Residual of the regularised problem; the largest number for gaps that are not finite.
    pub(crate) fn judge(
        &mut self,
        view: &ProblemView<'_>,
        local: &[LocalCompliance],
        delta: &[f64],
        lambda: &[f64],
        scale: f64,
    ) -> f64 {
        self.regularise(view, local, delta, lambda);
        let rho = |a: usize| local.get(a).map_or(1.0, LocalCompliance::rho);
        let reached = natural_map_scaled(view, scale, rho, &self.gap, lambda).relative;
        if reached.is_finite() { reached } else { f64::MAX }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chain() -> ProximalPoint {
        let mut chain = ProximalPoint::with_capacity(3);
        chain.begin(3);
        chain
    }

    #[test]
    fn easy_problems_move_the_centre_at_every_step_and_the_shift_follows_the_residual() {
        let mut chain = chain();
        for (k, now) in [1e-1, 1e-3, 1e-6].into_iter().enumerate() {
            let lambda = [k as f64; 3];
            assert_eq!(chain.course(&lambda, now, 1e-8), Course::Step);
            assert_eq!(chain.centre, lambda);
            assert!((chain.shift - DAMPING * now).abs() < 1e-15);
            chain.residual = 0.01 * now;
        }
    }

    #[test]
    fn a_problem_that_is_not_solved_begins_again_with_a_larger_shift_and_ends_at_last() {
        let mut chain = chain();
        assert_eq!(chain.course(&[1.0; 3], 1e-3, 1e-8), Course::Step);
        for failure in 1..=PATIENCE {
            let before = chain.shift;
            chain.residual = 1e-3;
            for _ in 1..MOST_STEPS {
                assert_eq!(chain.course(&[2.0; 3], 0.5e-3, 1e-8), Course::Step);
            }
            let course = chain.course(&[2.0; 3], 0.5e-3, 1e-8);
            assert_eq!(course, if failure < PATIENCE { Course::Repeat } else { Course::End });
            assert_eq!(chain.centre, [1.0; 3]);
            assert!(chain.shift > before);
        }
    }

    #[test]
    fn a_problem_whose_steps_are_lost_begins_again_sooner() {
        let taken = |rises: f64| {
            let mut chain = chain();
            assert_eq!(chain.course(&[1.0; 3], 1e-4, 1e-8), Course::Step);
            let mut steps = 1;
            loop {
                chain.residual = rises * 1e-4;
                match chain.course(&[2.0; 3], rises * 1e-4, 1e-8) {
                    Course::Step => steps += 1,
                    course => return (steps, course, chain.centre),
                }
            }
        };
        assert_eq!(taken(0.5 * LOST), (MOST_STEPS, Course::Repeat, vec![1.0; 3]));
        assert_eq!(taken(2.0 * LOST), (LOST_STEPS, Course::Repeat, vec![1.0; 3]));
    }

    #[test]
    fn a_residual_that_does_not_fall_though_steps_are_easy_is_the_shift_itself() {
        let mut chain = chain();
        chain.course(&[1.0; 3], 1e-3, 1e-8);
        let first = chain.shift;
        chain.residual = 0.0;
        chain.course(&[1.0; 3], 0.9e-3, 1e-8);
        assert!(chain.shift < 0.5 * first);
    }
}
