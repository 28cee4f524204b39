//! Closest points between points, segments and triangles.
//!
//! Point against triangle follows the region walk of Ericson, Real-Time Collision Detection (2005), 5.1.5; segment
//! against segment his 5.1.9. Every result carries barycentric weights, because a contact acts on nodes.

use nalgebra::Vector3;

use crate::contact::FeatureKind;

/// A point of a triangle by its weights, and the feature that holds it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrianglePoint {
    /// Barycentric weights; they sum to 1 and none is negative.
    pub weights: [f64; 3],
    /// Vertex, edge or inside.
    pub kind: FeatureKind,
    /// Local number of the vertex (0..3) or edge (edge `k` joins vertices `k` and `k + 1`); 0 for the inside.
    pub local: usize,
}

impl TrianglePoint {
    fn vertex(k: usize) -> Self {
        let mut weights = [0.0; 3];
        weights[k] = 1.0;
        Self { weights, kind: FeatureKind::Vertex, local: k }
    }

    fn edge(k: usize, t: f64) -> Self {
        if t <= 0.0 {
            return Self::vertex(k);
        }
        if t >= 1.0 {
            return Self::vertex((k + 1) % 3);
        }
        let mut weights = [0.0; 3];
        weights[k] = 1.0 - t;
        weights[(k + 1) % 3] = t;
        Self { weights, kind: FeatureKind::Edge, local: k }
    }

    /// The point in space.
    pub fn position(&self, corners: &[Vector3<f64>; 3]) -> Vector3<f64> {
        corners[0] * self.weights[0] + corners[1] * self.weights[1] + corners[2] * self.weights[2]
    }
}

/// The point of a triangle that is closest to `p`.
pub fn closest_on_triangle(p: &Vector3<f64>, corners: &[Vector3<f64>; 3]) -> TrianglePoint {
    let [a, b, c] = corners;
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return TrianglePoint::vertex(0);
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return TrianglePoint::vertex(1);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return TrianglePoint::edge(0, d1 / (d1 - d3));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return TrianglePoint::vertex(2);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return TrianglePoint::edge(2, 1.0 - d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        return TrianglePoint::edge(1, (d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let sum = va + vb + vc;
    let (v, w) = (vb / sum, vc / sum);
    TrianglePoint { weights: [1.0 - v - w, v, w], kind: FeatureKind::Triangle, local: 0 }
}

/// The point of a triangle that is closest to the segment from `p` to `q`; where they cross, the crossing.
pub fn closest_to_segment(p: &Vector3<f64>, q: &Vector3<f64>, corners: &[Vector3<f64>; 3]) -> TrianglePoint {
    if let Some(crossing) = crossing(p, q, corners) {
        return crossing;
    }
    let mut best = closest_on_triangle(p, corners);
    let mut best_distance = (best.position(corners) - p).norm_squared();
    let mut offer = |point: TrianglePoint, distance: f64| {
        if distance < best_distance {
            best = point;
            best_distance = distance;
        }
    };
    let end = closest_on_triangle(q, corners);
    offer(end, (end.position(corners) - q).norm_squared());
    for k in 0..3 {
        let (a, b) = (&corners[k], &corners[(k + 1) % 3]);
        let (s, t) = closest_segments(a, b, p, q);
        offer(TrianglePoint::edge(k, s), (a + (b - a) * s - (p + (q - p) * t)).norm_squared());
    }
    best
}

/// Where the segment passes through the inside of the triangle.
fn crossing(p: &Vector3<f64>, q: &Vector3<f64>, corners: &[Vector3<f64>; 3]) -> Option<TrianglePoint> {
    let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
    let (hp, hq) = ((p - corners[0]).dot(&normal), (q - corners[0]).dot(&normal));
    if hp == hq || hp * hq > 0.0 {
        return None;
    }
    let x = p + (q - p) * (hp / (hp - hq));
    let weights = barycentric(&x, corners)?;
    weights.iter().all(|w| *w > 0.0).then_some(TrianglePoint { weights, kind: FeatureKind::Triangle, local: 0 })
}

/// Barycentric weights of the projection of `x` onto the triangle's plane (negative outside); none if degenerate.
pub fn barycentric(x: &Vector3<f64>, corners: &[Vector3<f64>; 3]) -> Option<[f64; 3]> {
    let (ab, ac, ax) = (corners[1] - corners[0], corners[2] - corners[0], x - corners[0]);
    let normal = ab.cross(&ac);
    let area = normal.norm_squared();
    if area.is_nan() || area <= 0.0 {
        return None;
    }
    let v = ax.cross(&ac).dot(&normal) / area;
    let w = ab.cross(&ax).dot(&normal) / area;
    Some([1.0 - v - w, v, w])
}

/// Parameters in `[0, 1]` of the closest points of the segments `a b` and `p q`.
///
/// Where the segments are parallel and overlap, the pair is the one nearest to `a`.
pub fn closest_segments(a: &Vector3<f64>, b: &Vector3<f64>, p: &Vector3<f64>, q: &Vector3<f64>) -> (f64, f64) {
    let (d1, d2, r) = (b - a, q - p, a - p);
    let (aa, ee, f) = (d1.norm_squared(), d2.norm_squared(), d2.dot(&r));
    if aa <= 0.0 {
        return (0.0, if ee > 0.0 { (f / ee).clamp(0.0, 1.0) } else { 0.0 });
    }
    let c = d1.dot(&r);
    if ee <= 0.0 {
        return ((-c / aa).clamp(0.0, 1.0), 0.0);
    }
    let bb = d1.dot(&d2);
    let denominator = aa * ee - bb * bb;
    let s = if denominator > 1e-14 * aa * ee { ((bb * f - c * ee) / denominator).clamp(0.0, 1.0) } else { 0.0 };
    let t = (bb * s + f) / ee;
    if t < 0.0 {
        ((-c / aa).clamp(0.0, 1.0), 0.0)
    } else if t > 1.0 {
        (((bb - c) / aa).clamp(0.0, 1.0), 1.0)
    } else {
        (s, t)
    }
}

/// The part of the segment `p q` that lies over a triangle, in the triangle's normal direction, as parameters.
///
/// None where it passes beside the triangle, or is seen as a point from above.
pub fn overlap(p: &Vector3<f64>, q: &Vector3<f64>, corners: &[Vector3<f64>; 3]) -> Option<(f64, f64)> {
    let (at_p, at_q) = (barycentric(p, corners)?, barycentric(q, corners)?);
    let (mut from, mut to) = (0.0f64, 1.0f64);
    for k in 0..3 {
        let (a, b) = (at_p[k], at_q[k]);
        if a < 0.0 && b < 0.0 {
            return None;
        }
        if a < 0.0 {
            from = from.max(a / (a - b));
        } else if b < 0.0 {
            to = to.min(a / (a - b));
        }
    }
    (from < to).then_some((from, to))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corners() -> [Vector3<f64>; 3] {
        [Vector3::new(0.0, 0.0, 0.0), Vector3::new(1.0, 0.1, 0.2), Vector3::new(0.2, 0.9, -0.1)]
    }

    /// A dense sampling of the triangle finds no closer point, for points all around it.
    #[test]
    fn closest_point_beats_every_sample() {
        let corners = corners();
        for i in 0..500 {
            let f = f64::from(i);
            let p = Vector3::new((f * 0.77).sin() * 1.5, (f * 1.31).cos() * 1.5, (f * 0.37).sin());
            let found = closest_on_triangle(&p, &corners);
            assert!((found.weights.iter().sum::<f64>() - 1.0).abs() < 1e-14);
            assert!(found.weights.iter().all(|w| *w >= 0.0), "{found:?}");
            let distance = (found.position(&corners) - p).norm();
            for a in 0..=20 {
                for b in 0..=20 - a {
                    let (v, w) = (f64::from(a) / 20.0, f64::from(b) / 20.0);
                    let x = corners[0] * (1.0 - v - w) + corners[1] * v + corners[2] * w;
                    assert!(distance <= (x - p).norm() + 1e-14);
                }
            }
        }
    }

    /// The same for segments, against samples of both.
    #[test]
    fn segment_beats_every_sample() {
        let corners = corners();
        for i in 0..200 {
            let f = f64::from(i);
            let p = Vector3::new((f * 0.77).sin() * 1.5, (f * 1.31).cos() * 1.5, (f * 0.37).sin());
            let q = Vector3::new((f * 0.57).cos() * 1.5, (f * 0.91).sin() * 1.5, (f * 1.37).cos());
            let x = closest_to_segment(&p, &q, &corners).position(&corners);
            let on_segment = |x: &Vector3<f64>| {
                let t = ((x - p).dot(&(q - p)) / (q - p).norm_squared()).clamp(0.0, 1.0);
                (p + (q - p) * t - x).norm()
            };
            let distance = on_segment(&x);
            for a in 0..=20 {
                for b in 0..=20 - a {
                    let (v, w) = (f64::from(a) / 20.0, f64::from(b) / 20.0);
                    let y = corners[0] * (1.0 - v - w) + corners[1] * v + corners[2] * w;
                    assert!(distance <= on_segment(&y) + 1e-13);
                }
            }
        }
    }

    #[test]
    fn overlap_is_the_part_above_the_triangle() {
        let corners = [Vector3::zeros(), Vector3::x(), Vector3::y()];
        let (from, to) =
            overlap(&Vector3::new(-1.0, 0.25, 1.0), &Vector3::new(3.0, 0.25, 1.0), &corners).expect("passes over it");
        assert!((from - 0.25).abs() < 1e-15 && (to - 1.75 / 4.0).abs() < 1e-15, "{from} {to}");
        assert_eq!(overlap(&Vector3::new(-1.0, 2.0, 1.0), &Vector3::new(3.0, 2.0, 1.0), &corners), None);
    }
}
