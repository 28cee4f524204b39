//! Rows, compliance, correction and warm start allocate nothing after warm-up. A test binary of its own, because it
//! replaces the allocator.

mod common;

use assert_no_alloc::{AllocDisabler, assert_no_alloc, violation_count};
use common::{DenseInverse, DenseWorkspace, free_nodes, patch, pose, spd};
use nalgebra::{DMatrix, Matrix3, Vector3};
use palpate_collision::{ContactKind, ContactSet, DetectionConfig, DetectionWorkspace, ToolShape, detect};
use palpate_constraints::compliance::{ComplianceMethod, ComplianceWorkspace, WarpedInverse, assemble, correct};
use palpate_constraints::rows::{ContactRows, Counterpart, RowInput, ToolMotion, build_rows};
use palpate_constraints::warm_start::WarmStart;

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

#[test]
fn a_contact_step_allocates_nothing() {
    let (mut surface, positions) = patch(6, 0.005);
    let tool = ToolShape::sphere(0.008).unwrap();
    let config = DetectionConfig { kind: ContactKind::Faces, max_contacts: 20, ..DetectionConfig::default() };
    let (free, n) = free_nodes(positions.len(), 9);
    let v_free = vec![0.01; 3 * n];
    let inverse = DenseInverse(spd(3 * n).try_inverse().unwrap());
    let rotations = vec![Matrix3::identity(); n];
    let (mut ws, mut set) = (DetectionWorkspace::new(&surface), ContactSet::with_capacity(20));
    let mut rows = ContactRows::with_capacity(20);
    let mut compliance = ComplianceWorkspace::new(60, DenseWorkspace::with_capacity(60));
    let mut w = DMatrix::zeros(60, 60);
    let mut warm = WarmStart::with_capacity(20);
    let mut lambda = vec![0.0; 60];
    let mut dv = vec![0.0; 3 * n];
    let mut sizes = [usize::MAX, 0];
    let mut step = |k: u32| {
        let f = f64::from(k) * 0.1;
        let at = |f: f64| {
            pose(Vector3::new(0.004 * f.sin(), 0.004 * f.cos(), 0.0075 + 0.003 * f.sin()), Vector3::new(f, 0.0, 0.0))
        };
        let place = at(f);
        surface.refit(&positions);
        detect(&surface, &positions, &tool, &place, &config, &mut ws, &mut set);
        let input = RowInput {
            free_of_node: &free,
            v_free: &v_free,
            dt: 0.03,
            counterpart: Counterpart::Tool {
                reference: place.translation.vector,
                motion: ToolMotion::between(&at(f - 0.1), &place),
            },
            friction: !k.is_multiple_of(3),
        };
        build_rows(&set.contacts, &input, &mut rows);
        let method = if k.is_multiple_of(2) { ComplianceMethod::Asynchronous } else { ComplianceMethod::Exact };
        let system = WarpedInverse::new(method, &inverse, &rotations);
        let m = rows.len();
        assemble(system, &rows.tissue, 0.03, w.view_mut((0, 0), (m, m)), &mut compliance);
        let lambda = &mut lambda[..rows.len()];
        warm.fetch(&set.contacts, &rows, 0..rows.blocks.len(), 2e-3, lambda);
        lambda.iter_mut().for_each(|l| *l += 0.1);
        correct(system, lambda, 0.03, &mut dv, &mut compliance);
        warm.store(&set.contacts, &rows, 0..rows.blocks.len(), lambda);
        sizes = [sizes[0].min(rows.len()), sizes[1].max(rows.len())];
    };
    step(0);
    let before = violation_count();
    assert_no_alloc(|| (1..300).for_each(&mut step));
    assert_eq!(violation_count() - before, 0);
    assert!(sizes[0] < sizes[1] && sizes[1] > 20, "the size of W changed: {sizes:?}");
}
