//! A contact problem as a linear complementarity problem, with faceted friction cones [Stewart and Trinkle 1996].
//!
//! ```text
//! w = M z + q ,   0 <= w _|_ z >= 0
//! ```
//!
//! The forces are `lambda_a = sum_j g_j z_j` with directions `g_j`: the normal, the corners `d_j` of the friction polygon,
//! or plus and minus a row that is held closed. Among directions `M_ij = g_i^T W g_j`, `q_i = g_i^T delta_free`. A bounded
//! force has one variable more, `gamma`:
//!
//! ```text
//! friction:   w_j += gamma for all corners ,   w_gamma = mu z_n - sum_j z_j   (Coulomb)  or  g - sum_j z_j   (Tresca)
//! threshold:  w_n += gamma ,                   w_gamma = limit - z_n
//! ```
//!
//! Numbers are brought to order one: block `a` by `sqrt(rho_a)`, and all of `q` by its largest entry.

use crate::problem::{Block, ProblemView, gather};
use nalgebra::Vector3;
use palpate_constraints::law::{ConicForm, Law, LocalCompliance};
use std::f64::consts::TAU;

/// A variable of the complementarity problem.
#[derive(Clone, Copy, Debug)]
enum Variable {
    /// Force of a block along a direction.
    Force { block: usize, direction: Vector3<f64> },
    /// The variable `gamma` of the block whose forces come before it.
    Bound { block: usize },
}

/// The variables, and the scale of the forces.
#[derive(Clone, Debug, Default)]
pub(crate) struct Complementarity {
    variables: Vec<Variable>,
    /// `W g_j` for one direction, m/N.
    image: Vec<f64>,
    /// Largest scaled entry of `delta_free`.
    size: f64,
}

impl Complementarity {
    pub(crate) fn with_capacity(variables: usize, rows: usize) -> Self {
        Self { variables: Vec::with_capacity(variables), image: Vec::with_capacity(rows), size: 1.0 }
    }

    /// Number of variables.
    pub(crate) fn len(&self) -> usize {
        self.variables.len()
    }

    /// Makes room for the variables of a problem, up to `most`. Allocates where a law has more facets than any before.
    pub(crate) fn reserve(&mut self, view: &ProblemView<'_>, facets: usize, most: usize) -> usize {
        let variables = |block: &Block| match block.law.conic_form() {
            ConicForm::Free => 2 * block.law.rows(),
            _ => corners(&block.law, facets, 0.0).0 + 2,
        };
        // Six more for the room that laying out a block asks for.
        let needed = view.blocks.iter().map(variables).sum::<usize>().min(most) + 6;
        self.variables.reserve_exact(needed.saturating_sub(self.variables.len()));
        needed
    }

    /// Chooses the variables. `facets` is the number of corners where the law leaves it open, `heading` the direction of
    /// the first corner of each block's polygon (rad). `false` where there is no room for them.
    pub(crate) fn lay_out(&mut self, view: &ProblemView<'_>, facets: usize, heading: &[f64]) -> bool {
        self.variables.clear();
        for (a, block) in view.blocks.iter().enumerate() {
            let (corners, first) = corners(&block.law, facets, heading.get(a).copied().unwrap_or(0.0));
            if self.variables.len() + corners + 6 > self.variables.capacity() {
                return false;
            }
            let force = |direction| Variable::Force { block: a, direction };
            match block.law.conic_form() {
                ConicForm::Free => {
                    for row in 0..block.law.rows() {
                        self.variables.push(force(Vector3::ith(row, 1.0)));
                        self.variables.push(force(Vector3::ith(row, -1.0)));
                    }
                }
                form => {
                    self.variables.push(force(Vector3::x()));
                    for j in 0..corners {
                        let angle = first + TAU * j as f64 / corners as f64;
                        self.variables.push(force(Vector3::new(0.0, angle.cos(), angle.sin())));
                    }
                    if corners > 0 || matches!(form, ConicForm::Interval { .. }) {
                        self.variables.push(Variable::Bound { block: a });
                    }
                }
            }
        }
        true
    }

    /// Writes `[I, -M, -e, q]` row by row into `tableau`, `2 n + 2` columns.
    pub(crate) fn fill(&mut self, view: &ProblemView<'_>, local: &[LocalCompliance], tableau: &mut [f64]) {
        let n = self.len();
        let width = 2 * n + 2;
        let scale = |a: usize| local.get(a).map_or(1.0, |local| local.rho().sqrt());
        self.size = view
            .blocks
            .iter()
            .enumerate()
            .map(|(a, block)| scale(a) * gather(view.delta_free, block).amax())
            .fold(f64::MIN_POSITIVE, f64::max);
        tableau.fill(0.0);
        for (i, row) in tableau.chunks_exact_mut(width).enumerate() {
            row[i] = 1.0;
            row[2 * n] = -1.0;
        }
        for j in 0..n {
            let Variable::Force { block, direction } = self.variables[j] else { continue };
            let Some(from) = view.blocks.get(block) else { continue };
            self.image.clear();
            self.image.resize(view.rows(), 0.0);
            for (c, g) in direction.iter().enumerate().take(from.law.rows()) {
                for (image, w) in self.image.iter_mut().zip(view.column(from.start + c)) {
                    *image += w * g;
                }
            }
            for i in 0..n {
                let Variable::Force { block: to, direction } = self.variables[i] else { continue };
                let Some(to_block) = view.blocks.get(to) else { continue };
                let m = direction.dot(&gather(&self.image, to_block)) * scale(block) * scale(to);
                tableau[i * width + n + j] = -m;
            }
            tableau[j * width + width - 1] = direction.dot(&gather(view.delta_free, from)) * scale(block) / self.size;
        }
        self.bounds(view.blocks, scale, tableau);
    }

    /// Rows and columns of the variables `gamma`.
    fn bounds(&self, blocks: &[Block], scale: impl Fn(usize) -> f64, tableau: &mut [f64]) {
        let n = self.len();
        let width = 2 * n + 2;
        for i in 0..n {
            let Variable::Bound { block } = self.variables[i] else { continue };
            let Some(law) = blocks.get(block).map(|block| block.law) else { continue };
            // The block's forces stand right before its bound, the normal first.
            let of_block = |v: &Variable| matches!(v, Variable::Force { block: other, .. } if *other == block);
            let first = i - self.variables[..i].iter().rev().take_while(|v| of_block(v)).count();
            let form = law.conic_form();
            let bounded = if let ConicForm::Interval { .. } = form { first..i } else { first + 1..i };
            for j in bounded {
                tableau[j * width + n + i] = -1.0;
                tableau[i * width + n + j] = 1.0;
            }
            match form {
                ConicForm::SecondOrder { friction } | ConicForm::Polyhedral { friction, .. } => {
                    tableau[i * width + n + first] = -friction;
                }
                ConicForm::Interval { limit } | ConicForm::Cylinder { limit } => {
                    tableau[i * width + width - 1] = limit / (scale(block) * self.size);
                }
                ConicForm::Free | ConicForm::NonNegative => {}
            }
        }
    }

    /// Adds the force of variable `j` at the value `z`.
    pub(crate) fn add_force(
        &self,
        view: &ProblemView<'_>,
        local: &[LocalCompliance],
        j: usize,
        z: f64,
        lambda: &mut [f64],
    ) {
        let Some(Variable::Force { block, direction }) = self.variables.get(j) else { return };
        let (Some(at), Some(local)) = (view.blocks.get(*block), local.get(*block)) else { return };
        let force = z * self.size * local.rho().sqrt();
        for (entry, g) in lambda.iter_mut().skip(at.start).zip(direction.iter().take(at.law.rows())) {
            *entry += g * force;
        }
    }
}

/// Number of corners of a law's friction polygon, and the angle of the first (rad).
fn corners(law: &Law, facets: usize, heading: f64) -> (usize, f64) {
    match law.conic_form() {
        ConicForm::SecondOrder { friction } if friction > 0.0 => (facets, heading),
        ConicForm::Cylinder { limit } if limit > 0.0 => (facets, heading),
        ConicForm::Polyhedral { friction, facets } if friction > 0.0 => (facets, 0.0),
        _ => (0, 0.0),
    }
}
