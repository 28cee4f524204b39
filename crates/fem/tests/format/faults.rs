//! Bad files are refused with file, line, number and remedy.

use std::path::Path;

use crate::format_samples::{all, cube, medit, msh1, msh22, tetgen, vtk};
use palpate_fem::format::{MeshFile, inspect_bytes, inspect_tetgen, read};
use palpate_fem::mesh::{MeshError, MeshWarning, TetMesh};

fn parse(name: &str, content: impl AsRef<[u8]>) -> Result<MeshFile, MeshError> {
    inspect_bytes(Path::new(name), content.as_ref())
}

/// What reading or validation says.
fn message(name: &str, content: impl AsRef<[u8]>) -> String {
    match parse(name, content) {
        Ok(file) => file.refusal.expect("the file is bad").to_string(),
        Err(error) => error.to_string(),
    }
}

/// The text of a sample with one line (counted from one) replaced.
fn with_line(content: Vec<u8>, line: usize, replacement: &str) -> String {
    let text = String::from_utf8(content).unwrap();
    let mut lines: Vec<&str> = text.lines().collect();
    lines[line - 1] = replacement;
    lines.join("\n")
}

/// The number of the first line that holds a word, counted from one.
fn line_of(content: &[u8], word: &str) -> usize {
    let text = std::str::from_utf8(content).unwrap();
    1 + text.lines().position(|line| line == word).unwrap()
}

#[test]
fn a_missing_file_is_named() {
    let error = read(Path::new("no/such/liver.msh")).unwrap_err();
    assert!(matches!(error, MeshError::Io { .. }));
    assert!(error.to_string().starts_with("no/such/liver.msh: "), "{error}");
    let error = read(Path::new("no/such/liver.ele")).unwrap_err();
    assert!(error.to_string().starts_with("no/such/liver.node: "), "{error}");
}

#[test]
fn words_that_are_not_numbers_are_named_with_their_line() {
    let mesh = cube();
    let text = with_line(msh1(&mesh), 5, "30 0 oops 0");
    assert!(message("a.msh", text).starts_with("a.msh:5: expected a coordinate, found \"oops\""));
    let text = with_line(medit(&mesh), 7, "0.5 zero 0 0");
    assert!(message("a.mesh", text).starts_with("a.mesh:7: expected a coordinate, found \"zero\""));
    let (node, ele) = tetgen(&mesh);
    let ele = with_line(ele, 3, "1 0 7 six 2 1");
    let error = inspect_tetgen(Path::new("a.node"), &node, Path::new("a.ele"), ele.as_bytes()).unwrap_err();
    assert!(error.to_string().starts_with("a.ele:3: expected a node of a tetrahedron, found \"six\""), "{error}");
}

#[test]
fn coordinates_that_are_not_finite_are_named_with_their_line() {
    let mesh = cube();
    for (value, shown) in [("nan", "NaN"), ("inf", "inf"), ("1e999", "inf")] {
        let text = with_line(msh22(&mesh, None), 14, &format!("3 0 {value} 0"));
        let expected = format!("a.msh:14: node 2 has the coordinate {shown}");
        assert!(message("a.msh", &text).starts_with(&expected), "{}", message("a.msh", &text));
    }
}

#[test]
fn nodes_that_do_not_exist_are_named_with_the_line_of_the_tetrahedron() {
    let mesh = cube();
    let bytes = msh1(&mesh);
    // The head, a point, then the tetrahedra.
    let line = line_of(&bytes, "$ELM") + 3;
    let text = with_line(bytes, line, "2 4 1 1 4 10 20 40 90");
    assert!(message("a.msh", text).starts_with(&format!("a.msh:{line}: tetrahedron 0 uses node 90")));

    let bytes = vtk(&mesh, false, false);
    let line = line_of(&bytes, "CELLS 7 34") + 3;
    let text = with_line(bytes, line, "4 0 6 2 -7");
    assert!(message("a.vtk", text).starts_with(&format!("a.vtk:{line}: tetrahedron 1 uses node -7")));
}

#[test]
fn one_inverted_tetrahedron_is_named_with_its_line_and_volume() {
    let mut mesh = cube();
    mesh.tetrahedra[3].swap(1, 2);
    for (name, bytes, line) in [
        ("a.msh", msh1(&mesh), line_of(&msh1(&mesh), "$ELM") + 3 + 3),
        ("a.mesh", medit(&mesh), line_of(&medit(&mesh), "Tetrahedra") + 2 + 3),
        ("a.vtk", vtk(&mesh, false, false), line_of(&vtk(&mesh, false, false), "CELLS 7 34") + 2 + 3),
    ] {
        let message = message(name, bytes);
        let expected = format!("{name}:{line}: tetrahedron 3 has volume -2.604e-3 m³");
        assert!(message.starts_with(&expected), "{message}\n{expected}");
    }
}

#[test]
fn files_that_number_all_tetrahedra_inside_out_are_turned_round() {
    let mut mesh = cube();
    mesh.tetrahedra.iter_mut().for_each(|t| t.swap(2, 3));
    let file = parse("a.msh", msh22(&mesh, None)).unwrap();
    assert_eq!(file.warnings, [MeshWarning::Reoriented { tetrahedra: 6 }]);
    assert!(file.refusal.is_none());
    assert_eq!(file.mesh, cube());
}

#[test]
fn few_stray_nodes_are_left_out_and_many_are_refused() {
    // Ten boxes side by side have 80 nodes: eight strays are a tenth, nine are more.
    let mut mesh = TetMesh { node_sets: cube().node_sets, region_names: cube().region_names, ..TetMesh::default() };
    for part in 0..10_u32 {
        mesh.nodes.extend(cube().nodes.iter().map(|x| x + nalgebra::Vector3::z() * f64::from(part) / 8.0));
        mesh.tetrahedra.extend(cube().tetrahedra.iter().map(|t| t.map(|node| node + 8 * part)));
        mesh.regions.extend(cube().regions);
    }
    let with_strays = |count: usize| {
        let mut mesh = mesh.clone();
        mesh.nodes.extend(std::iter::repeat_n(nalgebra::Vector3::repeat(0.25), count));
        parse("a.msh", msh22(&mesh, None)).unwrap()
    };
    let file = with_strays(8);
    assert!(file.refusal.is_none());
    assert!(file.warnings.contains(&MeshWarning::UnusedNodesDropped { nodes: 8 }), "{:?}", file.warnings);
    assert_eq!(file.mesh, mesh);
    let refusal = with_strays(9).refusal.unwrap().to_string();
    assert!(refusal.starts_with("a.msh:92: node 80 belongs to no tetrahedron, 9 of 89 nodes do not"), "{refusal}");
}

#[test]
fn other_solid_cells_are_counted_by_name_and_never_left_out() {
    let text = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$EndNodes\n\
                $Elements\n3\n1 4 2 1 1 1 2 3 4\n2 5 2 1 1 1 2 3 4 1 2 3 4\n3 5 2 1 1 1 2 3 4 1 2 3 4\n$EndElements\n";
    let message = message("a.msh", text);
    assert!(message.starts_with("a.msh:14: 2 hexahedra (8 nodes) cannot be simulated"), "{message}");

    let quadratic = "# vtk DataFile Version 3.0\nq\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 1 float\n0 0 0\n\
                     CELLS 1 14\n13 0 0 0 0 0 0 0 0 0 0 0 0 0\nCELL_TYPES 1\n27\n";
    let message = self::message("a.vtk", quadratic);
    assert!(message.starts_with("a.vtk:8: 1 quadratic pyramids (13 nodes) cannot"), "{message}");
    assert!(self::message("a.vtk", quadratic.replace("\n27\n", "\n63\n")).contains("VTK type 63"));

    let mixed = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$EndNodes\n\
                 $Elements\n2\n1 4 2 1 1 1 2 3 4\n2 11 2 1 1 1 2 3 4 1 2 3 4 1 2\n$EndElements\n";
    let message = self::message("a.msh", mixed);
    assert!(message.contains("1 linear beside 1 quadratic tetrahedra cannot be read here"), "{message}");
}

#[test]
fn surfaces_are_told_how_to_become_solid() {
    let triangle = "$NOD\n3\n1 0 0 0\n2 1 0 0\n3 0 1 0\n$ENDNOD\n$ELM\n1\n1 2 1 1 3 1 2 3\n$ENDELM\n";
    let polydata = "# vtk DataFile Version 3.0\ns\nBINARY\nDATASET POLYDATA\nPOINTS 0 float\n";
    for (name, content) in [
        ("a.msh", triangle),
        ("a.vtk", polydata),
        ("a.vtu", "<VTKFile type=\"PolyData\"></VTKFile>"),
        ("a.stl", "solid a\nendsolid\n"),
        ("a.OBJ", "v 0 0 0\n"),
        ("a.ply", "ply\n"),
        ("a.nii", ""),
    ] {
        let error = parse(name, content).unwrap_err();
        assert!(matches!(error, MeshError::NotVolumetric { .. }), "{error}");
        assert!(error.to_string().contains("palpate mesh make"));
    }
    let points = "$NOD\n1\n1 0 0 0\n$ENDNOD\n$ELM\n1\n1 15 1 1 1 1\n$ENDELM\n";
    assert!(matches!(parse("a.msh", points), Err(MeshError::NoTetrahedra { .. })));
}

#[test]
fn variants_that_are_not_read_name_one_that_is() {
    for (name, content, remedy) in [
        ("a.msh", "$MeshFormat\n4 0 8\n$EndMeshFormat\n", "msh41"),
        ("a.msh", "$MeshFormat\n4.1 1 4\n\u{1}\u{0}\u{0}\u{0}\n$EndMeshFormat\n", "msh41"),
        ("a.vtu", "<VTKFile type=\"UnstructuredGrid\" compressor=\"vtkLZ4DataCompressor\"/>", "zlib"),
        ("a.vtu", "<VTKFile type=\"PUnstructuredGrid\"/>", "UnstructuredGrid"),
        ("a.vtk", "# vtk DataFile Version 3.0\nt\nASCII\nDATASET STRUCTURED_GRID\n", "tetrahedra"),
        ("a.mesh", "MeshVersionFormatted 1\nDimension 2\n", "volume mesh"),
        ("a.meshb", "\u{1}\u{0}\u{0}\u{0}", "as text"),
    ] {
        let error = parse(name, content).unwrap_err();
        assert!(matches!(error, MeshError::Unsupported { .. }), "{name}: {error}");
        assert!(error.to_string().contains(remedy), "{error}");
    }
    assert!(matches!(parse("notes.txt", "hello"), Err(MeshError::UnknownFormat { .. })));
}

#[test]
fn counts_that_the_file_cannot_hold_are_refused_at_their_line() {
    for (name, content) in [
        ("a.msh", "$NOD\n99999999999\n"),
        ("a.mesh", "MeshVersionFormatted 2\nDimension 3 Vertices 99999999999\n1 2 3 0\n"),
    ] {
        let message = message(name, content);
        assert!(message.starts_with(&format!("{name}:2: the number of")), "{message}");
        assert!(message.contains("is 99999999999, but only"), "{message}");
    }
}

#[test]
fn the_content_decides_the_format_before_the_extension_does() {
    for sample in all().into_iter().filter(|sample| sample.ele.is_none()) {
        let file = parse("liver.dat", &sample.bytes).unwrap_or_else(|error| panic!("{}: {error}", sample.name));
        assert_eq!(file.mesh.tetrahedra, cube().tetrahedra, "{}", sample.name);
    }
}

#[test]
fn an_array_of_regions_that_is_not_whole_is_ignored_with_a_warning() {
    let text = String::from_utf8(vtk(&cube(), false, false)).unwrap();
    let head = text.find("region 1 7 int").unwrap();
    let broken = format!("{}region 1 7 double\n0 1 2 1 2 2.5 1\n", &text[..head]);
    let file = parse("a.vtk", broken).unwrap();
    assert_eq!(file.mesh.region_names, ["body"]);
    assert!(matches!(&file.warnings[..], [MeshWarning::RegionsIgnored { .. }]), "{:?}", file.warnings);
    // An array of a type that is not read stands behind complete geometry: the mesh is still good.
    let broken = format!("{}region 1 7 string\na\nb\nc\nd\ne\nf\ng\n", &text[..head]);
    let file = parse("a.vtk", broken).unwrap();
    assert!(file.refusal.is_none());
    assert!(file.warnings[0].to_string().contains("string"), "{:?}", file.warnings);
}
