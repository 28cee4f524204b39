//! GMRES [Saad and Schultz 1986] with a Gauss-Seidel preconditioner, in single precision and kept memory.
//!
//! For the systems of Newton on soft bodies, which need three to five digits only: the residual of the outer iteration is
//! formed in double precision, and the digits that a step leaves are found by the next one. Single precision halves the
//! memory that an iteration reads, which is what it costs.
//!
//! With `M = P + U`, `P` the lower triangle with the diagonal, the preconditioned operator is `M P^-1 = 1 + U P^-1`
//! [Eisenstat 1981]: one pass over the columns does the substitution and the product.

/// Iterations before the solver gives up: beyond about this many a factorisation costs less.
const ITERATIONS: usize = 40;

/// Columns taken at once, so that the vector is read and written once for all of them.
const WIDTH: usize = 4;

/// Memory of systems of up to a number of unknowns.
#[derive(Clone, Debug)]
pub(crate) struct KrylovSystem {
    /// The matrix by columns, with the right side behind it.
    numbers: Vec<f32>,
    rows: usize,
    /// Orthonormal basis, one vector after the other.
    basis: Vec<f32>,
    /// Upper triangle of the projected matrix, by columns of `ITERATIONS + 1`.
    hessenberg: Vec<f64>,
    /// Rotations that make it triangular: cosine and sine.
    rotations: Vec<(f64, f64)>,
    /// Rotated right side; then the coefficients of the solution.
    coefficients: Vec<f64>,
    work: Vec<f32>,
    solution: Vec<f64>,
    capacity: usize,
}

impl KrylovSystem {
    pub(crate) fn with_capacity(capacity: usize) -> Self {
        Self {
            numbers: Vec::with_capacity(capacity * (capacity + 1)),
            rows: 0,
            basis: Vec::with_capacity(capacity * (ITERATIONS + 1)),
            hessenberg: vec![0.0; ITERATIONS * (ITERATIONS + 1)],
            rotations: Vec::with_capacity(ITERATIONS),
            coefficients: Vec::with_capacity(ITERATIONS + 1),
            work: Vec::with_capacity(capacity),
            solution: Vec::with_capacity(capacity),
            capacity,
        }
    }

    /// Sizes the system to `rows` unknowns; numbers are as they were. Past the capacity it becomes empty.
    pub(crate) fn reset(&mut self, rows: usize) {
        self.rows = if rows <= self.capacity { rows } else { 0 };
        self.numbers.resize(self.rows * (self.rows + 1), 0.0);
    }

    /// Column `j` of the matrix; the right side for `j` the number of unknowns.
    pub(crate) fn column_mut(&mut self, j: usize) -> &mut [f32] {
        let rows = self.rows;
        self.numbers.get_mut(j * rows..(j + 1) * rows).unwrap_or(&mut [])
    }

    /// Solves to a residual of `tolerance` relative to the right side; `None` where that is not reached.
    pub(crate) fn solve(&mut self, tolerance: f64) -> Option<&[f64]> {
        let n = self.rows;
        let right = &self.numbers[n * n..];
        self.basis.clear();
        self.rotations.clear();
        self.coefficients.clear();
        self.solution.clear();
        // Scaled in double precision: squares of small gaps leave the range of single precision.
        let size = right.iter().map(|x| f64::from(*x) * f64::from(*x)).sum::<f64>().sqrt();
        if size == 0.0 {
            self.solution.resize(n, 0.0);
            return Some(&self.solution);
        }
        if !size.is_finite() {
            return None;
        }
        self.basis.extend(right.iter().map(|x| (f64::from(*x) / size) as f32));
        self.coefficients.push(1.0);
        let mut reached = false;
        for k in 0..ITERATIONS.min(n) {
            self.work.clear();
            self.work.extend_from_slice(&self.basis[k * n..]);
            substitute(&self.numbers[..n * n], n, &mut self.work, None);
            // 1 + U P^-1: the pass leaves -U P^-1 of the vector.
            for (product, v) in self.work.iter_mut().zip(&self.basis[k * n..]) {
                *product = v - *product;
            }
            let left = self.orthogonalise(k)?;
            if left <= tolerance {
                reached = true;
                break;
            }
        }
        reached.then(|| self.combine(size))
    }

    /// Gram-Schmidt of the new vector in `work` against `k + 1` others, and the rotation of its column; returns the
    /// residual that is left, relative. `None` for numbers that are not finite.
    fn orthogonalise(&mut self, k: usize) -> Option<f64> {
        let n = self.rows;
        let column = &mut self.hessenberg[k * (ITERATIONS + 1)..(k + 1) * (ITERATIONS + 1)];
        for (entry, v) in column.iter_mut().zip(self.basis.chunks_exact(n)) {
            let h = dot(v, &self.work);
            for (w, v) in self.work.iter_mut().zip(v) {
                *w -= h * v;
            }
            *entry = f64::from(h);
        }
        let norm = f64::from(dot(&self.work, &self.work)).sqrt();
        for (i, (cos, sin)) in self.rotations.iter().enumerate() {
            let (a, b) = (column[i], column[i + 1]);
            (column[i], column[i + 1]) = (cos * a + sin * b, cos * b - sin * a);
        }
        let diagonal = column[k].hypot(norm);
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
        self.basis.extend(self.work.iter().map(|w| w * inverse));
        Some((sin * last).abs())
    }

    /// The solution `P^-1 V y` from the triangular system of the `y`.
    fn combine(&mut self, size: f64) -> &[f64] {
        let (n, k) = (self.rows, self.rotations.len());
        let entry = |i: usize, j: usize| self.hessenberg[j * (ITERATIONS + 1) + i];
        for j in (0..k).rev() {
            self.coefficients[j] /= entry(j, j);
            for i in 0..j {
                self.coefficients[i] -= entry(i, j) * self.coefficients[j];
            }
        }
        self.work.clear();
        self.work.resize(n, 0.0);
        for (v, y) in self.basis.chunks_exact(n).zip(&self.coefficients[..k]) {
            let y = *y as f32;
            for (w, v) in self.work.iter_mut().zip(v) {
                *w += y * v;
            }
        }
        self.solution.resize(n, 0.0);
        substitute(&self.numbers[..n * n], n, &mut self.work, Some(&mut self.solution));
        self.solution.iter_mut().for_each(|z| *z *= size);
        &self.solution
    }
}

/// Forward substitution `x = P^-1 r` that goes on through the upper triangle: `r` becomes `-U x`, and `x` goes to `out`.
fn substitute(matrix: &[f32], n: usize, r: &mut [f32], mut out: Option<&mut Vec<f64>>) {
    let mut columns = matrix.chunks_exact(n * WIDTH);
    let mut first = 0;
    for four in &mut columns {
        // The unknowns of the diagonal block, then all other rows at once.
        let mut x = [0.0_f32; WIDTH];
        for j in 0..WIDTH {
            let value = r[first + j] / four[j * n + first + j];
            x[j] = value;
            for i in j + 1..WIDTH {
                r[first + i] -= four[j * n + first + i] * value;
            }
        }
        for j in 0..WIDTH {
            // What the columns after it leave in the rows of the block.
            r[first + j] = -(j + 1..WIDTH).map(|c| four[c * n + first + j] * x[c]).sum::<f32>();
        }
        let (a, rest) = four.split_at(n);
        let (b, rest) = rest.split_at(n);
        let (c, d) = rest.split_at(n);
        for range in [0..first, first + WIDTH..n] {
            let entries =
                a[range.clone()].iter().zip(&b[range.clone()]).zip(c[range.clone()].iter().zip(&d[range.clone()]));
            for (r, ((a, b), (c, d))) in r[range].iter_mut().zip(entries) {
                *r -= (a * x[0] + b * x[1]) + (c * x[2] + d * x[3]);
            }
        }
        if let Some(out) = out.as_deref_mut() {
            for (z, x) in out.iter_mut().skip(first).zip(x) {
                *z = f64::from(x);
            }
        }
        first += WIDTH;
    }
    for column in columns.remainder().chunks_exact(n) {
        let x = r[first] / column[first];
        for (r, a) in r.iter_mut().zip(column) {
            *r -= a * x;
        }
        r[first] = 0.0;
        if let Some(z) = out.as_deref_mut().and_then(|out| out.get_mut(first)) {
            *z = f64::from(x);
        }
        first += 1;
    }
}

/// Scalar product in eight partial sums.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0_f32; 8];
    let (left, right) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f32 = left.remainder().iter().zip(right.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in left.zip(right) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += a * b;
        }
    }
    sums.iter().sum::<f32>() + rest
}
