//! A contact between a tool and a point of a tissue surface.

use nalgebra::Vector3;

/// A potential contact: a material point of the tissue, the direction in which the tool pushes it, and their gap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Identifies the surface feature (vertex, edge or triangle) so that forces can be matched between steps.
    pub feature: u64,
    /// Mesh nodes that carry the tissue point.
    pub nodes: [u32; 3],
    /// Barycentric weights of the nodes; they sum to 1. A contact at a node has weights `[1, 0, 0]`.
    pub weights: [f64; 3],
    /// Unit vector from the tool towards the tissue: the direction in which the tool pushes the tissue.
    pub normal: Vector3<f64>,
    /// The tissue point in the world frame [m].
    pub tissue_point: Vector3<f64>,
    /// The tool's point opposite to it in the world frame [m].
    pub tool_point: Vector3<f64>,
    /// `(tissue_point - tool_point) · normal` [m]; negative where the tool is inside the tissue.
    pub gap: f64,
}
