//! Forces and system matrix of the liver: elements a second by law, size, threads and definiteness filter; and for every
//! registered law a table of nanoseconds per element, in packs against one element at a time in the same run.
//!
//! The body is bent, so that the filter has work in about half of the elements.

#![allow(clippy::print_stdout)] // the table is the result

use std::{hint::black_box, time::Instant};

use cpu_time::ThreadTime;
use criterion::{BenchmarkId, Criterion, Throughput};
use palpate::fem::assembly::{FemWorkspace, assemble, incremental_energy, internal_forces};
use palpate::fem::element::quadratic::{POINTS, QuadraticMatrices};
use palpate::fem::element::{ElementKind, ElementMatrices};
use palpate::fem::material::{Law, Material};
use palpate::fem::pack::{DeformedPack, PACK, PackMatrices, QuadraticPackMatrices};
use palpate::world::World;

mod organ;
use organ::{CELLS, SMALL, benches, bent, liver, liver_of, measuring, nodes, pool};

/// Young's modulus (Pa) and Poisson's ratio of the bundled scene's parenchyma.
const TISSUE: [f64; 2] = [6e3, 0.45];

const LAWS: [&str; 2] = ["neo_hookean", "corotational"];

fn law(name: &str) -> Material {
    Material::from_young_poisson(name, TISSUE[0], TISSUE[1]).expect("the law is registered")
}

fn measure(c: &mut Criterion, case: String, world: &World) {
    let (model, state) = (world.model(), bent(world.model()));
    let mut ws = FemWorkspace::new(model);
    let mut group = c.benchmark_group("assembly");
    group.throughput(Throughput::Elements(world.mesh().tetrahedra.len() as u64));
    group.bench_function(BenchmarkId::new(case, format!("{} threads", rayon::current_num_threads())), |b| {
        b.iter(|| assemble(model, &state, world.dt(), &[], &mut ws));
    });
    group.finish();
}

/// Packs between two readings of the clock.
const PACKS: usize = 64;

/// The liver all of one law and one kind of element.
fn liver_by(law: &Material, kind: ElementKind) -> World {
    liver(SMALL, |scene| {
        scene.bodies[0].material = (*law).into();
        scene.bodies[0].regions.clear();
        scene.bodies[0].element = kind;
    })
}

/// Median times (ns per element): forces and tangents one element at a time and in packs, and the whole assembly. Averaged
/// elements stand under a pressure here; what their groups cost is part of the assembly. Time of the thread, so that other
/// programs count only by what they push out of the caches.
fn kernels(law: &Material, world: &World, filter: bool) -> [f64; 3] {
    let (model, state) = (world.model(), bent(world.model()));
    let q = &state.q;
    let kind = model.element_kind();
    let law = if kind == ElementKind::Averaged { law.without_bulk().map_or(*law, |(law, _)| law) } else { *law };
    let pressure = [0.1 * TISSUE[0]; PACK];
    let mut ws = FemWorkspace::new(model);
    ws.filter = filter;
    let (mut matrices, mut quadratic_matrices) = (ElementMatrices::ZERO, QuadraticMatrices::ZERO);
    let mut results = [PackMatrices::ZERO; POINTS];
    let mut quadratic_results = Box::new(QuadraticPackMatrices::ZERO);
    let repetitions = match kind {
        _ if !measuring() => 1,
        ElementKind::Quadratic => 11,
        _ => 41,
    };
    let mut times = [Vec::new(), Vec::new(), Vec::new()];
    let mut read = |which: usize, elements: usize, start: ThreadTime| {
        times[which].push(start.elapsed().as_secs_f64() * 1e9 / elements as f64);
    };
    for _ in 0..repetitions {
        if kind == ElementKind::Quadratic {
            let packs = model.quadratic_packs().chunks(PACKS);
            for (elements, packs) in model.quadratic_elements().chunks(PACK * PACKS).zip(packs) {
                let start = ThreadTime::now();
                for element in elements {
                    element.answer(&law, q, filter, &mut quadratic_matrices);
                    black_box(&quadratic_matrices);
                }
                read(0, elements.len(), start);
                let start = ThreadTime::now();
                for pack in packs {
                    for (at, point) in pack.at_points(q).iter().zip(&mut results) {
                        law.pack(at, filter, point);
                    }
                    pack.sum_points(&results, &mut quadratic_results);
                    black_box(&quadratic_results);
                }
                read(1, elements.len(), start);
            }
        }
        for (elements, packs) in model.elements().chunks(PACK * PACKS).zip(model.packs().chunks(PACKS)) {
            let start = ThreadTime::now();
            for element in elements {
                let edges = element.edges(q);
                if kind == ElementKind::Averaged {
                    law.element_under_pressure(element, &edges, pressure[0], filter, &mut matrices);
                } else {
                    law.element(element, &edges, filter, &mut matrices);
                }
                black_box(&matrices);
            }
            read(0, elements.len(), start);
            let start = ThreadTime::now();
            for pack in packs {
                let pressure = (kind == ElementKind::Averaged).then_some(&pressure);
                law.pack(&DeformedPack { pressure, ..pack.at(q) }, filter, &mut results[0]);
                black_box(&results[0]);
            }
            read(1, elements.len(), start);
        }
        let start = ThreadTime::now();
        black_box(assemble(model, &state, world.dt(), &[], &mut ws));
        read(2, model.elements().len(), start);
    }
    times.map(|mut times| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    })
}

/// Prints the table of [`kernels`] for every registered law and kind of element, on one thread.
fn print_kernels() {
    println!(
        "\nns per element, one thread, {} elements; medians",
        liver_of(SMALL, law(LAWS[0])).mesh().tetrahedra.len()
    );
    println!("| element | law | filter | one at a time | in packs | ratio | sums and rows | assembly |");
    println!("| --- | --- | --- | ---: | ---: | ---: | ---: | ---: |");
    for kind in [ElementKind::Linear, ElementKind::Averaged, ElementKind::Quadratic] {
        for name in Material::NAMES {
            let law = law(name);
            if kind == ElementKind::Averaged && law.without_bulk().is_none() {
                continue;
            }
            let world = liver_by(&law, kind);
            for filter in [false, true] {
                let [plain, packs, assembly] = pool(1).install(|| kernels(&law, &world, filter));
                let (kind, state, ratio) = (kind.name(), if filter { "on" } else { "off" }, plain / packs);
                let sums = assembly - packs;
                println!(
                    "| {kind} | {name} | {state} | {plain:.0} | {packs:.0} | {ratio:.1} | {sums:.0} | {assembly:.0} |"
                );
            }
        }
    }
}

/// Prints medians (ns per element) of the whole assembly, of forces alone and of the energy alone, by kind of element.
fn print_kinds() {
    println!("\nns per element, neo_hookean with filter, bent; medians");
    println!("| element | elements | threads | assembly | forces alone | energy alone |");
    println!("| --- | ---: | ---: | ---: | ---: | ---: |");
    for kind in [ElementKind::Linear, ElementKind::Averaged, ElementKind::Quadratic] {
        let world = liver_by(&law(LAWS[0]), kind);
        let (model, state) = (world.model(), bent(world.model()));
        let elements = world.mesh().tetrahedra.len();
        let repetitions = if measuring() { 41 } else { 1 };
        for threads in [1, 2] {
            let [whole, forces, energy] = pool(threads).install(|| {
                let mut ws = FemWorkspace::new(model);
                ws.dt = world.dt();
                let mut times = [Vec::new(), Vec::new(), Vec::new()];
                for _ in 0..repetitions {
                    let start = Instant::now();
                    black_box(assemble(model, &state, world.dt(), &[], &mut ws));
                    times[0].push(start.elapsed().as_secs_f64());
                    let start = Instant::now();
                    black_box(internal_forces(model, &state, &mut ws));
                    times[1].push(start.elapsed().as_secs_f64());
                    let start = Instant::now();
                    black_box(incremental_energy(model, &state, world.dt()));
                    times[2].push(start.elapsed().as_secs_f64());
                }
                times.map(|mut times| {
                    times.sort_by(f64::total_cmp);
                    times[times.len() / 2] * 1e9 / elements as f64
                })
            });
            let name = kind.name();
            println!("| {name} | {elements} | {threads} | {whole:.0} | {forces:.0} | {energy:.0} |");
        }
    }
}

fn main() {
    print_kernels();
    print_kinds();
    if std::env::args().any(|argument| argument == "table") {
        return;
    }
    for cell in CELLS {
        for name in LAWS {
            let world = liver_of(cell, law(name));
            for threads in [1, 2] {
                benches(threads, |c| measure(c, format!("{name}, {}", nodes(&world)), &world));
            }
        }
    }
    for name in LAWS {
        let world = liver(SMALL, |scene| {
            scene.bodies[0].material = law(name).into();
            scene.bodies[0].regions.clear();
            scene.bodies[0].definiteness_filter = false;
        });
        benches(1, |c| measure(c, format!("{name} unfiltered, {}", nodes(&world)), &world));
    }
}
