//! The precomputed compliance of the skin against half solves with the same factor, and its bounds.

#![allow(clippy::print_stdout)] // measured numbers

use std::sync::Arc;

use assert_no_alloc::{AllocDisabler, assert_no_alloc, violation_count};
use nalgebra::{DMatrix, Matrix3, Rotation3, Vector3};
use palpate_constraints::compliance::{ComplianceMethod, ComplianceWorkspace, WarpedInverse, assemble, correct};
use palpate_constraints::precomputed::{PrecomputedInverse, PrecomputedWorkspace};
use palpate_constraints::surface_inverse::{GatherWorkspace, SurfaceInverse, SurfaceInverseError};
use palpate_fem::assembly::{FemWorkspace, assemble as assemble_body};
use palpate_fem::block::block;
use palpate_fem::factor::{Factor, FactorStatus, ReachWorkspace, SolveWorkspace, SymbolicFactor};
use palpate_fem::material::Material;
use palpate_fem::model::{FemConfig, FemModel};
use palpate_fem::nodal_rows::NodalRows;
use palpate_fem::rotation::nodal_rotations;
use palpate_fem::sparse::FIXED;

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

const DT: f64 = 1.0 / 30.0;

/// Largest difference to W in double precision, relative to its largest entry: every entry of the inverse is rounded to
/// 6e-8, and an entry of W is a combination of up to nine blocks of similar size.
const ROUNDING: f64 = 3e-7;

/// A block held at its bottom.
struct Body {
    model: FemModel,
    nodes: Vec<Vector3<f64>>,
    triangles: Vec<[u32; 3]>,
    symbolic: Arc<SymbolicFactor>,
    rest: Factor,
}

impl Body {
    fn new() -> Self {
        let lines: Vec<f64> = (0..=5).map(|k| 0.01 * f64::from(k)).collect();
        let mesh = block(&lines, &lines, &lines);
        let fixed = (0..mesh.nodes.len() as u32).filter(|&n| mesh.nodes[n as usize].z == 0.0).collect();
        let material = Material::from_young_poisson("neo_hookean", 5e3, 0.45).unwrap();
        let model = FemModel::new(&mesh, &FemConfig { material, fixed, ..FemConfig::default() }).unwrap();
        let positions: Vec<_> = model.node_of_free().iter().map(|&n| mesh.nodes[n as usize]).collect();
        let symbolic = Arc::new(SymbolicFactor::new(model.pattern(), &positions).unwrap());
        let triangles = mesh.surface().triangles.clone();
        let rest = Factor::new(Arc::clone(&symbolic));
        let mut body = Self { nodes: mesh.nodes.clone(), model, triangles, symbolic, rest };
        body.rest = body.factor(&body.nodes);
        body
    }

    fn factor(&self, q: &[Vector3<f64>]) -> Factor {
        let mut state = self.model.rest_state();
        state.q.copy_from_slice(q);
        let mut fem = FemWorkspace::new(&self.model);
        assemble_body(&self.model, &state, DT, &[], &mut fem);
        let mut factor = Factor::new(Arc::clone(&self.symbolic));
        assert_eq!(factor.refactor(&fem.system).status, FactorStatus::Ok);
        factor
    }

    /// Free nodes of the skin.
    fn skin(&self) -> Vec<u32> {
        let free = self.model.free_of_node();
        let mut skin: Vec<u32> = self.triangles.iter().flatten().map(|&n| free[n as usize]).collect();
        skin.sort_unstable();
        skin.dedup();
        skin.retain(|&n| n != FIXED);
        skin
    }

    /// Three rows of a contact on each of some triangles of the skin, and at some nodes.
    fn rows(&self) -> NodalRows {
        let free = self.model.free_of_node();
        let mut rows = NodalRows::with_capacity(90, 3);
        let movable = self.triangles.iter().filter(|t| free[t[0] as usize] != FIXED);
        for (k, t) in movable.enumerate().step_by(17).take(20) {
            for c in 0..3 {
                let turn = Rotation3::from_scaled_axis(Vector3::new(0.3 * k as f64, 1.0, -0.5));
                let direction = turn * Vector3::ith(c, 1.0);
                let weights = if k % 2 == 0 { [0.5, 0.3, 0.2] } else { [1.0, 0.0, 0.0] };
                let touched = t.iter().zip(weights).filter(|(n, w)| *w > 0.0 && free[**n as usize] != FIXED);
                rows.push_row(touched.map(|(&n, w)| (free[n as usize], direction * w)));
            }
        }
        rows
    }
}

fn workspace(body: &Body, surface: &SurfaceInverse, rows: usize) -> ComplianceWorkspace<PrecomputedWorkspace> {
    let reach = ReachWorkspace::new(&body.symbolic, rows);
    let mut inverse = PrecomputedWorkspace::new(reach, SolveWorkspace::new(&body.symbolic));
    inverse.make_room_for(surface);
    ComplianceWorkspace::new(rows, inverse)
}

/// W and the motion of some forces by an inverse.
fn result(
    body: &Body,
    system: WarpedInverse<'_, PrecomputedInverse<'_>>,
    surface: &SurfaceInverse,
) -> (DMatrix<f64>, Vec<f64>) {
    let rows = body.rows();
    let m = rows.len();
    let mut ws = workspace(body, surface, m);
    let (mut w, mut dv) = (DMatrix::zeros(m, m), vec![0.0; 3 * body.model.free_nodes()]);
    let report = assemble(system, &rows, DT, &mut w, &mut ws);
    assert!(report.usable && report.asymmetry == 0.0, "{report:?}");
    let lambda: Vec<f64> = (0..m).map(|r| (r % 7) as f64 - 2.0).collect();
    assert!(correct(system, &lambda, DT, &mut dv, &mut ws));
    (w, dv)
}

fn far(a: &[f64], b: &[f64]) -> f64 {
    let largest = b.iter().fold(0.0_f64, |largest, x| largest.max(x.abs()));
    a.iter().zip(b).fold(0.0_f64, |far, (a, b)| far.max((a - b).abs())) / largest
}

#[test]
fn gathered_compliance_is_that_of_half_solves_at_rest_and_under_any_turn_of_the_body() {
    let body = Body::new();
    let surface = SurfaceInverse::new(&body.rest, &body.skin(), usize::MAX).unwrap();
    assert_eq!(surface.nodes(), body.skin().len());
    let turn = Rotation3::from_scaled_axis(Vector3::new(0.7, -1.1, 0.4)).into_inner();
    for (name, q) in
        [("rest", body.nodes.clone()), ("turned", body.nodes.iter().map(|x| turn * x + Vector3::x()).collect())]
    {
        let now = body.factor(&q);
        let mut rotations = vec![Matrix3::identity(); body.model.free_nodes()];
        nodal_rotations(&body.model, &body.nodes, &q, &mut rotations);
        let exact = WarpedInverse::new(ComplianceMethod::Exact, PrecomputedInverse::from(&now), &rotations);
        let gathered = PrecomputedInverse { factor: &body.rest, surface: Some(&surface) };
        let warped = WarpedInverse::new(ComplianceMethod::Warped, gathered, &rotations);
        let ((w, dv), (w_exact, dv_exact)) = (result(&body, warped, &surface), result(&body, exact, &surface));
        let (of_w, of_motion) = (far(w.as_slice(), w_exact.as_slice()), far(&dv, &dv_exact));
        println!("{name}: W {of_w:.1e}, motion {of_motion:.1e}");
        // The correction is a solve in double precision; nodal rotations are exact to some roundings.
        assert!(of_w < ROUNDING && of_motion < 1e-11, "{name}: {of_w:e} {of_motion:e}");
        // A W that was gathered carries single precision: it is not the half solves' by mistake.
        assert!(of_w > 1e-10, "{name}: {of_w:e}");
        assert!(
            w.clone().cholesky().is_some() == w_exact.cholesky().is_some(),
            "{name}: definite where the exact one is"
        );
    }
}

#[test]
fn rows_off_the_skin_and_a_factor_made_anew_fall_back_to_half_solves() {
    let mut body = Body::new();
    let skin = body.skin();
    let surface = SurfaceInverse::new(&body.rest, &skin, usize::MAX).unwrap();
    let inner = (0..body.model.free_nodes() as u32).find(|n| !skin.contains(n)).unwrap();
    let mut rows = NodalRows::with_capacity(2, 1);
    rows.push_row([(inner, Vector3::x())]);
    rows.push_row([(skin[0], Vector3::x())]);
    assert!(!surface.covers(&rows));
    let mut gather = GatherWorkspace::new(&surface, 2);
    let mut w = DMatrix::zeros(2, 2);
    assert!(!surface.gather_into(&rows, 1.0, w.as_view_mut(), &mut gather));

    let half = |factor: &Factor| {
        let mut w = DMatrix::zeros(2, 2);
        let mut reach = ReachWorkspace::new(&body.symbolic, 2);
        assert_eq!(factor.compliance_into(&rows, DT * DT, &mut w, &mut reach).rows, 2);
        w
    };
    let mut ws = workspace(&body, &surface, 2);
    let both = PrecomputedInverse { factor: &body.rest, surface: Some(&surface) };
    let system = WarpedInverse { inverse: both, rotations: None };
    assert!(assemble(system, &rows, DT, &mut w, &mut ws).usable);
    assert_eq!(w, half(&body.rest), "bit for bit what half solves give");

    let squeezed: Vec<_> = body.nodes.iter().map(|x| Vector3::new(x.x, x.y, 0.8 * x.z)).collect();
    let other = body.factor(&squeezed);
    assert!(surface.is_of(&body.rest) && !surface.is_of(&other));
    let system =
        WarpedInverse { inverse: PrecomputedInverse { factor: &other, surface: Some(&surface) }, rotations: None };
    assert!(assemble(system, &rows, DT, &mut w, &mut ws).usable);
    assert_eq!(w, half(&other));
    // Factored again from the same matrix it is another factor: what was derived from the old one is not asked.
    body.rest = body.factor(&body.nodes);
    assert!(!surface.is_of(&body.rest));
}

#[test]
fn memory_is_bounded_and_mistakes_name_what_is_wrong() {
    let body = Body::new();
    let skin = body.skin();
    assert_eq!(SurfaceInverse::bytes(1000), 1000 * 1001 / 2 * 36);
    let most = SurfaceInverse::bytes(skin.len()) - 1;
    let error = SurfaceInverse::new(&body.rest, &skin, most).unwrap_err();
    assert!(matches!(error, SurfaceInverseError::TooLarge { nodes, .. } if nodes == skin.len()));
    assert!(error.to_string().contains(&format!("{} nodes", skin.len())), "{error}");
    let unknown = SurfaceInverse::new(&body.rest, &[0, 100_000], usize::MAX).unwrap_err();
    assert!(unknown.to_string().contains("100000"), "{unknown}");
    let empty = Factor::new(Arc::clone(&body.symbolic));
    assert_eq!(SurfaceInverse::new(&empty, &skin, usize::MAX).unwrap_err(), SurfaceInverseError::InvalidFactor);
}

#[test]
fn gathering_allocates_nothing_and_refuses_more_rows_than_it_has_room_for() {
    let body = Body::new();
    let surface = SurfaceInverse::new(&body.rest, &body.skin(), usize::MAX).unwrap();
    let rows = body.rows();
    let m = rows.len();
    let mut gather = GatherWorkspace::new(&surface, m);
    let (mut w, mut again) = (DMatrix::zeros(m, m), DMatrix::zeros(m, m));
    assert!(surface.gather_into(&rows, 1.0, w.as_view_mut(), &mut gather));
    let before = violation_count();
    assert!(assert_no_alloc(|| surface.gather_into(&rows, 1.0, again.as_view_mut(), &mut gather)));
    assert_eq!(violation_count(), before);
    assert_eq!(w, again, "what was touched before is forgotten");
    let mut tight = GatherWorkspace::new(&surface, 2);
    assert!(!surface.gather_into(&rows, 1.0, again.as_view_mut(), &mut tight));
    let mut few = NodalRows::with_capacity(2, 3);
    (0..2).for_each(|r| few.push_row(rows.row(r)));
    let mut small = DMatrix::zeros(2, 2);
    assert!(surface.gather_into(&few, 1.0, small.as_view_mut(), &mut tight), "it serves again after a refusal");
    assert_eq!(small, w.view((0, 0), (2, 2)));
}
