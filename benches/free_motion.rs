//! Free motion of the pressed liver: conjugate gradients with the factor of this very matrix, and with that of the body
//! at rest, plain and warped by nodal rotations; and what one iteration is made of.

#![allow(clippy::print_stdout)]

use criterion::Criterion;
use nalgebra::Matrix3;
use palpate::fem::factor::{Factor, FactorStatus, SolveWorkspace};
use palpate::fem::pcg::{PcgConfig, PcgWorkspace, pcg};
use palpate::fem::preconditioner::WarpedPreconditioner;
use palpate::fem::rotation::nodal_rotations;
use palpate::fem::sparse::SystemMatrix;
use palpate::step::StepWorkspace;
use palpate::world::World;
use std::sync::Arc;

mod organ;
use organ::{CELLS, benches, liver_under_ball, nodes, press};

fn factor_of(world: &World, system: &SystemMatrix) -> Factor {
    let mut factor = Factor::new(Arc::clone(world.symbolic()));
    assert_eq!(factor.refactor(system).status, FactorStatus::Ok, "the filter keeps the matrix definite");
    factor
}

fn measure(c: &mut Criterion, world: &World) {
    let (simulation, report) = press(world);
    let free = world.model().free_nodes();
    let fem = &simulation.workspace().fem;
    let (system, rhs) = (&fem.system, &fem.rhs);
    let (q_now, q_rest) = (simulation.state().before(), simulation.state().rest());
    let mut at_rest = StepWorkspace::new(world);
    let rest = world.model().rest_state();
    palpate::fem::assembly::assemble(world.model(), &rest, world.dt(), &[], &mut at_rest.fem);

    let mut rotations = vec![Matrix3::identity(); free];
    nodal_rotations(world.model(), q_rest, q_now, &mut rotations);
    let angles = rotations.iter().map(|r| (0.5 * (r.trace() - 1.0)).clamp(-1.0, 1.0).acos().to_degrees());
    println!(
        "{}: pressed {:.1} mm deep, nodes turned by up to {:.1} degrees",
        nodes(world),
        1e3 * report.indentation,
        angles.fold(0.0, f64::max)
    );

    let (fresh, stale) = (factor_of(world, system), factor_of(world, &at_rest.fem.system));
    let config = PcgConfig::default();
    let (mut work, mut solve, mut dv) = (PcgWorkspace::new(free), SolveWorkspace::new(world.symbolic()), rhs.clone());
    let mut group = c.benchmark_group(format!("free_motion, {}", nodes(world)));
    for (case, factor, warped) in [("fresh", &fresh, false), ("stale", &stale, false), ("stale, warped", &stale, true)]
    {
        let mut once = || {
            if warped {
                nodal_rotations(world.model(), q_rest, q_now, &mut rotations);
            } else {
                rotations.fill(Matrix3::identity());
            }
            let mut preconditioner = WarpedPreconditioner { factor, rotations: &rotations, workspace: &mut solve };
            dv.fill(0.0);
            pcg(system, rhs, &mut dv, &mut preconditioner, config, &mut work)
        };
        println!("{case} factor: {} iterations to {:.0e}", once().iterations, config.relative_tolerance);
        group.bench_function(case, |b| b.iter(&mut once));
    }
    group.bench_function("part: product with the matrix", |b| b.iter(|| system.multiply(rhs, &mut dv)));
    group.bench_function("part: solve with the factor", |b| b.iter(|| fresh.solve(&mut dv, &mut solve)));
    group.bench_function("part: nodal rotations", |b| {
        b.iter(|| nodal_rotations(world.model(), q_rest, q_now, &mut rotations));
    });
    group.finish();
}

fn main() {
    benches(0, |c| {
        for cell in &CELLS[..2] {
            measure(c, &liver_under_ball(*cell));
        }
    });
}
