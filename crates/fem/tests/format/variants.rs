//! One mesh in every format and encoding that is read gives one and the same mesh.

use std::path::Path;

use crate::format_samples::{Keeps, Sample, all, cube};
use palpate_fem::format::{MeshFile, inspect_bytes, inspect_tetgen};
use palpate_fem::mesh::MeshError;

fn inspect(sample: &Sample) -> Result<MeshFile, MeshError> {
    match &sample.ele {
        Some(ele) => inspect_tetgen(Path::new(sample.name), &sample.bytes, Path::new("tetgen.ele"), ele),
        None => inspect_bytes(Path::new(sample.name), &sample.bytes),
    }
}

#[test]
fn every_format_and_encoding_gives_the_same_mesh() {
    let expected = cube();
    for sample in all() {
        let file = inspect(&sample).unwrap_or_else(|error| panic!("{}: {error}", sample.name));
        assert!(file.refusal.is_none() && file.warnings.is_empty(), "{}: {file:?}", sample.name);
        let mesh = &file.mesh;
        // Exact: every coordinate is a power of two.
        assert_eq!(mesh.nodes, expected.nodes, "{}", sample.name);
        assert_eq!(mesh.tetrahedra, expected.tetrahedra, "{}", sample.name);
        assert_eq!(mesh.regions, expected.regions, "{}", sample.name);
        if sample.keeps == Keeps::Names {
            assert_eq!(*mesh, expected, "{}", sample.name);
        } else {
            assert_eq!(mesh.region_names, ["region_1", "region_2"], "{}", sample.name);
        }
    }
}

#[test]
fn groups_without_names_are_called_by_what_they_are_made_of() {
    let sets = |name: &str| {
        let samples = all();
        let sample = samples.iter().find(|sample| sample.name == name).unwrap();
        inspect(sample).unwrap().mesh.node_sets.into_iter().collect::<Vec<_>>()
    };
    assert_eq!(sets("v1.msh"), [("point_4".to_string(), vec![0])]);
    assert_eq!(sets("medit.mesh"), [("surface_5".to_string(), vec![0, 4, 6])]);
    assert_eq!(sets("tetgen.node"), [("marker_5".to_string(), vec![0, 2, 4, 6])]);
}

#[test]
fn numbers_of_text_files_may_be_spread_over_lines_as_they_like() {
    let expected = cube();
    for name in ["v1.msh", "v41.msh", "medit.mesh"] {
        let samples = all();
        let sample = samples.iter().find(|sample| sample.name == name).unwrap();
        let text = String::from_utf8(sample.bytes.clone()).unwrap();
        // Windows' line ends; and quoted names must stay on their lines.
        let mesh = inspect_bytes(Path::new(name), text.replace('\n', "\r\n").as_bytes()).unwrap().mesh;
        assert_eq!((&mesh.nodes, &mesh.tetrahedra), (&expected.nodes, &expected.tetrahedra), "{name}");
    }
}
