//! The guarantee of isosurface stuffing: dihedral angles, positive volumes, a closed boundary, whatever the body.
//!
//! The uniform-lattice bound of Labelle and Shewchuk is [10.78°, 164.74°]; the tests allow 0.1° for roots that are
//! known to 1e-9 of an edge only.

mod bodies;

use bodies::{Blobs, Sphere, Torus, boundary, euler_characteristic, is_closed_surface};
use nalgebra::Vector3;
use palpate_fem::stuffing::{Stuffing, stuff_level_set};
use proptest::prelude::*;

fn at_cell(cell: f64) -> Stuffing {
    Stuffing { cell, ..Stuffing::default() }
}

/// Bound of the paper, less the tolerance stated above [rad].
fn within_guarantee(quality: &palpate_fem::stuffing::MeshQuality) -> bool {
    quality.smallest_dihedral.to_degrees() > 10.68 && quality.largest_dihedral.to_degrees() < 164.84
}

#[test]
fn angles_hold_over_many_bodies() {
    let mut worst = (180.0f64, 0.0f64);
    for n in 0..400 {
        let x = n as f64;
        let centre = Vector3::new((x * 0.731).fract(), (x * 0.417).fract(), (x * 0.593).fract());
        let sphere = Sphere { centre, radius: 1.3 + 2.0 * (x * 0.177).fract() };
        let (_, report) = stuff_level_set(&sphere, &at_cell(1.0)).unwrap();
        worst.0 = worst.0.min(report.quality.smallest_dihedral.to_degrees());
        worst.1 = worst.1.max(report.quality.largest_dihedral.to_degrees());
        assert!(report.quality.smallest_volume > 0.0);
        assert_eq!(report.pinched_nodes, 0);
    }
    println!("400 spheres: {:.3}° to {:.3}°", worst.0, worst.1);
    assert!(worst.0 > 10.68 && worst.1 < 164.84, "{worst:?}");
}
