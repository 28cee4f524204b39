//! Contact frames.
//!
//! An orthonormal right-handed frame `[n, t, s]` from the normal alone, after Duff, Burgess, Christensen, Hery, Kensler,
//! Liani, Villemin, Building an Orthonormal Basis, Revisited, JCGT 6(1), 2017. It needs no branch and no square root,
//! gives the same tangents for the same normal, and is continuous but for the plane `n_z = 0`, where the tangents jump.
//! Coulomb's cone is round, so no force depends on the tangents; forces carried between steps are kept in the world
//! frame for the same reason.

use nalgebra::Vector3;

/// Directions of the rows of one contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactFrame {
    /// Normal `n`: from the tool towards the tissue.
    pub normal: Vector3<f64>,
    /// Tangents `t` and `s`, with `n = t x s`.
    pub tangents: [Vector3<f64>; 2],
}

impl ContactFrame {
    /// The frame of a unit normal.
    pub fn new(normal: Vector3<f64>) -> Self {
        let n = &normal;
        let sign = 1.0f64.copysign(n.z);
        let a = -1.0 / (sign + n.z);
        let b = n.x * n.y * a;
        let t = Vector3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x);
        let s = Vector3::new(b, sign + n.y * n.y * a, -n.y);
        Self { normal, tangents: [t, s] }
    }

    /// The direction of row 0 (normal), 1 or 2 (tangents) of a contact.
    pub fn directions(&self) -> [Vector3<f64>; 3] {
        [self.normal, self.tangents[0], self.tangents[1]]
    }

    /// The world vector of components `[n]` or `[n, t, s]`; missing components are zero.
    pub fn to_world(&self, components: &[f64]) -> Vector3<f64> {
        self.directions().iter().zip(components).map(|(d, c)| d * *c).sum()
    }

    /// Components `[n, t, s]` of a world vector.
    pub fn to_local(&self, v: &Vector3<f64>) -> [f64; 3] {
        self.directions().map(|d| d.dot(v))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Orthonormal and right-handed to rounding for every direction, poles included.
        #[test]
        fn frame_is_orthonormal(x in -1.0..1.0f64, y in -1.0..1.0f64, z in -1.0..1.0f64, pole in 0..4) {
            let v = match pole {
                0 => Vector3::new(1e-9 * x, 1e-9 * y, -1.0),
                1 => Vector3::new(x, y, 0.0),
                _ => Vector3::new(x, y, z),
            };
            prop_assume!(v.norm() > 1e-3);
            let frame = ContactFrame::new(v.normalize());
            let d = frame.directions();
            for i in 0..3 {
                for j in 0..3 {
                    let expected = if i == j { 1.0 } else { 0.0 };
                    prop_assert!((d[i].dot(&d[j]) - expected).abs() < 1e-14);
                }
            }
            prop_assert!((frame.tangents[0].cross(&frame.tangents[1]) - frame.normal).norm() < 1e-14);
            let force = Vector3::new(0.3, -0.7, 0.2);
            prop_assert!((frame.to_world(&frame.to_local(&force)) - force).norm() < 1e-14);
        }
    }
}
