//! How often tissue winds round its edges: once in every shape that it can have, twice where it went through itself although
//! no element is inside out; and linear elasticity, which leads it out.

use crate::tissue_setup::block;
use nalgebra::{Rotation3, Vector3};
use palpate_fem::assembly::{FemWorkspace, TangleReport, Windings, assemble, internal_forces};
use palpate_fem::element::{ElementKind, quadratic::EDGES};
use palpate_fem::material::Material;
use palpate_fem::mesh::TetMesh;
use palpate_fem::model::{FemConfig, FemModel};

fn model(mesh: &TetMesh, kind: ElementKind, law: &str, young: f64, poisson: f64) -> FemModel {
    let config = FemConfig {
        material: Material::from_young_poisson(law, young, poisson).unwrap(),
        element: kind,
        density: 1000.0,
        ..FemConfig::default()
    };
    let promoted = (kind == ElementKind::Quadratic).then(|| mesh.clone().promoted());
    FemModel::new(promoted.as_ref().unwrap_or(mesh), &config).unwrap()
}

/// A ring of 12 tetrahedra round the edge between the first two nodes, each an angle of 30° wide.
fn ring() -> TetMesh {
    let mut nodes = vec![Vector3::zeros(), Vector3::new(0.0, 0.0, 0.01)];
    nodes.extend((0..12).map(|k| {
        let (sine, cosine) = (f64::from(k) * std::f64::consts::PI / 6.0).sin_cos();
        Vector3::new(0.01 * cosine, 0.01 * sine, 0.005)
    }));
    let tetrahedra = (0..12).map(|k| [0, 1, 2 + k, 2 + (k + 1) % 12]).collect();
    TetMesh { nodes, tetrahedra, ..TetMesh::default() }
}

/// The place of `x` where the angle about the axis is `times` as large.
fn wound(x: &Vector3<f64>, times: f64) -> Vector3<f64> {
    let angle = x.y.atan2(x.x) * (times - 1.0);
    Rotation3::from_axis_angle(&Vector3::z_axis(), angle) * x
}

/// Node positions where the corners go to `place`, mid-nodes with them in the middle of their edges.
fn placed(model: &FemModel, place: impl Fn(&Vector3<f64>) -> Vector3<f64>) -> Vec<Vector3<f64>> {
    let mut q: Vec<_> = model.q_rest().iter().map(&place).collect();
    for element in model.quadratic_elements() {
        for (k, (a, b)) in EDGES.into_iter().enumerate() {
            let [a, b, mid] = [a, b, 4 + k].map(|i| element.nodes[i] as usize);
            q[mid] = (place(&model.q_rest()[a]) + place(&model.q_rest()[b])) * 0.5;
        }
    }
    q
}

#[test]
fn tissue_that_went_through_itself_winds_twice_round_an_edge_though_no_element_is_inside_out() {
    for kind in ElementKind::ALL {
        let model = model(&ring(), kind, "neo_hookean", 5e3, 0.4);
        let mut windings = Windings::new(&model);
        for (times, expected) in [(1.0, 0), (2.0, 1), (3.0, 1), (-1.0, 1)] {
            let q = placed(&model, |x| wound(x, times));
            let open = model.elements().iter().all(|e| e.deformation_gradient(&q).determinant() > 0.0);
            assert_eq!(open, times > 0.0, "{kind:?}, {times}");
            let report = windings.find(&model, &q);
            assert_eq!((report.edges, report.winding), (expected, times as i32), "{kind:?}, {times}: {report:?}");
            assert!(expected == 0 || report.tetrahedron < 12, "{report:?}");
        }
    }
}

#[test]
fn tissue_that_is_bent_turned_and_stretched_winds_once_round_every_edge() {
    let mesh = block([3, 2, 4], [0.03, 0.02, 0.04], 0.2);
    for kind in ElementKind::ALL {
        let model = model(&mesh, kind, "neo_hookean", 5e3, 0.4);
        let mut windings = Windings::new(&model);
        // Bent by 60° about the y axis, twisted, stretched across: one-to-one.
        let bent = |x: &Vector3<f64>| {
            let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), -26.0 * x.z);
            let twist = Rotation3::from_axis_angle(&Vector3::z_axis(), 20.0 * x.z);
            turn * (twist * Vector3::new(1.5 * x.x, 0.8 * x.y, 0.0) + Vector3::x() * 0.04)
        };
        let q = placed(&model, bent);
        assert!(model.elements().iter().all(|e| e.deformation_gradient(&q).determinant() > 0.0), "one-to-one");
        assert_eq!(windings.find(&model, &q), TangleReport::NONE, "{kind:?}");
        assert_eq!(windings.find(&model, model.q_rest()), TangleReport::NONE, "{kind:?}");
        // Inside out every inner edge is wound backwards, and there are some.
        let q = placed(&model, |x| Vector3::new(x.x, x.y, -x.z));
        let report = windings.find(&model, &q);
        assert!(report.edges > 50 && report.winding == -1, "{kind:?}: {report:?}");
    }
}

/// Led tissue of any element and law has forces and matrix of the linear law with its shear modulus, to the bit, and its own
/// again afterwards.
#[test]
fn led_tissue_is_linear_with_the_shear_modulus_of_its_law() {
    let mesh = block([2, 2, 3], [0.02, 0.02, 0.03], 0.2);
    for kind in ElementKind::ALL {
        let own = model(&mesh, kind, "neo_hookean", 2.8e3, 0.4);
        // `μ = 1 kPa` both.
        let linear = if kind == ElementKind::Quadratic { kind } else { ElementKind::Linear };
        let linear = model(&mesh, linear, "linear", 2.5e3, 0.25);
        let mut state = own.rest_state();
        for (k, q) in state.q.iter_mut().enumerate() {
            *q = Vector3::new(-q.y, 1.3 * q.x, q.z) + Vector3::repeat(0.001 * (k as f64).sin());
        }
        let (mut ws, mut reference) = (FemWorkspace::new(&own), FemWorkspace::new(&linear));
        let before = internal_forces(&own, &state, &mut ws);
        let forces = ws.f_int.clone();
        ws.led = true;
        let report = assemble(&own, &state, 0.03, &[], &mut ws);
        assemble(&linear, &state, 0.03, &[], &mut reference);
        // Sums over the same elements; their order may differ where averaged elements have another pattern.
        let far = ws.f_int.iter().zip(&reference.f_int).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        let largest = reference.f_int.iter().map(|f| f.norm()).fold(0.0, f64::max);
        assert!(largest > 0.0 && far <= 1e-12 * largest, "{kind:?}: {far:e} of {largest:e}");
        for i in 0..linear.free_nodes() {
            for p in own.pattern().row(i) {
                let j = own.pattern().columns()[p];
                let there = linear.pattern().find(i as u32, j).map(|p| reference.system.blocks[p]).unwrap_or_default();
                let stiffest = reference.system.blocks.iter().map(|b| b.amax()).fold(0.0, f64::max);
                assert!((ws.system.blocks[p] - there).amax() <= 1e-12 * stiffest, "{kind:?}: {i}, {j}");
            }
        }
        assert_eq!(report.inverted, before.inverted, "elements inside out are counted as by the own law");
        ws.led = false;
        internal_forces(&own, &state, &mut ws);
        assert!(ws.f_int == forces, "{kind:?}");
    }
}
