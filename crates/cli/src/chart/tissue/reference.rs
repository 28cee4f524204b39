//! Static solutions of an independent finite-element code on the same mesh, with the same law and linear tetrahedra.

use std::path::Path;
use std::sync::Arc;

use miette::{IntoDiagnostic, Result, WrapErr, miette};
use nalgebra::Vector3;
use palpate::fem::factor::SymbolicFactor;
use palpate::fem::format;
use palpate::fem::integrator::equilibrium::{EquilibriumConfig, Loads, Prescribed, equilibrium};
use palpate::fem::integrator::newton::{ImplicitWorkspace, NewtonConfig};
use palpate::fem::material::Material;
use palpate::fem::model::{FemConfig, FemModel};
use serde::Deserialize;

/// The cases: compressed, sheared, stretched, sagging under its weight.
pub(crate) const CASES: [&str; 4] =
    ["compress_neo_hookean", "shear_mooney_rivlin", "stretch_st_venant_kirchhoff", "sag_neo_hookean"];

/// How far we are from the reference.
#[derive(Clone, Debug)]
pub(crate) struct Agreement {
    /// The law.
    pub(crate) law: String,
    /// Largest distance of a node from where the reference has it, over the largest displacement.
    pub(crate) displacement: f64,
    /// Difference of the force on the bottom, over that force.
    pub(crate) reaction: f64,
    /// Load steps and linear solves.
    pub(crate) effort: (u32, u32),
}

#[derive(Deserialize)]
struct Reference {
    law: String,
    parameters: Parameters,
    top: Option<String>,
    density: f64,
    gravity: Option<[f64; 3]>,
    reaction_bottom: [f64; 3],
    u: Vec<[f64; 3]>,
}

#[derive(Deserialize)]
struct Parameters {
    mu: Option<f64>,
    lambda: Option<f64>,
    k0: Option<f64>,
    c1: Option<f64>,
    c2: Option<f64>,
}

impl Reference {
    /// The law of the reference, by the name and the parameters that a scene would give.
    fn material(&self) -> Result<Material> {
        let p = &self.parameters;
        let mut table = serde_json::Map::new();
        let mut set = |name: &str, value: f64| table.insert(name.into(), value.into());
        match (self.law.as_str(), p) {
            ("neo_hookean" | "st_venant_kirchhoff", Parameters { mu: Some(mu), .. }) => {
                // Small strain: mu and lambda give Young's modulus and Poisson's ratio.
                let lambda = p.lambda.or(p.k0).ok_or_else(|| miette!("no bulk parameter"))?;
                set("young", mu * (3.0 * lambda + 2.0 * mu) / (lambda + mu));
                set("poisson", 0.5 * lambda / (lambda + mu));
            }
            ("mooney_rivlin", Parameters { c1: Some(c1), c2: Some(c2), k0: Some(k0), .. }) => {
                set("c1", *c1);
                set("c2", *c2);
                set("bulk", *k0);
            }
            (law, _) => return Err(miette!("no such law here: {law}")),
        }
        table.insert("law".into(), self.law.clone().into());
        serde_json::from_value(table.into()).into_diagnostic()
    }
}

/// Solves a case of the folder and compares.
pub(crate) fn compare(folder: &Path, case: &str) -> Result<Agreement> {
    let path = folder.join(format!("fem/{case}.json"));
    let text = std::fs::read_to_string(&path).into_diagnostic().wrap_err_with(|| path.display().to_string())?;
    let reference: Reference = serde_json::from_str(&text).into_diagnostic()?;
    let mesh = format::read(&folder.join(format!("fem/{case}.vtk"))).map_err(|e| miette!("{e}"))?.mesh;
    let u: Vec<Vector3<f64>> = reference.u.iter().map(|u| Vector3::from(*u)).collect();
    let (low, high) = mesh.nodes.iter().fold((f64::MAX, f64::MIN), |(a, b), x| (a.min(x.z), b.max(x.z)));
    let at = |z: f64| {
        let near = |x: &Vector3<f64>| (x.z - z).abs() < 1e-9;
        (0..mesh.nodes.len() as u32).filter(|&i| near(&mesh.nodes[i as usize])).collect::<Vec<u32>>()
    };
    let bottom = at(low);
    let top = if reference.top.is_some() { at(high) } else { Vec::new() };
    let config = FemConfig {
        material: reference.material()?,
        density: reference.density,
        gravity: reference.gravity.map_or_else(Vector3::zeros, Vector3::from),
        fixed: bottom.iter().chain(&top).copied().collect(),
        filter: false,
        ..FemConfig::default()
    };
    let model = FemModel::new(&mesh, &config).map_err(|e| miette!("{e}"))?;
    let rest: Vec<_> = model.node_of_free().iter().map(|&i| mesh.nodes[i as usize]).collect();
    let symbolic = Arc::new(SymbolicFactor::new(model.pattern(), &rest).map_err(|e| miette!("{e}"))?);
    let mut ws = ImplicitWorkspace::new(&model, &symbolic);
    let mut state = model.rest_state();
    let prescribed: Vec<Prescribed> =
        top.iter().map(|&node| Prescribed { node, position: mesh.nodes[node as usize] + u[node as usize] }).collect();
    let loads = Loads { prescribed: &prescribed, ..Loads::default() };
    let newton = NewtonConfig { iterations: 40, tolerance: 1e-10 };
    let settings = EquilibriumConfig { newton, ..EquilibriumConfig::default() };
    let report = equilibrium(&model, &loads, &settings, &mut state, &mut ws).into_diagnostic()?;
    let largest = u.iter().map(|u| u.norm()).fold(0.0, f64::max);
    let distance = state.q.iter().zip(&mesh.nodes).zip(&u).map(|((q, x), u)| (q - x - u).norm()).fold(0.0, f64::max);
    // The reference leaves out the weight of the bottom's own nodes, which the ground carries as well.
    let force: Vector3<f64> = bottom.iter().map(|&i| -ws.fem.f_int[i as usize]).sum();
    let expected = Vector3::from(reference.reaction_bottom);
    Ok(Agreement {
        law: reference.law,
        displacement: distance / largest,
        reaction: (force - expected).norm() / expected.norm(),
        effort: (report.load_steps, report.iterations),
    })
}

/// The folder of reference data for tests.
#[cfg(test)]
pub(crate) fn folder() -> Option<std::path::PathBuf> {
    let shared = std::env::var_os("PALPATE_SHARED").map_or_else(
        || std::path::PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared")),
        std::path::PathBuf::from,
    );
    Some(shared.join("reference")).filter(|folder| folder.is_dir())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equilibria_agree_with_an_independent_code_to_a_millionth() {
        let Some(folder) = folder() else {
            println!("skipped: there are no reference data; PALPATE_SHARED names their folder");
            return;
        };
        for case in CASES {
            let a = compare(&folder, case).unwrap();
            assert!(a.displacement < 1e-6 && a.reaction < 1e-6, "{case}: {a:?}");
        }
    }
}
