//! Label images become meshes: volumes, regions, voids, loose pieces, refusals.
#![allow(clippy::print_stdout)] // measured numbers, and why a test was skipped

use crate::bodies::{boundary, euler_characteristic, is_closed_surface};
use nalgebra::Vector3;
use palpate_fem::image::LabelImage;
use palpate_fem::mesh::TetMesh;
use palpate_fem::stuffing::{Stuffing, StuffingError, cell_for_nodes_of_image, stuff_image};

/// An image of cubic millimetre-sized voxels (anisotropic: 1 x 1 x 2 mm), labelled by position (mm).
fn image(size: [usize; 3], label: impl Fn(Vector3<f64>) -> u8) -> LabelImage {
    let spacing = [1e-3, 1e-3, 2e-3];
    let mut labels = Vec::new();
    for k in 0..size[2] {
        for j in 0..size[1] {
            for i in 0..size[0] {
                labels.push(label(Vector3::new(i as f64 + 0.5, j as f64 + 0.5, 2.0 * k as f64 + 1.0)));
            }
        }
    }
    LabelImage::new(size, spacing, Vector3::new(0.1, -0.2, 0.3), labels).unwrap()
}

/// A ball of radius 25 mm, with an eccentric ball of radius 8 mm in it.
fn ball_in_ball() -> LabelImage {
    let (outer, inner) = (Vector3::new(32.0, 32.0, 32.0), Vector3::new(40.0, 30.0, 30.0));
    image([64, 64, 32], |x| match ((x - outer).norm() < 25.0, (x - inner).norm() < 8.0) {
        (_, true) => 7,
        (true, _) => 200,
        _ => 0,
    })
}

fn stuffing(cell: f64) -> Stuffing {
    Stuffing { cell, labels: vec![(200, "organ".to_owned())], ..Stuffing::default() }
}

fn is_sound(mesh: &TetMesh) -> bool {
    is_closed_surface(&boundary(mesh)) && mesh.regions.len() == mesh.tetrahedra.len()
}

#[test]
fn a_ball_keeps_its_volume_and_place() {
    let image = ball_in_ball();
    for cell in [0.006, 0.009, 0.012] {
        let (mesh, report) = stuff_image(&image, &stuffing(cell)).unwrap();
        let error = report.quality.volume / report.label_volume - 1.0;
        println!("cell {cell}: {} nodes, volume error {error:.2e}", report.nodes);
        assert!(error.abs() < 5e-3 && is_sound(&mesh));
        assert_eq!(euler_characteristic(&boundary(&mesh)), 2);
        // Every boundary node within 4 % of the radius of the sphere (half a voxel's diagonal is 1.2 mm of 25 mm).
        let centre = image.origin + Vector3::repeat(0.032);
        for &node in boundary(&mesh).iter().flatten() {
            let radius = (mesh.nodes[node as usize] - centre).norm();
            assert!((radius / 0.025 - 1.0).abs() < 0.04, "radius {radius}");
        }
    }
}

#[test]
fn regions_have_the_volumes_of_their_labels() {
    let (mesh, report) = stuff_image(&ball_in_ball(), &stuffing(0.006)).unwrap();
    assert_eq!(mesh.region_names, ["organ", "label_7"]);
    let per_tetrahedron = report.quality.volume / report.tetrahedra as f64;
    for region in &report.regions {
        println!("{region:?}");
        // The region is filled to the nearest tetrahedron; the organ takes the rest and the error of the whole.
        let tolerance = 2.0 * per_tetrahedron + 5e-3 * report.label_volume;
        assert!((region.volume - region.label_volume).abs() < tolerance);
    }
    // Tetrahedra of the inner region are where the inner ball is.
    let inner = Vector3::new(0.14, -0.17, 0.33);
    for (t, _) in mesh.tetrahedra.iter().zip(&mesh.regions).filter(|(_, r)| **r == 1) {
        let centroid = t.iter().map(|&n| mesh.nodes[n as usize]).sum::<Vector3<f64>>() / 4.0;
        assert!((centroid - inner).norm() < 0.008 + 0.003, "{centroid:?}");
    }
}

#[test]
fn a_box_with_a_void_and_a_loose_piece_becomes_one_solid() {
    let image = image([80, 50, 30], |x| {
        let within = |low: f64, high: f64| x.iter().all(|&c| c > low && c < high);
        u8::from((within(8.0, 40.0) && !within(20.0, 26.0)) || (x - Vector3::new(62.0, 20.0, 20.0)).norm() < 9.0)
    });
    let (mesh, report) = stuff_image(&image, &stuffing(0.005)).unwrap();
    assert_eq!((report.dropped_bodies, euler_characteristic(&boundary(&mesh))), (1, 2));
    // The void is a cube of 6 mm; cells that it touches at its edges only are not counted.
    assert!((report.filled_volume / 216e-9 - 1.0).abs() < 0.05, "void {:.3e}", report.filled_volume);
    let solid = 32.0f64.powi(3) * 1e-9;
    assert!((report.quality.volume / solid - 1.0).abs() < 0.02, "{}", report.quality.volume);
    assert_eq!(mesh.region_names, ["label_1"]);
}

#[test]
fn the_same_image_gives_the_same_mesh() {
    let image = ball_in_ball();
    let (first, second) =
        (stuff_image(&image, &stuffing(0.009)).unwrap(), stuff_image(&image, &stuffing(0.009)).unwrap());
    assert_eq!(first, second);
    let bits = |mesh: &TetMesh| {
        mesh.nodes.iter().flat_map(|x| x.iter().map(|c| c.to_bits()).collect::<Vec<_>>()).collect::<Vec<_>>()
    };
    assert_eq!(bits(&first.0), bits(&second.0));
}

#[test]
fn a_label_can_be_left_out() {
    let image = ball_in_ball();
    let (mesh, report) = stuff_image(&image, &Stuffing::of_labels(0.004, [("shell", 7)])).unwrap();
    assert_eq!(mesh.region_names, ["shell"]);
    assert!((report.quality.volume / report.label_volume - 1.0).abs() < 5e-3);
    let mut alone = image.clone();
    alone.retain_labels(&[7]);
    assert_eq!(mesh.nodes, stuff_image(&alone, &stuffing(0.004)).unwrap().0.nodes);

    let error = stuff_image(&image, &Stuffing::of_labels(0.004, [("shell", 7), ("tumour", 8)])).unwrap_err();
    assert!(matches!(&error, StuffingError::NoSuchLabel { label: 8, name, .. } if name == "tumour"), "{error}");
}

#[test]
fn a_number_of_nodes_is_met() {
    let image = ball_in_ball();
    for nodes in [400, 2000] {
        let cell = cell_for_nodes_of_image(&image, nodes, &stuffing(1.0)).unwrap();
        let (mesh, _) = stuff_image(&image, &stuffing(cell)).unwrap();
        assert!((mesh.nodes.len() as f64 / nodes as f64).ln().abs() <= 0.1, "{} for {nodes}", mesh.nodes.len());
    }
}

#[test]
fn defaults_are_those_of_the_documentation() {
    let default = Stuffing::default();
    assert_eq!((default.cell, default.smoothing), (0.0155, 0.3));
    assert!(default.keep_largest && default.match_volume);
    assert_eq!(
        [255, 127, 85, 84].map(|l| default.name_of(l)),
        ["parenchyma", "vessels", "lesion", "label_84"].map(str::to_owned)
    );
}

#[test]
fn senseless_cells_and_empty_images_are_refused_with_a_remedy() {
    let image = ball_in_ball();
    let refusal = |cell: f64| stuff_image(&image, &stuffing(cell)).unwrap_err();
    for cell in [0.0, -0.01, f64::NAN, f64::INFINITY] {
        assert!(matches!(refusal(cell), StuffingError::BadCell { .. }), "{cell}");
    }
    let StuffingError::CellTooLarge { usable, .. } = refusal(15.0) else { panic!("15 m") };
    assert!(stuff_image(&image, &stuffing(usable)).is_ok());
    assert!(matches!(refusal(0.055), StuffingError::CellTooLarge { .. }), "larger than the ball, not than the image");
    for tiny in [1e-5, 1e-9, 1e-300] {
        let StuffingError::CellTooSmall { usable, .. } = refusal(tiny) else { panic!("{tiny} m") };
        assert!(usable > 1e-4 && usable < 2e-3, "usable {usable}");
    }
    let bad = Stuffing { smoothing: -1.0, ..stuffing(0.01) };
    assert!(matches!(stuff_image(&image, &bad), Err(StuffingError::BadSmoothing { .. })));
    let empty = LabelImage::new([8, 8, 8], [1e-2; 3], Vector3::zeros(), vec![0; 512]).unwrap();
    assert_eq!(stuff_image(&empty, &stuffing(0.01)), Err(StuffingError::Empty));
}
