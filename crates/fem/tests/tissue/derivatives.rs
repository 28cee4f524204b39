//! Energy, force and tangent of every registered law are derivatives of one another, and respect the symmetries of
//! space: on one skewed element, in stretched, sheared, compressed, nearly flat and inverted states.
#![allow(non_snake_case)]

use crate::tissue_setup::{Random, all_materials};
use nalgebra::{DMatrix, Matrix3, Rotation3, SMatrix, Vector3};
use palpate_fem::{
    element::{ElementMatrices, Tetrahedron, UPPER},
    material::{Law, Material},
};

type Matrix12 = SMatrix<f64, 12, 12>;

/// A skewed element of about 1 cm.
fn element() -> (Tetrahedron, Vec<Vector3<f64>>) {
    let q = [[0.0, 0.0, 0.0], [0.011, 0.001, -0.002], [0.003, 0.009, 0.001], [-0.001, 0.002, 0.012]];
    let q: Vec<_> = q.into_iter().map(Vector3::from).collect();
    (Tetrahedron::new([0, 1, 2, 3], &q).unwrap(), q)
}

/// Deformation gradients by name; `J` in brackets.
fn states() -> Vec<(&'static str, Matrix3<f64>)> {
    let turn = Rotation3::from_euler_angles(0.4, -1.1, 2.0).into_inner();
    let lean = Rotation3::from_euler_angles(-0.7, 0.3, 0.5).into_inner();
    let diagonal = |a, b, c| Matrix3::from_diagonal(&Vector3::new(a, b, c));
    let mut shear = Matrix3::identity();
    shear[(0, 1)] = 0.8;
    shear[(1, 2)] = -0.5;
    vec![
        ("nearly at rest", turn * diagonal(1.01, 0.98, 1.02)),
        ("stretched (2.0)", turn * diagonal(2.1, 1.2, 0.8) * lean),
        ("sheared (1)", turn * shear),
        ("compressed (0.3)", turn * diagonal(0.95, 0.8, 0.3 / 0.76) * lean),
        ("equal stretches (0.9)", turn * diagonal(1.2, 1.2, 0.625) * lean),
        ("nearly equal (0.5)", turn * diagonal(0.8, 0.8 + 1e-9, 0.8 - 3e-7) * lean),
        ("below the floor of a stretch (0.27)", turn * diagonal(1.4, 1.0, 0.19) * lean),
        ("crushed (0.05)", turn * diagonal(0.9, 0.5, 0.1) * lean),
        ("inverted (-0.5)", turn * diagonal(1.1, 0.9, -0.5) * lean),
        ("inverted far (-2)", turn * diagonal(1.6, 1.3, -1.0) * lean),
    ]
}

/// Laws that a rotation leaves alone.
fn frame_indifferent() -> impl Iterator<Item = Material> {
    all_materials(5e3, 0.45).into_iter().filter(Law::is_frame_indifferent)
}

fn deform(F: &Matrix3<f64>, q: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    q.iter().map(|x| F * x).collect()
}

fn energy(material: &Material, element: &Tetrahedron, q: &[Vector3<f64>]) -> f64 {
    element.volume * material.energy_density(&element.deformation_gradient(q))
}

fn matrices(material: &Material, element: &Tetrahedron, q: &[Vector3<f64>], filter: bool) -> (ElementMatrices, bool) {
    let mut out = ElementMatrices::ZERO;
    let filtered = material.element(element, &element.edges(q), filter, &mut out);
    (out, filtered)
}

fn forces(material: &Material, element: &Tetrahedron, q: &[Vector3<f64>]) -> [Vector3<f64>; 4] {
    let (out, _) = matrices(material, element, q, false);
    std::array::from_fn(|a| out.force(a))
}

fn stiffness(out: &ElementMatrices) -> Matrix12 {
    let mut K = Matrix12::zeros();
    for (k, (a, b)) in UPPER.into_iter().enumerate() {
        let block = out.upper(k);
        K.fixed_view_mut::<3, 3>(3 * b, 3 * a).copy_from(&block.transpose());
        K.fixed_view_mut::<3, 3>(3 * a, 3 * b).copy_from(&block);
    }
    K
}

/// Central differences err by `h² f'''` and by `eps f / h`; `h = eps^(1/3)` of the element's size balances both near
/// `eps^(2/3)` = 4e-11 of the values. Two orders more allow for third derivatives of strongly deformed states.
const STEP: f64 = 6e-6 * 0.01;
const RELATIVE: f64 = 1e-8;

#[test]
fn force_is_minus_the_derivative_of_the_energy() {
    let (element, rest) = element();
    for material in all_materials(5e3, 0.45) {
        for (name, F) in states() {
            let q = deform(&F, &rest);
            let f = forces(&material, &element, &q);
            let scale = f.iter().map(|f| f.norm()).fold(0.0, f64::max);
            for (a, c) in (0..4).flat_map(|a| (0..3).map(move |c| (a, c))) {
                let at = |sign: f64| {
                    let mut moved = q.clone();
                    moved[a][c] += sign * STEP;
                    energy(&material, &element, &moved)
                };
                let difference = -(at(1.0) - at(-1.0)) / (2.0 * STEP);
                // The energy itself is rounded, which its size over the step shows.
                let tolerance = RELATIVE * (scale + 1e-8 * at(0.0).abs() / STEP);
                assert!(
                    (difference - f[a][c]).abs() <= tolerance,
                    "{} {name}: {difference} {}",
                    material.name(),
                    f[a][c]
                );
            }
        }
    }
}

#[test]
fn stiffness_is_minus_the_derivative_of_the_force_and_symmetric() {
    let (element, rest) = element();
    for material in all_materials(5e3, 0.45) {
        for (name, F) in states() {
            let q = deform(&F, &rest);
            let K = stiffness(&matrices(&material, &element, &q, false).0);
            let mut differences = Matrix12::zeros();
            for (b, c) in (0..4).flat_map(|b| (0..3).map(move |c| (b, c))) {
                let at = |sign: f64| {
                    let mut moved = q.clone();
                    moved[b][c] += sign * STEP;
                    forces(&material, &element, &moved)
                };
                let (ahead, behind) = (at(1.0), at(-1.0));
                for a in 0..4 {
                    let column = (behind[a] - ahead[a]) / (2.0 * STEP);
                    differences.fixed_view_mut::<3, 1>(3 * a, 3 * b + c).copy_from(&column);
                }
            }
            let error = (K - differences).amax() / K.amax();
            assert!(error <= RELATIVE, "{} {name}: K differs from -df/dq by {error:e}", material.name());
            let skew = (K - K.transpose()).amax() / K.amax();
            assert!(skew <= 1e-14, "{} {name}: not symmetric by {skew:e}", material.name());
        }
    }
}

#[test]
fn the_energy_is_zero_and_free_of_force_at_rest() {
    let (element, rest) = element();
    for material in all_materials(5e3, 0.45) {
        assert!(energy(&material, &element, &rest).abs() < 1e-15 * 5e3 * element.volume);
        for f in forces(&material, &element, &rest) {
            assert!(f.norm() < 1e-13 * 5e3 * 1e-4, "{}: {f}", material.name());
        }
    }
}

#[test]
fn a_rigid_motion_by_any_angle_is_free_of_force() {
    let (element, rest) = element();
    let mut random = Random(3);
    for material in frame_indifferent() {
        for k in 0..200 {
            let axis = nalgebra::Unit::new_normalize(random.vector());
            let angle = if k == 0 { std::f64::consts::PI } else { 4.0 * random.symmetric() };
            let R = Rotation3::from_axis_angle(&axis, angle);
            let shift = random.vector();
            let q: Vec<_> = rest.iter().map(|x| R * x + shift).collect();
            for f in forces(&material, &element, &q) {
                // Young's modulus times the area of a face; positions near 1 m round edges of 1 cm to 1e-14.
                assert!(f.norm() < 1e-12 * 5e3 * 1e-4 * 100.0, "{} at {angle}: {f}", material.name());
            }
        }
    }
}

#[test]
fn laws_are_frame_indifferent() {
    let Q = Rotation3::from_euler_angles(2.5, -0.4, 1.3).into_inner();
    for material in frame_indifferent() {
        for (name, F) in states() {
            let (energy, turned) = (material.energy_density(&F), material.energy_density(&(Q * F)));
            assert!((energy - turned).abs() <= 1e-12 * energy.abs().max(1.0), "{} {name}", material.name());
            let (P, turned) = (material.first_piola(&F), material.first_piola(&(Q * F)));
            assert!((Q * P - turned).amax() <= 1e-11 * P.amax(), "{} {name}", material.name());
        }
    }
}

#[test]
fn internal_forces_have_no_sum_and_no_torque() {
    let (element, rest) = element();
    for material in frame_indifferent() {
        for (name, F) in states() {
            let q = deform(&F, &rest);
            let f = forces(&material, &element, &q);
            let scale = f.iter().map(|f| f.norm()).sum::<f64>();
            let sum: Vector3<f64> = f.iter().sum();
            let torque: Vector3<f64> = q.iter().zip(&f).map(|(q, f)| q.cross(f)).sum();
            assert!(sum.norm() <= 1e-14 * scale, "{} {name}: {sum}", material.name());
            // The torque vanishes as F S Fᵀ is symmetric: to the rounding of force times the element's size.
            assert!(torque.norm() <= 1e-12 * scale * 0.02, "{} {name}: {torque}", material.name());
        }
    }
}

#[test]
fn small_strain_is_linear_elasticity() {
    let (young, poisson) = (5e3, 0.3);
    let mut random = Random(11);
    for material in all_materials(young, poisson) {
        let lame = material.small_strain();
        assert!((lame.young() - young).abs() < 1e-9 * young && (lame.poisson() - poisson).abs() < 1e-12);
        let size = 1e-6;
        let gradient = Matrix3::from_fn(|_, _| random.symmetric());
        let strain = (gradient + gradient.transpose()) * (0.5 * size);
        let linear = strain * (2.0 * lame.mu) + Matrix3::identity() * (lame.lambda * strain.trace());
        let P = material.first_piola(&(Matrix3::identity() + gradient * size));
        // What is left is quadratic in the strain: of relative size 1e-6 times a small number.
        assert!((P - linear).amax() < 2e-5 * linear.amax(), "{}: {P} {linear}", material.name());
    }
}

#[test]
fn forces_do_not_depend_on_the_order_of_nodes() {
    let (element, rest) = element();
    // The even permutations of four nodes, which keep the volume positive.
    let orders = [[1, 2, 0, 3], [0, 2, 3, 1], [1, 0, 3, 2], [3, 2, 1, 0], [2, 3, 0, 1]];
    for material in all_materials(5e3, 0.45) {
        for (name, F) in states() {
            let q = deform(&F, &rest);
            let f = forces(&material, &element, &q);
            let scale = f.iter().map(|f| f.norm()).fold(0.0, f64::max);
            for order in orders {
                let other = Tetrahedron::new(order, &rest).unwrap();
                let g = forces(&material, &other, &q);
                for (local, &node) in order.iter().enumerate() {
                    let difference = (g[local] - f[node as usize]).norm();
                    assert!(difference <= 1e-11 * scale, "{} {name} {order:?}", material.name());
                }
            }
        }
    }
}

#[test]
fn the_filter_gives_semidefinite_tangents_and_leaves_definite_ones_alone() {
    let (element, rest) = element();
    let (mut acted, mut left) = (0, 0);
    let mut random = Random(5);
    for material in all_materials(5e3, 0.45) {
        let mut cases = states();
        cases.extend((0..200).map(|_| ("random", Matrix3::from_fn(|_, _| 1.5 * random.symmetric()))));
        for (name, F) in cases {
            let q = deform(&F, &rest);
            let exact = stiffness(&matrices(&material, &element, &q, false).0);
            let (out, filtered) = matrices(&material, &element, &q, true);
            let K = stiffness(&out);
            let eigenvalues = |K: &Matrix12| {
                let K = (K + K.transpose()) * 0.5;
                DMatrix::from_fn(12, 12, |i, j| K[(i, j)]).symmetric_eigenvalues()
            };
            let (least, most) = (eigenvalues(&K).min(), K.amax());
            assert!(least >= -1e-11 * most, "{} {name}: {least:e}", material.name());
            let indefinite = eigenvalues(&exact).min() < -1e-9 * exact.amax();
            if filtered {
                acted += 1;
                assert!((K - exact).amax() > 0.0);
            } else {
                left += 1;
                assert!(!indefinite, "{} {name}: filter missed an indefinite tangent", material.name());
                assert!((K - exact).amax() <= 1e-12 * exact.amax(), "{} {name}", material.name());
            }
        }
    }
    // Both branches must have been taken, or the test says nothing.
    assert!(acted > 100 && left > 20, "{acted} {left}");
}

#[test]
fn degenerate_elements_have_finite_forces_that_restore_volume() {
    let (element, rest) = element();
    let flat = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 0.0));
    let line = Matrix3::from_diagonal(&Vector3::new(1.0, 0.0, 0.0));
    for material in all_materials(5e3, 0.45) {
        for F in [flat, line, Matrix3::zeros(), -Matrix3::identity()] {
            let q = deform(&F, &rest);
            for filter in [false, true] {
                let (out, _) = matrices(&material, &element, &q, filter);
                assert!(out.forces.iter().all(|x| x.is_finite()));
                assert!(out.blocks.iter().all(|b| b.iter().all(|x| x.is_finite())));
            }
        }
        // Opening the flat element along the force lowers the energy.
        let q = deform(&flat, &rest);
        let f = forces(&material, &element, &q);
        let along: Vec<_> = q.iter().zip(&f).map(|(q, f)| q + f * (1e-6 / f.norm())).collect();
        assert!(energy(&material, &element, &along) < energy(&material, &element, &q), "{}", material.name());
    }
}

#[test]
fn materials_are_read_by_name_and_refuse_parameters_outside_their_range() {
    let read = |text: &str| serde_json::from_str::<Material>(text);
    for name in Material::NAMES {
        let material = read(&format!(r#"{{ "law": "{name}", "young": 5000.0, "poisson": 0.45 }}"#)).unwrap();
        assert_eq!(material.name(), *name);
        assert_eq!(Some(material), Material::from_young_poisson(name, 5000.0, 0.45), "{name}");
        let again = read(&serde_json::to_string(&material).unwrap()).unwrap();
        assert_eq!(again, material);
        for (young, poisson, key) in [(-1.0, 0.3, "young"), (5e3, 0.5, "poisson"), (5e3, -1.0, "poisson")] {
            assert!(Material::from_young_poisson(name, young, poisson).unwrap().validate().is_err(), "{name}");
            let text = format!(r#"{{ "law": "{name}", "young": {young}, "poisson": {poisson} }}"#);
            assert!(read(&text).unwrap_err().to_string().starts_with(key), "{text}");
        }
        assert!(Material::from_young_poisson(name, f64::INFINITY, 0.3).unwrap().validate().is_err(), "{name}");
    }
    let by_moduli = read(r#"{ "law": "neo_hookean", "mu": 1000.0, "k0": 9000.0 }"#).unwrap().small_strain();
    assert!((by_moduli.mu - 1000.0).abs() < 1e-9 && (by_moduli.lambda - 9000.0).abs() < 1e-8);
    for wrong in [
        r#"{ "law": "neo_hookean", "mu": 1000.0 }"#,
        r#"{ "law": "neo_hookean", "mu": 1000.0, "k0": -700.0 }"#,
        r#"{ "law": "neo_hookean", "young": 5e3, "poisson": 0.45, "stiffness": 1.0 }"#,
        r#"{ "law": "corotational", "young": 5e3 }"#,
        r#"{ "law": "jelly", "young": 5e3, "poisson": 0.45 }"#,
    ] {
        assert!(read(wrong).is_err(), "{wrong}");
    }
}
