//! A round rod of tetrahedra.

use nalgebra::Vector3;
use palpate::fem::block::{block, evenly};
use palpate::fem::mesh::TetMesh;

/// A rod of `radius` (m) along z from 0 to `length` (m): `across` cells over the diameter (even), `along` its length.
///
/// A square of cells is mapped onto the disc so that lines at equal distance from the centre become circles; the flat
/// sides lie within the circle ([`widen`]).
pub(crate) fn rod(radius: f64, length: f64, across: usize, along: usize) -> TetMesh {
    let side = evenly(-1.0, 1.0, across);
    let mut mesh = block(&side, &side, &evenly(0.0, length, along));
    for x in &mut mesh.nodes {
        let flat = disc(x.x, x.y);
        *x = Vector3::new(radius * flat.0, radius * flat.1, x.z);
    }
    mesh
}

/// The square `[-1, 1]²` to the unit disc: its rings become circles, its corners points of the circle.
fn disc(x: f64, y: f64) -> (f64, f64) {
    let ring = x.abs().max(y.abs());
    if ring == 0.0 {
        return (0.0, 0.0);
    }
    // The angle grows evenly along each quarter of the ring.
    let quarter = std::f64::consts::FRAC_PI_4;
    let angle = if x.abs() >= y.abs() {
        quarter * y / x + if x < 0.0 { 4.0 * quarter } else { 0.0 }
    } else {
        2.0 * quarter - quarter * x / y + if y < 0.0 { 4.0 * quarter } else { 0.0 }
    };
    (ring * angle.cos(), ring * angle.sin())
}

/// Widens a rod of flat sides so that its cross-section has the disc's second moment `pi r⁴ / 4`, which bending feels.
pub(crate) fn widen(mesh: &mut TetMesh, across: usize) {
    // A regular polygon of n corners on a circle of radius r has the second moment n r⁴ sin(a) (2 + cos(a)) / 24 with
    // a = 2 pi / n; the disc has pi r⁴ / 4.
    let n = 4.0 * across as f64;
    let a = 2.0 * std::f64::consts::PI / n;
    let share = n * a.sin() * (2.0 + a.cos()) / (6.0 * std::f64::consts::PI);
    let factor = share.powf(-0.25);
    for x in &mut mesh.nodes {
        (x.x, x.y) = (x.x * factor, x.y * factor);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rod_has_the_volume_and_second_moment_of_a_cylinder() {
        let (radius, length) = (0.5, 3.0);
        for across in [4, 8] {
            let mut mesh = rod(radius, length, across, 3);
            assert!(mesh.validate().is_ok(), "no tetrahedron is inverted");
            widen(&mut mesh, across);
            // ∫ x² over a tetrahedron: V/20 (Σ x_a² + (Σ x_a)²).
            let second: f64 = mesh
                .tetrahedra
                .iter()
                .map(|t| {
                    let [a, b, c, d] = t.map(|i| mesh.nodes[i as usize]);
                    let volume = (b - a).cross(&(c - a)).dot(&(d - a)) / 6.0;
                    let (sum, squares) = [a, b, c, d].iter().fold((0.0, 0.0), |(s, q), p| (s + p.x, q + p.x * p.x));
                    volume * (squares + sum * sum) / 20.0
                })
                .sum();
            let exact = std::f64::consts::PI * radius.powi(4) / 4.0 * length;
            assert!((second / exact - 1.0).abs() < 1e-12, "{across} cells: {second} against {exact}");
        }
    }
}
