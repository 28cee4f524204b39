//! Forces and system matrix of the liver: elements a second by law, size, threads and definiteness filter.
//!
//! The body is bent, so that the filter has work in about half of the elements.

use criterion::{BenchmarkId, Criterion, Throughput};
use palpate::fem::assembly::{FemWorkspace, assemble};
use palpate::fem::material::Material;
use palpate::world::World;

mod organ;
use organ::{CELLS, SMALL, benches, bent, liver, liver_of, nodes};

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

fn main() {
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
