//! What is remembered of a node of a patch.

use nalgebra::Vector3;

use super::creep::Creep;

/// A node of the patch in use.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    pub(super) name: u32,
    /// Whether the patch before had it.
    pub(super) known: bool,
    /// Where it was at the end of the tick before \[m\].
    pub(super) shape: Vector3<f64>,
    pub(super) creep: Creep,
    /// From the shape to the place where contacts are found \[m\].
    pub(super) lag: Vector3<f64>,
    /// From the shape without forces to the place where contacts are found \[m\]: what the forces do, which it follows by
    /// a share in each tick.
    pub(super) yielded: Vector3<f64>,
    /// x − q_end \[m\].
    pub(super) drift: Vector3<f64>,
}

impl Node {
    /// One that nothing is known of.
    pub(super) const NEW: Self = Self {
        name: u32::MAX,
        known: false,
        shape: Vector3::new(0.0, 0.0, 0.0),
        creep: Creep::REST,
        lag: Vector3::new(0.0, 0.0, 0.0),
        yielded: Vector3::new(0.0, 0.0, 0.0),
        drift: Vector3::new(0.0, 0.0, 0.0),
    };
}
