//! `W = B C Bᵀ` of the rows of a tick on a patch.

use nalgebra::Matrix3;

use super::rows::{Row, Rows};
use crate::coupling::Coupling;
use crate::patch::HapticPatch;

impl Rows {
    /// W \[m/N\] by `yields` of the patch's compliance, by columns without padding, with the compliances of the tool's pose and of its opening \[rad/(N m)\]. False
    /// where a number is not finite.
    pub(super) fn compliance_into(
        &self,
        patch: &HapticPatch,
        yields: f64,
        (coupling, opening): (&Coupling, f64),
        w: &mut [f64],
    ) -> bool {
        let m = self.len();
        let tool = ToolYield { c: coupling.compliance(), turning: coupling.rotational_compliance(), opening };
        let places = PlaceBlocks::new(patch, yields);
        let mut finite = true;
        for (j, (b, columns)) in self.contact.iter().zip(&self.blocks).enumerate() {
            for (a, lines) in self.contact.iter().zip(&self.blocks).skip(j) {
                let (first, last) = (columns.start, lines.start);
                if lines.law.rows() == 1 && columns.law.rows() == 1 {
                    let entry = tool.normals(a, b, &places);
                    finite &= entry.is_finite();
                    (w[first * m + last], w[last * m + first]) = (entry, entry);
                    continue;
                }
                let block = tool.block(a, b, &places);
                finite &= block.sum().is_finite();
                for s in 0..columns.law.rows() {
                    for r in 0..lines.law.rows() {
                        // Symmetric to the bit: the upper triangle is the lower one's mirror, on the diagonal too.
                        let (row, column) = (last + r, first + s);
                        if row >= column {
                            (w[column * m + row], w[row * m + column]) = (block[(r, s)], block[(r, s)]);
                        }
                    }
                }
            }
        }
        finite
    }
}

/// How the tool gives way behind its couplings.
struct ToolYield {
    /// Translation \[m/N\], rotation and opening \[rad/(N m)\].
    c: f64,
    turning: f64,
    opening: f64,
}

impl ToolYield {
    /// Displacement of the tool's point of `a` per force at that of `b` by translation and opening, over `start` \[m/N\].
    #[inline]
    fn translation(&self, start: Matrix3<f64>, a: &Row, b: &Row) -> Matrix3<f64> {
        let mut between = start + Matrix3::from_diagonal_element(self.c);
        if self.opening > 0.0 {
            between += a.opens * b.opens.transpose() * self.opening;
        }
        between
    }

    /// Entry of two normals.
    fn normals(&self, a: &Row, b: &Row, places: &PlaceBlocks<'_>) -> f64 {
        let tissue = places.between(a, b);
        if a.body.is_some() || b.body.is_some() {
            return self.block(a, b, places)[(0, 0)];
        }
        let mut entry = a.frame.column(0).dot(&(self.translation(tissue, a, b) * b.frame.column(0)));
        if self.turning > 0.0 {
            entry += self.turning * a.turn(0).dot(&b.turn(0));
        }
        entry
    }

    /// Block of two contacts.
    #[inline]
    fn block(&self, a: &Row, b: &Row, places: &PlaceBlocks<'_>) -> Matrix3<f64> {
        let tissue = places.between(a, b);
        let mut block = if a.body.is_none() && b.body.is_none() {
            a.frame.tr_mul(&(self.translation(tissue, a, b) * b.frame))
        } else {
            let places = a.local.tr_mul(&(tissue * b.local));
            if !(a.touches && b.touches) {
                return places;
            }
            places + a.frame.tr_mul(&(self.translation(Matrix3::zeros(), a, b) * b.frame))
        };
        if self.turning > 0.0 {
            block += Matrix3::from_fn(|r, s| self.turning * a.turn(r).dot(&b.turn(s)));
        }
        block
    }
}

/// C by blocks of two places.
struct PlaceBlocks<'a> {
    compliance: &'a [f64],
    stride: usize,
    yields: f64,
}

impl<'a> PlaceBlocks<'a> {
    fn new(patch: &'a HapticPatch, yields: f64) -> Self {
        Self { compliance: patch.compliance(), stride: patch.degrees_of_freedom(), yields }
    }

    /// Displacement of the point of `a` per force at the point of `b` \[m/N\].
    #[inline]
    fn between(&self, a: &Row, b: &Row) -> Matrix3<f64> {
        let mut sum = Matrix3::zeros();
        for &(q, share) in &b.places[..b.count] {
            for &(p, weight) in &a.places[..a.count] {
                // Nodes that are held fixed come last and have no compliance.
                if 3 * p.max(q) < self.stride {
                    for column in 0..3 {
                        let at = (3 * q + column) * self.stride + 3 * p;
                        if let Some([x, y, z]) = self.compliance.get(at..at + 3) {
                            let share = weight * share * self.yields;
                            sum[(0, column)] += share * x;
                            sum[(1, column)] += share * y;
                            sum[(2, column)] += share * z;
                        }
                    }
                }
            }
        }
        sum
    }
}
