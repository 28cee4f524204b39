//! Compliance of a body with a diagonal system matrix: explicit integration.
//!
//! `A = M (1 + αh/2)` (kg): a force on a node moves that node alone within the step, so that `W` couples only rows that
//! share a node.

use nalgebra::DMatrixViewMut;
use palpate_fem::nodal_rows::NodalRows;

use crate::compliance::InverseRows;

/// The inverse of a diagonal system matrix with one mass per free node.
#[derive(Clone, Debug)]
pub struct LumpedInverse {
    /// `1 / A` of every free node (1/kg).
    inverse: Vec<f64>,
}

impl LumpedInverse {
    /// From the diagonal of `A` (kg), one value per free node.
    pub fn new(mass: impl IntoIterator<Item = f64>) -> Self {
        Self { inverse: mass.into_iter().map(f64::recip).collect() }
    }

    fn at(&self, node: u32) -> f64 {
        self.inverse.get(node as usize).copied().unwrap_or(0.0)
    }
}

impl InverseRows for LumpedInverse {
    type Workspace = NodalRows;

    fn compliance_into(
        &self,
        rows: &NodalRows,
        scale: f64,
        mut w: DMatrixViewMut<'_, f64>,
        ws: &mut NodalRows,
    ) -> bool {
        if w.shape() != (rows.len(), rows.len()) {
            return false;
        }
        ws.clear();
        for r in 0..rows.len() {
            ws.push_row(rows.row(r));
            for s in 0..=r {
                let mut sum = 0.0;
                for (i, a) in rows.row(r) {
                    for (_, b) in rows.row(s).filter(|&(j, _)| j == i) {
                        sum += self.at(i) * a.dot(&b);
                    }
                }
                w[(r, s)] = scale * sum;
                w[(s, r)] = scale * sum;
            }
        }
        true
    }

    fn correct(&self, lambda: &[f64], x: &mut [f64], ws: &mut NodalRows) -> bool {
        if lambda.len() != ws.len() || x.len() != 3 * self.inverse.len() {
            return false;
        }
        x.fill(0.0);
        ws.add_transposed(lambda, x);
        x.chunks_exact_mut(3).zip(&self.inverse).for_each(|(x, inverse)| x.iter_mut().for_each(|x| *x *= inverse));
        true
    }
}
