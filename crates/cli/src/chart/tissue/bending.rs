//! A cantilever that sags under its weight: the error of its tip, by law, element and mesh size.
//!
//! 0.10 x 0.02 x 0.02 m, clamped at one end, `E = 50 kPa`, Poisson ratio 0.49, 1060 kg/m³; a slender beam would sag by
//! 78 mm in the linear theory, so the answer is far from it. The reference is the same law on quadratic tetrahedra that
//! are finer than all others.

use miette::Result;
use nalgebra::Vector3;
use palpate::fem::block::{block, evenly};
use palpate::fem::element::ElementKind;
use palpate::fem::mesh::TetMesh;

use super::body::{Body, at_rest, time_alone};

const LENGTH: f64 = 0.10;
const SIDE: f64 = 0.02;

/// Groups of steps that are timed.
const GROUPS: usize = 7;

/// A beam of `cells` over its height and five times as many along.
pub(crate) fn mesh(cells: usize) -> TetMesh {
    let side = evenly(0.0, SIDE, cells);
    block(&evenly(0.0, LENGTH, 5 * cells), &side, &side)
}

/// The beam of one law and element.
pub(crate) fn body(law: &str, element: ElementKind) -> Body {
    Body {
        material: format!("{{ law = \"{law}\", young = 50e3, poisson = 0.49 }}"),
        element,
        density: 1060.0,
        gravity: [0.0, 0.0, -9.81],
        fixed: "{ node_set = \"x_min\" }".into(),
        rate: 30.0,
        rayleigh: [2.0, 0.005],
        settle: true,
        more: "",
    }
}

/// One beam at rest.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bending {
    /// Where a lower corner of the free end comes to rest, from where it was (m); `None` where that was not found.
    pub(crate) tip: Option<Vector3<f64>>,
    /// Nodes.
    pub(crate) nodes: usize,
    /// Time per step (s); `None` where a step failed or none was asked for.
    pub(crate) time: Option<f64>,
}

/// The beam at rest, and its time per step where `timed`.
pub(crate) fn sag(law: &str, element: ElementKind, cells: usize, timed: bool) -> Result<Bending> {
    let world = body(law, element).world(mesh(cells))?;
    // A corner of the free end: on every mesh a node.
    let corner = Vector3::new(LENGTH, 0.0, 0.0);
    let nodes = &world.mesh().nodes;
    let distance = |i: &usize| (nodes[*i] - corner).norm();
    let node = (0..nodes.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0);
    let sim = at_rest(&world);
    let tip = sim.as_ref().map(|sim| sim.positions()[node] - nodes[node]);
    let time = sim.filter(|_| timed).and_then(|sim| time_alone(sim, GROUPS));
    Ok(Bending { tip, nodes: nodes.len(), time })
}
