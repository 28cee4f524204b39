//! Values that are probably in another unit: each is possible, and none is what somebody meant.

use nalgebra::Isometry3;
use palpate_fem::material::{Law, Material};
use palpate_fem::mesh::TetMesh;

use crate::scene::{Readable, Scene};

/// Shear moduli (Pa) from softer than any gel to stiffer than bone.
const SHEAR_MODULI: [f64; 2] = [1.0, 1e11];

/// Densities (kg/m³) from below lung to above the heaviest metal.
const DENSITIES: [f64; 2] = [50.0, 25e3];

/// Longest time (s) of stiffness-proportional damping: a motion is damped for about as long.
const LONGEST_DAMPING: f64 = 1.0;

/// A tool that is many times as large as the body.
pub(super) fn vast_tool(scene: &Scene, mesh: &TetMesh) -> Option<String> {
    let (low, high) = scene.description().tools.first()?.shape.bounding_box(&Isometry3::identity());
    let (tool, body) = ((high - low).norm(), mesh.bounding_box().diagonal());
    let vast = tool > 20.0 * body;
    vast.then(|| format!("the tool is {tool:.3} m across and the body {body:.3} m: are the lengths of both in metres?"))
}

/// Warnings of values of body and contact.
pub(super) fn implausible(scene: &Scene, mesh: &TetMesh) -> Vec<String> {
    let description = scene.description();
    let body = &description.bodies[0];
    let mut warnings = Vec::new();
    let whole = [("the body", &body.material.law)];
    let places = whole.into_iter().chain(body.regions.iter().map(|(name, tissue)| (name.as_str(), &tissue.law)));
    warnings.extend(places.filter_map(|(place, law)| stiffness(place, law)));
    if body.total_mass.is_none() && !(DENSITIES[0]..=DENSITIES[1]).contains(&body.density) {
        let density = Readable(body.density);
        warnings.push(format!("density = {density} kg/m³: tissue has about 1,000; is it in kg/m³?"));
    }
    if body.rayleigh_stiffness > LONGEST_DAMPING {
        let time = Readable(body.rayleigh_stiffness);
        warnings.push(format!(
            "rayleigh_stiffness = {time} s damps any motion for about that long; is it in milliseconds?"
        ));
    }
    let (margin, across) = (description.contact.margin, mesh.bounding_box().diagonal());
    if margin > 0.5 * across {
        let margin = Readable(margin);
        warnings.push(format!(
            "contact.margin = {margin} m, and the body is {across:.3} m across: every face is looked at in every step; is it \
             in metres?"
        ));
    }
    warnings
}

fn stiffness(place: &str, law: &Material) -> Option<String> {
    let shear = law.small_strain().mu;
    let odd = !(SHEAR_MODULI[0]..=SHEAR_MODULI[1]).contains(&shear);
    odd.then(|| format!("{place}: a shear modulus of {shear:.1e} Pa; tissue has 1e2 to 1e6: are its moduli in Pa?"))
}
