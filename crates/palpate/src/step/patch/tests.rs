//! Patches of a block under a ball.

use nalgebra::Isometry3;
use palpate_constraints::rows::RowBlock;

use super::*;
use crate::refresh::FactorSample;
use crate::scene::Scene;
use crate::step::step;

/// A ball 1 mm deep in a block.
const PRESS: &str = r#"
        name = "press"
        [[body]]
        name = "block"
        block = { min = [0, 0, 0], max = [0.04, 0.04, 0.04], cells = [4, 4, 4] }
        material = { law = "neo_hookean", young = 5e3, poisson = 0.4 }
        fixed = [{ below = { axis = "z", at = 0.0 } }]
        [[tool]]
        name = "ball"
        shape = { kind = "sphere", radius = 0.012 }
        [hand]
        path = [{ time = 0.0, position = [0.02, 0.02, 0.053] }]
    "#;

#[test]
fn a_patch_gives_the_step_back_and_rows_that_hold_elsewhere_are_condensed_into_it() {
    let world = Scene::from_toml(PRESS, std::path::Path::new("")).unwrap().build().unwrap();
    let mut ws = StepWorkspace::new(&world);
    let factor = FactorSample::first(&world, &world.model().rest_state(), &mut ws).unwrap();
    let mut state = StepState::new(&world, world.model().rest_state());
    let mut snapshot = world.empty_snapshot();
    let input = StepInput { time: 0.0, tool: Isometry3::translation(0.02, 0.02, 0.051).into(), factor: &factor };
    let mut report = step(&world, &input, &mut state, &mut ws, &mut snapshot);
    let patch = &snapshot.patch;
    assert!(patch.valid && patch.len() == report.patch.nodes && report.active > 0);
    // The forces are those of the step, and under them the shape is the step's.
    let total: Vector3<f64> = patch.force().iter().sum();
    assert!((total + report.force).norm() < 1e-12 * total.norm(), "{total} {}", report.force);
    let mut moved = vec![Vector3::zeros(); patch.len()];
    patch.yielding(patch.force(), &mut vec![0.0; patch.degrees_of_freedom()], &mut moved);
    for (k, &node) in patch.skin().nodes().iter().enumerate() {
        let off = patch.q_free()[k] + moved[k] - state.fem.q[node as usize];
        assert!(off.norm() < 1e-15, "node {node}: {off}");
    }
    // C is that of the rows: W of the step's own contacts at nodes.
    let n = patch.degrees_of_freedom();
    let free = patch.compliance().to_vec();
    let drift = patch.drift()[3];
    for (j, block) in ws.rows.blocks.iter().enumerate() {
        let node = state.contacts.contacts[block.contact as usize].nodes[0];
        let (k, normal) = (patch.skin().number_of(node).unwrap(), ws.rows.frames[j].normal);
        let c = nalgebra::DMatrixView::from_slice(&free, n, n);
        let expected = normal.dot(&(c.fixed_view::<3, 3>(3 * k, 3 * k) * normal));
        let w = ws.problem.view().column(block.first_row as usize)[block.first_row as usize];
        assert!((w - expected).abs() < 1e-12 * w, "{w} {expected}");
    }

    // A suture holds one of its nodes in x: nothing that the tool does moves that node there any more.
    let held = patch.skin().nodes()[3];
    let free_node = world.model().free_of_node()[held as usize];
    let first_row = ws.rows.len() as u32;
    ws.rows.tissue.push_row([(free_node, Vector3::x())]);
    ws.rows.rigid.push_row([]);
    super::rows::push_no_tool(&mut ws.rows);
    ws.rows.blocks.push(RowBlock { contact: 0, first_row, rows: 1 });
    ws.rows.frames.push(ws.rows.frames[0]);
    ws.lambda[first_row as usize] = 1.0;
    fill(&world, &input, None, &state, &mut ws, &mut report, &mut snapshot.patch);
    let condensed = snapshot.patch.compliance();
    assert!(snapshot.patch.valid && condensed.len() == free.len());
    let held = snapshot.patch.drift()[3];
    assert!(held.x.abs() < 1e-9 * drift.norm() && drift.x.abs() > 1e-3 * drift.norm(), "{held} of {drift}");
    assert!(held.z.abs() > 0.5 * drift.z.abs(), "and drifts on elsewhere");
    let c = |w: &[f64], i: usize, j: usize| w[j * n + i];
    for j in 0..n {
        assert!(c(condensed, 9, j).abs() < 1e-12 * c(&free, 9, 9), "it moves by {} m/N", c(condensed, 9, j));
        assert!(c(condensed, j, j) <= c(&free, j, j) * (1.0 + 1e-12), "and nothing yields more than before");
        for i in 0..n {
            let expected = c(&free, i, j) - c(&free, i, 9) * c(&free, 9, j) / c(&free, 9, 9);
            assert!((c(condensed, i, j) - expected).abs() < 1e-12 * c(&free, 9, 9), "{i} {j}");
        }
    }
}
