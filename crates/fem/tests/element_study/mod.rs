//! Small-strain problems on blocks, solved directly: a manufactured solution and a tapered panel in bending and shear.
#![allow(dead_code, non_snake_case)]

use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};
use palpate_fem::{
    assembly::{Coefficients, FemWorkspace, assemble_with, volume_ratios},
    averaging::Grouping,
    element::{
        ElementKind,
        quadratic::{EDGES, shape_functions},
    },
    factor::{Factor, SolveWorkspace, SymbolicFactor},
    material::{Lame, NeoHookean},
    mesh::TetMesh,
    model::{FemConfig, FemModel, FemState},
};

use crate::tissue_setup::{block, mesh_for, nodes_where};

/// Young's modulus of all problems (Pa).
pub(crate) const YOUNG: f64 = 1e4;

/// A kind of element, and how averaged ones are grouped.
pub(crate) type Choice = (ElementKind, Grouping);

pub(crate) const LINEAR: Choice = (ElementKind::Linear, Grouping::Patches);
pub(crate) const QUADRATIC: Choice = (ElementKind::Quadratic, Grouping::Patches);
pub(crate) const AVERAGED: Choice = (ElementKind::Averaged, Grouping::Patches);
pub(crate) const AVERAGED_NODES: Choice = (ElementKind::Averaged, Grouping::Nodes);

pub(crate) fn model(mesh: &TetMesh, (element, grouping): Choice, poisson: f64, fixed: Vec<u32>) -> FemModel {
    let config = FemConfig {
        element,
        grouping,
        material: NeoHookean { young: YOUNG, poisson }.into(),
        gravity: Vector3::zeros(),
        filter: false,
        fixed,
        ..FemConfig::default()
    };
    FemModel::new(mesh, &config).expect("model")
}

/// Cost of a solution.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cost {
    pub(crate) unknowns: usize,
    pub(crate) blocks: usize,
    pub(crate) factor_nonzeros: usize,
    pub(crate) factor_flops: f64,
}

/// Displacement of every node under forces on the nodes, of the body linearised at rest.
pub(crate) fn small_displacement(model: &FemModel, forces: &[Vector3<f64>]) -> (Vec<Vector3<f64>>, Cost) {
    let mut ws = FemWorkspace::new(model);
    assemble_with(model, &model.rest_state(), Coefficients::STATIC, forces, &mut ws);
    let positions: Vec<_> = model.node_of_free().iter().map(|&i| model.q_rest()[i as usize]).collect();
    let symbolic = std::sync::Arc::new(SymbolicFactor::new(model.pattern(), &positions).expect("pattern"));
    let mut factor = Factor::new(symbolic.clone());
    factor.refactor(&ws.system);
    let mut x = ws.rhs.clone();
    assert!(factor.solve(&mut x, &mut SolveWorkspace::new(&symbolic)).is_ok());
    let mut u = vec![Vector3::zeros(); model.nodes()];
    for (k, &i) in model.node_of_free().iter().enumerate() {
        u[i as usize] = Vector3::new(x[3 * k], x[3 * k + 1], x[3 * k + 2]);
    }
    let cost = Cost {
        unknowns: x.len(),
        blocks: model.pattern().blocks(),
        factor_nonzeros: symbolic.nonzeros(),
        factor_flops: symbolic.flops(),
    };
    (u, cost)
}

/// Conical product of three Gauss points each way: barycentric coordinates and shares of the volume; exact for polynomials
/// of degree three, and for those of degree five but for the factors of the collapsed coordinates.
pub(crate) fn quadrature() -> Vec<([f64; 4], f64)> {
    let gauss = [(-0.6_f64.sqrt(), 5.0 / 18.0), (0.0, 8.0 / 18.0), (0.6_f64.sqrt(), 5.0 / 18.0)];
    let gauss = gauss.map(|(x, w)| (0.5 * (1.0 + x), w));
    let mut points = Vec::new();
    for (x, wx) in gauss {
        for (y, wy) in gauss {
            for (z, wz) in gauss {
                let l = [x, (1.0 - x) * y, (1.0 - x) * (1.0 - y) * z];
                let weight = 6.0 * wx * wy * wz * (1.0 - x).powi(2) * (1.0 - y);
                points.push(([1.0 - l.iter().sum::<f64>(), l[0], l[1], l[2]], weight));
            }
        }
    }
    points
}

/// Nodes, values and gradients of the shape functions of element `e` at barycentric coordinates; edges are straight.
fn shapes(model: &FemModel, e: usize, l: &[f64; 4]) -> (Vec<u32>, Vec<f64>, Vec<Vector3<f64>>) {
    let element = &model.elements()[e];
    let rows = element.inverse_rest_edges.transpose();
    let mut D: Vec<Vector3<f64>> = rows.column_iter().map(|c| c.into_owned()).collect();
    D.insert(0, -D.iter().sum::<Vector3<f64>>());
    match model.quadratic_elements().get(e) {
        None => (element.nodes.to_vec(), l.to_vec(), D),
        Some(curved) => {
            let mut gradients: Vec<_> = (0..4).map(|a| D[a] * (4.0 * l[a] - 1.0)).collect();
            gradients.extend(EDGES.map(|(a, b)| (D[b] * l[a] + D[a] * l[b]) * 4.0));
            (curved.nodes.to_vec(), shape_functions(l).to_vec(), gradients)
        }
    }
}

/// Consistent nodal forces of a force per volume (N/m³).
pub(crate) fn consistent_load(model: &FemModel, density: impl Fn(&Vector3<f64>) -> Vector3<f64>) -> Vec<Vector3<f64>> {
    let mut forces = vec![Vector3::zeros(); model.nodes()];
    for (e, element) in model.elements().iter().enumerate() {
        for (l, weight) in quadrature() {
            let x: Vector3<f64> = element.nodes.iter().zip(l).map(|(&i, l)| model.q_rest()[i as usize] * l).sum();
            let force = density(&x) * (weight * element.volume);
            let (nodes, N, _) = shapes(model, e, &l);
            nodes.iter().zip(N).for_each(|(&i, n)| forces[i as usize] += force * n);
        }
    }
    forces
}

/// A displacement without divergence that vanishes on the unit cube's surface, and its gradient.
fn exact(x: &Vector3<f64>) -> (Vector3<f64>, Matrix3<f64>) {
    let s2 = x.map(|x| (PI * x).sin().powi(2));
    let s = x.map(|x| (2.0 * PI * x).sin());
    let c = x.map(|x| (2.0 * PI * x).cos());
    let scale = [2.0, -1.0, -1.0];
    let mut u = Vector3::zeros();
    let mut gradient = Matrix3::zeros();
    for i in 0..3 {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        u[i] = scale[i] * s2[i] * s[j] * s[k];
        gradient[(i, i)] = scale[i] * PI * s[i] * s[j] * s[k];
        gradient[(i, j)] = scale[i] * 2.0 * PI * s2[i] * c[j] * s[k];
        gradient[(i, k)] = scale[i] * 2.0 * PI * s2[i] * s[j] * c[k];
    }
    (u, gradient)
}

/// `-Δu` of that displacement.
fn exact_load(x: &Vector3<f64>) -> Vector3<f64> {
    let scale = [2.0, -1.0, -1.0];
    Vector3::from_fn(|i, _| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        let curvature = 2.0 * (2.0 * PI * x[i]).cos() - 8.0 * (PI * x[i]).sin().powi(2);
        -scale[i] * PI * PI * curvature * (2.0 * PI * x[j]).sin() * (2.0 * PI * x[k]).sin()
    })
}

/// Errors of the manufactured solution, each over the norm of the exact answer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Errors {
    /// `‖u - u_h‖` in L2.
    pub(crate) displacement: f64,
    /// Energy norm of the error.
    pub(crate) energy: f64,
    /// `μ ‖∇(u - u_h)‖`: the energy norm without the bulk part.
    pub(crate) gradient: f64,
    /// L2 norm of the pressure (exact: none) over `μ ‖∇u‖`.
    pub(crate) pressure: f64,
}

/// Solves the manufactured problem on `cells`³ cells with inner nodes moved by 10 % of a cell.
pub(crate) fn manufactured(choice: Choice, cells: usize, poisson: f64) -> (Errors, Cost) {
    let mesh = mesh_for(&block([cells; 3], [1.0; 3], 0.1), choice.0);
    let fixed = nodes_where(&mesh, |x| x.iter().any(|&x| !(1e-9..1.0 - 1e-9).contains(&x)));
    let model = model(&mesh, choice, poisson, fixed);
    let Lame { mu, lambda } = Lame::from_young_poisson(YOUNG, poisson);
    let load = consistent_load(&model, |x| exact_load(x) * mu);
    let (u, cost) = small_displacement(&model, &load);
    let mut norms = [0.0; 6];
    for e in 0..model.elements().len() {
        for (l, weight) in quadrature() {
            let w = weight * model.elements()[e].volume;
            let (nodes, N, g) = shapes(&model, e, &l);
            let x: Vector3<f64> =
                model.elements()[e].nodes.iter().zip(l).map(|(&i, l)| model.q_rest()[i as usize] * l).sum();
            let (mut found, mut gradient) = (Vector3::zeros(), Matrix3::zeros());
            for (k, &i) in nodes.iter().enumerate() {
                found += u[i as usize] * N[k];
                gradient += u[i as usize] * g[k].transpose();
            }
            let (u_exact, gradient_exact) = exact(&x);
            let energy = |G: &Matrix3<f64>| {
                let strain = (G + G.transpose()) * 0.5;
                2.0 * mu * strain.norm_squared() + lambda * strain.trace().powi(2)
            };
            norms[0] += w * (found - u_exact).norm_squared();
            norms[1] += w * u_exact.norm_squared();
            norms[2] += w * energy(&(gradient - gradient_exact));
            norms[3] += w * energy(&gradient_exact);
            norms[4] += w * (gradient - gradient_exact).norm_squared();
            norms[5] += w * gradient_exact.norm_squared();
        }
    }
    let pressure =
        pressures(&model, &u, lambda).iter().zip(model.elements()).map(|(p, e)| p * p * e.volume).sum::<f64>();
    let errors = Errors {
        displacement: (norms[0] / norms[1]).sqrt(),
        energy: (norms[2] / norms[3]).sqrt(),
        gradient: (norms[4] / norms[5]).sqrt(),
        pressure: (pressure / norms[5]).sqrt() / mu,
    };
    (errors, cost)
}

/// `λ (J - 1)` of each element at small displacement (Pa), `J` as the bulk term sees it.
pub(crate) fn pressures(model: &FemModel, u: &[Vector3<f64>], lambda: f64) -> Vec<f64> {
    // J is linear in u near rest: a small multiple keeps it so, and loses half of the digits.
    let small = 1e-6;
    let q = model.q_rest().iter().zip(u).map(|(x, u)| x + u * small).collect();
    let state = FemState { q, v: vec![Vector3::zeros(); u.len()], memory: Vec::new() };
    volume_ratios(model, &state).iter().map(|J| lambda * (J - 1.0) / small).collect()
}

/// Cook's panel with a thickness: 48 x 44..16 x 12 mm, tapered, held at one end and sheared by 1 N at the other. Returns
/// the mean displacement of the loaded end along the load (m) and the jumps of pressure between neighbouring elements, as the
/// root of the mean square over that of the pressures.
pub(crate) fn panel(choice: Choice, refinement: usize, poisson: f64) -> (f64, f64, Cost) {
    let (nx, ny, nz) = (4 * refinement, 4 * refinement, refinement);
    let mut mesh = block([nx, ny, nz], [0.048, 1.0, 0.012], 0.0);
    for x in &mut mesh.nodes {
        let along = x.x / 0.048;
        let (low, high) = (0.044 * along, 0.044 + 0.016 * along);
        x.y = low + (high - low) * x.y;
    }
    let mesh = mesh_for(&mesh, choice.0);
    let model = model(&mesh, choice, poisson, nodes_where(&mesh, |x| x.x < 1e-9));
    let mut forces = vec![Vector3::zeros(); mesh.nodes.len()];
    let (mut area, end) = (0.0, mesh.surface());
    let loaded = |t: &&[u32; 3]| t.iter().all(|&i| mesh.nodes[i as usize].x > 0.048 - 1e-9);
    for t in end.triangles.iter().filter(loaded) {
        let [a, b, c] = t.map(|i| mesh.nodes[i as usize]);
        let A = 0.5 * (b - a).cross(&(c - a)).norm();
        area += A;
        t.iter().for_each(|&i| forces[i as usize].y += A / 3.0);
    }
    forces.iter_mut().for_each(|f| *f /= area);
    let (u, cost) = small_displacement(&model, &forces);
    // The work of the load is the force times the mean displacement.
    let mean = forces.iter().zip(&u).map(|(f, u)| f.dot(u)).sum::<f64>();
    let p = pressures(&model, &u, Lame::from_young_poisson(YOUNG, poisson).lambda);
    let (mut jumps, mut count, size) = (0.0, 0.0, p.iter().map(|p| p * p).sum::<f64>() / p.len() as f64);
    let tets: Vec<[u32; 4]> = model.elements().iter().map(|e| e.nodes).collect();
    let mut faces: Vec<([u32; 3], usize)> = Vec::new();
    for (e, t) in tets.iter().enumerate() {
        for skip in 0..4 {
            let mut face: Vec<u32> = (0..4).filter(|&a| a != skip).map(|a| t[a]).collect();
            face.sort_unstable();
            faces.push(([face[0], face[1], face[2]], e));
        }
    }
    faces.sort_unstable();
    for pair in faces.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
        jumps += (p[pair[0].1] - p[pair[1].1]).powi(2);
        count += 1.0;
    }
    (mean, (jumps / count / size).sqrt(), cost)
}
