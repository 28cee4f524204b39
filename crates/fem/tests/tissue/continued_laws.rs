//! Laws that end at a flat element go on as another function below a volume ratio.

#![allow(non_snake_case)]

use crate::tissue_setup::all_materials;
use nalgebra::{Matrix3, Vector3};
use palpate_fem::material::{Law, Material, neo_hookean::EXTENSION_BELOW as J0};

/// Stress (Pa) along an axis that is shortened to `J`, across which nothing moves.
fn pressure(material: &Material, J: f64) -> f64 {
    material.first_piola(&Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, J)))[(2, 2)]
}

#[test]
fn the_continuation_is_twice_differentiable_where_it_begins() {
    for material in all_materials(5e3, 0.45) {
        let d = 1e-7;
        let [below, at, above] = [J0 - d, J0, J0 + d].map(|J| pressure(&material, J));
        assert!((above - at - (at - below)).abs() < 1e-5 * (above - below).abs(), "{}", material.name());
    }
}

/// The third derivative of the energy jumps where another function begins, and only there: the curvature of the pressure
/// on the two sides, each from three points, differs by `O(d)` of itself where it does not.
#[test]
fn laws_say_whether_another_function_begins() {
    for material in all_materials(5e3, 0.45) {
        let d = 1e-4;
        let curvature = |J: f64| {
            let [a, b, c] = [J - d, J, J + d].map(|J| pressure(&material, J));
            (a - 2.0 * b + c) / (d * d)
        };
        let (below, above) = (curvature(J0 - d), curvature(J0 + d));
        let (stiffness, name) = (material.small_strain().lambda, material.name());
        let jumps = (above - below).abs() > 0.1 * stiffness;
        assert_eq!(jumps, material.is_continued(), "{name}: {below:e} below and {above:e} above");
    }
}

#[test]
fn an_inverted_element_is_pushed_back_harder_the_further_it_is_inverted() {
    let material = all_materials(5e3, 0.45)[0];
    let [far, near, crushed] = [-0.5, -0.2, 0.1].map(|J| pressure(&material, J));
    assert!(far < near && near < crushed && crushed < 0.0);
}
