//! What a user chooses for a soft body.

use std::{collections::BTreeMap, sync::Arc};

use nalgebra::Vector3;

use super::FemError;
use crate::{
    averaging::Grouping,
    element::ElementKind,
    material::{Law, Material, MaterialError, NeoHookean, PronyTerm, viscosity::validate_prony},
    mesh::TetMesh,
};

/// Largest ratio of Young's moduli within one body. Beyond it single-step integration and the preconditioner lose more
/// digits than a real-time tolerance leaves.
pub const MAX_STIFFNESS_RATIO: f64 = 1e4;

/// Choices for one soft body.
#[derive(Clone, Debug, PartialEq)]
pub struct FemConfig {
    /// The kind of all elements; quadratic ones need a mesh with mid-nodes. Default: linear.
    pub element: ElementKind,
    /// How averaged elements are grouped. Default: patches, which the convergence study favours.
    pub grouping: Grouping,
    /// Material of the regions that `region_materials` does not name. Default: neo-Hookean, 5 kPa, 0.45 (soft liver).
    pub material: Material,
    /// Material by region name. Default: none.
    pub region_materials: BTreeMap<String, Material>,
    /// Prony viscosity of the regions that `region_viscosities` does not name; no terms is elastic. Default: none.
    pub viscosity: Vec<PronyTerm>,
    /// Prony viscosity by region name. Default: none.
    pub region_viscosities: BTreeMap<String, Vec<PronyTerm>>,
    /// Density of the regions that `region_densities` does not name (kg/m³), >= 0. Default: 1060.
    pub density: f64,
    /// Density by region name (kg/m³), >= 0. Default: none.
    pub region_densities: BTreeMap<String, f64>,
    /// If set, this mass (kg) is shared equally by all nodes, fixed ones included, and densities are not used: the
    /// uniform mass of other engines' scenes. Default: none.
    pub total_mass: Option<f64>,
    /// Rayleigh damping by mass `α` (1/s), >= 0: `C = α M + β K`. Default: 0.
    pub rayleigh_mass: f64,
    /// Rayleigh damping by stiffness `β` (s), >= 0. Default: 0.
    pub rayleigh_stiffness: f64,
    /// Acceleration of gravity (m/s²). Default: (0, 0, -9.81).
    pub gravity: Vector3<f64>,
    /// Mesh nodes that do not move: they keep the position that the state holds. Default: none.
    pub fixed: Vec<u32>,
    /// Mesh nodes that do not move for now but may be released by [`FemModel::changed`](super::FemModel::changed): they keep
    /// their rows in the system, which are those of a mass alone. Backward Euler serves such bodies. Default: none.
    pub held: Vec<u32>,
    /// Definiteness filter: each element's tangent is replaced by the nearest positive semidefinite one. On for real
    /// time; off for reference runs, where Newton's method converges quadratically. Default: true.
    pub filter: bool,
}

impl Default for FemConfig {
    fn default() -> Self {
        Self {
            element: ElementKind::Linear,
            grouping: Grouping::Patches,
            material: NeoHookean { young: 5e3, poisson: 0.45 }.into(),
            region_materials: BTreeMap::new(),
            viscosity: Vec::new(),
            region_viscosities: BTreeMap::new(),
            density: 1060.0,
            region_densities: BTreeMap::new(),
            total_mass: None,
            rayleigh_mass: 0.0,
            rayleigh_stiffness: 0.0,
            gravity: Vector3::new(0.0, 0.0, -9.81),
            fixed: Vec::new(),
            held: Vec::new(),
            filter: true,
        }
    }
}

/// Checks a number of the configuration: finite and not negative.
fn not_negative(name: &'static str, value: f64, range: &'static str) -> Result<(), FemError> {
    if value >= 0.0 && value.is_finite() { Ok(()) } else { Err(FemError::OutOfRange { name, value, range }) }
}

impl FemConfig {
    /// Checks everything that does not depend on the mesh's geometry.
    pub(super) fn validate(&self, mesh: &TetMesh) -> Result<(), FemError> {
        let named = self.region_materials.keys().chain(self.region_densities.keys());
        for name in named.chain(self.region_viscosities.keys()) {
            if !mesh.region_names.contains(name) {
                return Err(FemError::UnknownRegion { name: name.clone(), known: mesh.region_names.clone() });
            }
        }
        let in_place = |place: String, material: &Material, viscosity: &[PronyTerm]| {
            let turns = viscosity.is_empty() || material.is_frame_indifferent();
            (material.validate())
                .and_then(|()| validate_prony(viscosity))
                .and_then(|()| if turns { Ok(()) } else { Err(MaterialError::NoViscosity(material.name())) })
                .map_err(|error| FemError::Material { place, error })
        };
        in_place("the body".into(), &self.material, &self.viscosity)?;
        for name in self.region_materials.keys().chain(self.region_viscosities.keys()) {
            let tissue = self.region(name);
            in_place(format!("region `{name}`"), &tissue.material, &tissue.viscosity)?;
        }
        not_negative("density", self.density, ">= 0 kg/m³ and finite (soft tissue: about 1060)")?;
        for &density in self.region_densities.values() {
            not_negative("region_densities", density, ">= 0 kg/m³ and finite (soft tissue: about 1060)")?;
        }
        if let Some(mass) = self.total_mass {
            not_negative("total_mass", mass, ">= 0 kg and finite")?;
        }
        not_negative("rayleigh_mass", self.rayleigh_mass, ">= 0 1/s and finite")?;
        not_negative("rayleigh_stiffness", self.rayleigh_stiffness, ">= 0 s and finite")?;
        if let Some(&value) = self.gravity.iter().find(|g| !g.is_finite()) {
            return Err(FemError::OutOfRange { name: "gravity", value, range: "finite, in m/s²" });
        }
        let nodes = mesh.nodes.len();
        if let Some(&node) = self.fixed.iter().chain(&self.held).find(|&&i| i as usize >= nodes) {
            return Err(FemError::FixedOutOfRange { node, nodes });
        }
        Ok(())
    }

    /// What each region consists of; the whole body where the mesh has no regions.
    pub(super) fn regions(&self, mesh: &TetMesh) -> Vec<(Tissue, f64)> {
        if mesh.regions.is_empty() {
            let tissue = Tissue { material: self.material, viscosity: self.viscosity.as_slice().into() };
            return vec![(tissue, self.density)];
        }
        let density = |name| *self.region_densities.get(name).unwrap_or(&self.density);
        mesh.region_names.iter().map(|name| (self.region(name), density(name))).collect()
    }

    fn region(&self, name: &str) -> Tissue {
        Tissue {
            material: *self.region_materials.get(name).unwrap_or(&self.material),
            viscosity: self.region_viscosities.get(name).unwrap_or(&self.viscosity).as_slice().into(),
        }
    }
}

/// A law with its viscosity.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Tissue {
    /// The law; its shear modulus is the instantaneous one.
    pub(crate) material: Material,
    /// Terms of the Prony series; none is elastic.
    pub(crate) viscosity: Arc<[PronyTerm]>,
}
