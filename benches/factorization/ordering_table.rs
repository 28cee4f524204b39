//! Orderings and numeric methods side by side.

use std::sync::Arc;
use std::time::{Duration, Instant};

use cpu_time::ThreadTime;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::perm::PermRef;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use faer::{Par, Side, Spec};
use palpate::fem::assembly::{FemWorkspace, assemble};
use palpate::fem::factor::{Factor, FactorStatus, LeftLookingFactor, SymbolicFactor};
use palpate::fem::ordering::{NodeOrdering, approximate_minimum_degree, nested_dissection, plane_dissection};
use palpate::fem::sparse::SystemMatrix;
use palpate::scene::Scene;
use palpate::world::World;

use super::organ::{CELLS, liver, measuring, pool};

/// Cells of the blocks, of 10 mm each; the bottom is fixed.
const BLOCKS: [[usize; 3]; 4] = [[9, 9, 10], [13, 13, 15], [23, 19, 9], [19, 19, 20]];

/// Repetitions, of which the least time counts: other work on the machine only adds to it.
const REPETITIONS: usize = 9;

fn block(cells: [usize; 3]) -> World {
    let mut scene = Scene::bundled("block").expect("the scene is bundled");
    scene
        .edit(|scene| {
            let max = cells.map(|n| 0.01 * n as f64);
            let block = scene.bodies[0].block.as_mut().expect("the body is a block");
            (block.min, block.max, block.cells) = ([0.0; 3], max, cells);
            let above = max[2] + 0.05;
            scene.hand.path.iter_mut().for_each(|key| key.position[2] += above);
        })
        .expect("the change is valid");
    scene.build().expect("the block is sound")
}

/// `P A Pᵀ = L Lᵀ` by columns, one at a time.
struct Simplicial {
    symbolic: SymbolicCholesky<u32>,
    lower: SymbolicSparseColMat<u32>,
    entries: Vec<f64>,
    values: Vec<f64>,
    memory: MemBuffer,
}

impl Simplicial {
    fn new(a: &SystemMatrix, ordering: &NodeOrdering) -> Self {
        let n = a.pattern.rows();
        let (mut start, mut rows, mut entries) = (vec![0], Vec::new(), Vec::new());
        for column in 0..3 * n as u32 {
            for p in a.pattern.row(column as usize / 3) {
                // the block in row `column / 3` is the transpose of the one in that column
                for c in 0..3 {
                    let row = 3 * a.pattern.columns()[p] + c;
                    if row >= column {
                        rows.push(row);
                        entries.push(a.blocks[p][(column as usize % 3, c as usize)]);
                    }
                }
            }
            start.push(rows.len() as u32);
        }
        let lower = SymbolicSparseColMat::new_checked(3 * n, 3 * n, start, None, rows);
        let forward: Vec<u32> = ordering.degrees_of_freedom().collect();
        let mut inverse = vec![0; forward.len()];
        forward.iter().enumerate().for_each(|(new, &old)| inverse[old as usize] = new as u32);
        let symbolic = factorize_symbolic_cholesky(
            lower.as_ref(),
            Side::Lower,
            SymmetricOrdering::Custom(PermRef::new_checked(&forward, &inverse, 3 * n)),
            CholeskySymbolicParams {
                supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SIMPLICIAL,
                ..Default::default()
            },
        )
        .expect("the pattern is small");
        let scratch = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Spec::default());
        Self { values: vec![0.0; symbolic.len_val()], memory: MemBuffer::new(scratch), symbolic, lower, entries }
    }

    fn refactor(&mut self) {
        self.symbolic
            .factorize_numeric_llt(
                &mut self.values,
                SparseColMatRef::new(self.lower.as_ref(), &self.entries),
                Side::Lower,
                LltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut self.memory),
                Spec::default(),
            )
            .expect("the matrix is positive definite");
    }
}

/// Least times (ms) of several pieces of work that are done in turn, by the clock of the thread or of the wall.
fn least<const N: usize>(alone: bool, mut work: [&mut dyn FnMut(); N]) -> [f64; N] {
    let mut times = [f64::INFINITY; N];
    for _ in 0..if measuring() { REPETITIONS } else { 1 } {
        for (least, work) in times.iter_mut().zip(&mut work) {
            let (wall, cpu) = (Instant::now(), ThreadTime::now());
            work();
            let time: Duration = if alone { cpu.elapsed() } else { wall.elapsed() };
            *least = least.min(1e3 * time.as_secs_f64());
        }
    }
    times
}

fn line(name: &str, a: &SystemMatrix, ordering: NodeOrdering, order: &str) {
    let mut simplicial = Simplicial::new(a, &ordering);
    let symbolic = Arc::new(SymbolicFactor::with_ordering(&a.pattern, ordering).expect("the pattern has nodes"));
    let mut left_looking = LeftLookingFactor::new(Arc::clone(&symbolic), a).expect("the pattern is the same");
    let mut factor = Factor::new(Arc::clone(&symbolic));
    assert_eq!(factor.refactor(a).status, FactorStatus::Ok);
    assert_eq!(left_looking.refactor(a), FactorStatus::Ok);
    assert!(left_looking.difference(&factor) < 1e-12);
    let [own, faer] = least(true, [&mut || _ = factor.refactor(a), &mut || _ = left_looking.refactor(a)]);
    let [by_columns] = least(true, [&mut || simplicial.refactor()]);
    let (one, two) = (pool(1), pool(2));
    let mut other = Factor::new(Arc::clone(&symbolic));
    let [on_one, on_two] =
        least(false, [&mut || _ = one.install(|| factor.refactor(a)), &mut || _ = two.install(|| other.refactor(a))]);
    println!(
        "{name:>11} {:>6} {order:>12} {:>9.2} {:>8.2} {:>7} {own:>8.1} {:>8.1} {faer:>8.1} {by_columns:>10.1} {:>9.2}",
        symbolic.nodes(),
        1e-6 * symbolic.nonzeros() as f64,
        1e-9 * symbolic.flops(),
        symbolic.supernode_count(),
        1e-6 * symbolic.flops() / own,
        on_one / on_two,
    );
}

/// All orderings of one body.
fn body(name: &str, world: &World) {
    let model = world.model();
    let mut ws = FemWorkspace::new(model);
    assemble(model, &model.rest_state(), world.dt(), &[], &mut ws);
    let positions: Vec<_> = model.node_of_free().iter().map(|&node| world.mesh().nodes[node as usize]).collect();
    let pattern = model.pattern();
    line(name, &ws.system, approximate_minimum_degree(pattern), "AMD");
    line(name, &ws.system, plane_dissection(pattern, &positions), "plane cuts");
    line(name, &ws.system, nested_dissection(pattern, &positions), "minimum cuts");
}

pub(crate) fn print() {
    println!(
        "{:>11} {:>6} {:>12} {:>9} {:>8} {:>7} {:>8} {:>8} {:>8} {:>10} {:>9}",
        "body",
        "nodes",
        "ordering",
        "1e6 nnz",
        "Gflop",
        "snodes",
        "own ms",
        "Gflop/s",
        "faer ms",
        "simplicial",
        "2 threads"
    );
    let (livers, blocks) = if measuring() { (&CELLS[..], &BLOCKS[..]) } else { (&CELLS[..1], &BLOCKS[..1]) };
    livers.iter().for_each(|&cell| body("liver", &liver(cell, |_| ())));
    blocks.iter().for_each(|&cells| body("block", &block(cells)));
}
