//! exploration
#![allow(clippy::print_stdout)]
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use palpate::prelude::*;

fn run(shape: &str, element: &str, friction: f64, depth: f64, off: [f64; 2], compliance: &str) -> (f64, f64) {
    let text = format!(
        r#"
        name = "rest"
        gravity = [0, 0, 0]
        [rates]
        step = 30
        [[body]]
        name = "block"
        block = {{ min = [0, 0, 0], max = [0.08, 0.08, 0.04], cells = [8, 8, 4] }}
        element = "{element}"
        density = 1000
        rayleigh_stiffness = 0.005
        material = {{ law = "neo_hookean", young = 10e3, poisson = 0.40 }}
        fixed = [{{ node_set = "z_min" }}]
        compliance = "{compliance}"
        [[tool]]
        name = "ball"
        shape = {shape}
        [contact]
        at = "faces"
        friction = {friction}
        max_contacts = 200
        [solver]
        tolerance = 1e-8
        max_sweeps = 5000
        [hand]
        path = [{{ time = 0, position = [0, 0, 0.2] }}]
        "#
    );
    let scene = Scene::from_toml(&text, std::path::Path::new("")).unwrap();
    let world = scene.build().unwrap();
    let mut sim = Simulation::new(&world).unwrap();
    let verbose = std::env::var("V").is_ok();
    let mut last = Vec::new();
    for k in 0..90 {
        let d = depth * (f64::from(k) / 15.0).min(1.0);
        let turn = UnitQuaternion::from_euler_angles(0.0, std::f64::consts::FRAC_PI_2, 0.3);
        let pose = Isometry3::from_parts(Vector3::new(0.04 + off[0], 0.04 + off[1], 0.04 + 0.02 - d).into(), turn);
        let r = sim.step(&pose);
        if k >= 60 {
            last.push(r.force.z);
        }
        if verbose && (k >= 70) {
            print!(
                "{k} {:.5} N status {:?} res {:.1e} act {} of {} ",
                r.force.z, r.solve.status, r.solve.residual, r.active, r.detection.contacts
            );
            let s = sim.state();
            let rows = if friction > 0.0 { 3 } else { 1 };
            for (b, l) in sim.workspace().rows().blocks.iter().zip(sim.forces().chunks_exact(rows)) {
                let c = &s.contacts.contacts[b.contact as usize];
                if c.feature & 0xffff_ffff == 406 {
                    let g: Vector3<f64> = (0..3).map(|k| s.fem.q[c.nodes[k] as usize] * c.weights[k]).sum();
                    let after = (g - pose.translation.vector).norm() - 0.02;
                    print!(" [slot {} gap {:.4} after {after:.3e}]", c.feature >> 32 & 0xff, c.gap * 1e6);
                    print!(
                        " {}{}:{:.3}@{:.2},{:.2}",
                        c.feature >> 61,
                        c.feature & 0xffffffff,
                        l[0],
                        c.tissue_point.x * 1e3,
                        c.tissue_point.y * 1e3
                    );
                }
            }
            println!();
        }
    }
    let (lo, hi) = last.iter().fold((f64::MAX, f64::MIN), |(a, b), f| (a.min(*f), b.max(*f)));
    let mean = last.iter().sum::<f64>() / last.len() as f64;
    (mean, (hi - lo) / mean)
}

#[test]
fn explore() {
    let filter = std::env::var("F").unwrap_or_default();
    for (name, shape) in [
        ("sphere", "{ kind = \"sphere\", radius = 0.02 }"),
        ("capsule", "{ kind = \"capsule\", radius = 0.02, half_length = 0.015 }"),
    ] {
        for element in ["linear", "quadratic", "averaged"] {
            for friction in [0.0, 0.3] {
                for (depth, off) in [(0.004, [0.0, 0.0]), (0.006, [0.0013, 0.0021])] {
                    let label = format!("{name} {element} {friction} {depth}");
                    if !label.contains(&filter) {
                        continue;
                    }
                    let t = std::time::Instant::now();
                    let (mean, range) = run(shape, element, friction, depth, off, "exact");
                    println!("{label}: {mean:.4} N, {:.4} %  {:.1} s", 100.0 * range, t.elapsed().as_secs_f64());
                }
            }
        }
    }
}
