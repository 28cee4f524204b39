//! Closed triangle surfaces: signed distance, stuffing, and what is refused.
#![allow(clippy::print_stdout)] // measured numbers, and why a test was skipped

use crate::bodies::{boundary, euler_characteristic, is_closed_surface};
use nalgebra::Vector3;
use palpate_fem::closed_surface::{ClosedSurface, SurfaceError};
use palpate_fem::stuffing::{Stuffing, StuffingError, stuff_surface};

/// A cube [0, 1]³ of twelve triangles, outward.
fn cube() -> (Vec<Vector3<f64>>, Vec<[u32; 3]>) {
    let vertices = (0..8).map(|i| Vector3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64)).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    (vertices, quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect())
}

/// A sphere of `2 n²` quadrilaterals in latitude and longitude.
fn sphere(radius: f64, n: u32, inward: bool) -> (Vec<Vector3<f64>>, Vec<[u32; 3]>) {
    let mut vertices = Vec::new();
    for i in 0..=n {
        for j in 0..2 * n {
            let (theta, phi) = (std::f64::consts::PI * i as f64 / n as f64, std::f64::consts::PI * j as f64 / n as f64);
            // The poles coincide exactly; the surface must join them.
            let ring = if i == 0 || i == n { 0.0 } else { theta.sin() };
            vertices.push(Vector3::new(ring * phi.cos(), ring * phi.sin(), theta.cos()) * radius);
        }
    }
    let at = |i: u32, j: u32| i * 2 * n + j % (2 * n);
    let mut triangles = Vec::new();
    for i in 0..n {
        for j in 0..2 * n {
            let (p, q, r, s) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            triangles.extend([[p, q, r], [p, r, s]]);
        }
    }
    if inward {
        triangles.iter_mut().for_each(|t| t.swap(0, 1));
    }
    (vertices, triangles)
}

#[test]
fn signed_distance_to_a_cube_is_exact() {
    let (vertices, triangles) = cube();
    let cube = ClosedSurface::new(vertices, triangles).unwrap();
    assert_eq!(cube.volume(), 1.0);
    for n in 0..4000 {
        let coordinate = |k: f64| 3.0 * (f64::from(n) * k).fract() - 1.0;
        // Every eighth coordinate is rounded, so that rays run along edges and faces.
        let x = Vector3::new(coordinate(0.731), coordinate(0.417), coordinate(0.593));
        let x = if n % 8 == 0 { x.map(|c| (4.0 * c).round() / 4.0) } else { x };
        let outside = x.map(|c| (-c).max(c - 1.0).max(0.0)).norm();
        let inside = x.iter().map(|c| c.min(1.0 - c)).fold(f64::INFINITY, f64::min);
        let expected = if outside > 0.0 { -outside } else { inside };
        assert!((cube.signed_distance(&x) - expected).abs() < 1e-14, "at {x:?}: {}", cube.signed_distance(&x));
    }
}

#[test]
fn a_sphere_of_triangles_is_stuffed_on_its_surface() {
    let (vertices, triangles) = sphere(0.05, 40, false);
    let surface = ClosedSurface::new(vertices, triangles).unwrap();
    let (mesh, report) = stuff_surface(&surface, &Stuffing { cell: 0.008, ..Stuffing::default() }).unwrap();
    println!("{} nodes, {} tetrahedra, {:?}", report.nodes, report.tetrahedra, report.quality);
    let triangles = boundary(&mesh);
    assert!(is_closed_surface(&triangles) && euler_characteristic(&triangles) == 2);
    for &node in triangles.iter().flatten() {
        assert!(surface.signed_distance(&mesh.nodes[node as usize]).abs() < 1e-10);
    }
    assert!((report.quality.volume / surface.volume() - 1.0).abs() < 0.02);
    assert!(report.quality.smallest_dihedral.to_degrees() > 10.7);
    assert_eq!(mesh.region_names, ["body"]);
}

#[test]
fn an_inner_shell_is_a_void_and_a_reversed_surface_is_turned() {
    let (mut vertices, mut triangles) = sphere(0.05, 24, false);
    let (inner, inner_triangles) = sphere(0.02, 24, true);
    let offset = vertices.len() as u32;
    vertices.extend(inner);
    triangles.extend(inner_triangles.iter().map(|t| t.map(|v| v + offset)));
    let reversed: Vec<_> = triangles.iter().map(|t| [t[1], t[0], t[2]]).collect();
    for triangles in [triangles, reversed] {
        let surface = ClosedSurface::new(vertices.clone(), triangles).unwrap();
        assert!(surface.signed_distance(&Vector3::zeros()) < 0.0);
        assert!(surface.signed_distance(&Vector3::new(0.035, 0.001, 0.002)) > 0.0);
        let (mesh, report) = stuff_surface(&surface, &Stuffing { cell: 0.008, ..Stuffing::default() }).unwrap();
        assert_eq!(euler_characteristic(&boundary(&mesh)), 4, "two spheres");
        assert!((report.quality.volume / surface.volume() - 1.0).abs() < 0.03);
    }
}

#[test]
fn open_crowded_and_twisted_surfaces_are_refused_with_counts() {
    let (vertices, triangles) = cube();
    let mut open = triangles.clone();
    open.pop();
    let error = ClosedSurface::new(vertices.clone(), open).unwrap_err();
    assert!(matches!(error, SurfaceError::NotClosed { open: 3, crowded: 0, edges: 18, .. }), "{error}");
    assert!(error.to_string().contains("3 of 18 edges") && error.to_string().contains("Close Holes"));

    let mut crowded = triangles.clone();
    crowded.push([0, 7, 1]);
    let error = ClosedSurface::new(vertices.clone(), crowded).unwrap_err();
    assert!(matches!(error, SurfaceError::NotClosed { crowded: 1.., .. }), "{error}");

    let mut twisted = triangles.clone();
    twisted[0].swap(0, 1);
    let error = ClosedSurface::new(vertices.clone(), twisted).unwrap_err();
    assert!(matches!(error, SurfaceError::NotOriented { edges: 3 }), "{error}");

    for (vertices, triangles) in [
        (Vec::new(), Vec::new()),
        (vertices.clone(), vec![[0, 1, 8]]),
        (vertices.clone(), vec![[0, 0, 1]]),
        (vec![Vector3::repeat(f64::NAN); 3], vec![[0, 1, 2]]),
    ] {
        assert!(matches!(ClosedSurface::new(vertices, triangles), Err(SurfaceError::Degenerate { .. })));
    }
}

#[test]
fn a_surface_in_millimetres_taken_for_metres_is_refused_by_its_lattice() {
    let (vertices, triangles) = sphere(120.0, 12, false);
    let surface = ClosedSurface::new(vertices, triangles).unwrap();
    let error = stuff_surface(&surface, &Stuffing::default()).unwrap_err();
    assert!(matches!(error, StuffingError::CellTooSmall { .. }));
    assert!(error.to_string().contains("are the units right?"));
}

#[test]
fn a_scanned_organ_is_stuffed() {
    let shared = std::env::var("PALPATE_SHARED")
        .unwrap_or_else(|_| concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared").to_owned());
    let path = format!("{shared}/meshes/liver-smooth.obj");
    if !std::path::Path::new(&path).exists() {
        println!("skipped: {path} is absent");
        return;
    }
    let surface = ClosedSurface::from_path(&path, 1.0).unwrap();
    let [low, high] = palpate_fem::stuffing::LevelSet::bounds(&surface);
    let cell = (high - low).min() / 12.0;
    let start = std::time::Instant::now();
    let (mesh, report) = stuff_surface(&surface, &Stuffing { cell, ..Stuffing::default() }).unwrap();
    println!("{} triangles, {report:?} in {:.0} ms", surface.triangles().len(), start.elapsed().as_secs_f64() * 1e3);
    assert!(is_closed_surface(&boundary(&mesh)));
    assert!(report.quality.smallest_dihedral.to_degrees() > 10.7);
    assert!((report.quality.volume / surface.volume() - 1.0).abs() < 0.05);
}
