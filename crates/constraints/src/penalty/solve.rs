//! Newton's method on a body with penalty contacts.
//!
//! ```text
//! find w:  A w = h Hᵀ F(δ_free + h H w)
//! repeat:  (A + h² Hᵀ K H) p = h Hᵀ F - A w      F and K = -dF/dδ with the bounds of friction held
//!          w <- w + t p                          t halved until the energy with those bounds falls
//!          bounds <- μ F_n                       where the balance with those held is ten times better
//! until    |h Hᵀ F - A w| <= tolerance |h Hᵀ F|   with the true bounds
//! ```
//!
//! With the bounds held the energy is convex, and Newton's method with the search ends whatever the stiffness. Taking them from the
//! normal force in every iteration goes round in circles between stick and slip once contacts are stiff.
//! A run that ends before that hands its motion and forces out only where they balance to [`BALANCED`]: the forces of very stiff
//! contacts are the rounding of their gaps times the stiffness, far larger than what the motion answers.
//! `w` (m/s) is what contact adds to the free velocity. The linear systems are solved by conjugate gradients with a
//! preconditioner made for `A` alone: every contact row is one more eigenvalue, so that they take some tens of iterations, and more
//! the stiffer the contacts. The matrix has the pattern of `A` because the nodes of a contact share an element.

use nalgebra::Vector3;
use palpate_fem::nodal_rows::NodalRows;
use palpate_fem::pcg::{PcgConfig, PcgStatus, PcgWorkspace, pcg};
use palpate_fem::preconditioner::Preconditioner;
use palpate_fem::sparse::SystemMatrix;

use super::PenaltyContact;
use crate::rows::RowBlock;

/// Balance with the bounds held, relative to the true one, at which they are taken anew.
const HELD: f64 = 0.1;

/// Most halvings of one of Newton's steps.
const MOST_CUTS: u32 = 30;

/// Balance, relative to the contact forces, up to which the motion and forces of a run that did not converge are handed out.
pub const BALANCED: f64 = 1e-2;

/// Fall of the energy that is asked for, relative to the slope (Armijo).
const SLOPE: f64 = 1e-4;

/// Rounding of the energy relative to its parts: a rise below it is none.
const ROUNDING: f64 = 1e-13;

/// The body and its contacts in one step.
#[derive(Clone, Copy, Debug)]
pub struct PenaltyProblem<'a> {
    /// System matrix `A` (kg).
    pub system: &'a SystemMatrix,
    /// `H` over the free nodes.
    pub rows: &'a NodalRows,
    /// Rows of each contact.
    pub blocks: &'a [RowBlock],
    /// Gap of each row (m) if nothing touched.
    pub delta_free: &'a [f64],
    /// Step `h` (s).
    pub dt: f64,
}

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PenaltyLimits {
    /// What may be left of the balance, relative to the contact forces; `> 0`.
    pub tolerance: f64,
    /// Most of Newton's iterations.
    pub iterations: u32,
    /// When the conjugate gradients of one iteration stop.
    pub linear: PcgConfig,
}

/// How the iteration ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PenaltyStatus {
    /// The balance holds to the tolerance.
    Converged,
    /// The iterations are used up; motion and forces are zero where they do not balance to [`BALANCED`].
    OutOfIterations,
    /// No step along the direction lowers the energy, or the linear solve had no direction; motion and forces as above.
    Stalled,
    /// A number was not finite; motion and forces are zero.
    NonFinite,
    /// Sizes disagree, or a contact's nodes share no element; motion and forces are zero.
    Invalid,
}

/// What the iteration reports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PenaltyReport {
    /// How it ended.
    pub status: PenaltyStatus,
    /// Newton's iterations.
    pub iterations: u32,
    /// Iterations of the conjugate gradients, all together.
    pub linear_iterations: usize,
    /// What is left of the balance, relative to the contact forces; zero without contact forces.
    pub balance: f64,
}

/// Memory of the iteration; allocates nothing once made.
#[derive(Clone, Debug)]
pub struct PenaltyWorkspace {
    /// The contacts, to be filled before each solve; one a block.
    pub contacts: Vec<PenaltyContact>,
    matrix: SystemMatrix,
    pcg: PcgWorkspace,
    /// `A w`, `A p`, `p`, the balance.
    aw: Vec<f64>,
    ap: Vec<f64>,
    p: Vec<f64>,
    r: Vec<f64>,
    delta: Vec<f64>,
    slope: Vec<f64>,
    /// Friction that each contact may have (N).
    bounds: Vec<f64>,
}

impl PenaltyWorkspace {
    /// Memory for the body of `system` and so many contacts of three rows.
    pub fn new(system: &SystemMatrix, contacts: usize) -> Self {
        let n = system.pattern.rows();
        let zeros = vec![0.0; 3 * n];
        Self {
            contacts: Vec::with_capacity(contacts),
            matrix: system.clone(),
            pcg: PcgWorkspace::new(n),
            aw: zeros.clone(),
            ap: zeros.clone(),
            p: zeros.clone(),
            r: zeros,
            delta: Vec::with_capacity(3 * contacts),
            slope: Vec::with_capacity(3 * contacts),
            bounds: Vec::with_capacity(contacts),
        }
    }
}

/// Solves from `w = 0` with the contacts in the workspace; leaves the motion (m/s) in `w` and the forces (N), one a row, in
/// `lambda`.
pub fn penalty_motion(
    problem: &PenaltyProblem<'_>,
    limits: &PenaltyLimits,
    preconditioner: &mut impl Preconditioner,
    w: &mut [f64],
    lambda: &mut [f64],
    ws: &mut PenaltyWorkspace,
) -> PenaltyReport {
    w.fill(0.0);
    lambda.fill(0.0);
    let mut report =
        PenaltyReport { status: PenaltyStatus::Invalid, iterations: 0, linear_iterations: 0, balance: f64::INFINITY };
    if !fits(problem, w, lambda, ws) {
        return report;
    }
    ws.aw.fill(0.0);
    ws.delta.clear();
    ws.delta.extend_from_slice(problem.delta_free);
    ws.slope.clear();
    ws.slope.resize(problem.rows.len(), 0.0);
    // Without friction first: normal forces at the free gaps are those of a body that does not give way.
    ws.bounds.clear();
    ws.bounds.resize(problem.blocks.len(), 0.0);
    report.status = loop {
        report.balance = balance(problem, Bounds::True, lambda, ws);
        if !report.balance.is_finite() {
            break PenaltyStatus::NonFinite;
        }
        if report.balance <= limits.tolerance {
            break PenaltyStatus::Converged;
        }
        if report.iterations >= limits.iterations {
            break PenaltyStatus::OutOfIterations;
        }
        if balance(problem, Bounds::Held, lambda, ws) <= HELD * report.balance {
            for ((bound, block), contact) in ws.bounds.iter_mut().zip(problem.blocks).zip(&ws.contacts) {
                *bound = contact.bound(&gather(&ws.delta, block));
            }
            balance(problem, Bounds::Held, lambda, ws);
        }
        if !stiffen(problem, ws) {
            break PenaltyStatus::Invalid;
        }
        ws.p.fill(0.0);
        let linear = pcg(&ws.matrix, &ws.r, &mut ws.p, preconditioner, limits.linear, &mut ws.pcg);
        report.linear_iterations += linear.iterations;
        if linear.status == PcgStatus::NonFinite {
            break PenaltyStatus::NonFinite;
        }
        if !advance(problem, w, ws) {
            break PenaltyStatus::Stalled;
        }
        report.iterations += 1;
    };
    let gave_up = matches!(report.status, PenaltyStatus::NonFinite | PenaltyStatus::Invalid);
    if !gave_up {
        // The forces of the motion that is handed back, inside the cones.
        report.balance = balance(problem, Bounds::True, lambda, ws);
    }
    // Written so that NaN does not balance.
    let balanced = report.balance <= BALANCED;
    if gave_up || !balanced {
        w.fill(0.0);
        lambda.fill(0.0);
    }
    report
}

fn fits(problem: &PenaltyProblem<'_>, w: &[f64], lambda: &[f64], ws: &PenaltyWorkspace) -> bool {
    let (n, m) = (3 * problem.system.pattern.rows(), problem.rows.len());
    let rows = problem.blocks.iter().all(|block| block.range().end <= m && (1..=3).contains(&block.rows));
    rows && [w.len(), ws.p.len()] == [n, n]
        && [lambda.len(), problem.delta_free.len()] == [m, m]
        && ws.contacts.len() == problem.blocks.len()
        && ws.matrix.blocks.len() == problem.system.blocks.len()
}

/// The entries of a contact in a vector over rows, padded with zeros.
fn gather(rows: &[f64], block: &RowBlock) -> Vector3<f64> {
    Vector3::from_fn(|i, _| if i < block.rows as usize { rows[block.first_row as usize + i] } else { 0.0 })
}

/// The bounds of friction.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Bounds {
    /// By the normal force.
    True,
    /// As they are held.
    Held,
}

/// Forces at the gaps so far, and `r = h Hᵀ F - A w`; returns its size relative to the forces.
fn balance(problem: &PenaltyProblem<'_>, bounds: Bounds, lambda: &mut [f64], ws: &mut PenaltyWorkspace) -> f64 {
    for ((block, contact), held) in problem.blocks.iter().zip(&ws.contacts).zip(&ws.bounds) {
        let delta = gather(&ws.delta, block);
        let bound = if bounds == Bounds::Held { *held } else { contact.bound(&delta) };
        let force = contact.force_within(&delta, bound);
        lambda[block.range()].iter_mut().zip(&force).for_each(|(to, from)| *to = *from);
    }
    ws.r.fill(0.0);
    problem.rows.add_transposed(lambda, &mut ws.r);
    let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    ws.r.iter_mut().for_each(|r| *r *= problem.dt);
    let forces = norm(&ws.r);
    ws.r.iter_mut().zip(&ws.aw).for_each(|(r, aw)| *r -= aw);
    let left = norm(&ws.r);
    // No force and no motion: nothing touches. Forces that have just vanished leave the motion to be undone.
    if left == 0.0 { 0.0 } else { left / forces.max(norm(&ws.aw)) }
}

/// `A + h² Hᵀ K H` into the workspace; false where an entry has no place in the pattern.
fn stiffen(problem: &PenaltyProblem<'_>, ws: &mut PenaltyWorkspace) -> bool {
    ws.matrix.blocks.copy_from_slice(&problem.system.blocks);
    let h2 = problem.dt * problem.dt;
    for ((block, contact), bound) in problem.blocks.iter().zip(&ws.contacts).zip(&ws.bounds) {
        let tangent = contact.tangent_within(&gather(&ws.delta, block), *bound) * h2;
        for (i, row) in block.range().enumerate() {
            for (j, column) in block.range().enumerate().filter(|&(j, _)| tangent[(i, j)] != 0.0) {
                for (a, left) in problem.rows.row(row) {
                    for (b, right) in problem.rows.row(column) {
                        let place = ws.matrix.pattern.find(a, b);
                        let Some(entry) = place.and_then(|p| ws.matrix.blocks.get_mut(p)) else { return false };
                        *entry += left * right.transpose() * tangent[(i, j)];
                    }
                }
            }
        }
    }
    true
}

/// Moves along `p` as far as the energy with the present bounds of friction falls; false where it does not.
fn advance(problem: &PenaltyProblem<'_>, w: &mut [f64], ws: &mut PenaltyWorkspace) -> bool {
    let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
    problem.system.multiply(&ws.p, &mut ws.ap);
    for (r, slope) in ws.slope.iter_mut().enumerate() {
        *slope = problem.dt * problem.rows.dot(r, &ws.p);
    }
    let (linear, quadratic, descent) = (dot(w, &ws.ap), dot(&ws.p, &ws.ap), dot(&ws.r, &ws.p));
    if descent.is_nan() || descent <= 0.0 {
        return false;
    }
    let springs = |t: f64| -> f64 {
        let at = |block: &RowBlock| gather(&ws.delta, block) + gather(&ws.slope, block) * t;
        let energy =
            |((block, contact), bound): ((&RowBlock, &PenaltyContact), &f64)| contact.energy_within(&at(block), *bound);
        problem.blocks.iter().zip(&ws.contacts).zip(&ws.bounds).map(energy).sum()
    };
    let before = springs(0.0);
    let floor = ROUNDING * (before + 0.5 * dot(w, &ws.aw));
    let falls = |t: f64| t * (linear + 0.5 * t * quadratic) + springs(t) - before <= -SLOPE * t * descent + floor;
    let Some(t) = (0..=MOST_CUTS).map(|k| 0.5f64.powi(k as i32)).find(|&t| falls(t)) else { return false };
    w.iter_mut().zip(&ws.p).for_each(|(w, p)| *w += t * p);
    ws.aw.iter_mut().zip(&ws.ap).for_each(|(aw, ap)| *aw += t * ap);
    ws.delta.iter_mut().zip(&ws.slope).for_each(|(delta, slope)| *delta += t * slope);
    true
}
