//! Preconditioned conjugate gradients (Hestenes and Stiefel 1952).
//!
//! Stops on `‖b − A x‖₂ / ‖b‖₂`, the norm that can be checked from outside; the preconditioner's norm would change
//! with the age of the factor. When the recurrence says that the tolerance is met, the residual is computed afresh,
//! reported, and iterated on if rounding has made the two differ.
//!
//! Solves with one matrix may share what they learn of it: the directions of earlier ones are kept, which are
//! conjugate, and a later one begins with its error removed from their span and never searches there again (Saad,
//! Yeung, Erhel and Guyomarc'h 2000, with directions of conjugate gradients in the place of eigenvectors). Two scalar
//! products and two additions for each direction cost far less than a solve with a factor.
//!
//! Scalar products are plain sums in the order of the unknowns, so the iterates have the same bits for any number of
//! threads.

use crate::directions::Directions;
use crate::preconditioner::Preconditioner;
use crate::sparse::SystemMatrix;

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PcgConfig {
    /// Bound on `‖b − A x‖₂ / ‖b‖₂`; positive.
    pub relative_tolerance: f64,
    /// Most applications of the preconditioner.
    pub max_iterations: usize,
}

impl Default for PcgConfig {
    /// 1e-6 within 200 iterations: methods that trust the motion to a force error of 1e-3 leave it three digits.
    fn default() -> Self {
        Self { relative_tolerance: 1e-6, max_iterations: 200 }
    }
}

/// How the iteration ended. In every case `x` is finite and the last iterate, which of all has the least error in
/// the norm of `A` as far as `A` was seen to be positive definite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PcgStatus {
    /// The residual is within tolerance.
    Converged,
    /// The iterations are used up.
    OutOfIterations,
    /// A direction with `pᵀ A p <= 0` was met, or `rᵀ P⁻¹ r <= 0`: `A` or the preconditioner is not positive definite.
    Indefinite,
    /// A number was not finite: in `A`, in `b`, or by overflow.
    NonFinite,
    /// The preconditioner refused (see its [`SolveStatus`](crate::factor::SolveStatus)).
    PreconditionerFailed,
    /// Vectors, matrix and workspace differ in length; `x` is untouched.
    WrongSize,
}

/// What the iteration reports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PcgReport {
    /// How it ended.
    pub status: PcgStatus,
    /// Steps that were taken.
    pub iterations: usize,
    /// `‖b − A x‖₂ / ‖b‖₂` of the `x` that is returned; zero if `b` is zero, infinite if it cannot be computed.
    pub relative_residual: f64,
}

/// Vectors of one iteration, each of length `3 n`, and the directions of earlier solves.
#[derive(Clone, Debug)]
pub struct PcgWorkspace {
    kept: Directions,
    r: Vec<f64>,
    z: Vec<f64>,
    p: Vec<f64>,
    ap: Vec<f64>,
}

impl PcgWorkspace {
    /// Memory for `nodes` free nodes.
    pub fn new(nodes: usize) -> Self {
        let zeros = vec![0.0; 3 * nodes];
        Self { kept: Directions::new(0, 0), r: zeros.clone(), z: zeros.clone(), p: zeros.clone(), ap: zeros }
    }

    /// Keeps up to `most` directions from solve to solve, 48 bytes each for every node. [`Self::forget`] is to be called
    /// whenever the matrix is another: with directions of another the solution is as good, and found later.
    #[must_use]
    pub fn keeping_directions(self, most: usize) -> Self {
        Self { kept: Directions::new(most, self.r.len()), ..self }
    }

    /// Forgets the directions of earlier solves: the next one is with another matrix.
    pub fn forget(&mut self) {
        self.kept.clear();
    }

    /// `b − A x` of the last solve, as long as the matrix has rows; computed afresh at its end where it converged.
    pub fn residual(&self) -> &[f64] {
        &self.r
    }
}

/// Solves `A x = b` from the guess in `x`, with `A` symmetric positive definite.
///
/// Allocates nothing if called on a rayon worker (`ThreadPool::install`). The product `A p` is spread over the pool;
/// handing work to it from an outside thread makes rayon allocate a queue block now and then.
///
/// A guess that is not finite, or worse than none, is replaced by zero.
pub fn pcg(
    a: &SystemMatrix,
    b: &[f64],
    x: &mut [f64],
    preconditioner: &mut impl Preconditioner,
    config: PcgConfig,
    workspace: &mut PcgWorkspace,
) -> PcgReport {
    let n = 3 * a.pattern.rows();
    let report = |status, iterations, relative_residual| PcgReport { status, iterations, relative_residual };
    if b.len() != n || x.len() != n || workspace.r.len() != n || a.blocks.len() != a.pattern.blocks() {
        return report(PcgStatus::WrongSize, 0, f64::INFINITY);
    }
    let PcgWorkspace { kept, r, z, p, ap } = workspace;
    let b_norm = dot(b, b).sqrt();
    if !b_norm.is_finite() || b_norm == 0.0 {
        x.fill(0.0);
        let zero = b_norm == 0.0;
        return report(
            if zero { PcgStatus::Converged } else { PcgStatus::NonFinite },
            0,
            if zero { 0.0 } else { f64::INFINITY },
        );
    }

    let guessed = x.iter().any(|x| *x != 0.0);
    let mut residual = if guessed { residual(a, b, x, r) / b_norm } else { 1.0 };
    let helps = guessed && residual <= 1.0; // false for NaN too
    if !helps {
        x.fill(0.0);
        r.copy_from_slice(b);
        residual = 1.0;
    }
    let mut earlier = kept.len();
    if earlier > 0 && residual > config.relative_tolerance && residual.is_finite() {
        kept.remove_from(r, x);
        residual = dot(r, r).sqrt() / b_norm;
    }
    let (mut rz, mut curvature) = (0.0, 0.0);
    let (mut restart, mut conjugate) = (true, true);
    let mut iteration = 0;
    loop {
        let last = iteration >= config.max_iterations;
        if last || residual <= config.relative_tolerance {
            residual = self::residual(a, b, x, r) / b_norm;
            if residual <= config.relative_tolerance {
                return report(PcgStatus::Converged, iteration, residual);
            }
            if last {
                return report(PcgStatus::OutOfIterations, iteration, residual);
            }
            // the recurrence had drifted: go on from the true residual, and search everywhere again
            (restart, earlier, conjugate) = (true, 0, false);
        }

        // direction: z = P⁻¹ r, p = z + beta p
        if !preconditioner.apply(r, z).is_ok() {
            return report(PcgStatus::PreconditionerFailed, iteration, residual);
        }
        let rz_new = dot(r, z);
        if !rz_new.is_finite() {
            return report(PcgStatus::NonFinite, iteration, residual);
        }
        if rz_new <= 0.0 {
            return report(PcgStatus::Indefinite, iteration, residual);
        }
        if restart {
            p.copy_from_slice(z);
        } else {
            // beside directions of earlier solves, which rounding leaves not quite conjugate, from what it stands for
            let beta = if earlier > 0 { -dot(z, ap) / curvature } else { rz_new / rz };
            p.iter_mut().zip(&*z).for_each(|(p, z)| *p = z + beta * *p);
        }
        kept.make_conjugate(earlier, z, p);
        let mut along = if earlier > 0 { dot(p, r) } else { rz_new };
        if earlier > 0 && (along - rz_new).abs() > 0.5 * rz_new {
            // equal, where the directions of earlier solves are what they should be
            p.copy_from_slice(z);
            (along, earlier, conjugate) = (rz_new, 0, false);
        }
        (rz, restart) = (rz_new, false);

        // step: alpha = rz / pAp; x moves only once the new residual is known to be finite
        a.multiply(p, ap);
        curvature = dot(p, ap);
        if curvature <= 0.0 {
            return report(PcgStatus::Indefinite, iteration, residual);
        }
        let alpha = along / curvature;
        r.iter_mut().zip(&*ap).for_each(|(r, ap)| *r -= alpha * ap);
        let next = dot(r, r).sqrt() / b_norm;
        if !next.is_finite() || !alpha.is_finite() {
            return report(PcgStatus::NonFinite, iteration, residual);
        }
        x.iter_mut().zip(&*p).for_each(|(x, p)| *x += alpha * p);
        if conjugate {
            kept.push(p, ap, curvature);
        }
        residual = next;
        iteration += 1;
    }
}

/// `r = b − A x`; returns its norm.
fn residual(a: &SystemMatrix, b: &[f64], x: &[f64], r: &mut [f64]) -> f64 {
    a.multiply(x, r);
    r.iter_mut().zip(b).for_each(|(r, b)| *r = b - *r);
    dot(r, r).sqrt()
}

/// Scalar product in four interleaved partial sums, a fixed order that vectorises.
pub(crate) fn dot(x: &[f64], y: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (x, x_rest) = x.as_chunks::<4>();
    let (y, y_rest) = y.as_chunks::<4>();
    for (x, y) in x.iter().zip(y) {
        for k in 0..4 {
            sums[k] += x[k] * y[k];
        }
    }
    let rest: f64 = x_rest.iter().zip(y_rest).map(|(x, y)| x * y).sum();
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}
