//! GMRES [Saad and Schultz 1986] with a block Gauss-Seidel preconditioner, in single precision and kept memory.
//!
//! For the systems of Newton on soft bodies, which need one to three digits only: the residual of the outer iteration is
//! formed in double precision, and the digits that a step leaves are found by the next one. Single precision halves the
//! memory that an iteration reads, which is what it costs.
//!
//! The matrix is never formed. With `M = P + U`, `P` the blocks on and below the diagonal, one pass over the columns of `W`
//! does the substitution `x = P^-1 v` and leaves `W` times the forces of `x`, from which `M x = M P^-1 v` follows: an
//! iteration costs one product, its preconditioner included.

use crate::coupled_block::{CoupledBlock, Quad, times};
use crate::single::SingleCompliance;
use pulp::{Arch, Simd, WithSimd};

/// Iterations before the solver gives up, where there are as many unknowns. A nearly singular `W` of 150 contacts takes
/// more than 40, and a factorisation costs several times as much as all of these.
const ITERATIONS: usize = 160;

/// Memory of systems of up to a number of blocks.
#[derive(Clone, Debug)]
pub(crate) struct KrylovSpace {
    /// Orthonormal basis, one vector after the other; a quad for each block.
    basis: Vec<Quad>,
    /// The preconditioned basis.
    preconditioned: Vec<Quad>,
    /// Upper triangle of the projected matrix, by columns of `ITERATIONS + 1`.
    hessenberg: Vec<f64>,
    /// Rotations that make it triangular: cosine and sine.
    rotations: Vec<(f64, f64)>,
    /// Rotated right side; then the coefficients of the solution.
    coefficients: Vec<f64>,
    /// `W` times the forces of `x`.
    gap: Vec<f32>,
    work: Vec<Quad>,
    solution: Vec<[f64; 4]>,
}

impl KrylovSpace {
    /// Memory for systems of up to `blocks` blocks on `rows` rows.
    pub(crate) fn with_capacity(blocks: usize, rows: usize) -> Self {
        let basis = || Vec::with_capacity(blocks * (ITERATIONS + 1));
        Self {
            basis: basis(),
            preconditioned: basis(),
            hessenberg: vec![0.0; ITERATIONS * (ITERATIONS + 1)],
            rotations: Vec::with_capacity(ITERATIONS),
            coefficients: Vec::with_capacity(ITERATIONS + 1),
            gap: Vec::with_capacity(SingleCompliance::longest(rows)),
            work: Vec::with_capacity(blocks),
            solution: Vec::with_capacity(blocks),
        }
    }

    /// Solves to a residual of `tolerance` relative to the right side; the solution and the iterations that it took, `None` where that is not reached.
    pub(crate) fn solve(
        &mut self,
        w: &SingleCompliance,
        blocks: &[CoupledBlock],
        right: &[[f64; 4]],
        tolerance: f64,
    ) -> Option<(&[[f64; 4]], usize)> {
        let n = right.len();
        self.basis.clear();
        self.preconditioned.clear();
        self.rotations.clear();
        self.coefficients.clear();
        self.solution.clear();
        self.solution.resize(n, [0.0; 4]);
        self.work.resize(n, [0.0; 4]);
        self.gap.resize(w.length(), 0.0);
        // Scaled in double precision: squares of small gaps leave the range of single precision.
        let size = right.as_flattened().iter().map(|x| x * x).sum::<f64>().sqrt();
        if size == 0.0 {
            return Some((&self.solution, 0));
        }
        if tolerance >= 1.0 {
            return Some((&self.solution, 0));
        }
        if !size.is_finite() {
            return None;
        }
        self.basis.extend(right.iter().map(|quad| quad.map(|x| (x / size) as f32)));
        self.coefficients.push(1.0);
        for k in 0..ITERATIONS.min(3 * n) {
            self.preconditioned.resize((k + 1) * n, [0.0; 4]);
            let (v, x) = (&self.basis[k * n..], &mut self.preconditioned[k * n..]);
            Arch::new().dispatch(Product { w, blocks, v, x, gap: &mut self.gap, product: &mut self.work });
            let left = self.orthogonalise(k)?;
            if left <= tolerance {
                return Some((self.combine(size), k + 1));
            }
        }
        None
    }

    /// Gram-Schmidt of the new vector in `work` against `k + 1` others, and the rotation of its column; returns the
    /// residual that is left, relative. `None` for numbers that are not finite.
    fn orthogonalise(&mut self, k: usize) -> Option<f64> {
        let column = &mut self.hessenberg[k * (ITERATIONS + 1)..(k + 1) * (ITERATIONS + 1)];
        let norm = Arch::new().dispatch(GramSchmidt { basis: &self.basis, vector: &mut self.work, products: column });
        for (i, (cos, sin)) in self.rotations.iter().enumerate() {
            let (a, b) = (column[i], column[i + 1]);
            (column[i], column[i + 1]) = (cos * a + sin * b, cos * b - sin * a);
        }
        let diagonal = (column[k] * column[k] + norm * norm).sqrt();
        if !(diagonal.is_finite() && diagonal > 0.0) {
            return None;
        }
        let (cos, sin) = (column[k] / diagonal, norm / diagonal);
        column[k] = diagonal;
        self.rotations.push((cos, sin));
        let last = self.coefficients[k];
        self.coefficients[k] = cos * last;
        self.coefficients.push(-sin * last);
        // The basis is complete where nothing is left; a division by zero then harms nobody.
        let inverse = (1.0 / norm) as f32;
        self.basis.extend(self.work.iter().map(|quad| quad.map(|x| x * inverse)));
        Some((sin * last).abs())
    }

    /// The solution `P^-1 V y` from the triangular system of the `y`.
    fn combine(&mut self, size: f64) -> &[[f64; 4]] {
        let k = self.rotations.len();
        let entry = |i: usize, j: usize| self.hessenberg[j * (ITERATIONS + 1) + i];
        for j in (0..k).rev() {
            self.coefficients[j] /= entry(j, j);
            for i in 0..j {
                self.coefficients[i] -= entry(i, j) * self.coefficients[j];
            }
        }
        for (x, y) in self.preconditioned.chunks_exact(self.work.len()).zip(&self.coefficients[..k]) {
            let y = y * size;
            for (z, x) in self.solution.as_flattened_mut().iter_mut().zip(x.as_flattened()) {
                *z += y * f64::from(*x);
            }
        }
        &self.solution
    }
}

/// `x = P^-1 v` and `product = M x`.
struct Product<'a> {
    w: &'a SingleCompliance,
    blocks: &'a [CoupledBlock],
    v: &'a [Quad],
    x: &'a mut [Quad],
    gap: &'a mut [f32],
    product: &'a mut [Quad],
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { w, blocks, v, x, gap, product } = self;
        gap.fill(0.0);
        for (block, (v, x)) in blocks.iter().zip(v.iter().zip(x.iter_mut())) {
            let (force, unknowns) = block.substitute(v, &block.read(gap));
            *x = unknowns;
            w.add(simd, block.place, block.rows, &force, gap);
        }
        for (block, (x, product)) in blocks.iter().zip(x.iter().zip(product)) {
            *product = times(&block.tests, &block.read(gap));
            for i in 0..4 {
                product[i] += block.own[i] * x[i];
            }
        }
    }
}

/// Modified Gram-Schmidt of `vector` against each vector of `basis`; the result is the norm of what is left.
struct GramSchmidt<'a> {
    basis: &'a [Quad],
    vector: &'a mut [Quad],
    products: &'a mut [f64],
}

impl WithSimd for GramSchmidt<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let Self { basis, vector, products } = self;
        for (product, other) in products.iter_mut().zip(basis.chunks_exact(vector.len())) {
            let h = dot(other, vector);
            for (v, o) in vector.iter_mut().zip(other) {
                for i in 0..4 {
                    v[i] -= h * o[i];
                }
            }
            *product = f64::from(h);
        }
        f64::from(dot(vector, vector)).sqrt()
    }
}

/// Scalar product in sixteen partial sums, whatever the width of the processor's vectors.
#[inline(always)]
fn dot(a: &[Quad], b: &[Quad]) -> f32 {
    let mut sums = [[0.0_f32; 4]; 4];
    let ((left, left_rest), (right, right_rest)) = (a.as_chunks::<4>(), b.as_chunks::<4>());
    for (a, b) in left.iter().zip(right) {
        for j in 0..4 {
            for i in 0..4 {
                sums[j][i] += a[j][i] * b[j][i];
            }
        }
    }
    for (a, b) in left_rest.iter().zip(right_rest) {
        for i in 0..4 {
            sums[0][i] += a[i] * b[i];
        }
    }
    sums.as_flattened().iter().sum()
}
