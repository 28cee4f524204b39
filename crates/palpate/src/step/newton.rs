//! Newton's method with contact.
//!
//! The free motion by Newton's method alone, corrected once with the compliance of its end, would be wrong by the
//! curvature of the tissue between the free and the corrected place: a tenth of the force in an ordinary press. So the
//! motion is repeated under the contact forces found so far,
//! ```text
//! q_k = argmin Φ(q) - q·Hᵀ λ_k,    A_k its matrix,    W_k = h² H A_k⁻¹ Hᵀ
//! δ = W_k (λ_{k+1} - λ_k) + δ(q_k)  in the law of each contact,
//! ```
//! until the forces stay. The last correction is then small to second order, and motion and forces satisfy the
//! nonlinear balance `M (v⁺ - v)/h = f_int(q⁺) + f_ext + Hᵀ λ` to the tolerance. `H` is that of the begin of the step.

use nalgebra::Vector3;
use palpate_constraints::rows::Twist;
use palpate_fem::integrator::backward_euler::newton_step;
use palpate_fem::integrator::newton::{NewtonConfig, NewtonStatus};
use palpate_fem::pcg::{PcgReport, PcgStatus};

use super::workspace::NewtonStage;
use super::{Clock, StepInput, StepReport, StepState, StepWorkspace, correction, forces, rigid, stages};
use crate::world::World;

/// Most motions under corrected forces in one step.
const MOST_PASSES: usize = 10;

/// Change of the forces, relative to the largest, at which they stay.
const STAY: f64 = 1e-4;

/// One step: detection, then motion, rows, compliance and forces until the forces stay, then the last correction.
pub(super) fn newton_with_contact(
    world: &World,
    config: &NewtonConfig,
    input: &StepInput<'_>,
    state: &mut StepState,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
    clock: &mut Clock,
) {
    let tool = &input.tool;
    stages::detection(world, tool, state, ws, report);
    rigid::rigid_motion(world, state, ws);
    report.times.detection = clock.lap();
    put_down(ws);
    for pass in 0..MOST_PASSES {
        motion(world, config, state, ws, report);
        report.times.free_motion += clock.lap();
        stages::rows(world, tool, state, ws, report);
        stages::compliance(world, input.factor, ws, report);
        relieve(ws);
        stages::choose_laws(world, ws);
        report.times.compliance += clock.lap();
        (report.active, report.indentation) = (0, 0.0);
        forces::solve(world, input, state, ws, report);
        report.times.solve += clock.lap();
        if ws.rows.is_empty() || !report.compliance.usable || stays(ws) {
            break;
        }
        if pass + 1 == MOST_PASSES {
            report.unsettled = true;
            break;
        }
        carry(world, ws);
    }
    if !report.compliance.usable && put_down(ws) {
        // Without compliance the step goes on without contact, and so must its motion.
        motion(world, config, state, ws, report);
        report.times.free_motion += clock.lap();
    }
    correction::correct(world, input.factor, state, ws, report);
    report.times.correction = clock.lap();
}

/// The motion from the begin of the step under the forces carried so far; adds to the report.
fn motion(world: &World, config: &NewtonConfig, state: &StepState, ws: &mut StepWorkspace, report: &mut StepReport) {
    let Some(stage) = &mut ws.newton else { return };
    stage.free.q.copy_from_slice(&state.fem.q);
    stage.free.v.copy_from_slice(&state.fem.v);
    stage.free.memory.copy_from_slice(&state.fem.memory);
    stage.factored = false;
    let newton = newton_step(world.model(), ws.dt, &stage.load, config, &mut stage.free, &mut stage.ws);
    // The matrix of the step's end belongs to the memory of its begin.
    stage.free.memory.copy_from_slice(&state.fem.memory);
    report.assembly = newton.assembly;
    report.cuts += newton.cuts;
    report.free_motion = PcgReport {
        status: match newton.status {
            NewtonStatus::Converged => PcgStatus::Converged,
            NewtonStatus::OutOfIterations | NewtonStatus::Stalled => PcgStatus::OutOfIterations,
            NewtonStatus::Singular => PcgStatus::Indefinite,
            NewtonStatus::NonFinite => PcgStatus::NonFinite,
        },
        iterations: report.free_motion.iterations + newton.iterations as usize,
        relative_residual: newton.relative_residual,
    };
    for (v, &node) in ws.v_free.chunks_exact_mut(3).zip(world.model().node_of_free()) {
        v.copy_from_slice(stage.free.v[node as usize].as_slice());
    }
}

/// `δ_free = δ(q_k) - W λ_k`: the gaps if nothing touched, as the problem and the snapshot want them.
fn relieve(ws: &mut StepWorkspace) {
    let Some(stage) = &ws.newton else { return };
    let view = ws.problem.view();
    for (j, &carried) in stage.carried.iter().enumerate().take(ws.rows.len()).filter(|(_, c)| **c != 0.0) {
        ws.rows.delta_free.iter_mut().zip(view.column(j)).for_each(|(delta, w)| *delta -= w * carried);
    }
    ws.problem.delta_free_mut().copy_from_slice(&ws.rows.delta_free);
}

/// True where the forces that were found are those that the motion carried.
fn stays(ws: &StepWorkspace) -> bool {
    let Some(NewtonStage { carried, .. }) = &ws.newton else { return true };
    let lambda = &ws.lambda[..ws.rows.len()];
    let largest = lambda.iter().fold(0.0_f64, |most, l| most.max(l.abs()));
    lambda.iter().zip(carried).all(|(l, c)| (l - c).abs() <= STAY * largest)
}

/// Lets the next motion carry nothing; true where the last one carried a force.
fn put_down(ws: &mut StepWorkspace) -> bool {
    let Some(stage) = &mut ws.newton else { return false };
    let carries = stage.carried.iter().any(|&c| c != 0.0);
    stage.carried.fill(0.0);
    stage.load.fill(Vector3::zeros());
    ws.rigid.carried.fill(Twist::default());
    carries
}

/// Lets the next motion carry the forces that were found.
fn carry(world: &World, ws: &mut StepWorkspace) {
    let Some(stage) = &mut ws.newton else { return };
    let lambda = &ws.lambda[..ws.rows.len()];
    stage.carried[..lambda.len()].copy_from_slice(lambda);
    stage.free_load.fill(0.0);
    ws.rows.tissue.add_transposed(lambda, &mut stage.free_load);
    for (f, &node) in stage.free_load.chunks_exact(3).zip(world.model().node_of_free()) {
        stage.load[node as usize] = Vector3::new(f[0], f[1], f[2]);
    }
    ws.rigid.carry(&ws.rows, lambda, ws.dt);
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use nalgebra::Isometry3;

    use super::*;
    use crate::scene::Scene;
    use crate::simulation::Simulation;
    use crate::step::StepStatus;
    use crate::world::Integration;

    /// A block that nothing holds, so that its momentum tells of every force on it.
    const TOML: &str = r#"
name = "adrift"
gravity = [0.0, 0.0, 0.0]

[[body]]
name = "block"
block = { min = [0.0, 0.0, 0.0], max = [0.04, 0.04, 0.02], cells = [3, 3, 2] }
density = 10000
rayleigh_stiffness = 0.005
integrator = "newton"
newton = { tolerance = 1e-11 }
material = { law = "neo_hookean", young = 6e3, poisson = 0.45 }

[[tool]]
name = "ball"
shape = { kind = "sphere", radius = 0.012 }

[hand]
path = [{ time = 0, position = [0.02, 0.02, 0.05] }]
"#;

    fn world() -> World {
        Scene::from_toml(TOML, Path::new("")).unwrap().build().unwrap()
    }

    fn pose(depth: f64) -> Isometry3<f64> {
        Isometry3::translation(0.021, 0.019, 0.032 - depth)
    }

    /// Momentum (N s) of the body.
    fn momentum(world: &World, v: &[Vector3<f64>]) -> Vector3<f64> {
        world.model().mass().iter().zip(v).map(|(m, v)| v * *m).sum()
    }

    #[test]
    fn what_the_body_gains_in_momentum_the_tool_bears_also_where_it_lets_go() {
        let world = world();
        let mut simulation = Simulation::new(&world).unwrap();
        let (mut most, mut let_go, mut active) = (0.0_f64, 0, 0);
        // In, a little back, out, and again after the body, which flees.
        for depth in [0.0, 0.001, 0.002, 0.001, -0.01, 0.008, 0.014, 0.018, 0.01] {
            let before = momentum(&world, &simulation.state().fem.v);
            let report = simulation.step(&pose(depth));
            assert_eq!(report.status, StepStatus::Advanced);
            let gained = (momentum(&world, &simulation.state().fem.v) - before) / world.dt();
            most = most.max(report.force.norm());
            let_go += usize::from(report.active < active);
            active = report.active;
            // Newton's method leaves 1e-11 of the forces within the body, which are some tens of newtons.
            assert!((gained + report.force).norm() < 1e-9, "depth {depth}: {gained} and {}", report.force);
        }
        assert!(most > 0.05 && let_go > 0, "{most} N, {let_go}");
    }

    /// A step pressed by 2 mm whose motion already carries a force, at the point where the last forces turn out zero.
    fn carrying(world: &World) -> (Simulation<'_>, StepWorkspace, StepReport, Vec<f64>) {
        let Integration::Newton(config) = world.integration() else { panic!("newton") };
        let mut simulation = Simulation::new(world).unwrap();
        let report = simulation.step(&pose(0.002));
        let mut ws = StepWorkspace::new(world);
        let mut report = StepReport { force: Vector3::zeros(), ..report };
        let tool = pose(0.0021).into();
        stages::detection(world, &tool, simulation.state_mut(), &mut ws, &mut report);
        motion(world, config, simulation.state(), &mut ws, &mut report);
        let free = ws.v_free.clone();
        stages::rows(world, &tool, simulation.state(), &mut ws, &mut report);
        let m = ws.rows.len();
        assert!(m > 0);
        ws.lambda[..m].iter_mut().step_by(3).for_each(|l| *l = 0.02);
        carry(world, &mut ws);
        ws.lambda[..m].fill(0.0);
        motion(world, config, simulation.state(), &mut ws, &mut report);
        (simulation, ws, report, free)
    }

    #[test]
    fn forces_that_the_motion_carried_and_that_were_let_go_leave_it_again() {
        let world = world();
        let (mut simulation, mut ws, mut report, free) = carrying(&world);
        let before = momentum(&world, &simulation.state().fem.v);
        let carried = ws.newton.as_ref().unwrap().carried.iter().sum::<f64>() * world.dt();
        let factor = crate::refresh::FactorSample::first(&world, &simulation.state().fem, &mut ws).unwrap();
        stages::compliance(&world, &factor, &mut ws, &mut report);
        correction::correct(&world, &factor, simulation.state_mut(), &mut ws, &mut report);
        assert_eq!(report.status, StepStatus::Advanced);
        let after = momentum(&world, &simulation.state().fem.v);
        assert!(carried > 1e-4 && (after - before).norm() < 1e-9 * carried, "{carried} N s, {}", after - before);
        // The motion without load, up to the curvature of the tissue between the two.
        let (mut off, mut moved) = (0.0_f64, 0.0_f64);
        for ((v, free), &node) in ws.v_free.chunks_exact(3).zip(free.chunks_exact(3)).zip(world.model().node_of_free())
        {
            let free = Vector3::new(free[0], free[1], free[2]);
            off = off.max((simulation.state().fem.v[node as usize] - free).norm());
            moved = moved.max((Vector3::new(v[0], v[1], v[2]) - free).norm());
        }
        assert!(off < 0.1 * moved, "{off} of {moved} m/s");
    }

    #[test]
    fn a_load_that_is_put_down_leaves_the_motion_as_if_it_had_never_been() {
        let world = world();
        let Integration::Newton(config) = world.integration() else { panic!("newton") };
        let (simulation, mut ws, mut report, free) = carrying(&world);
        assert!(ws.v_free != free && put_down(&mut ws) && !put_down(&mut ws));
        motion(&world, config, simulation.state(), &mut ws, &mut report);
        assert!(ws.v_free == free, "to the bit");
    }
}
