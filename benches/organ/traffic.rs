//! What one iteration of the conjugate gradients reads, and how fast: its parts wait for memory, not for arithmetic.

use std::hint::black_box;
use std::sync::Arc;

use cpu_time::ThreadTime;
use nalgebra::Matrix3;
use palpate::fem::factor::{Factor, FactorStatus, SolveWorkspace};
use palpate::fem::preconditioner::{rotate, rotate_back};
use palpate::fem::rotation::nodal_rotations;
use palpate::step::StepWorkspace;
use palpate::world::World;

/// Repetitions of each part.
const REPETITIONS: usize = 15;

/// Median processor time (s) of the calling thread.
fn median(mut work: impl FnMut()) -> f64 {
    let mut times = [0.0; REPETITIONS];
    for time in &mut times {
        let clock = ThreadTime::now();
        work();
        *time = clock.elapsed().as_secs_f64();
    }
    times.sort_by(f64::total_cmp);
    times[REPETITIONS / 2]
}

/// Sum of many numbers in as many partial sums as hide the latency of addition.
fn sum(numbers: &[f64]) -> f64 {
    let mut sums = [0.0; 32];
    for numbers in numbers.as_chunks::<32>().0 {
        sums.iter_mut().zip(numbers).for_each(|(sum, x)| *sum += x);
    }
    sums.iter().sum()
}

/// Prints time and rate of each part on the body at rest, beside the rate of a plain sum over as many bytes as `L` has.
pub(crate) fn print(world: &World) {
    let (model, symbolic) = (world.model(), world.symbolic());
    let rest = model.rest_state();
    let mut ws = StepWorkspace::new(world);
    palpate::fem::assembly::assemble(model, &rest, world.dt(), &[], &mut ws.fem);
    let (system, rhs) = (&ws.fem.system, &ws.fem.rhs);
    let mut factor = Factor::with_packed_copy(Arc::clone(symbolic));
    assert_eq!(factor.refactor(system).status, FactorStatus::Ok);
    let (mut solve, mut x) = (SolveWorkspace::new(symbolic), vec![1.0; rhs.len()]);
    let mut rotations = vec![Matrix3::identity(); model.free_nodes()];

    let values = symbolic.stored_values() as f64;
    let blocks = 72.0 * system.blocks.len() as f64;
    let stream = vec![1.0; symbolic.stored_values()];
    let mut line = |name: &str, bytes: f64, work: &mut dyn FnMut(&mut [f64])| {
        let time = median(|| work(&mut x));
        x.fill(1.0);
        print!("; {name} {:.2} ms", 1e3 * time);
        if bytes > 0.0 {
            print!(" ({:.1} GB/s of {:.1} MB)", 1e-9 * bytes / time, 1e-6 * bytes);
        }
    };
    print!("       traffic");
    line("sum", 8.0 * values, &mut |_| _ = black_box(sum(black_box(&stream))));
    line("solve f64", 16.0 * values, &mut |x| assert!(factor.solve(x, &mut solve).is_ok()));
    let packed = symbolic.packed_bytes() as f64;
    line("16 bit", 2.0 * packed, &mut |x| assert!(factor.precondition(x, &mut solve).is_ok()));
    let mut y = rhs.clone();
    line("A x", blocks, &mut |x| system.multiply(x, &mut y));
    line("turn", 0.0, &mut |x| {
        rotate_back(&rotations, x);
        rotate(&rotations, x);
    });
    line("nodal rotations", 0.0, &mut |_| nodal_rotations(model, &rest.q, &rest.q, &mut rotations));
    println!();
}
