//! `W = B C Bᵀ` of the rows of a tick on a patch.

use nalgebra::Matrix3;

use super::rows::{Row, Rows};
use crate::coupling::Coupling;
use crate::patch::HapticPatch;

impl Rows {
    /// W \[m/N\] by `yields` of the patch's compliance, by columns without padding, with the compliances of the tool's
    /// pose and of its opening \[rad/(N m)\]. False where a number is not finite.
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
        if tool.only_moves() && self.all_have_friction() {
            return self.frictional_into(tool.c, &places, w);
        }
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

    /// Whether all contacts are on the skin and have three rows.
    fn all_have_friction(&self) -> bool {
        let rows = self.contact.iter().zip(&self.blocks);
        rows.into_iter().all(|(row, block)| row.body.is_none() && block.law.rows() == 3)
    }

    /// The same for such contacts and a tool that gives way by `c` \[m/N\] and does not turn.
    fn frictional_into(&self, c: f64, places: &PlaceBlocks<'_>, w: &mut [f64]) -> bool {
        let m = self.len();
        // 0, or NaN.
        let mut finite = 0.0;
        for (k, a) in self.contact.iter().enumerate() {
            let lines = transposed(&a.frame);
            for (l, b) in self.contact.iter().enumerate().take(k + 1) {
                let mut between = places.columns(a, b);
                (0..3).for_each(|i| between[i][i] += c);
                for s in 0..3 {
                    let moved = times(&between, &[b.frame[(0, s)], b.frame[(1, s)], b.frame[(2, s)], 0.0]);
                    let entries = times(&lines, &moved);
                    finite += 0.0 * (entries[0] + entries[1] + entries[2]);
                    let column = 3 * l + s;
                    // Symmetric to the bit, on the diagonal too.
                    let first = if k == l { s } else { 0 };
                    for (r, entry) in entries.iter().enumerate().take(3).skip(first) {
                        let row = 3 * k + r;
                        (w[column * m + row], w[row * m + column]) = (*entry, *entry);
                    }
                }
            }
        }
        finite == 0.0
    }
}

/// Three columns, each with a zero, as the processor's vectors take them.
type Columns = [[f64; 4]; 3];

/// `A x`.
#[inline(always)]
#[allow(non_snake_case)]
fn times(A: &Columns, x: &[f64; 4]) -> [f64; 4] {
    std::array::from_fn(|i| A[0][i] * x[0] + A[1][i] * x[1] + A[2][i] * x[2])
}

#[allow(non_snake_case)]
fn transposed(A: &Matrix3<f64>) -> Columns {
    std::array::from_fn(|i| [A[(i, 0)], A[(i, 1)], A[(i, 2)], 0.0])
}

/// How the tool gives way behind its couplings.
struct ToolYield {
    /// Translation \[m/N\], rotation and opening \[rad/(N m)\].
    c: f64,
    turning: f64,
    opening: f64,
}

impl ToolYield {
    /// Whether it neither turns nor opens.
    fn only_moves(&self) -> bool {
        self.turning <= 0.0 && self.opening <= 0.0
    }

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
        let columns = self.columns(a, b);
        Matrix3::from_fn(|r, s| columns[s][r])
    }

    /// The same by columns.
    #[inline]
    fn columns(&self, a: &Row, b: &Row) -> Columns {
        let mut sum = [[0.0; 4]; 3];
        for &(q, share) in &b.places[..b.count] {
            for &(p, weight) in &a.places[..a.count] {
                // Nodes that are held fixed come last and have no compliance.
                if 3 * p.max(q) < self.stride {
                    let share = weight * share * self.yields;
                    for (column, sum) in sum.iter_mut().enumerate() {
                        let at = (3 * q + column) * self.stride + 3 * p;
                        if let Some([x, y, z]) = self.compliance.get(at..at + 3) {
                            sum[0] += share * x;
                            sum[1] += share * y;
                            sum[2] += share * z;
                        }
                    }
                }
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Rotation3, Vector3};
    use palpate_constraints::law::Coulomb;
    use palpate_solver::problem::Block;

    use super::*;

    const NODES: usize = 7;

    /// A contact of its own direction, shared by up to three nodes, of which the last is held fixed.
    fn contact(k: usize) -> Row {
        let f = k as f64;
        let frame = Rotation3::from_scaled_axis(Vector3::new(0.3 + f, 0.7 * f, -0.2)).into_inner();
        Row {
            feature: k as u64,
            body: None,
            places: [(k % NODES, 0.5), ((k + 2) % NODES, 0.3), (NODES + k, 0.2)],
            count: 1 + k % 3,
            touches: true,
            frame,
            local: frame,
            lever: Vector3::new(0.01, 0.002 * f, -0.003),
            opens: Vector3::zeros(),
            force: Vector3::zeros(),
            load: Vector3::zeros(),
            slip: Vector3::zeros(),
            stuck: 0,
            owed: crate::tick::patch::known::Owed::NONE,
            gap: 0.0,
        }
    }

    /// A symmetric C (m/N) of nodes that feel one another.
    fn compliance() -> Vec<f64> {
        let n = 3 * NODES;
        let entry =
            |i: usize, j: usize| 1e-3 * (-0.4 * i.abs_diff(j) as f64).exp() * (1.0 + 0.1 * ((i + j) % 3) as f64);
        (0..n * n).map(|k| entry(k / n, k % n)).collect()
    }

    #[test]
    fn frictional_contacts_have_the_same_compliance_side_by_side_and_block_by_block() {
        let mut rows = Rows::new(5, 0);
        for k in 0..5 {
            rows.contact.push(contact(k));
            rows.blocks.push(Block { start: 3 * k, law: Coulomb { friction: 0.5 }.into() });
            rows.delta_free.extend([0.0; 3]);
        }
        let (c, m) = (compliance(), rows.len());
        let places = PlaceBlocks { compliance: &c, stride: 3 * NODES, yields: 0.7 };
        let tool = ToolYield { c: 2e-4, turning: 0.0, opening: 0.0 };
        assert!(tool.only_moves() && rows.all_have_friction());
        let mut w = vec![f64::NAN; m * m];
        assert!(rows.frictional_into(tool.c, &places, &mut w));
        for (l, b) in rows.contact.iter().enumerate() {
            for (k, a) in rows.contact.iter().enumerate() {
                let block = tool.block(a, b, &places);
                for (r, s) in (0..3).flat_map(|r| (0..3).map(move |s| (r, s))) {
                    let (at, mirrored) = ((3 * l + s) * m + 3 * k + r, (3 * k + r) * m + 3 * l + s);
                    assert_eq!(w[at], w[mirrored], "symmetric to the bit");
                    // A few sums of products of numbers up to 1e-3.
                    assert!((w[at] - block[(r, s)]).abs() < 1e-17, "{k} {l}: {} {}", w[at], block[(r, s)]);
                }
            }
        }
        let mut broken = c.clone();
        broken[0] = f64::NAN;
        let places = PlaceBlocks { compliance: &broken, ..places };
        assert!(!rows.frictional_into(tool.c, &places, &mut w), "a number that is not finite is told");
    }
}
