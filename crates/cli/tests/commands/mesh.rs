//! `palpate mesh`: meshes are described, and made from surfaces and label images.

use crate::program_runs::{NODES, Place, SCENE};
use palpate::fem::format;
use serde_json::Value;

#[test]
fn a_mesh_is_described_as_text_and_as_json() {
    let place = Place::new();
    place.run("run scene.toml --lockstep --steps 1 --no-trace --final block.vtu");
    let text = place.run("mesh block.vtu");
    assert_eq!(text.code, Some(0), "{text:?}");
    assert!(text.out.contains(&format!("nodes            {NODES}")), "{}", text.out);
    let json: Value = serde_json::from_str(&place.run("mesh block.vtu --json --scale 0.001").out).unwrap();
    // 60 x 60 x 30 of what is taken for millimetres
    let volume = json["quality"]["volume"].as_f64().unwrap();
    assert!((volume / 1.08e-13 - 1.0).abs() < 0.02, "{volume:e} m³");
}

#[test]
fn tetrahedra_are_made_from_a_closed_surface() {
    let place = Place::new();
    // An octahedron of 40 mm between its tips, in millimetres: volume 4/3 · 20³ mm³.
    place.write(
        "gem.obj",
        "v 20 0 0\nv -20 0 0\nv 0 20 0\nv 0 -20 0\nv 0 0 20\nv 0 0 -20\nf 1 3 5\nf 3 2 5\nf 2 4 5\nf 4 1 5\n\
         f 3 1 6\nf 2 3 6\nf 4 2 6\nf 1 4 6\n",
    );
    let made = place.run("mesh make gem.obj --scale 0.001 --cell 4mm --out gem.vtu");
    assert_eq!(made.code, Some(0), "{made:?}");
    let mesh = format::read(&place.path("gem.vtu")).unwrap();
    let exact = 4.0 / 3.0 * 0.02_f64.powi(3);
    assert!((mesh.quality.volume / exact - 1.0).abs() < 0.05, "{} of {exact} m³", mesh.quality.volume);
    let again = place.run("mesh make gem.obj --scale 0.001 --cell 4mm --out gem.vtu");
    assert!(again.code == Some(2) && again.err.contains("--force"), "{again:?}");
    assert_eq!(place.run("mesh make gem.obj --scale 0.001 --cell 5mm --out gem.vtu --force").code, Some(0));
}

/// The liver alone, without the organs beside it, from the program and from a scene.
#[test]
fn labels_of_an_image_are_chosen_by_name() {
    let place = Place::new();
    let image = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/scenes/liver.inr.gz");
    std::fs::copy(image, place.path("organ.inr.gz")).unwrap();
    let make =
        |labels: &str| place.run(&format!("mesh make organ.inr.gz --cell 30mm --out organ.vtu --force {labels}"));
    let volume = || format::read(&place.path("organ.vtu")).unwrap().quality.volume;
    assert_eq!(make("").code, Some(0));
    let all = volume();
    let alone = make("--labels liver=255");
    assert_eq!(alone.code, Some(0), "{alone:?}");
    assert!(alone.out.contains("liver: ") && !alone.out.contains("vessels"), "{}", alone.out);
    assert!(volume() < 0.95 * all, "{} of {all}", volume());
    let missing = make("--labels liver=255,bone=3");
    assert!(
        missing.code == Some(2) && missing.err.contains("label 3 of `bone`; it has 84, 85, 127, 255"),
        "{missing:?}"
    );

    let block = "block = { min = [-0.03, -0.03, 0.0], max = [0.03, 0.03, 0.03], cells = [3, 3, 2] }";
    let scene = |labels: &str| {
        let body = format!("image = \"organ.inr.gz\"\ncell = 0.03\nlabels = {labels}");
        let held = "above = { axis = \"y\", at = 0.15 }";
        place.write("organ.toml", &SCENE.replace(block, &body).replace("node_set = \"z_min\"", held));
        place.run("check organ.toml")
    };
    let check = scene("{ liver = 255 }");
    assert_eq!(check.code, Some(0), "{check:?}");
    for (labels, word) in [
        ("{ liver = 255, bone = 3 }", "organ.toml:9:"),
        ("{ liver = 0 }", "background"),
        ("{ a = 255, b = 255 }", "one name"),
        ("{ liver = 256 }", "256"),
    ] {
        let run = scene(labels);
        assert!(run.code == Some(2) && run.err.contains(word), "{labels}: {run:?}");
    }
}
