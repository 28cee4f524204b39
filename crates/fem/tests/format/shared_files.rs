//! Every mesh that users have sent is read, with the counts and volumes that independent readers found in it.

use std::path::PathBuf;

use palpate_fem::format::{self, Format};
use palpate_fem::mesh::{MeshError, MeshWarning};

/// The folder of shared files, or a printed reason why there is none.
fn shared() -> Option<PathBuf> {
    let default = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared");
    let folder = std::env::var_os("PALPATE_SHARED").map_or_else(|| PathBuf::from(default), PathBuf::from);
    if !folder.join("meshes").is_dir() {
        eprintln!("skipped: {} has no meshes", folder.display());
        return None;
    }
    Some(folder)
}

/// File, format, nodes, tetrahedra, volume in the file's own unit.
///
/// Nodes and tetrahedra were counted by meshio 5.3.5, or for MSH 1, which it does not read, from the text; volumes
/// were summed by numpy.
const FILES: [(&str, Format, usize, usize, f64); 17] = [
    ("meshes/box20k.msh", Format::Gmsh, 4320, 20976, 0.00084),
    ("meshes/box5k.msh", Format::Gmsh, 1170, 5040, 0.00084),
    ("meshes/box756.msh", Format::Gmsh, 224, 756, 0.0010079999999999998),
    ("meshes/cylinder_8x30x6.msh", Format::Gmsh, 1446, 6750, 1.2474703441648e-06),
    ("meshes/liver.msh", Format::Gmsh, 181, 596, 36.56085106149482),
    ("meshes/liver2.msh", Format::Gmsh, 507, 1493, 1.125092151433261),
    ("meshes/torus_low_res.msh", Format::Gmsh, 264, 862, 8.216912878585381),
    ("meshes/truthcylinder1.msh", Format::Gmsh, 642, 2524, 1513.4158527232614),
    ("meshes/A.vtk", Format::VtkLegacy, 413, 1116, 14.415560304353146),
    // Three of its 2,996 nodes belong to no tetrahedron.
    ("meshes/raptorTetra_8418.vtu", Format::Vtu, 2993, 8418, 27.251767013618167),
    ("data/human_liver_ftetwild.vtk", Format::VtkLegacy, 5582, 23526, 1765470.8481405508),
    ("reference/fem/compress_neo_hookean.vtk", Format::VtkLegacy, 216, 750, 1e-3),
    ("reference/fem/sag_neo_hookean.vtk", Format::VtkLegacy, 216, 750, 1e-3),
    ("reference/fem/shear_mooney_rivlin.vtk", Format::VtkLegacy, 216, 750, 1e-3),
    ("reference/fem/stretch_st_venant_kirchhoff.vtk", Format::VtkLegacy, 216, 750, 1e-3),
    ("reference/indentation/block.vtk", Format::VtkLegacy, 1183, 5184, 5e-4),
    ("reference/pdms/cylinder.vtk", Format::VtkLegacy, 3668, 12724, 1.0159009457477928e-05),
];

#[test]
fn every_shared_mesh_loads_with_its_known_counts_and_volume() {
    let Some(shared) = shared() else { return };
    for (name, format, nodes, tetrahedra, volume) in FILES {
        let file = format::read(&shared.join(name)).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(file.format, format, "{name}");
        assert_eq!((file.mesh.nodes.len(), file.mesh.tetrahedra.len()), (nodes, tetrahedra), "{name}");
        // Single precision in A.vtk and raptor: meshio rounds their decimals, we do not. 2^-24 of a coordinate, thrice.
        assert!((file.mesh.volume() / volume - 1.0).abs() < 1e-6, "{name}: {}", file.mesh.volume());
        assert_eq!(file.quality, file.mesh.validate().unwrap(), "{name}");
        let surface = file.mesh.surface();
        assert!(surface.topology().closed, "{name}");
        let enclosed = surface.enclosed_volume(&file.mesh.nodes);
        assert!((enclosed / file.mesh.volume() - 1.0).abs() < 1e-11, "{name}: {enclosed}");
        eprintln!("{name}\n{}{:?}", file.quality, file.warnings);
    }
}

#[test]
fn the_human_liver_is_in_millimetres_and_says_so() {
    let Some(shared) = shared() else { return };
    let file = format::read(&shared.join("data/human_liver_ftetwild.vtk")).unwrap();
    let scale = file.warnings.iter().find_map(|warning| match warning {
        MeshWarning::Units { scale, .. } => Some(*scale),
        _ => None,
    });
    assert_eq!(scale, Some(1e-3));
    let litres = 1e3 * file.mesh.scaled(1e-3).unwrap().volume();
    assert!((1.7..1.8).contains(&litres), "{litres}");
}

#[test]
fn gmsh_groups_of_triangles_and_lines_become_node_sets_on_the_surface() {
    let Some(shared) = shared() else { return };
    let mesh = format::read(&shared.join("meshes/torus_low_res.msh")).unwrap().mesh;
    let surface = mesh.surface();
    assert_eq!(mesh.region_names, ["region_2"]);
    assert!(!mesh.node_sets.is_empty());
    for (name, set) in &mesh.node_sets {
        assert!(set.iter().all(|node| surface.nodes.binary_search(node).is_ok()), "{name}");
        assert!(set.is_sorted(), "{name}");
    }
}

#[test]
fn surfaces_and_images_are_refused_with_the_way_to_tetrahedra() {
    let Some(shared) = shared() else { return };
    for name in
        ["meshes/liver.vtk", "meshes/liver-smooth.obj", "meshes/dental_instrument_light.obj", "data/liver.inr.gz"]
    {
        let error = format::read(&shared.join(name)).unwrap_err();
        assert!(matches!(error, MeshError::NotVolumetric { .. }), "{error}");
        let message = error.to_string();
        assert!(message.contains("palpate mesh make") && message.contains(name), "{message}");
    }
}
