//! Why no equilibrium is sought.

use thiserror::Error;

/// Loads that no body can be in equilibrium with, or settings with which none is found.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum EquilibriumError {
    /// A node is moved that the model leaves free.
    #[error("node {node} is moved to a place, but it is free: fix it in the body's description")]
    FreeNode {
        /// The node.
        node: u32,
    },
    /// A node does not exist.
    #[error("node {node} is moved to a place, but the mesh has {nodes} nodes (counted from 0)")]
    NoNode {
        /// The node.
        node: u32,
        /// Nodes of the mesh.
        nodes: usize,
    },
    /// A place is not finite.
    #[error("node {node} is moved to a place that is not finite")]
    Place {
        /// The node.
        node: u32,
    },
    /// Nothing holds the body.
    #[error("no node is fixed: a body that nothing holds has no equilibrium; fix some nodes")]
    Unsupported,
    /// A load step that is not in its range.
    #[error("{name} = {value}: the {range}; the default is {default}")]
    Step {
        /// The field of [`EquilibriumConfig`](super::EquilibriumConfig).
        name: &'static str,
        /// What was given.
        value: f64,
        /// Where it must lie, in words.
        range: &'static str,
        /// What serves most bodies.
        default: f64,
    },
    /// Newton's method may do nothing, or stops at once.
    #[error("newton.{name} = {value}: {range}")]
    Newton {
        /// The field of [`NewtonConfig`](crate::integrator::newton::NewtonConfig).
        name: &'static str,
        /// What was given.
        value: f64,
        /// Where it must lie, in words.
        range: &'static str,
    },
    /// The forces do not belong to this mesh.
    #[error("{forces} forces for {nodes} nodes: give one per mesh node, or none")]
    ForceCount {
        /// Forces given.
        forces: usize,
        /// Nodes of the mesh.
        nodes: usize,
    },
}
