//! Prints accuracy and cost of every kind of element, near incompressibility too:
//! `cargo run --release -p palpate-fem --example element_study`.
#![allow(clippy::print_stdout)]

use std::time::Instant;

use palpate_fem::element::ElementKind;

#[path = "../tests/element_study/mod.rs"]
mod element_study;
#[path = "../tests/tissue_setup/mod.rs"]
mod tissue_setup;
use element_study::{AVERAGED, AVERAGED_NODES, Choice, Cost, LINEAR, QUADRATIC, manufactured, panel};

const CHOICES: [(&str, Choice); 4] =
    [("linear", LINEAR), ("quadratic", QUADRATIC), ("averaged patches", AVERAGED), ("averaged nodes", AVERAGED_NODES)];

fn cost(cost: &Cost, seconds: f64) -> String {
    let (unknowns, blocks, nonzeros) = (cost.unknowns, cost.blocks, cost.factor_nonzeros as f64 / 1e6);
    format!("{unknowns:>8} {blocks:>9} {nonzeros:>9.2} {:>9.0} {seconds:>7.2}", cost.factor_flops / 1e6)
}

fn main() {
    let head = format!("{:>8} {:>9} {:>9} {:>9} {:>7}", "unknowns", "blocks", "L (1e6)", "Mflop", "s");
    println!("manufactured solution without divergence, errors relative\n");
    println!(
        "{:>16} {:>7} {:>5} {:>9} {:>9} {:>9} {:>9} {head}",
        "element", "poisson", "cells", "u", "energy", "grad u", "pressure"
    );
    for poisson in [0.3, 0.49, 0.499, 0.4999] {
        for (name, choice) in CHOICES {
            let sizes: &[usize] = if choice.0 == ElementKind::Quadratic { &[3, 4, 6] } else { &[6, 8, 12] };
            for &cells in sizes {
                let start = Instant::now();
                let (e, c) = manufactured(choice, cells, poisson);
                let cost = cost(&c, start.elapsed().as_secs_f64());
                println!(
                    "{name:>16} {poisson:>7} {cells:>5} {:>9.2e} {:>9.2e} {:>9.2e} {:>9.2e} {cost}",
                    e.displacement, e.energy, e.gradient, e.pressure
                );
            }
        }
    }
    println!("\ntapered panel, mean displacement of the loaded end, jumps of pressure between neighbours\n");
    println!("{:>16} {:>7} {:>5} {:>9} {:>9} {head}", "element", "poisson", "size", "u (mm)", "jumps");
    for poisson in [0.3, 0.49, 0.499, 0.4999] {
        for (name, choice) in CHOICES {
            let sizes: &[usize] = if choice.0 == ElementKind::Quadratic { &[1, 2, 3] } else { &[1, 2, 3, 4] };
            for &size in sizes {
                let start = Instant::now();
                let (u, jumps, c) = panel(choice, size, poisson);
                let cost = cost(&c, start.elapsed().as_secs_f64());
                println!("{name:>16} {poisson:>7} {size:>5} {:>9.4} {jumps:>9.3} {cost}", u * 1e3);
            }
        }
    }
}
