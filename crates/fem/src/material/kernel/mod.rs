//! Forces and tangent of packs of eight elements, as many per pass as the processor's vectors hold.
//!
//! Without filter a hyperelastic law takes the six pieces of its tangent from edges alone (`six_pieces`); with filter,
//! and for laws of the singular values, the principal frame (`principal`). Results go to [`PackMatrices`],
//! node 0 included.

#![allow(non_snake_case)]

mod frame;
pub mod principal;
mod six_pieces;
mod small_strain;

use pulp::{Arch, Simd, WithSimd};

pub(crate) use self::{
    principal::{PrincipalLaw, principal_forces, principal_pack},
    six_pieces::{six_pieces_energy, six_pieces_forces, six_pieces_pack},
    small_strain::{small_strain_forces, small_strain_pack},
};
use crate::{
    lanes::{Lanes, Mat3, Real, Vec3, cross, dot},
    pack::{DeformedPack, PACK, Pack, PackMatrices, Row},
};

/// The instruction set that a kernel runs on.
pub(crate) trait Dispatch: Copy {
    /// Runs `op` on it.
    fn run<Op: WithSimd>(self, op: Op) -> Op::Output;
}

/// The widest vectors of this machine.
impl Dispatch for Arch {
    #[inline]
    fn run<Op: WithSimd>(self, op: Op) -> Op::Output {
        self.dispatch(op)
    }
}

/// Parts into which `N` vectors of `S` cut the elements of a pack.
#[inline(always)]
pub(crate) fn parts<S: Simd, const N: usize>(pack: &Pack) -> usize {
    pack.len.min(PACK).div_ceil(Lanes::<S, N>::COUNT)
}

/// The pressures on a part of a pack.
#[inline(always)]
fn pressure<S: Simd>(simd: S, at: &DeformedPack<'_>, part: usize) -> Option<Lanes<S>> {
    at.pressure.map(|row| Lanes::load(simd, row, part))
}

/// `J` of elements with deformed edges `e`.
#[inline(always)]
fn jacobian<S: Simd, const N: usize>(simd: S, e: &Mat3<Lanes<S, N>>, pack: &Pack, part: usize) -> Lanes<S, N> {
    dot(&e[0], &cross(&e[1], &e[2])) * Lanes::load(simd, &pack.inverse_det, part)
}

#[inline(always)]
fn load3<S: Simd, const N: usize>(simd: S, rows: &[Row; 3], part: usize) -> Vec3<Lanes<S, N>> {
    [Lanes::load(simd, &rows[0], part), Lanes::load(simd, &rows[1], part), Lanes::load(simd, &rows[2], part)]
}

#[inline(always)]
pub(crate) fn load33<S: Simd, const N: usize>(simd: S, rows: &[[Row; 3]; 3], part: usize) -> Mat3<Lanes<S, N>> {
    [load3(simd, &rows[0], part), load3(simd, &rows[1], part), load3(simd, &rows[2], part)]
}

#[inline(always)]
fn load6<S: Simd, const N: usize>(simd: S, rows: &[Row; 6], part: usize) -> [Lanes<S, N>; 6] {
    [
        Lanes::load(simd, &rows[0], part),
        Lanes::load(simd, &rows[1], part),
        Lanes::load(simd, &rows[2], part),
        Lanes::load(simd, &rows[3], part),
        Lanes::load(simd, &rows[4], part),
        Lanes::load(simd, &rows[5], part),
    ]
}

#[inline(always)]
pub(crate) fn store3<S: Simd, const N: usize>(values: &Vec3<Lanes<S, N>>, rows: &mut [Row; 3], part: usize) {
    for c in 0..3 {
        values[c].store(&mut rows[c], part);
    }
}

#[inline(always)]
fn store33<S: Simd, const N: usize>(values: &Mat3<Lanes<S, N>>, rows: &mut [[Row; 3]; 3], part: usize) {
    for c in 0..3 {
        store3(&values[c], &mut rows[c], part);
    }
}

/// Place of entry `(r, c)` in a stored triangle.
pub(crate) const TRIANGLE: [[usize; 3]; 3] = [[0, 1, 2], [1, 3, 4], [2, 4, 5]];

/// Forces and blocks of the nodes 1, 2, 3.
struct Free<T> {
    /// Forces (N).
    forces: Mat3<T>,
    /// Triangles of `K_11, K_22, K_33` (N/m).
    diagonal: [[T; 6]; 3],
    /// `K_12, K_13, K_23` by columns (N/m).
    off_diagonal: [Mat3<T>; 3],
    /// Volume ratio.
    jacobian: T,
}

/// Writes the forces of all nodes, of which node 0 has minus the sum over the others. Returns that sum over all components.
#[inline(always)]
fn write_forces<S: Simd>([f1, f2, f3]: &Mat3<Lanes<S>>, out: &mut PackMatrices, part: usize) -> Lanes<S> {
    let mut checksum = f1[0].constant(0.0);
    for c in 0..3 {
        let others = f1[c] + f2[c] + f3[c];
        checksum = checksum + others;
        (-others).store(&mut out.forces[0][c], part);
        f1[c].store(&mut out.forces[1][c], part);
        f2[c].store(&mut out.forces[2][c], part);
        f3[c].store(&mut out.forces[3][c], part);
    }
    checksum
}

/// What a kernel without tangent writes: forces, volume ratio and checksum.
#[inline(always)]
fn store_forces<S: Simd>(forces: &Mat3<Lanes<S>>, jacobian: Lanes<S>, out: &mut PackMatrices, part: usize) {
    write_forces(forces, out, part).store(&mut out.checksum, part);
    jacobian.store(&mut out.jacobian, part);
}

impl<S: Simd> Free<Lanes<S>> {
    /// Adds node 0, minus the sum over the others, and writes everything.
    #[inline(always)]
    fn store(&self, out: &mut PackMatrices, part: usize) {
        let mut checksum = write_forces(&self.forces, out, part);
        let [k11, k22, k33] = &self.diagonal;
        let [k12, k13, k23] = &self.off_diagonal;
        for c in 0..3 {
            for r in 0..3 {
                let s = TRIANGLE[r][c];
                let k01 = -(k11[s] + k12[r][c] + k13[r][c]);
                let k02 = -(k12[c][r] + k22[s] + k23[r][c]);
                let k03 = -(k13[c][r] + k23[c][r] + k33[s]);
                k01.store(&mut out.off_diagonal[0][3 * c + r], part);
                k02.store(&mut out.off_diagonal[1][3 * c + r], part);
                k03.store(&mut out.off_diagonal[2][3 * c + r], part);
                k12[c][r].store(&mut out.off_diagonal[3][3 * c + r], part);
                k13[c][r].store(&mut out.off_diagonal[4][3 * c + r], part);
                k23[c][r].store(&mut out.off_diagonal[5][3 * c + r], part);
                if r >= c {
                    (-(k01 + k02 + k03)).store(&mut out.diagonal[0][s], part);
                    k11[s].store(&mut out.diagonal[1][s], part);
                    k22[s].store(&mut out.diagonal[2][s], part);
                    k33[s].store(&mut out.diagonal[3][s], part);
                }
            }
        }
        for k in [k11, k22, k33] {
            checksum = checksum + k[0] + k[3] + k[5];
        }
        checksum.store(&mut out.checksum, part);
        self.jacobian.store(&mut out.jacobian, part);
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Vector3};
    use pulp::{Scalar, Scalar128b, Scalar256b, Scalar512b};

    use super::*;
    use crate::{
        element::Tetrahedron,
        material::{BatchReport, Corotational, Lame, MooneyRivlin, NeoHookean, Ogden, hyperelastic::Hyperelastic},
    };

    /// Vectors without instructions for them.
    macro_rules! emulated {
        ($($simd:ident),+) => {
            $(impl Dispatch for $simd {
                fn run<Op: WithSimd>(self, op: Op) -> Op::Output {
                    op.with_simd(self)
                }
            })+
        };
    }
    emulated!(Scalar, Scalar128b, Scalar256b, Scalar512b);

    /// Eleven elements in two packs, stretched, sheared, flat and inverted.
    fn body() -> (Vec<Pack>, Vec<Vector3<f64>>) {
        let corners = [[0.0; 3], [0.02, 0.001, 0.0], [0.003, 0.02, 0.0], [-0.002, 0.004, 0.02]].map(Vector3::from);
        let (mut elements, mut rest, mut q) = (Vec::new(), Vec::new(), Vec::new());
        for e in 0..11 {
            let first = 4 * e as u32;
            rest.extend(corners);
            elements.extend(Tetrahedron::new([first, first + 1, first + 2, first + 3], &rest));
            let F = Matrix3::new(1.3, 0.2, -0.1 * e as f64, 0.0, 0.8, 0.3, 0.1, 0.0, 1.0 - 0.25 * e as f64);
            q.extend(corners.map(|x| F * x));
        }
        (elements.chunks(PACK).filter_map(Pack::new).collect(), q)
    }

    type Answers = Vec<(PackMatrices, usize)>;

    /// Calls `kernel` for each pack and keeps what it wrote for elements.
    fn answers(kernel: impl Fn(&DeformedPack<'_>, &mut PackMatrices)) -> (Answers, BatchReport) {
        let (packs, q) = body();
        let (mut kept, mut report): (Answers, _) = (Vec::new(), BatchReport::default());
        for (k, pack) in packs.iter().enumerate() {
            let pressure = std::array::from_fn(|lane| 100.0 * lane as f64 - 300.0);
            for pressure in [None, Some(&pressure)] {
                let mut out = PackMatrices::ZERO;
                kernel(&DeformedPack { pressure, ..pack.at(&q) }, &mut out);
                // Places without an element hold what the width of the vectors leaves there.
                let mut of_elements = PackMatrices::ZERO;
                for lane in 0..pack.len {
                    of_elements.set_element(lane, &out.element(lane));
                    of_elements.jacobian[lane] = out.jacobian[lane];
                    of_elements.filtered[lane] = out.filtered[lane];
                }
                out.note((PACK * k) as u32, pack.len, &mut report);
                kept.push((of_elements, pack.len));
            }
        }
        (kept, report)
    }

    fn hyperelastic(dispatch: impl Dispatch, law: &impl Hyperelastic) -> [(Answers, BatchReport); 2] {
        [
            answers(|at, out| six_pieces_pack(dispatch, law, at, out)),
            answers(|at, out| principal_pack(dispatch, law, at, true, out)),
        ]
    }

    fn all(dispatch: impl Dispatch) -> Vec<(Answers, BatchReport)> {
        let (ogden, corotational) = (Ogden::from_young_poisson(5e3, 0.45), Corotational::from_young_poisson(5e3, 0.45));
        let mut all = Vec::from(hyperelastic(dispatch, &NeoHookean::from_young_poisson(5e3, 0.45)));
        all.extend(hyperelastic(dispatch, &MooneyRivlin::from_young_poisson(5e3, 0.45)));
        for filter in [false, true] {
            all.push(answers(|at, out| principal_pack(dispatch, &ogden, at, filter, out)));
            all.push(answers(|at, out| principal_pack(dispatch, &corotational, at, filter, out)));
        }
        let lame = Lame::from_young_poisson(5e3, 0.45);
        all.push(answers(|at, out| small_strain_pack(dispatch, lame, at, out)));
        all
    }

    #[test]
    fn vectors_of_every_width_give_the_same_bits() {
        let widest = all(Arch::new());
        assert!(widest.iter().all(|(_, report)| report.inverted > 0 && report.non_finite.is_none()));
        assert!(widest[1].1.filtered > 0);
        assert_eq!(all(Scalar), widest, "one element at a time");
        assert_eq!(all(Scalar128b), widest, "two");
        assert_eq!(all(Scalar256b), widest, "four");
        assert_eq!(all(Scalar512b), widest, "eight");
    }
}
