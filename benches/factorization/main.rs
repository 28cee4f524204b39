//! Cholesky factorisation of the liver's system matrix by size, and a full solve. Throughput counts the operations
//! of the factorisation, so that "elem/s" reads as flop/s.
//!
//! `cargo bench --bench factorization -- table` prints instead, for livers and blocks of 1,000 to 8,000 nodes: fill and
//! operations of three orderings; processor times on one thread of the own factorisation, of faer's over the same
//! supernodes, and of faer's simplicial one; and the wall time of the own one on two threads over that on one.

#![allow(clippy::print_stdout)]

use criterion::{Criterion, Throughput};
use palpate::fem::assembly::{FemWorkspace, assemble};
use palpate::fem::factor::{Factor, FactorStatus, SolveWorkspace, SymbolicFactor};
use palpate::fem::ordering::approximate_minimum_degree;
use palpate::world::World;
use std::sync::Arc;

#[path = "../organ/mod.rs"]
mod organ;
use organ::{CELLS, SMALL, benches, bent, liver, nodes};
mod ordering_table;

fn measure(c: &mut Criterion, world: &World) {
    let mut ws = FemWorkspace::new(world.model());
    assemble(world.model(), &bent(world.model()), world.dt(), &[], &mut ws);
    let mut factor = Factor::new(Arc::clone(world.symbolic()));
    assert_eq!(factor.refactor(&ws.system).status, FactorStatus::Ok, "the filter keeps the matrix definite");

    let mut group = c.benchmark_group("factorization");
    group.throughput(Throughput::Elements(world.symbolic().flops() as u64));
    group.bench_function(format!("refactor, {}", nodes(world)), |b| b.iter(|| factor.refactor(&ws.system)));
    group.finish();

    // The yardstick of nested dissection.
    let by_degree = approximate_minimum_degree(world.model().pattern());
    let symbolic = SymbolicFactor::with_ordering(world.model().pattern(), by_degree).expect("the pattern has nodes");
    let mut other = Factor::new(Arc::new(symbolic));
    assert_eq!(other.refactor(&ws.system).status, FactorStatus::Ok);
    let mut group = c.benchmark_group("factorization by minimum degree");
    group.throughput(Throughput::Elements(other.symbolic().flops() as u64));
    group.bench_function(format!("refactor, {}", nodes(world)), |b| b.iter(|| other.refactor(&ws.system)));
    group.finish();

    let mut group = c.benchmark_group("solve");
    let mut solve = SolveWorkspace::new(world.symbolic());
    let mut x = ws.rhs.clone();
    group.bench_function(format!("one right side, {}", nodes(world)), |b| {
        b.iter(|| {
            x.copy_from_slice(&ws.rhs);
            factor.solve(&mut x, &mut solve)
        });
    });
    group.finish();
}

fn main() {
    if std::env::args().any(|argument| argument == "table") {
        ordering_table::print();
        return;
    }
    // One worker, as the factor thread is one.
    benches(1, |c| {
        for cell in CELLS {
            measure(c, &liver(cell, |_| ()));
        }
        let world = liver(SMALL, |_| ());
        let positions: Vec<_> =
            world.model().node_of_free().iter().map(|&node| world.mesh().nodes[node as usize]).collect();
        c.bench_function(&format!("ordering and symbolic factor, {}", nodes(&world)), |b| {
            b.iter(|| SymbolicFactor::new(world.model().pattern(), &positions));
        });
    });
}
