use std::time::Instant;
use palpate_fem::image::LabelImage;
use palpate_fem::stuffing::{Stuffing, stuff_image};
#[test]
fn explore() {
    let bytes = include_bytes!("../../../examples/scenes/liver.inr.gz");
    let t = Instant::now();
    let image = LabelImage::from_inrimage_bytes(bytes).unwrap();
    println!("read {:?} {:?}", t.elapsed(), image.dims);
    for cell in [0.016, 0.015, 0.014, 0.012, 0.010, 0.008, 0.007] {
        let t = Instant::now();
        let (mesh, report) = stuff_image(&image, &Stuffing { cell, ..Stuffing::default() }).unwrap();
        let el = t.elapsed();
        println!("{cell} {el:?} n {} t {} vol {:.1}/{:.1} dihedral {:.2}..{:.2} dropped {} {:.2e} mended {} pinched {} shift {:.2e} filled {:.2e} area {:.1}", report.nodes, report.tetrahedra, report.quality.volume*1e6, report.label_volume*1e6, report.quality.smallest_dihedral.to_degrees(), report.quality.largest_dihedral.to_degrees(), report.dropped_bodies, report.dropped_volume, report.mended_pinches, report.pinched_nodes, report.shift, report.filled_volume, report.quality.boundary_area*1e4);
        for r in &report.regions { println!("   {} {} {:.1} {:.1} share {:.2} n {}", r.label, r.name, r.label_volume*1e6, r.volume*1e6, r.least_share, r.tetrahedra); }
        let mut out = String::new();
        use std::fmt::Write;
        writeln!(out, "{} {}", mesh.nodes.len(), mesh.tetrahedra.len()).unwrap();
        for n in &mesh.nodes { writeln!(out, "{} {} {}", n.x, n.y, n.z).unwrap(); }
        for (t, r) in mesh.tetrahedra.iter().zip(&mesh.regions) { writeln!(out, "{} {} {} {} {r}", t[0], t[1], t[2], t[3]).unwrap(); }
        std::fs::write(format!("/tmp/liver_{}.txt", (cell*1e3) as i32), out).unwrap();
    }
}
