//! What is stuffed: a continuous function, positive inside.

use nalgebra::Vector3;

/// A body as the set where a continuous function is positive.
pub trait LevelSet {
    /// Positive inside, negative outside, about the distance (m) to the surface near it.
    fn value(&self, point: &Vector3<f64>) -> f64;

    /// Lower and upper corner (m) of a box that holds the body.
    fn bounds(&self) -> [Vector3<f64>; 2];
}

/// A level set moved outward by `shift` and grown by bumps around given points.
pub(super) struct Grown<'a, L: ?Sized> {
    pub(super) base: &'a L,
    /// Added everywhere (m).
    pub(super) shift: f64,
    /// Where the body is grown (m).
    pub(super) bumps: Vec<Vector3<f64>>,
    /// Height at the middle of a bump (m); it falls to zero, smoothly, at `BUMP_REACH` heights.
    pub(super) height: f64,
}

/// Radius of a bump in units of its height.
const BUMP_REACH: f64 = 3.0;

impl<L: LevelSet + ?Sized> LevelSet for Grown<'_, L> {
    fn value(&self, point: &Vector3<f64>) -> f64 {
        let mut value = self.base.value(point) + self.shift;
        let reach = BUMP_REACH * self.height;
        for centre in &self.bumps {
            let fall = 1.0 - (point - centre).norm_squared() / (reach * reach);
            if fall > 0.0 {
                value += self.height * fall * fall;
            }
        }
        value
    }

    fn bounds(&self) -> [Vector3<f64>; 2] {
        let grow = self.shift.max(0.0) + if self.bumps.is_empty() { 0.0 } else { self.height };
        let [low, high] = self.base.bounds();
        [low.add_scalar(-grow), high.add_scalar(grow)]
    }
}
