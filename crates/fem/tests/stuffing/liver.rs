//! The bundled liver at the sizes that scenes and benches use.
#![allow(clippy::print_stdout)] // measured numbers, and why a test was skipped

use std::time::Instant;

use crate::bodies::{boundary, enclosed_volume, is_closed_surface};
use palpate_fem::image::LabelImage;
use palpate_fem::stuffing::{Stuffing, stuff_image};

const LIVER: &[u8] = include_bytes!("../../../../examples/scenes/liver.inr.gz");

#[test]
fn the_image_is_the_one_of_its_note() {
    let image = LabelImage::from_inrimage_bytes(LIVER).unwrap();
    assert_eq!(image.dims, [438, 353, 165]);
    assert_eq!(image.spacing, [0.617188e-3, 0.617188e-3, 1.33333e-3]);
    let counts = image.histogram();
    assert_eq!([255, 127, 85].map(|l| counts[l]), [3_160_496, 314_086, 17_702]);
    assert_eq!(
        image,
        LabelImage::from_path(concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/scenes/liver.inr.gz")).unwrap()
    );
}

/// Nodes within 3 % of what the sizes are named after; volume within 0.5 % of the labels (the requirement is 2 %);
/// the regions within 5 %, or one tetrahedron for the lesion of 9 cm³.
#[test]
fn sizes_volumes_and_angles() {
    let image = LabelImage::from_inrimage_bytes(LIVER).unwrap();
    for (cell, nodes) in [(0.0155, 1500), (0.012, 3000), (0.0084, 8000)] {
        let start = Instant::now();
        let (mesh, report) = stuff_image(&image, &Stuffing { cell, ..Stuffing::default() }).unwrap();
        let quality = &report.quality;
        println!(
            "cell {:.1} mm: {} nodes, {} tetrahedra, {:.1} of {:.1} cm³, {:.2}° to {:.2}°, edges {:.1} to {:.1} mm, \
             {} pinches mended, {:.0} ms",
            cell * 1e3,
            report.nodes,
            report.tetrahedra,
            quality.volume * 1e6,
            report.label_volume * 1e6,
            quality.smallest_dihedral.to_degrees(),
            quality.largest_dihedral.to_degrees(),
            quality.shortest_edge * 1e3,
            quality.longest_edge * 1e3,
            report.mended_pinches,
            start.elapsed().as_secs_f64() * 1e3
        );
        assert!((report.nodes as f64 / nodes as f64 - 1.0).abs() < 0.03);
        assert!((quality.volume / 1773.6e-6 - 1.0).abs() < 5e-3);
        assert!(quality.smallest_dihedral.to_degrees() > 15.0 && quality.largest_dihedral.to_degrees() < 160.0);
        assert!(quality.smallest_volume > 0.0);
        assert_eq!((report.dropped_bodies, report.pinched_nodes), (0, 0));
        let surface = boundary(&mesh);
        assert!(is_closed_surface(&surface));
        assert!((enclosed_volume(&mesh, &surface) / quality.volume - 1.0).abs() < 1e-10);
        assert_eq!(mesh.region_names, ["parenchyma", "vessels", "lesion"]);
        for region in report.regions.iter().filter(|r| r.tetrahedra > 0) {
            println!(
                "    {}: {:.2} of {:.2} cm³, {} tetrahedra, share from {:.2}",
                region.name,
                region.volume * 1e6,
                region.label_volume * 1e6,
                region.tetrahedra,
                region.least_share
            );
            let one = quality.volume / report.tetrahedra as f64;
            assert!((region.volume - region.label_volume).abs() < one.max(5e-3 * region.label_volume));
        }
    }
}
