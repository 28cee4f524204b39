//! Moments against closed forms.

use nalgebra::{Matrix3, Rotation3, Vector3};
use palpate_rigid::Moments;

fn near(a: &Moments, b: &Moments, tolerance: f64) {
    let length = b.volume.cbrt();
    assert!((a.volume - b.volume).abs() < tolerance * b.volume, "{} {}", a.volume, b.volume);
    assert!((a.centroid - b.centroid).norm() < tolerance * length, "{} {}", a.centroid, b.centroid);
    assert!((a.inertia - b.inertia).norm() < tolerance * b.inertia.norm(), "{} {}", a.inertia, b.inertia);
}

/// A box between two corners, by its twelve triangles.
fn block(low: Vector3<f64>, high: Vector3<f64>) -> (Vec<Vector3<f64>>, Vec<[u32; 3]>) {
    let corner = |k: usize| Vector3::from_fn(|c, _| if k >> c & 1 == 0 { low[c] } else { high[c] });
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    ((0..8).map(corner).collect(), triangles)
}

#[test]
fn a_box_has_the_moments_of_a_box_wherever_it_lies_and_however_it_is_turned() {
    let size = Vector3::new(0.3, 0.2, 0.5);
    let volume = size.product();
    let [a, b, c] = [size.x * size.x, size.y * size.y, size.z * size.z];
    let inertia = Matrix3::from_diagonal(&(Vector3::new(b + c, a + c, a + b) * (volume / 12.0)));
    let (vertices, triangles) = block(-0.5 * size, 0.5 * size);
    near(&Moments::of_surface(&vertices, &triangles), &Moments { volume, centroid: Vector3::zeros(), inertia }, 1e-14);
    let (turn, shift) = (Rotation3::new(Vector3::new(0.4, -1.0, 0.7)), Vector3::new(30.0, -7.0, 11.0));
    let moved: Vec<_> = vertices.iter().map(|v| turn * v + shift).collect();
    let expected = Moments { volume, centroid: shift, inertia: turn * inertia * turn.transpose() };
    // Far from the origin the digits of the coordinates are what is left.
    near(&Moments::of_surface(&moved, &triangles), &expected, 1e-11);
}

#[test]
fn a_capsule_without_length_is_a_ball_and_a_long_one_a_cylinder() {
    near(&Moments::of_capsule(0.0, 0.3), &Moments::of_sphere(0.3), 1e-15);
    let (half, r) = (50.0, 0.01);
    let volume = std::f64::consts::PI * r * r * 2.0 * half;
    let across = volume * (0.25 * r * r + half * half / 3.0);
    let rod = Moments {
        volume,
        centroid: Vector3::zeros(),
        inertia: Matrix3::from_diagonal(&Vector3::new(across, across, 0.5 * volume * r * r)),
    };
    // The half balls are a part of 4 r / 3 in 2 · 50 m.
    near(&Moments::of_capsule(half, r), &rod, 1e-3);
}

/// A capsule as a fine surface of revolution.
#[test]
fn a_capsule_has_the_moments_of_its_surface() {
    let (half, r, n, m) = (0.04, 0.03, 96, 192);
    let mut vertices = vec![Vector3::new(0.0, 0.0, -half - r)];
    for i in 1..2 * n {
        let angle = std::f64::consts::PI * f64::from(i) / f64::from(2 * n);
        // The ring at the equator is drawn out into the cylinder.
        let z = -r * angle.cos() + if i <= n { -half } else { half };
        let again = if i == n { vec![z, z + 2.0 * half] } else { vec![z] };
        for z in again {
            for j in 0..m {
                let turn = std::f64::consts::TAU * f64::from(j) / f64::from(m);
                vertices.push(Vector3::new(r * angle.sin() * turn.cos(), r * angle.sin() * turn.sin(), z));
            }
        }
    }
    let rings = (vertices.len() as u32 - 1) / m as u32;
    vertices.push(Vector3::new(0.0, 0.0, half + r));
    let (m, last) = (m as u32, vertices.len() as u32 - 1);
    let at = |ring: u32, j: u32| 1 + ring * m + j % m;
    let mut triangles = Vec::new();
    for j in 0..m {
        triangles.push([0, at(0, j + 1), at(0, j)]);
        triangles.push([last, at(rings - 1, j), at(rings - 1, j + 1)]);
        for i in 0..rings - 1 {
            triangles.push([at(i, j), at(i, j + 1), at(i + 1, j + 1)]);
            triangles.push([at(i, j), at(i + 1, j + 1), at(i + 1, j)]);
        }
    }
    // Chords of 2π / 192 lie inside by a thousandth.
    near(&Moments::of_surface(&vertices, &triangles), &Moments::of_capsule(half, r), 1e-3);
}
