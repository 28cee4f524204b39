//! A sphere pressed into a block: five depths against references on the same mesh, with contact at its nodes.

#![allow(clippy::print_stdout)] // tables of what was measured

use crate::quasi_static::{press, reference};
use nalgebra::Vector3;
use palpate::prelude::*;

const RADIUS: f64 = 0.040;
const TOP: f64 = 0.050;
const DEPTHS: [f64; 5] = [0.001, 0.002, 0.004, 0.006, 0.008];

/// Quadratic hexahedra with contact integrated on faces: what a fine mesh tends to (N), good to about 1.5 %.
const CONVERGED: [f64; 5] = [0.1124, 0.3401, 1.0234, 1.9950, 3.1935];

/// Forces (N) at the five depths through the engine, with so many equilibria from each depth to the next.
fn forces(law: &str, friction: f64, parts: u32) -> Option<[f64; 5]> {
    forces_by("", law, friction, parts)
}

/// The same with more lines in the scene's `[contact]`.
fn forces_by(contact: &str, law: &str, friction: f64, parts: u32) -> Option<[f64; 5]> {
    let path = reference("reference/indentation/block.vtk")?;
    let text = format!(
        r#"
        name = "indentation"
        [rates]
        step = 0.05
        [[body]]
        name = "block"
        mesh = "{name}"
        density = 1000
        material = {{ law = "{law}", young = 10e3, poisson = 0.40 }}
        fixed = [{{ below = {{ axis = "z", at = 1e-9 }} }}]
        compliance = "exact"
        tolerance = 1e-9
        [[tool]]
        name = "ball"
        shape = {{ kind = "sphere", radius = {RADIUS} }}
        [contact]
        at = "nodes"
        friction = {friction}
        max_contacts = 169
        {contact}
        [solver]
        tolerance = 1e-8
        max_sweeps = 20000
        [hand]
        path = [{{ time = 0, position = [0, 0, 0.1] }}]
        "#,
        name = path.file_name()?.display(),
    );
    let scene = Scene::from_toml(&text, path.parent()?).unwrap();
    let world = scene.build().unwrap();
    let centre = world.mesh().bounding_box().centre();
    let mut sim = Simulation::new(&world).unwrap();
    let mut at = 0.0;
    Some(DEPTHS.map(|depth| {
        // Friction remembers the way: the depth grows in small parts, each an equilibrium.
        for part in 1..parts {
            let way = at + (depth - at) * f64::from(part) / f64::from(parts);
            press(&mut sim, Vector3::new(centre.x, centre.y, TOP + RADIUS - way), 1e-6);
        }
        at = depth;
        let (report, steps) = press(&mut sim, Vector3::new(centre.x, centre.y, TOP + RADIUS - depth), 1e-6);
        println!("  {:.0} mm: {:.5} N, {} contacts, {steps} steps", 1e3 * depth, report.force.z, report.active);
        report.force.z
    }))
}

fn compare(law: &str, expected: &[f64; 5]) -> Option<f64> {
    let ours = forces(law, 0.0, 1)?;
    println!("{law}\n depth   ours     this mesh (error)   converged (error)");
    let mut worst = 0.0f64;
    for (k, f) in ours.iter().enumerate() {
        let error = f / expected[k] - 1.0;
        worst = worst.max(error.abs());
        let far = 100.0 * (f / CONVERGED[k] - 1.0);
        let depth = 1e3 * DEPTHS[k];
        println!(
            "{depth:4} mm  {f:.4}  {:.4} ({:+.2} %)  {:.4} ({far:+.1} %)",
            expected[k],
            100.0 * error,
            CONVERGED[k]
        );
    }
    Some(worst)
}

/// On the reference's mesh with contact at its nodes, that leaves no gap: higher than the reference by 0.6 % where one node
/// touches and by 0.2 % at 8 mm, as if it were 6 µm deeper everywhere. That is the yielding of the reference's contact, see
/// [`the_references_contact_yields_like_a_spring_of_one_stiffness`]. The mesh itself makes +8 to +17 %.
#[test]
fn neo_hookean_block_answers_like_the_reference_on_its_mesh() {
    let Some(worst) = compare("neo_hookean", &[0.1286, 0.3953, 1.1920, 2.1538, 3.5440]) else { return };
    assert!(worst < 0.01, "{worst}");
}

/// The same with polar frames on both sides; the law is 3 % to 13 % softer than neo-Hookean at these strains.
#[test]
fn corotational_block_answers_like_the_reference_on_its_mesh() {
    let Some(worst) = compare("corotational", &[0.1251, 0.3811, 1.1094, 1.9347, 3.1002]) else { return };
    assert!(worst < 0.01, "{worst}");
}

/// Stiffness (N/m) of each contact in the reference, inferred: its note does not say that its contact yields.
const REFERENCE_CONTACT: f64 = 2e4;

/// What explains the difference is a spring of 20 kN/m at each node, which the tool enters by some 6 µm. One number fits
/// twenty: with it all forces of four laws at five depths are the reference's, to the last digit that it gives (half of which is
/// 0.5e-4 N). The fifth law stays up to 0.48 % off: the note marks it `λ+μ`, perhaps another form of the stable law than ours.
#[test]
fn the_references_contact_yields_like_a_spring_of_one_stiffness() {
    let contact = format!("method = \"penalty\"\npenalty = {{ stiffness = {REFERENCE_CONTACT:e}, damping = 0.0 }}");
    let same = [
        ("neo_hookean", [0.1286, 0.3953, 1.1920, 2.1538, 3.5440]),
        ("linear", [0.1267, 0.3894, 1.1543, 2.0344, 3.2703]),
        ("st_venant_kirchhoff", [0.1202, 0.3607, 0.9927, 1.6370, 2.5146]),
        ("corotational", [0.1251, 0.3811, 1.1094, 1.9347, 3.1002]),
    ];
    let other = [("stable_neo_hookean", [0.1274, 0.3922, 1.1765, 2.1150, 3.4754])];
    for ((law, expected), is_same) in same.into_iter().map(|c| (c, true)).chain(other.map(|c| (c, false))) {
        let Some(ours) = forces_by(&contact, law, 0.0, 1) else { return };
        println!("{law}: {:+.3?} %", std::array::from_fn::<f64, 5, _>(|k| 100.0 * (ours[k] / expected[k] - 1.0)));
        for (ours, expected) in ours.into_iter().zip(expected) {
            // Beyond the half digit what our own search for equilibrium leaves: 1e-6 of the force.
            let bound = if is_same { 0.5e-4 + 2e-6 * expected } else { 5e-3 * expected };
            assert!((ours - expected).abs() < bound, "{law}: {ours} N, not {expected} N");
        }
    }
}

/// Stick raises the force: it holds the skin under the ball from spreading. From 1 mm on nearly all nodes stick at 0.5,
/// so a tenfold friction changes little more, and less friction lies between.
///
/// The reference's note says "less than 1.2 %", without the depth: here that holds up to 2 mm; at 8 mm
/// full stick makes +4.7 %, whether the depth grows in 4, 10 or 30 parts.
#[test]
fn friction_raises_the_normal_force_up_to_full_stick() {
    let Some(smooth) = forces("neo_hookean", 0.0, 1) else { return };
    let change = |friction: f64| -> [f64; 5] {
        let rough = forces("neo_hookean", friction, 4).unwrap();
        std::array::from_fn(|k| 100.0 * (rough[k] / smooth[k] - 1.0))
    };
    let (little, half, stick) = (change(0.1), change(0.5), change(5.0));
    println!(" depth   friction 0.1, 0.5, 5 change the force by");
    for (k, depth) in DEPTHS.iter().enumerate() {
        println!("{:4} mm   {:+.2} %   {:+.2} %   {:+.2} %", 1e3 * depth, little[k], half[k], stick[k]);
        // 0.02 %: the first depth touches at one node on the axis, where friction does nothing.
        assert!(-0.02 < little[k] && little[k] < half[k] + 0.02 && half[k] < stick[k] + 0.02);
        assert!(half[k] < if *depth <= 0.002 { 1.2 } else { 6.0 }, "{half:?}");
    }
}
