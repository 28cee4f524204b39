//! Assembly of internal forces and of the system matrix into a pattern built once.
//!
//! ```text
//! A = M + h C + h² K                                         kg,    C = α M + β K,  K = -∂f_int/∂q
//! b = h (f_ext + M g + f_int(q) - C v) - h² K v              N s
//! ```
//! over the free nodes: backward Euler with one linearisation [Baraff, Witkin 1998], unknown `Δv`. One `K` (filtered or
//! not, as the model says) stands in `A` and in `b`. Fixed nodes have no row and count as resting.
//!
//! The same bits come out for any number of threads: the elements of a body are summed in parts, and the parts by rows, both in
//! an order of the body's own.

#![allow(non_snake_case)]

mod energy;
mod fold;
mod packed;
mod rows;
mod sum;
mod upper;
mod viscous;
mod winding;

use nalgebra::{Matrix3, Vector3};

use self::rows::{for_rows, system_block};
use self::sum::{Wanted, sum_elements};
pub(crate) use self::{energy::sum_by_halves, packed::PackLists, upper::UpperBlocks};
pub use self::{
    energy::{elastic_energy, incremental_energy},
    fold::{FoldReport, Folds, OPEN_BELOW},
    viscous::advance_memory,
    winding::{TangleReport, Windings},
};
use crate::{
    averaging::AveragingWorkspace,
    element::{ElementKind, QuadraticTetrahedron},
    material::BatchReport,
    model::{FemModel, FemState},
    pack::{PackMatrices, QuadraticPackMatrices},
    sparse::SystemMatrix,
};

/// Rows that one task handles.
const ROWS: usize = 64;

/// Scratch memory of a body: everything that may be thrown away.
#[derive(Clone, Debug)]
pub struct FemWorkspace {
    /// The matrix of the last assembly.
    pub system: SystemMatrix,
    /// Right side of the last assembly, `3 n` values over the free nodes.
    pub rhs: Vec<f64>,
    /// Internal force on every mesh node (N), fixed ones included: there it is minus the reaction.
    pub f_int: Vec<Vector3<f64>>,
    /// The step (s) in which viscous tissue relaxes, for functions that are told none. At first infinity: the relaxed
    /// equilibrium.
    pub dt: f64,
    /// Whether the next assemblies filter the tangents; at first what the model says.
    pub filter: bool,
    /// Elements that are held open; at first none.
    pub folds: Folds,
    /// Whether forces and tangents are those of linear elasticity in place of the laws, to lead the body out of a tangle: with
    /// the shear moduli of the laws and Poisson's ratio 1/4, without viscosity. Its energy is convex, so that one equilibrium
    /// is all it has. At first false; energies are not concerned.
    pub led: bool,
    /// Upper blocks of `K`.
    upper: Vec<Matrix3<f64>>,
    /// Results of packs, of one kind or the other: a batch of each part.
    pack_results: Vec<PackMatrices>,
    quadratic_results: Vec<QuadraticPackMatrices>,
    /// Blocks and forces of all parts.
    part_blocks: Vec<Matrix3<f64>>,
    part_forces: Vec<Vector3<f64>>,
    averaging: AveragingWorkspace,
}

impl FemWorkspace {
    /// Memory for a body, on one thread or several.
    pub fn new(model: &FemModel) -> Self {
        let lists = model.pack_lists();
        let (part_blocks, part_forces) = lists.places();
        let results = model.packs_of_batch() * lists.parts().len();
        let quadratic = model.element_kind() == ElementKind::Quadratic;
        Self {
            system: SystemMatrix::zeros(model.pattern().clone()),
            rhs: vec![0.0; 3 * model.free_nodes()],
            f_int: vec![Vector3::zeros(); model.nodes()],
            dt: f64::INFINITY,
            filter: model.filter(),
            folds: Folds::new(model),
            led: false,
            upper: vec![Matrix3::zeros(); model.upper_blocks().count()],
            pack_results: vec![PackMatrices::ZERO; if quadratic { 0 } else { results }],
            quadratic_results: vec![QuadraticPackMatrices::ZERO; if quadratic { results } else { 0 }],
            averaging: model.averaging().map(|groups| groups.workspace()).unwrap_or_default(),
            part_blocks: vec![Matrix3::zeros(); part_blocks],
            part_forces: vec![Vector3::zeros(); part_forces],
        }
    }
}

/// Factors of mass and stiffness in a matrix `mass M + stiffness K`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coefficients {
    /// Factor of the lumped mass matrix.
    pub mass: f64,
    /// Factor of the tangent stiffness.
    pub stiffness: f64,
}

impl Coefficients {
    /// `K` alone (N/m), for static solutions.
    pub const STATIC: Self = Self { mass: 0.0, stiffness: 1.0 };
}

/// What an assembly met. Elements are tetrahedra of the mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AssemblyReport {
    /// Elements whose tangent the definiteness filter changed.
    pub filtered: u32,
    /// Elements with volume ratio `J <= 0`.
    pub inverted: u32,
    /// Smallest volume ratio `J`.
    pub min_jacobian: f64,
    /// Tetrahedron of the smallest `J`; `u32::MAX` where no `J` is a number.
    pub min_jacobian_tetrahedron: u32,
    /// A tetrahedron whose force or stiffness is not finite: the first one of the first material that has any.
    pub non_finite: Option<u32>,
}

impl AssemblyReport {
    /// Before any assembly: nothing was met.
    pub const NONE: Self = Self {
        filtered: 0,
        inverted: 0,
        min_jacobian: f64::INFINITY,
        min_jacobian_tetrahedron: u32::MAX,
        non_finite: None,
    };

    /// The worst of two assemblies: the larger counts, the smallest volume ratio, the first element that is not finite.
    #[must_use]
    pub fn worst(self, later: Self) -> Self {
        let least = if later.min_jacobian < self.min_jacobian { later } else { self };
        Self {
            filtered: self.filtered.max(later.filtered),
            inverted: self.inverted.max(later.inverted),
            min_jacobian: least.min_jacobian,
            min_jacobian_tetrahedron: least.min_jacobian_tetrahedron,
            non_finite: self.non_finite.or(later.non_finite),
        }
    }

    fn new(report: BatchReport, model: &FemModel) -> Self {
        let tetrahedron = |e: u32| model.mesh_tetrahedron().get(e as usize).copied().unwrap_or(u32::MAX);
        Self {
            filtered: report.filtered,
            inverted: report.inverted,
            min_jacobian: report.min_jacobian,
            min_jacobian_tetrahedron: tetrahedron(report.min_jacobian_element),
            non_finite: report.non_finite.map(tetrahedron),
        }
    }
}

/// Fills `ws.system` with `A = M + h C + h² K` (kg), `ws.rhs` with `b` (N s) and `ws.f_int` (N).
///
/// `dt` is the step `h` (s); `f_ext` one force per mesh node (N), or empty.
pub fn assemble(
    model: &FemModel,
    state: &FemState,
    dt: f64,
    f_ext: &[Vector3<f64>],
    ws: &mut FemWorkspace,
) -> AssemblyReport {
    let report = sum_elements(model, state, dt, Wanted::Tangents { filter: ws.filter }, ws);
    let (alpha, beta) = (model.rayleigh_mass(), model.rayleigh_stiffness());
    let coefficients = Coefficients { mass: 1.0 + dt * alpha, stiffness: dt * (beta + dt) };
    let upper = &ws.upper;
    let f_int = &ws.f_int;
    for_rows(model, &mut ws.system, &mut ws.rhs, |i, node, blocks| {
        let mass = model.mass()[node];
        let mut Kv = Vector3::zeros();
        for (p, block) in model.pattern().row(i).zip(blocks) {
            let K = model.upper_blocks().block(p, upper);
            let j = model.pattern().columns()[p] as usize;
            Kv += K.times(&state.v[model.node_of_free()[j] as usize]);
            *block = system_block(K, coefficients, mass, i == j);
        }
        let f = f_ext.get(node).copied().unwrap_or_default()
            + f_int[node]
            + (model.gravity() - state.v[node] * alpha) * mass;
        f * dt - Kv * coefficients.stiffness
    });
    report
}

/// Fills `ws.system` with `coefficients.mass M + coefficients.stiffness K`, `ws.rhs` with the static residual
/// `f_ext + M g + f_int` (N) and `ws.f_int` (N), over the step `ws.dt`. Newton's method for equilibrium solves `K Δq = rhs`.
pub fn assemble_with(
    model: &FemModel,
    state: &FemState,
    coefficients: Coefficients,
    f_ext: &[Vector3<f64>],
    ws: &mut FemWorkspace,
) -> AssemblyReport {
    let report = sum_elements(model, state, ws.dt, Wanted::Tangents { filter: ws.filter }, ws);
    let upper = &ws.upper;
    let f_int = &ws.f_int;
    for_rows(model, &mut ws.system, &mut ws.rhs, |i, node, blocks| {
        let mass = model.mass()[node];
        for (p, block) in model.pattern().row(i).zip(blocks) {
            let diagonal = model.pattern().columns()[p] as usize == i;
            *block = system_block(model.upper_blocks().block(p, upper), coefficients, mass, diagonal);
        }
        f_ext.get(node).copied().unwrap_or_default() + f_int[node] + model.gravity() * mass
    });
    report
}

/// Fills `ws.f_int` with the internal forces on all nodes (N), without the tangent, over the step `ws.dt`;
/// leaves `ws.system` alone. The same bits for any number of threads; allocates nothing.
pub fn internal_forces(model: &FemModel, state: &FemState, ws: &mut FemWorkspace) -> AssemblyReport {
    sum_elements(model, state, ws.dt, Wanted::Forces, ws)
}

/// Volume ratio that the bulk term sees in each element, in the order of [`FemModel::elements`]: its own `det F`, the mean
/// over the points of a quadratic element, or the mean of the groups of an averaged one. For pictures of the pressure.
pub fn volume_ratios(model: &FemModel, state: &FemState) -> Vec<f64> {
    let of_quadratic = |element: &QuadraticTetrahedron| {
        let at_points = element.deformation_gradients(&state.q);
        at_points.iter().zip(element.weights).map(|(F, w)| w * F.determinant()).sum::<f64>() / element.volume()
    };
    match (model.element_kind(), model.averaging()) {
        (ElementKind::Quadratic, _) => model.quadratic_elements().iter().map(of_quadratic).collect(),
        (_, Some(groups)) => groups.ratios(model.elements(), &state.q),
        _ => model.elements().iter().map(|e| e.deformation_gradient(&state.q).determinant()).collect(),
    }
}
