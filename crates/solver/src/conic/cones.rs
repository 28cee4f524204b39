//! The admissible forces of all blocks as rows `b - A x` in cones.

use clarabel::algebra::CscMatrix;
use clarabel::solver::SupportedConeT::{self, NonnegativeConeT, SecondOrderConeT, ZeroConeT};
use palpate_constraints::law::ConicForm;
use std::f64::consts::PI;

/// Rows `b - A x` in cones, entry by entry as they come.
#[derive(Clone, Default)]
pub(crate) struct Cones {
    /// Row and column of each entry of `A`.
    entries: Vec<(usize, usize)>,
    values: Vec<f64>,
    /// `b`.
    pub(crate) right: Vec<f64>,
    cones: Vec<SupportedConeT<f64>>,
}

impl Cones {
    /// Nothing, in the memory that is there.
    pub(crate) fn clear(&mut self) {
        self.entries.clear();
        self.values.clear();
        self.right.clear();
        self.cones.clear();
    }

    /// Whether the entries lie where those of `other` do, in the same cones.
    pub(crate) fn have_structure_of(&self, other: &Self) -> bool {
        self.right.len() == other.right.len() && self.cones == other.cones && self.entries == other.entries
    }

    /// The cones, one after another.
    pub(crate) fn cones(&self) -> &[SupportedConeT<f64>] {
        &self.cones
    }

    /// `A` for `columns` unknowns, and the place in it of each entry from here; entries at one place add up.
    pub(crate) fn matrix(&self, columns: usize) -> (CscMatrix<f64>, Vec<usize>) {
        let mut order: Vec<usize> = (0..self.entries.len()).collect();
        order.sort_by_key(|&k| (self.entries[k].1, self.entries[k].0));
        let (mut starts, mut rows) = (vec![0; columns + 1], Vec::with_capacity(order.len()));
        let (mut places, mut last) = (vec![0; order.len()], None);
        for k in order {
            let (row, column) = self.entries[k];
            if last != Some((row, column)) {
                rows.push(row);
                starts[column + 1] += 1;
                last = Some((row, column));
            }
            places[k] = rows.len() - 1;
        }
        (0..columns).for_each(|column| starts[column + 1] += starts[column]);
        let mut values = vec![0.0; rows.len()];
        self.write(&places, &mut values);
        (CscMatrix::new(self.right.len(), columns, starts, rows, values), places)
    }

    /// The values of `A` at those places.
    pub(crate) fn write(&self, places: &[usize], values: &mut [f64]) {
        values.fill(0.0);
        places.iter().zip(&self.values).for_each(|(place, value)| values[*place] += value);
    }

    /// A further cone for the rows that follow.
    pub(crate) fn cone(&mut self, cone: SupportedConeT<f64>) {
        self.cones.push(cone);
    }

    /// An entry of `A`.
    pub(crate) fn entry(&mut self, row: usize, column: usize, value: f64) {
        self.entries.push((row, column));
        self.values.push(value);
    }

    /// A row `constant + sum of entries` of the cone that is pushed next.
    fn row(&mut self, constant: f64, entries: &[(usize, f64)]) {
        for (column, value) in entries {
            self.entry(self.right.len(), *column, -value);
        }
        self.right.push(constant);
    }

    /// The admissible forces of a block from row `n` on; limits are of scaled forces.
    pub(crate) fn admit(&mut self, form: ConicForm, n: usize, scale: f64) {
        let (t, s) = (n + 1, n + 2);
        match form {
            ConicForm::Free => {}
            ConicForm::NonNegative => {
                self.row(0.0, &[(n, 1.0)]);
                self.cones.push(NonnegativeConeT(1));
            }
            ConicForm::Interval { limit } => {
                self.row(0.0, &[(n, 1.0)]);
                self.row(limit / scale, &[(n, -1.0)]);
                self.cones.push(NonnegativeConeT(2));
            }
            ConicForm::SecondOrder { friction } if friction > 0.0 => {
                self.row(0.0, &[(n, friction)]);
                self.row(0.0, &[(t, 1.0)]);
                self.row(0.0, &[(s, 1.0)]);
                self.cones.push(SecondOrderConeT(3));
            }
            ConicForm::Cylinder { limit } if limit > 0.0 => {
                self.admit(ConicForm::NonNegative, n, scale);
                self.row(limit / scale, &[]);
                self.row(0.0, &[(t, 1.0)]);
                self.row(0.0, &[(s, 1.0)]);
                self.cones.push(SecondOrderConeT(3));
            }
            ConicForm::Polyhedral { friction, facets } if friction > 0.0 => {
                let half = PI / facets as f64;
                for j in 0..facets {
                    let (sin, cos) = ((2 * j + 1) as f64 * half).sin_cos();
                    self.row(0.0, &[(n, friction * half.cos()), (t, -cos), (s, -sin)]);
                }
                self.cones.push(NonnegativeConeT(facets));
            }
            // Without friction.
            _ => {
                self.admit(ConicForm::NonNegative, n, scale);
                self.row(0.0, &[(t, 1.0)]);
                self.row(0.0, &[(s, 1.0)]);
                self.cones.push(ZeroConeT(2));
            }
        }
    }
}
