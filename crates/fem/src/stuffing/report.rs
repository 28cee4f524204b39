//! What a stuffing produced, or why it did not.

use super::config::MAX_LATTICE_VERTICES;
use super::quality::StuffingQuality;

/// What became of one label of an image.
#[derive(Clone, Debug, PartialEq)]
pub struct RegionReport {
    /// The label in the image.
    pub label: u8,
    /// Name of its region.
    pub name: String,
    /// Volume of its voxels (m³).
    pub label_volume: f64,
    /// Volume of its tetrahedra (m³).
    pub volume: f64,
    /// Number of its tetrahedra; a region without any is not among the mesh's names.
    pub tetrahedra: usize,
    /// Smallest share of the label within a tetrahedron of its region.
    pub least_share: f64,
}

/// What a stuffing produced.
#[derive(Clone, Debug, PartialEq)]
pub struct StuffingReport {
    /// Lattice constant (m).
    pub cell: f64,
    /// Nodes of the mesh.
    pub nodes: usize,
    /// Tetrahedra of the mesh.
    pub tetrahedra: usize,
    /// Volumes, angles and edges.
    pub quality: StuffingQuality,
    /// Bodies that were dropped because a larger one exists.
    pub dropped_bodies: usize,
    /// Their volume (m³).
    pub dropped_volume: f64,
    /// Places where the body was grown to part a touching boundary.
    pub mended_pinches: usize,
    /// Nodes where the boundary still touches itself; 0 unless mending failed.
    pub pinched_nodes: usize,
    /// Volume of all labels of an image and of filled voids (m³); 0 for other sources.
    pub label_volume: f64,
    /// Part of it that voids in the labels made, which the mesh fills (m³).
    pub filled_volume: f64,
    /// Outward shift of the level set that keeps the volume (m).
    pub shift: f64,
    /// The labels of an image; empty for other sources.
    pub regions: Vec<RegionReport>,
}

/// Why a body could not be stuffed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StuffingError {
    /// The cell is not a positive, finite length.
    #[error("cell = {cell} m must be positive and finite; give the lattice constant in metres, such as 0.0155")]
    BadCell {
        /// The cell (m).
        cell: f64,
    },
    /// The smoothing is negative or not finite.
    #[error("smoothing = {smoothing} cells must lie between 0 and 2")]
    BadSmoothing {
        /// The blur (cells).
        smoothing: f64,
    },
    /// The cell is larger than the body.
    #[error(
        "cell = {cell} m is larger than the body's extent of {extent:.4} m; use {usable:.4} m or less (are the units right?)"
    )]
    CellTooLarge {
        /// The cell (m).
        cell: f64,
        /// Least extent of the body (m).
        extent: f64,
        /// A cell that resolves it (m).
        usable: f64,
    },
    /// The lattice would exceed its limit.
    #[error(
        "cell = {cell} m needs {vertices:.0} lattice vertices, the limit is {MAX_LATTICE_VERTICES}; \
         use {usable:.4} m or more (are the units right?)"
    )]
    CellTooSmall {
        /// The cell (m).
        cell: f64,
        /// Vertices that it asks for.
        vertices: f64,
        /// A cell within the limit (m).
        usable: f64,
    },
    /// A label that was asked for by name is not in the image.
    #[error("no voxel of the image has the label {label} of `{name}`; it has {present}")]
    NoSuchLabel {
        /// The label.
        label: u8,
        /// Its name.
        name: String,
        /// The labels that there are, in words.
        present: String,
    },
    /// The image shows background only.
    #[error("the image holds no label but 0 (background); there is nothing to mesh")]
    Empty,
    /// No lattice vertex lies inside.
    #[error("no lattice vertex lies inside the body at cell = {cell} m: it is too thin or empty; use a smaller cell")]
    NothingInside {
        /// The cell (m).
        cell: f64,
    },
    /// No cell gives a number of nodes.
    #[error("no cell was found that gives about {nodes} nodes; the nearest gives {nearest}")]
    NoSuchSize {
        /// The number asked for.
        nodes: usize,
        /// The nearest that was found.
        nearest: usize,
    },
}
