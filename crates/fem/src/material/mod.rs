//! Constitutive laws, one file each, and the register that makes them reachable by name.
//!
//! A law gives the energy density `Ψ(F)` (J/m³), the first Piola stress `P = ∂Ψ/∂F` (Pa) and what one linear tetrahedron
//! adds to the stiffness. All three are derivatives of one energy, also beyond the physical domain (inverted elements).
//! Every law is linear in two moduli, `Ψ = μ ψ_s + k ψ_b` with the shear modulus `μ` and the bulk modulus `k` at small
//! strain: [`Law::relaxed`] lowers the first, which is what viscosity acts on.
//! A new law is one file and one line in `materials!`.

#![allow(non_snake_case)]

pub mod arruda_boyce;
pub mod bulk;
pub mod corotational;
pub mod hyperelastic;
pub mod kernel;
mod lame;
pub mod linear;
pub mod mooney_rivlin;
pub mod neo_hookean;
pub mod ogden;
pub mod principal;
mod report;
pub mod response;
pub mod st_venant_kirchhoff;
pub mod stable_neo_hookean;
pub mod veronda_westmann;
pub mod viscosity;
pub(crate) mod volume;

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

pub use self::{
    arruda_boyce::ArrudaBoyce,
    bulk::Bulk,
    corotational::Corotational,
    lame::{Lame, MaterialError},
    linear::Linear,
    mooney_rivlin::MooneyRivlin,
    neo_hookean::NeoHookean,
    ogden::Ogden,
    report::BatchReport,
    st_venant_kirchhoff::StVenantKirchhoff,
    stable_neo_hookean::StableNeoHookean,
    veronda_westmann::VerondaWestmann,
    viscosity::PronyTerm,
};
use crate::{
    element::{ElementMatrices, Tetrahedron},
    pack::{DeformedPack, PACK, Pack, PackMatrices, Row},
};

/// Elements of one law that are computed together; results of a batch stay in the first-level cache.
pub const BATCH: usize = 32;

/// A hyperelastic constitutive law with validated parameters.
pub trait Law: Copy + Send + Sync {
    /// Checks the parameters against the law's range.
    fn validate(&self) -> Result<(), MaterialError>;

    /// Lamé parameters of the linear elasticity that the law tends to at small strain.
    fn small_strain(&self) -> Lame;

    /// The law with its shear modulus times `1 - share`, at the same bulk modulus; `share` in `[0, 1)`. The laws are linear
    /// in both moduli: energy, stress and tangent of the shear part are `(law - law.relaxed(share)) / share`.
    fn relaxed(&self, share: f64) -> Self;

    /// The law without its bulk term, and that term: `Ψ(F) = rest(F) + U(det F)`. `None` where the law has no term of the
    /// volume ratio alone that grows with Poisson's ratio.
    fn without_bulk(&self) -> Option<(Self, Bulk)> {
        None
    }

    /// Whether a rotation of the body leaves the energy as it is: every law but the linear one.
    fn is_frame_indifferent(&self) -> bool {
        true
    }

    /// Whether the law ends at a flat element, and goes on as another function below the volume ratio
    /// [`EXTENSION_BELOW`](neo_hookean::EXTENSION_BELOW); one that does not is the same polynomial or spectral function of
    /// `F` everywhere.
    fn is_continued(&self) -> bool;

    /// Energy density `Ψ(F)` (J/m³), zero at rest.
    fn energy_density(&self, F: &Matrix3<f64>) -> f64;

    /// First Piola stress `P = ∂Ψ/∂F` (Pa).
    fn first_piola(&self, F: &Matrix3<f64>) -> Matrix3<f64>;

    /// Forces and exact tangent of one element with deformed `edges` (m); with `filter`, the nearest positive
    /// semidefinite tangent in the space of `F`. Returns whether the filter changed the tangent.
    fn element(&self, element: &Tetrahedron, edges: &Matrix3<f64>, filter: bool, out: &mut ElementMatrices) -> bool;

    /// [`Law::element`] for the energy `Ψ(F) + p J` under a given `pressure` `p` (Pa, positive in tension). `None` where
    /// [`Law::without_bulk`] is.
    fn element_under_pressure(
        &self,
        _element: &Tetrahedron,
        _edges: &Matrix3<f64>,
        _pressure: f64,
        _filter: bool,
        _out: &mut ElementMatrices,
    ) -> Option<bool> {
        None
    }

    /// [`Law::element`] for a batch of at most [`BATCH`] elements. `out` is as long as `elements`.
    fn batch(
        &self,
        elements: &[Tetrahedron],
        q: &[Vector3<f64>],
        filter: bool,
        out: &mut [ElementMatrices],
    ) -> BatchReport {
        let mut report = BatchReport::default();
        for (k, (element, out)) in elements.iter().zip(out).enumerate() {
            let edges = element.edges(q);
            let filtered = self.element(element, &edges, filter, out);
            report.note(k as u32, edges.determinant() / (6.0 * element.volume), filtered, out.is_finite());
        }
        report
    }

    /// [`Law::element`] for a pack of elements, several at once; under pressures as
    /// [`Law::element_under_pressure`].
    fn pack(&self, at: &DeformedPack<'_>, filter: bool, out: &mut PackMatrices);

    /// The forces of [`Law::pack`] without tangents: `out` gets forces and volume ratios, its blocks mean nothing then.
    fn pack_forces(&self, at: &DeformedPack<'_>, out: &mut PackMatrices);

    /// Energy of each element of a pack (J), under pressures as [`Law::pack`]; places without an element mean nothing.
    fn pack_energies(&self, at: &DeformedPack<'_>) -> Row {
        let mut energies = [0.0; PACK];
        for (lane, energy) in energies.iter_mut().enumerate().take(at.rest.len) {
            let rest = at.rest.element(lane);
            let F = at.edges_of(lane) * rest.inverse_rest_edges;
            let pressure = at.pressure.map_or(0.0, |p| p[lane] * F.determinant());
            *energy = rest.volume * (self.energy_density(&F) + pressure);
        }
        energies
    }

    /// [`Law::pack`] for packs at nodal positions `q` (m). `out` is as long as `packs`; the report counts elements.
    fn packed(&self, packs: &[Pack], q: &[Vector3<f64>], filter: bool, out: &mut [PackMatrices]) -> BatchReport {
        let (mut report, mut first) = (BatchReport::default(), 0);
        for (pack, out) in packs.iter().zip(out) {
            self.pack(&pack.at(q), filter, out);
            out.note(first, pack.len, &mut report);
            first += pack.len as u32;
        }
        report
    }
}

/// Registers laws: the enum, its serde names, and one `match` per pack.
macro_rules! materials {
    ($($variant:ident = $name:literal),+ $(,)?) => {
        /// A material: any registered law. In files: `{ law = "neo_hookean", young = 5e3, poisson = 0.45 }`.
        #[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(tag = "law")]
        pub enum Material {
            $(
                #[doc = concat!("[`", stringify!($variant), "`], `\"", $name, "\"` in files.")]
                #[serde(rename = $name)]
                $variant($variant),
            )+
        }

        impl Material {
            /// Names of all laws, in the order of registration.
            pub const NAMES: &'static [&'static str] = &[$($name),+];

            /// Name of this law in files.
            pub fn name(&self) -> &'static str {
                match self { $(Self::$variant(_) => $name),+ }
            }

            /// The law called `name` with the given small-strain parameters; `None` where no law has that name.
            pub fn from_young_poisson(name: &str, young: f64, poisson: f64) -> Option<Self> {
                match name {
                    $($name => Some(Self::$variant($variant::from_young_poisson(young, poisson))),)+
                    _ => None,
                }
            }
        }

        impl Law for Material {
            fn validate(&self) -> Result<(), MaterialError> {
                match self { $(Self::$variant(law) => law.validate()),+ }
            }

            fn small_strain(&self) -> Lame {
                match self { $(Self::$variant(law) => law.small_strain()),+ }
            }

            fn relaxed(&self, share: f64) -> Self {
                match self { $(Self::$variant(law) => Self::$variant(Law::relaxed(law, share))),+ }
            }

            fn without_bulk(&self) -> Option<(Self, Bulk)> {
                match self { $(Self::$variant(law) => Law::without_bulk(law).map(|(law, bulk)| (law.into(), bulk))),+ }
            }

            fn element_under_pressure(
                &self,
                element: &Tetrahedron,
                edges: &Matrix3<f64>,
                pressure: f64,
                filter: bool,
                out: &mut ElementMatrices,
            ) -> Option<bool> {
                match self {
                    $(Self::$variant(law) => law.element_under_pressure(element, edges, pressure, filter, out)),+
                }
            }

            fn is_frame_indifferent(&self) -> bool {
                match self { $(Self::$variant(law) => law.is_frame_indifferent()),+ }
            }

            fn is_continued(&self) -> bool {
                match self { $(Self::$variant(law) => law.is_continued()),+ }
            }

            fn energy_density(&self, F: &Matrix3<f64>) -> f64 {
                match self { $(Self::$variant(law) => law.energy_density(F)),+ }
            }

            fn first_piola(&self, F: &Matrix3<f64>) -> Matrix3<f64> {
                match self { $(Self::$variant(law) => law.first_piola(F)),+ }
            }

            fn element(
                &self,
                element: &Tetrahedron,
                edges: &Matrix3<f64>,
                filter: bool,
                out: &mut ElementMatrices,
            ) -> bool {
                match self { $(Self::$variant(law) => law.element(element, edges, filter, out)),+ }
            }

            fn batch(
                &self,
                elements: &[Tetrahedron],
                q: &[Vector3<f64>],
                filter: bool,
                out: &mut [ElementMatrices],
            ) -> BatchReport {
                match self { $(Self::$variant(law) => law.batch(elements, q, filter, out)),+ }
            }

            fn pack(&self, at: &DeformedPack<'_>, filter: bool, out: &mut PackMatrices) {
                match self { $(Self::$variant(law) => law.pack(at, filter, out)),+ }
            }

            fn pack_forces(&self, at: &DeformedPack<'_>, out: &mut PackMatrices) {
                match self { $(Self::$variant(law) => law.pack_forces(at, out)),+ }
            }

            fn pack_energies(&self, at: &DeformedPack<'_>) -> Row {
                match self { $(Self::$variant(law) => law.pack_energies(at)),+ }
            }
        }

        $(
            impl From<$variant> for Material {
                fn from(law: $variant) -> Self {
                    Self::$variant(law)
                }
            }
        )+
    };
}

materials! {
    NeoHookean = "neo_hookean",
    Corotational = "corotational",
    Linear = "linear",
    StVenantKirchhoff = "st_venant_kirchhoff",
    StableNeoHookean = "stable_neo_hookean",
    MooneyRivlin = "mooney_rivlin",
    ArrudaBoyce = "arruda_boyce",
    VerondaWestmann = "veronda_westmann",
    Ogden = "ogden",
}
