//! Static solutions of an independent finite-element code (FElupe 11.3) on the same mesh with the same element and law.
#![allow(clippy::print_stdout)]

use std::{fs, path::PathBuf};

use crate::tissue_setup::{equilibrium_dense, nodes_where};
use nalgebra::Vector3;
use palpate_fem::{
    assembly::FemWorkspace,
    material::{Lame, MooneyRivlin, NeoHookean, StVenantKirchhoff},
    mesh::TetMesh,
    model::{FemConfig, FemModel},
};
use serde_json::Value;

/// Folder of the reference solutions, if it is there.
fn folder() -> Option<PathBuf> {
    let shared =
        std::env::var("PALPATE_SHARED").unwrap_or(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared").into());
    let folder = PathBuf::from(shared).join("reference/fem");
    folder.is_dir().then_some(folder)
}

/// Points and tetrahedra of an ASCII legacy VTK file that holds nothing else before them.
fn read_vtk(text: &str) -> TetMesh {
    let mut words = text.split_whitespace();
    let number = |words: &mut std::str::SplitWhitespace| words.next().unwrap().parse::<f64>().unwrap();
    words.by_ref().find(|w| *w == "POINTS").unwrap();
    let points = number(&mut words) as usize;
    words.next();
    let mut mesh = TetMesh::default();
    for _ in 0..points {
        let x: [f64; 3] = std::array::from_fn(|_| number(&mut words));
        mesh.nodes.push(x.into());
    }
    words.by_ref().find(|w| *w == "CELLS").unwrap();
    let cells = number(&mut words) as usize;
    number(&mut words);
    for _ in 0..cells {
        assert_eq!(number(&mut words), 4.0);
        mesh.tetrahedra.push(std::array::from_fn(|_| number(&mut words) as u32));
    }
    // Orientation of the file's tetrahedra is not part of the reference.
    for t in &mut mesh.tetrahedra {
        let [a, b, c, d] = t.map(|i| mesh.nodes[i as usize]);
        if (b - a).cross(&(c - a)).dot(&(d - a)) < 0.0 {
            t.swap(2, 3);
        }
    }
    mesh
}

fn vector(value: &Value) -> Vector3<f64> {
    Vector3::from_fn(|c, _| value[c].as_f64().unwrap())
}

/// Solves the case and compares displacements (relative to the largest) and the reaction at the bottom.
fn agrees_with_reference(case: &str) {
    let Some(folder) = folder() else {
        println!("skipped: ../shared/reference/fem is absent (set PALPATE_SHARED)");
        return;
    };
    let reference: Value =
        serde_json::from_str(&fs::read_to_string(folder.join(format!("{case}.json"))).unwrap()).unwrap();
    let mesh = read_vtk(&fs::read_to_string(folder.join(format!("{case}.vtk"))).unwrap());
    let u: Vec<Vector3<f64>> = reference["u"].as_array().unwrap().iter().map(vector).collect();
    let top = mesh.nodes.iter().map(|x| x.z).fold(f64::NEG_INFINITY, f64::max);
    let bottom_nodes = nodes_where(&mesh, |x| x.z < 1e-9);
    let held_top = if reference["top"].is_null() { Vec::new() } else { nodes_where(&mesh, |x| x.z > top - 1e-9) };

    let parameter = |name: &str| reference["parameters"][name].as_f64().unwrap();
    let gravity = if reference["gravity"].is_null() { Vector3::zeros() } else { vector(&reference["gravity"]) };
    let config = FemConfig {
        material: match reference["law"].as_str().unwrap() {
            "neo_hookean" => NeoHookean::from_moduli(parameter("mu"), parameter("k0")).unwrap().into(),
            "mooney_rivlin" => MooneyRivlin { c1: parameter("c1"), c2: parameter("c2"), bulk: parameter("k0") }.into(),
            "st_venant_kirchhoff" => {
                let lame = Lame { mu: parameter("mu"), lambda: parameter("lambda") };
                StVenantKirchhoff { young: lame.young(), poisson: lame.poisson() }.into()
            }
            law => panic!("no law called {law}"),
        },
        density: reference["density"].as_f64().unwrap(),
        fixed: bottom_nodes.iter().chain(&held_top).copied().collect(),
        filter: false,
        ..FemConfig::default()
    };
    let mut state = None;
    let mut solved = None;
    // The load in ten steps.
    for step in 1..=10 {
        let share = f64::from(step) / 10.0;
        let model = FemModel::new(&mesh, &FemConfig { gravity: gravity * share, ..config.clone() }).unwrap();
        let mut ws = FemWorkspace::new(&model);
        let state = state.get_or_insert_with(|| model.rest_state());
        for &i in &held_top {
            state.q[i as usize] = mesh.nodes[i as usize] + u[i as usize] * share;
        }
        // 1e-11 N beside forces of 10 N.
        let residual = equilibrium_dense(&model, state, &mut ws, 1e-11);
        assert!(residual < 1e-9, "{case}: step {step} left {residual:e} N");
        solved = Some(ws);
    }
    let (state, ws) = (state.unwrap(), solved.unwrap());

    let largest = u.iter().map(|u| u.norm()).fold(0.0, f64::max);
    let error = (state.q.iter().zip(&mesh.nodes).zip(&u)).map(|((q, x), u)| (q - x - u).norm()).fold(0.0, f64::max);
    let reaction: Vector3<f64> = bottom_nodes.iter().map(|&i| -ws.f_int[i as usize]).sum();
    // The force of the ground on the tissue, without the weight of the bottom nodes, which the ground carries as well.
    let expected = vector(&reference["reaction_bottom"]);
    let difference = (reaction - expected).norm() / expected.norm();
    println!("{case}: displacements differ by {:.1e}, reaction by {difference:.1e}", error / largest);
    // The reference stops at a residual that leaves about 1e-10.
    assert!(error < 1e-6 * largest && difference < 1e-6, "{case}: {:e} {difference:e}", error / largest);
}

#[test]
fn a_compressed_neo_hookean_block_agrees_with_an_independent_code() {
    agrees_with_reference("compress_neo_hookean");
}

#[test]
fn a_sagging_neo_hookean_block_agrees_with_an_independent_code() {
    agrees_with_reference("sag_neo_hookean");
}

#[test]
fn a_sheared_mooney_rivlin_block_agrees_with_an_independent_code() {
    agrees_with_reference("shear_mooney_rivlin");
}

#[test]
fn a_stretched_st_venant_kirchhoff_block_agrees_with_an_independent_code() {
    agrees_with_reference("stretch_st_venant_kirchhoff");
}
