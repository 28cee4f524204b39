//! Anderson's acceleration of a fixed point `x = g(x)` [Anderson 1965; Walker and Ni 2011, type II].
//!
//! ```text
//! f = g(x) - x ,  gamma minimises |f - dF gamma| ,  next x = g(x) - (dX + dF) gamma
//! ```
//!
//! The columns of `dX` and `dF` are the last changes of `x` and `f`. On a linear map of dimension `d` the fixed point
//! is found after `d + 1` values of `g`, whatever its rate. Least squares by Gram and Schmidt, newest change first; a
//! change that says nothing beside newer ones is left out.

/// Changes that are remembered.
const DEPTH: usize = 10;

/// Part of a change of `f` that newer ones do not explain, below which it is left out: its direction would be rounding.
const NEW: f64 = 1e-6;

/// The last changes of vectors of one length, newest first, one after another.
#[derive(Clone, Debug, Default)]
pub(crate) struct Anderson {
    x: Vec<f64>,
    f: Vec<f64>,
    /// What the changes so far do not explain of `f`.
    rest: Vec<f64>,
    dx: Vec<f64>,
    df: Vec<f64>,
    /// Orthonormal directions of the changes of `f`, and the change of `x + f` that belongs to each.
    along: Vec<f64>,
    moved: Vec<f64>,
    known: usize,
}

impl Anderson {
    /// Memory for vectors of up to `length` numbers.
    pub(crate) fn with_capacity(length: usize) -> Self {
        let one = || Vec::with_capacity(length);
        let all = || Vec::with_capacity(DEPTH * length);
        Self { x: one(), f: one(), rest: one(), dx: all(), df: all(), along: all(), moved: all(), known: 0 }
    }

    /// Forgets all: the next step is plain.
    pub(crate) fn restart(&mut self) {
        self.x.clear();
        self.known = 0;
    }

    /// Moves `x` to the next iterate, where `g` is the map's value at `x`.
    pub(crate) fn step(&mut self, x: &mut [f64], g: &[f64]) {
        let n = x.len().min(g.len());
        if self.x.len() == n && n > 0 {
            self.remember(x, g);
        } else {
            self.restart();
            self.x.resize(n, 0.0);
            self.f.resize(n, 0.0);
            [&mut self.dx, &mut self.df, &mut self.along, &mut self.moved]
                .into_iter()
                .for_each(|all| all.resize(DEPTH * n, 0.0));
        }
        for (i, (x, g)) in x.iter().zip(g).enumerate() {
            (self.x[i], self.f[i]) = (*x, g - x);
        }
        x.iter_mut().zip(g).for_each(|(x, g)| *x = *g);
        self.correct(x);
    }

    /// Adds the change from the last iterate to this one.
    fn remember(&mut self, x: &[f64], g: &[f64]) {
        let n = self.x.len();
        self.dx.copy_within(..(DEPTH - 1) * n, n);
        self.df.copy_within(..(DEPTH - 1) * n, n);
        for i in 0..n {
            self.dx[i] = x[i] - self.x[i];
            self.df[i] = g[i] - x[i] - self.f[i];
        }
        self.known = (self.known + 1).min(DEPTH);
    }

    /// Takes from `x` what the changes explain of `f`.
    fn correct(&mut self, x: &mut [f64]) {
        let n = self.x.len();
        self.rest.clear();
        self.rest.extend_from_slice(&self.f);
        let mut kept = 0;
        for k in 0..self.known {
            let (dx, df) = (&self.dx[k * n..][..n], &self.df[k * n..][..n]);
            let (older, along) = self.along.split_at_mut(kept * n);
            let (older_moved, moved) = self.moved.split_at_mut(kept * n);
            let (along, moved) = (&mut along[..n], &mut moved[..n]);
            along.copy_from_slice(df);
            moved.iter_mut().zip(dx.iter().zip(df)).for_each(|(m, (dx, df))| *m = dx + df);
            for (q, p) in older.chunks_exact(n).zip(older_moved.chunks_exact(n)) {
                let share = dot(q, along);
                along.iter_mut().zip(q).for_each(|(a, q)| *a -= share * q);
                moved.iter_mut().zip(p).for_each(|(m, p)| *m -= share * p);
            }
            let (whole, left) = (dot(df, df).sqrt(), dot(along, along).sqrt());
            let says_nothing = left <= NEW * whole;
            if says_nothing || !left.is_finite() {
                continue;
            }
            along.iter_mut().for_each(|a| *a /= left);
            moved.iter_mut().for_each(|m| *m /= left);
            let share = dot(along, &self.rest);
            self.rest.iter_mut().zip(&*along).for_each(|(f, a)| *f -= share * a);
            x.iter_mut().zip(&*moved).for_each(|(x, m)| *x -= share * m);
            kept += 1;
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A linear map of dimension four that contracts by 0.99 at most: plain iteration gains two digits in 460 steps.
    #[test]
    fn a_linear_fixed_point_is_found_after_as_many_steps_as_it_has_dimensions() {
        let rates = [0.99, -0.9, 0.5, 0.1];
        let fixed = [1.0, -2.0, 3.0, 0.5];
        // Not diagonal: each rate along a direction of its own.
        let map = |x: &[f64]| -> Vec<f64> {
            let along = |i: usize, x: &[f64]| x[i] - fixed[i] + 0.3 * (x[(i + 1) % 4] - fixed[(i + 1) % 4]);
            (0..4).map(|i| fixed[i] + 0.7 * rates[i] * along(i, x)).collect()
        };
        let away = |x: &[f64]| x.iter().zip(fixed).map(|(x, f)| (x - f).abs()).fold(0.0, f64::max);
        let mut anderson = Anderson::with_capacity(4);
        for _ in 0..2 {
            let (mut plain, mut x) = (vec![0.0; 4], vec![0.0; 4]);
            for _ in 0..5 {
                plain = map(&plain);
                let g = map(&x);
                anderson.step(&mut x, &g);
            }
            assert!(away(&x) < 1e-12 && away(&plain) > 1e-2, "{x:?} {plain:?}");
            // What was learned of another start is forgotten.
            anderson.restart();
        }
    }

    #[test]
    fn a_change_that_says_nothing_new_does_no_harm() {
        let mut anderson = Anderson::with_capacity(1);
        let mut x = [0.0];
        // The map's value is constant: from the second step on all changes are nought.
        for _ in 0..20 {
            anderson.step(&mut x, &[2.0]);
        }
        assert_eq!(x, [2.0]);
    }
}
