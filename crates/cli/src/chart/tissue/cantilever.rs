//! A silicone rod that hangs over: measured, and computed by element and mesh size.
//!
//! L = 182 mm, diameter 8.5 mm, 965 kg/m³, clamped at one end. Mooney-Rivlin with `c1 = 151,065.46 Pa` on the first
//! invariant, `c2 = 101,709.668 Pa` on the second, both isochoric, and `k0 = 1e7 Pa` on `ln²J / 2`: from the tests of
//! SOFA (commit 2a278d8), which state the measured tip at `y = -116.25 mm, z = 128 mm` and SOFA's own answer on
//! 3,668 nodes and 12,724 linear tetrahedra: `y = -106.832 mm` after 180 steps of 20 ms with Rayleigh damping 0.1 by mass
//! and by stiffness.

use std::path::Path;

use miette::{Result, miette};
use nalgebra::Vector3;
use palpate::fem::element::ElementKind;
use palpate::fem::element::quadratic::EDGES;
use palpate::fem::format;
use palpate::fem::mesh::TetMesh;

use super::body::{Body, at_rest, positions_after, time_alone};
use super::cylinder::{rod, widen};

const LENGTH: f64 = 0.182;
const RADIUS: f64 = 0.00425;

/// The tip of the real rod: y and z (m).
pub(crate) const MEASURED: (f64, f64) = (-0.11625, 0.128);

/// SOFA's tip (m).
pub(crate) const SOFA: f64 = -0.106832;

/// Steps and rate (Hz) of the dynamic run.
const STEPS: u64 = 180;
const RATE: f64 = 50.0;

/// Groups of steps that are timed.
const GROUPS: usize = 7;

/// A rod's answer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tip {
    /// Nodes.
    pub(crate) nodes: usize,
    /// Tetrahedra.
    pub(crate) tetrahedra: usize,
    /// At rest (m).
    pub(crate) at_rest: Option<Vector3<f64>>,
    /// After the dynamic run (m).
    pub(crate) moving: Option<Vector3<f64>>,
    /// Time per step (s).
    pub(crate) time: Option<f64>,
}

/// The rod on our mesh, `across` cells over the diameter and `along` its length.
pub(crate) fn mesh(element: ElementKind, across: usize, along: usize) -> TetMesh {
    let mut mesh = rod(RADIUS, LENGTH, across, along);
    if element == ElementKind::Quadratic {
        mesh = curved(mesh);
    } else {
        widen(&mut mesh, across);
    }
    mesh
}

/// The rod of a mesh file, where there is one.
pub(crate) fn shared(folder: &Path) -> Option<Result<TetMesh>> {
    let path = folder.join("pdms/cylinder.vtk");
    path.is_file().then(|| format::read(&path).map(|file| file.mesh).map_err(|e| miette!("{e}")))
}

/// Ten nodes an element, those on the round side moved out onto the circle.
fn curved(mesh: TetMesh) -> TetMesh {
    let on_circle = |i: u32| mesh.nodes[i as usize].xy().norm() > 0.999 * RADIUS;
    // A triangle of an end has its nodes at one height; its chords stay straight.
    let level = |t: &[u32; 3]| t.iter().all(|&i| mesh.nodes[i as usize].z == mesh.nodes[t[0] as usize].z);
    let mut side = std::collections::BTreeSet::new();
    for t in mesh.surface().triangles.iter().filter(|t| t.iter().all(|&i| on_circle(i)) && !level(t)) {
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            side.insert((a.min(b), a.max(b)));
        }
    }
    let mut mesh = mesh.promoted();
    for (corners, mids) in mesh.tetrahedra.iter().zip(&mesh.mid_nodes) {
        for (&(a, b), &mid) in EDGES.iter().zip(mids) {
            let (a, b) = (corners[a], corners[b]);
            if side.contains(&(a.min(b), a.max(b))) {
                let x = &mut mesh.nodes[mid as usize];
                let outwards = RADIUS / x.xy().norm();
                (x.x, x.y) = (x.x * outwards, x.y * outwards);
            }
        }
    }
    mesh
}

fn body(element: ElementKind, settle: bool) -> Body {
    Body {
        material: "{ law = \"mooney_rivlin\", c1 = 151065.46, c2 = 101709.668, bulk = 1e7 }".into(),
        element,
        density: 965.0,
        gravity: [0.0, -9.81, 0.0],
        fixed: "{ below = { axis = \"z\", at = 0.0 } }".into(),
        rate: RATE,
        rayleigh: [0.1, 0.1],
        settle,
        more: "tolerance = 1e-8",
    }
}

/// The node at the middle of the free end.
fn tip(mesh: &TetMesh) -> usize {
    let end = Vector3::new(0.0, 0.0, LENGTH);
    let distance = |i: &usize| (mesh.nodes[*i] - end).norm();
    (0..mesh.nodes.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
}

/// The rod at rest, after the dynamic run, and its time per step.
pub(crate) fn hang(mesh: &TetMesh, element: ElementKind, dynamic: bool) -> Result<Tip> {
    let world = body(element, true).world(mesh.clone())?;
    let node = tip(world.mesh());
    let sim = at_rest(&world);
    let rest = sim.as_ref().map(|sim| sim.positions()[node]);
    let time = sim.and_then(|sim| time_alone(sim, GROUPS));
    let moving = if dynamic {
        let world = body(element, false).world(mesh.clone())?;
        positions_after(&world, STEPS).map(|q| q[node])
    } else {
        None
    };
    Ok(Tip { nodes: world.mesh().nodes.len(), tetrahedra: world.mesh().tetrahedra.len(), at_rest: rest, moving, time })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chart::tissue::reference;

    /// SOFA's own end of this rod, six digits: where its damped run comes to rest is the static answer on its mesh.
    #[test]
    fn the_rod_on_sofas_mesh_rests_where_sofa_says() {
        let Some(mesh) = reference::folder().and_then(|folder| shared(&folder)) else {
            println!("skipped: there is no pdms/cylinder.vtk; PALPATE_SHARED names the folder of reference data");
            return;
        };
        let tip = hang(&mesh.unwrap(), ElementKind::Linear, false).unwrap().at_rest.expect("an equilibrium");
        let sofa = Vector3::new(-0.000_373_234, -0.106_832, 0.141_393);
        assert!((tip - sofa).norm() < 1e-6, "{tip:?} against {sofa:?}");
    }

    /// The measured rod: fewer nodes than SOFA's mesh has, ten to an element, come within 2 %.
    #[test]
    fn quadratic_elements_come_within_two_percent_of_the_measured_rod() {
        let mesh = mesh(ElementKind::Quadratic, 2, 40);
        let tip = hang(&mesh, ElementKind::Quadratic, false).unwrap();
        assert!(tip.nodes < 3_668);
        let error = tip.at_rest.expect("an equilibrium").y / MEASURED.0 - 1.0;
        assert!(error.abs() < 0.02, "{error}");
    }
}
