//! Mistakes of mesh and configuration are refused at set-up, and the message says where and what to do.

use crate::tissue_setup::block;
use nalgebra::Vector3;
use palpate_fem::{
    material::{MaterialError, NeoHookean},
    mesh::TetMesh,
    model::{FemConfig, FemError, FemModel},
};

fn mesh() -> TetMesh {
    let mut mesh = block([1, 1, 2], [0.1; 3], 0.0);
    mesh.region_names = vec!["parenchyma".into(), "lesion".into()];
    mesh.regions = vec![0; mesh.tetrahedra.len()];
    mesh.regions[3] = 1;
    mesh
}

fn refused(change: impl FnOnce(&mut TetMesh, &mut FemConfig)) -> FemError {
    let (mut mesh, mut config) = (mesh(), FemConfig { fixed: vec![0, 1, 2], ..FemConfig::default() });
    assert!(FemModel::new(&mesh, &config).is_ok());
    change(&mut mesh, &mut config);
    FemModel::new(&mesh, &config).expect_err("refused")
}

#[test]
fn mistakes_of_the_configuration_are_refused() {
    let soft = NeoHookean { young: 1e3, poisson: 0.45 };
    let error = refused(|_, c| c.material = NeoHookean { poisson: 0.5, ..soft }.into());
    assert_eq!(error, FemError::Material { place: "the body".into(), error: MaterialError::Poisson(0.5) });

    let error = refused(|_, c| c.region_materials = [("lesoin".to_string(), soft.into())].into());
    assert!(error.to_string().contains("`lesoin` (did you mean `lesion`?)"), "{error}");
    let error = refused(|_, c| c.region_densities = [("x".to_string(), 1.0)].into());
    assert!(error.to_string().ends_with("parenchyma, lesion"), "{error}");

    let stiff = NeoHookean { young: 1.01e7, ..soft };
    let ratio = |c: &mut FemConfig, stiff: NeoHookean| {
        c.material = soft.into();
        c.region_materials = [("lesion".to_string(), stiff.into())].into();
    };
    assert!(matches!(refused(|_, c| ratio(c, stiff)), FemError::StiffnessRatio { .. }));
    let mut config = FemConfig { fixed: vec![0, 1, 2], ..FemConfig::default() };
    ratio(&mut config, NeoHookean { young: 1e7, ..soft });
    assert!(FemModel::new(&mesh(), &config).is_ok(), "a ratio of 1e4 is allowed");

    for (name, error) in [
        ("density", refused(|_, c| c.density = -1.0)),
        ("region_densities", refused(|_, c| c.region_densities = [("lesion".to_string(), f64::NAN)].into())),
        ("total_mass", refused(|_, c| c.total_mass = Some(-1.0))),
        ("rayleigh_mass", refused(|_, c| c.rayleigh_mass = -0.1)),
        ("rayleigh_stiffness", refused(|_, c| c.rayleigh_stiffness = f64::INFINITY)),
        ("gravity", refused(|_, c| c.gravity.x = f64::NAN)),
    ] {
        assert!(error.to_string().starts_with(&format!("{name} = ")), "{error}");
    }
    assert_eq!(refused(|_, c| c.fixed.push(12)), FemError::FixedOutOfRange { node: 12, nodes: 12 });
    assert_eq!(refused(|_, c| c.fixed = (0..12).collect()), FemError::AllFixed { nodes: 12 });
    assert_eq!(refused(|_, c| (c.density, c.fixed) = (0.0, Vec::new())), FemError::Unsupported);
}

#[test]
fn mistakes_of_the_mesh_are_refused() {
    assert_eq!(refused(|m, _| m.tetrahedra.clear()), FemError::Empty);
    let error = refused(|m, _| m.tetrahedra[5][2] = 12);
    assert_eq!(error, FemError::NodeOutOfRange { tetrahedron: 5, node: 12, nodes: 12 });
    assert!(
        matches!(refused(|m, _| m.tetrahedra[4].swap(0, 1)), FemError::Volume { tetrahedron: 4, volume } if volume < 0.0)
    );
    let flat = refused(|m, _| m.tetrahedra[4][1] = m.tetrahedra[4][0]);
    assert_eq!(flat, FemError::Volume { tetrahedron: 4, volume: 0.0 });
    assert!(matches!(refused(|m, _| m.nodes[0].x = f64::NAN), FemError::Volume { tetrahedron: 0, .. }));
    assert_eq!(refused(|m, _| m.nodes.push(Vector3::zeros())), FemError::Unconnected { node: 12 });
    assert_eq!(refused(|m, _| m.regions.truncate(3)), FemError::RegionCount { tetrahedra: 12, regions: 3 });
    let error = refused(|m, _| m.regions[7] = 2);
    assert_eq!(error, FemError::RegionOutOfRange { tetrahedron: 7, region: 2, names: 2 });
}

#[test]
fn documented_defaults_hold() {
    let config = FemConfig::default();
    assert_eq!(config.material, NeoHookean { young: 5e3, poisson: 0.45 }.into());
    assert_eq!((config.density, config.total_mass), (1060.0, None));
    assert_eq!((config.rayleigh_mass, config.rayleigh_stiffness), (0.0, 0.0));
    assert_eq!(config.gravity, Vector3::new(0.0, 0.0, -9.81));
    assert!(config.fixed.is_empty() && config.region_materials.is_empty() && config.region_densities.is_empty());
    assert!(config.filter);
}
