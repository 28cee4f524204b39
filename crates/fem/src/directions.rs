//! Conjugate directions of a matrix that is solved with more than once.

use crate::pcg::dot;

/// Directions `p` with `pᵢᵀ A pⱼ = 0`, and their products `A p`.
#[derive(Clone, Debug)]
pub(crate) struct Directions {
    p: Vec<f64>,
    ap: Vec<f64>,
    /// `pᵀ A p`, positive.
    curvature: Vec<f64>,
    most: usize,
    length: usize,
}

impl Directions {
    /// Memory for `most` directions of some length.
    pub(crate) fn new(most: usize, length: usize) -> Self {
        let numbers = vec![0.0; most * length];
        Self { p: numbers.clone(), ap: numbers, curvature: Vec::with_capacity(most), most, length }
    }

    pub(crate) fn len(&self) -> usize {
        self.curvature.len()
    }

    pub(crate) fn clear(&mut self) {
        self.curvature.clear();
    }

    /// Keeps a direction, where there is room and it is one.
    pub(crate) fn push(&mut self, p: &[f64], ap: &[f64], curvature: f64) {
        if self.len() < self.most && curvature > 0.0 {
            let place = self.len() * self.length..(self.len() + 1) * self.length;
            self.p[place.clone()].copy_from_slice(p);
            self.ap[place].copy_from_slice(ap);
            self.curvature.push(curvature);
        }
    }

    fn iter(&self) -> impl Iterator<Item = (&[f64], &[f64], f64)> {
        let vectors = self.p.chunks_exact(self.length.max(1)).zip(self.ap.chunks_exact(self.length.max(1)));
        vectors.zip(&self.curvature).map(|((p, ap), curvature)| (p, ap, *curvature))
    }

    /// Makes the residual `r` of `x` orthogonal to the directions: `x` then has the least error of all that they lead to.
    pub(crate) fn remove_from(&self, r: &mut [f64], x: &mut [f64]) {
        for (p, ap, curvature) in self.iter() {
            let step = dot(p, r) / curvature;
            x.iter_mut().zip(p).for_each(|(x, p)| *x += step * p);
            r.iter_mut().zip(ap).for_each(|(r, ap)| *r -= step * ap);
        }
    }

    /// Makes `direction`, which is `z` and what is conjugate already, conjugate to the first directions.
    pub(crate) fn make_conjugate(&self, first: usize, z: &[f64], direction: &mut [f64]) {
        for (p, ap, curvature) in self.iter().take(first) {
            let share = dot(ap, z) / curvature;
            direction.iter_mut().zip(p).for_each(|(direction, p)| *direction -= share * p);
        }
    }
}
