//! A body that is cut, held or released: the same as one that was built so.

use crate::tissue_setup::{block, nodes_where};
use nalgebra::{Matrix3, Vector3};
use palpate_fem::{
    assembly::{FemWorkspace, advance_memory, assemble},
    averaging::Grouping,
    element::ElementKind,
    factor::{ChangeStatus, Factor, FactorStatus, MatrixChange, SolveWorkspace, SymbolicFactor, UpdateStatus},
    material::{NeoHookean, PronyTerm},
    mesh::TetMesh,
    model::{CarriedMemory, FemConfig, FemError, FemModel, FemState},
    sparse::FIXED,
};

const DT: f64 = 1.0 / 30.0;

/// A block that stands on its bottom, one quarter of it viscous, and the same without the tetrahedra about a point.
fn blocks(element: ElementKind) -> (TetMesh, TetMesh, Vec<u32>, FemConfig) {
    let mut mesh = block([3, 3, 4], [0.03, 0.03, 0.04], 0.1);
    mesh.region_names = vec!["elastic".into(), "viscous".into()];
    mesh.regions = (0..mesh.tetrahedra.len()).map(|t| u16::from(t % 4 == 1)).collect();
    if element == ElementKind::Quadratic {
        mesh = mesh.promoted();
    }
    let config = FemConfig {
        element,
        material: NeoHookean { young: 5e3, poisson: 0.4 }.into(),
        region_viscosities: [("viscous".into(), vec![PronyTerm { modulus: 0.3, time: 0.2 }])].into(),
        rayleigh_mass: 0.3,
        rayleigh_stiffness: 0.01,
        fixed: nodes_where(&mesh, |x| x.z < 1e-9),
        ..FemConfig::default()
    };
    let mut cut = mesh.clone();
    let kept: Vec<u32> = (0..mesh.tetrahedra.len() as u32)
        .filter(|&t| {
            let corners = mesh.tetrahedra[t as usize].map(|n| mesh.nodes[n as usize]);
            (corners.iter().sum::<Vector3<f64>>() / 4.0 - Vector3::new(0.03, 0.03, 0.03)).norm() > 0.013
        })
        .collect();
    assert!(kept.len() + 10 < mesh.tetrahedra.len());
    cut.tetrahedra = kept.iter().map(|&t| mesh.tetrahedra[t as usize]).collect();
    cut.regions = kept.iter().map(|&t| mesh.regions[t as usize]).collect();
    cut.mid_nodes = kept.iter().filter_map(|&t| mesh.mid_nodes.get(t as usize).copied()).collect();
    (mesh, cut, kept, config)
}

/// A bent state in motion.
fn bent(model: &FemModel) -> FemState {
    let mut state = model.rest_state();
    for (q, v) in state.q.iter_mut().zip(&mut state.v) {
        let x = *q;
        *q += Vector3::new(6.0 * x.z * x.z, 3.0 * x.x * x.z, -2.0 * x.y * x.y);
        *v = Vector3::new(0.1 * x.z, 0.02, -x.x);
    }
    state
}

#[test]
fn a_cut_body_is_the_body_built_without_what_was_cut() {
    for element in [ElementKind::Linear, ElementKind::Quadratic] {
        let (mesh, cut, _, config) = blocks(element);
        let whole = FemModel::new(&mesh, &config).unwrap();
        let changed = whole.changed(&cut, &config).unwrap();
        let loose: Vec<u32> = (0..mesh.nodes.len() as u32)
            .filter(|node| !cut.tetrahedra.iter().flatten().chain(cut.mid_nodes.iter().flatten()).any(|n| n == node))
            .collect();
        assert!(!loose.is_empty(), "the cut must take a corner with it");
        // Built on its own, the cut mesh must not have loose nodes: they are left out and the rest renumbered.
        let mut number = vec![FIXED; mesh.nodes.len()];
        let mut alone = cut.clone();
        alone.nodes.clear();
        for (i, x) in mesh.nodes.iter().enumerate().filter(|(i, _)| !loose.contains(&(*i as u32))) {
            number[i] = alone.nodes.len() as u32;
            alone.nodes.push(*x);
        }
        alone.tetrahedra.iter_mut().flatten().for_each(|n| *n = number[*n as usize]);
        alone.mid_nodes.iter_mut().flatten().for_each(|n| *n = number[*n as usize]);
        let fixed = config.fixed.iter().map(|&n| number[n as usize]).collect();
        let alone = FemModel::new(&alone, &FemConfig { fixed, ..config.clone() }).unwrap();

        let state = bent(&changed);
        let (mut ws, mut ws_alone) = (FemWorkspace::new(&changed), FemWorkspace::new(&alone));
        let mut of_alone = alone.rest_state();
        for (i, &n) in number.iter().enumerate().filter(|(_, n)| **n != FIXED) {
            (of_alone.q[n as usize], of_alone.v[n as usize]) = (state.q[i], state.v[i]);
        }
        let _ = assemble(&changed, &state, DT, &[], &mut ws);
        let _ = assemble(&alone, &of_alone, DT, &[], &mut ws_alone);
        let pattern = changed.pattern();
        let mut compared = 0;
        for (i, &node) in changed.node_of_free().iter().enumerate() {
            if changed.held()[i] {
                assert!(loose.contains(&node));
                assert_eq!(ws.rhs[3 * i..3 * i + 3], [0.0; 3]);
                continue;
            }
            let of_alone = alone.free_of_node()[number[node as usize] as usize];
            for c in 0..3 {
                let (b, b_alone) = (ws.rhs[3 * i + c], ws_alone.rhs[3 * of_alone as usize + c]);
                assert!((b - b_alone).abs() < 1e-12 * (1.0 + b_alone.abs()), "right side: {b} and {b_alone}");
            }
            for p in pattern.row(i) {
                let other = number[changed.node_of_free()[pattern.columns()[p] as usize] as usize];
                let there = (other != FIXED).then(|| alone.free_of_node()[other as usize]);
                let there = there.and_then(|j| alone.pattern().find(of_alone, j));
                let block = there.map_or(Matrix3::zeros(), |p| ws_alone.system.blocks[p]);
                assert!((ws.system.blocks[p] - block).norm() < 1e-12 * (1.0 + block.norm()));
                compared += 1;
            }
        }
        println!("{}: {compared} blocks, {} loose nodes", element.name(), loose.len());
    }
}

#[test]
fn the_factor_of_the_whole_body_becomes_that_of_the_changed_one() {
    for element in [ElementKind::Linear, ElementKind::Quadratic] {
        let (mesh, cut, _, config) = blocks(element);
        let whole = FemModel::new(&mesh, &config).unwrap();
        let held = nodes_where(&mesh, |x| x.x < 1e-9 && x.z > 0.025);
        let changed = whole.changed(&cut, &FemConfig { held, ..config }).unwrap();
        let positions: Vec<_> = whole.node_of_free().iter().map(|&n| mesh.nodes[n as usize]).collect();
        let room = whole.free_nodes();
        let symbolic = SymbolicFactor::new(whole.pattern(), &positions).unwrap().with_room_for_changes(room);
        let symbolic = std::sync::Arc::new(symbolic);
        let state = FemState { memory: Vec::new(), ..bent(&whole) };
        let (mut before, mut after) = (FemWorkspace::new(&whole), FemWorkspace::new(&changed));
        let _ = assemble(&whole, &state, DT, &[], &mut before);
        let _ = assemble(&changed, &state, DT, &[], &mut after);
        let mut change = MatrixChange::with_capacity(whole.free_nodes(), room);
        assert_eq!(change.between(&before.system, &after.system, changed.held()), ChangeStatus::Ok);
        println!("{}: {} of {} nodes touched", element.name(), change.nodes().len(), whole.free_nodes());
        let (mut updated, mut fresh) = (Factor::new(symbolic.clone()), Factor::new(symbolic.clone()));
        assert_eq!(updated.refactor(&before.system).status, FactorStatus::Ok);
        assert_eq!(updated.change(&change), UpdateStatus::Ok);
        assert_eq!(fresh.refactor(&after.system).status, FactorStatus::Ok);
        let mut ws = SolveWorkspace::new(&symbolic);
        let (mut x, mut y) = (after.rhs.clone(), after.rhs.clone());
        assert!(updated.solve(&mut x, &mut ws).is_ok() && fresh.solve(&mut y, &mut ws).is_ok());
        let largest = y.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        let error = x.iter().zip(&y).fold(0.0_f64, |a, (x, y)| a.max((x - y).abs()));
        assert!(largest > 0.0 && error < 1e-9 * largest, "{error:e} of {largest:e}");
    }
}

#[test]
fn what_viscous_tissue_remembers_goes_with_its_elements() {
    for element in [ElementKind::Linear, ElementKind::Quadratic] {
        let (mesh, cut, kept, config) = blocks(element);
        let whole = FemModel::new(&mesh, &config).unwrap();
        let changed = whole.changed(&cut, &config).unwrap();
        let mut state = bent(&whole);
        advance_memory(&whole, &mut state, DT);
        let mut carried = changed.rest_state();
        carried.carry(&state, &whole, &changed, &CarriedMemory::new(&whole, &changed, &kept));
        assert!(carried.memory.len() < state.memory.len());
        // The memory of one step from rest depends on the shape alone.
        let mut own = bent(&changed);
        advance_memory(&changed, &mut own, DT);
        assert!(own.memory.iter().any(|stress| stress.norm() > 1.0));
        assert_eq!(carried.memory, own.memory);
        assert_eq!(carried.q, state.q);
        for (i, &node) in changed.node_of_free().iter().enumerate() {
            let expected = if changed.held()[i] { Vector3::zeros() } else { state.v[node as usize] };
            assert_eq!(carried.v[node as usize], expected);
        }
    }
}

#[test]
fn changes_that_do_not_fit_the_body_are_refused() {
    let (mesh, cut, _, config) = blocks(ElementKind::Linear);
    let whole = FemModel::new(&mesh, &config).unwrap();
    let mut moved = cut.clone();
    moved.nodes[5].x += 1e-3;
    assert_eq!(whole.changed(&moved, &config).unwrap_err(), FemError::Changed { what: "nodes" });
    let other = FemConfig { fixed: vec![0, 1, 2, 3], ..config.clone() };
    assert_eq!(whole.changed(&cut, &other).unwrap_err(), FemError::Changed { what: "fixed nodes" });
    let quadratic = FemConfig { element: ElementKind::Quadratic, ..config.clone() };
    assert_eq!(whole.changed(&cut, &quadratic).unwrap_err(), FemError::Changed { what: "elements" });
    // What was cut cannot come back: the pattern of the cut body has no place for it.
    let smaller =
        FemModel::new(&block([1, 1, 1], [0.01; 3], 0.0), &FemConfig { fixed: vec![0], ..FemConfig::default() });
    let mut turned = block([1, 1, 1], [0.01; 3], 0.0);
    let whole_cube = turned.tetrahedra.clone();
    turned.tetrahedra = vec![[1, 2, 4, 7]];
    let first = smaller.unwrap().changed(&turned, &FemConfig { fixed: vec![0], ..FemConfig::default() });
    assert!(whole_cube.len() == 6 && first.is_err());
    let averaged = FemConfig { element: ElementKind::Averaged, grouping: Grouping::Patches, ..config.clone() };
    let mesh = TetMesh { regions: Vec::new(), region_names: Vec::new(), ..mesh };
    let averaged = FemConfig { region_viscosities: Default::default(), ..averaged };
    let body = FemModel::new(&mesh, &averaged).unwrap();
    assert_eq!(body.changed(&mesh, &averaged).unwrap_err(), FemError::ChangedAverages);
    let unknown = FemConfig { held: vec![100_000], ..config };
    assert!(matches!(whole.changed(&cut, &unknown), Err(FemError::FixedOutOfRange { node: 100_000, .. })));
}
