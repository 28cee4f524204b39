//! Isosurface stuffing: label images and closed surfaces to tetrahedra of guaranteed quality.
//!
//! F. Labelle and J. R. Shewchuk, "Isosurface stuffing: fast tetrahedral meshes with good dihedral angles", ACM
//! Transactions on Graphics 26(3), 2007. A body-centred cubic lattice covers the body; lattice vertices close to the
//! surface are warped onto it; the tetrahedra that the surface still cuts are replaced by stencils. All dihedral
//! angles of the result lie between 10.78° and 164.74°, whatever the body.
//!
//! Departures from the paper: the lattice is uniform (no octree); where warping leaves two parts of the boundary
//! touching at a node or an edge, the body is grown there by a fraction of a cell and stuffed again, so that the
//! boundary is a closed 2-manifold; the level set of an image may be shifted to keep the volume of its labels.
//!
//! The lattice constant `cell` is the edge of the lattice's cubes. A cube holds two lattice vertices and twelve
//! tetrahedra, with edges of `cell` and 0.866 `cell`.

mod body;
mod cut;
mod lattice;
mod level_set;
mod quality;
mod regions;
mod sizing;
mod stencil;

use nalgebra::Vector3;

use crate::closed_surface::ClosedSurface;
use crate::image::{LabelImage, SmoothedOccupancy};
use crate::mesh::TetMesh;
use cut::CutLattice;
use lattice::Lattice;
use level_set::Grown;

pub use level_set::LevelSet;
pub use quality::MeshQuality;
pub use sizing::{cell_for_nodes, cell_for_nodes_of_image};

/// Most vertices of the lattice around a body; half of them, roughly, become nodes.
pub const MAX_LATTICE_VERTICES: usize = 4_000_000;

/// Labels of the bundled liver (`examples/scenes/liver.inr.gz`).
pub const LIVER_LABELS: [(u8, &str); 3] = [(255, "parenchyma"), (127, "vessels"), (85, "lesion")];

/// How a body is stuffed.
#[derive(Clone, Debug, PartialEq)]
pub struct Stuffing {
    /// Lattice constant [m]: edge of the cubes of the body-centred cubic lattice. Positive.
    pub cell: f64,
    /// Names of the regions of a label image. A label without a name N becomes the region `label_N`.
    pub labels: Vec<(u8, String)>,
    /// Whether to keep the largest body only (connected through faces).
    pub keep_largest: bool,
    /// Standard deviation of the blur of a label image, in cells; at least one voxel is blurred over in any case.
    pub smoothing: f64,
    /// Whether the level set of a label image is shifted until the mesh has the volume of the labels.
    pub match_volume: bool,
}

impl Default for Stuffing {
    /// 15 mm cells, about 1,500 nodes for a human liver; the labels of the bundled one; the largest body only.
    fn default() -> Self {
        Self {
            cell: 0.015,
            labels: LIVER_LABELS.map(|(label, name)| (label, name.to_owned())).into(),
            keep_largest: true,
            smoothing: 0.2,
            match_volume: true,
        }
    }
}

/// What became of one label of an image.
#[derive(Clone, Debug, PartialEq)]
pub struct RegionReport {
    /// The label in the image.
    pub label: u8,
    /// Name of its region.
    pub name: String,
    /// Volume of its voxels [m³].
    pub label_volume: f64,
    /// Volume of its tetrahedra [m³].
    pub volume: f64,
    /// Number of its tetrahedra; a region without any is not among the mesh's names.
    pub tetrahedra: usize,
    /// Smallest share of the label within a tetrahedron of its region.
    pub least_share: f64,
}

/// What a stuffing produced.
#[derive(Clone, Debug, PartialEq)]
pub struct StuffingReport {
    /// Lattice constant [m].
    pub cell: f64,
    /// Nodes of the mesh.
    pub nodes: usize,
    /// Tetrahedra of the mesh.
    pub tetrahedra: usize,
    /// Volumes, angles and edges.
    pub quality: MeshQuality,
    /// Bodies that were dropped because a larger one exists.
    pub dropped_bodies: usize,
    /// Their volume [m³].
    pub dropped_volume: f64,
    /// Places where the body was grown to part a touching boundary.
    pub mended_pinches: usize,
    /// Nodes where the boundary still touches itself; 0 unless mending failed.
    pub pinched_nodes: usize,
    /// Volume of all labels of an image and of filled voids [m³]; 0 for other sources.
    pub label_volume: f64,
    /// Part of it that voids in the labels made, which the mesh fills [m³].
    pub filled_volume: f64,
    /// Outward shift of the level set that keeps the volume [m].
    pub shift: f64,
    /// The labels of an image; empty for other sources.
    pub regions: Vec<RegionReport>,
}

/// Why a body could not be stuffed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StuffingError {
    /// The cell is not a positive, finite length.
    #[error("cell = {cell} m must be positive and finite; give the lattice constant in metres, such as 0.015")]
    BadCell {
        /// The cell [m].
        cell: f64,
    },
    /// The smoothing is negative or not finite.
    #[error("smoothing = {smoothing} cells must lie between 0 and 2")]
    BadSmoothing {
        /// The blur [cells].
        smoothing: f64,
    },
    /// The cell is larger than the body.
    #[error("cell = {cell} m is larger than the body's extent of {extent} m; use {usable} m or less (are the units right?)")]
    CellTooLarge {
        /// The cell [m].
        cell: f64,
        /// Least extent of the body [m].
        extent: f64,
        /// A cell that resolves it [m].
        usable: f64,
    },
    /// The lattice would exceed its limit.
    #[error(
        "cell = {cell} m needs {vertices:.0} lattice vertices, the limit is {MAX_LATTICE_VERTICES}; \
         use {usable} m or more (are the units right?)"
    )]
    CellTooSmall {
        /// The cell [m].
        cell: f64,
        /// Vertices that it asks for.
        vertices: f64,
        /// A cell within the limit [m].
        usable: f64,
    },
    /// The image shows background only.
    #[error("the image holds no label but 0 (background); there is nothing to mesh")]
    Empty,
    /// No lattice vertex lies inside.
    #[error("no lattice vertex lies inside the body at cell = {cell} m: it is too thin or empty; use a smaller cell")]
    NothingInside {
        /// The cell [m].
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

impl Stuffing {
    /// The name of a label's region.
    pub fn name_of(&self, label: u8) -> String {
        let named = self.labels.iter().find(|(l, _)| *l == label);
        named.map_or_else(|| format!("label_{label}"), |(_, name)| name.clone())
    }

    fn check(&self, bounds: [Vector3<f64>; 2]) -> Result<(), StuffingError> {
        let cell = self.cell;
        if !(cell.is_finite() && cell > 0.0) {
            return Err(StuffingError::BadCell { cell });
        }
        if !(0.0..=2.0).contains(&self.smoothing) {
            return Err(StuffingError::BadSmoothing { smoothing: self.smoothing });
        }
        let size = bounds[1] - bounds[0];
        if cell > size.min() {
            return Err(StuffingError::CellTooLarge { cell, extent: size.min(), usable: 0.5 * size.min() });
        }
        let vertices = Lattice::vertex_estimate(bounds, cell);
        if !(vertices <= MAX_LATTICE_VERTICES as f64) {
            // Six per cent to spare for the rounding of each axis up to whole cells.
            let usable = 1.06 * (2.0 * size.add_scalar(5.0 * cell).product() / MAX_LATTICE_VERTICES as f64).cbrt();
            return Err(StuffingError::CellTooSmall { cell, vertices, usable });
        }
        Ok(())
    }
}

/// Meshes the labelled part of an image, with one region per label.
///
/// The body is the blurred occupancy of all labels but 0, without voids ([`SmoothedOccupancy`]).
pub fn stuff_image(image: &LabelImage, stuffing: &Stuffing) -> Result<(TetMesh, StuffingReport), StuffingError> {
    let extent = Vector3::from_fn(|a, _| image.dims[a] as f64 * image.spacing[a]);
    stuffing.check([image.origin, image.origin + extent])?;
    let voxel = image.spacing.iter().copied().fold(0.0, f64::max);
    let sigma = voxel.max(stuffing.smoothing * stuffing.cell);
    let field = SmoothedOccupancy::new(image, sigma / 1.5, sigma).ok_or(StuffingError::Empty)?;
    stuffing.check(field.bounds())?;

    let target = field.label_volume() + field.filled_volume();
    let mut shift = 0.0;
    let (mut mesh, mut report) = stuff_shifted(&field, stuffing, shift)?;
    // Polyhedra lose volume where the surface is convex. One shift by the missing volume over the area leaves an
    // error of second order; three are more than enough for half a per cent.
    for _ in 0..3 {
        let missing = target - report.dropped_volume - report.quality.volume;
        if !stuffing.match_volume || missing.abs() < 1e-3 * target {
            break;
        }
        shift += (missing / report.quality.boundary_area).clamp(-0.25 * stuffing.cell, 0.25 * stuffing.cell);
        (mesh, report) = stuff_shifted(&field, stuffing, shift)?;
    }
    report.label_volume = target;
    report.filled_volume = field.filled_volume();
    report.regions = regions::assign(&mut mesh, image, stuffing);
    Ok((mesh, report))
}

/// Meshes the inside of a closed surface as one region, `body`. Nodes of the boundary lie on the surface, except
/// where the boundary had to be parted (`mended_pinches`); edges and corners of the surface are cut off within a cell.
pub fn stuff_surface(
    surface: &ClosedSurface,
    stuffing: &Stuffing,
) -> Result<(TetMesh, StuffingReport), StuffingError> {
    stuff_level_set(surface, stuffing)
}

/// Meshes the inside of a level set as one region, `body`.
pub fn stuff_level_set(
    level_set: &(impl LevelSet + ?Sized),
    stuffing: &Stuffing,
) -> Result<(TetMesh, StuffingReport), StuffingError> {
    stuff_shifted(level_set, stuffing, 0.0)
}

/// Rounds of growth before pinches are left as they are.
const MAX_MENDING_ROUNDS: usize = 10;

fn stuff_shifted(
    level_set: &(impl LevelSet + ?Sized),
    stuffing: &Stuffing,
    shift: f64,
) -> Result<(TetMesh, StuffingReport), StuffingError> {
    stuffing.check(level_set.bounds())?;
    let mut grown = Grown { base: level_set, shift, bumps: Vec::new(), height: 0.3 * stuffing.cell };
    // The lattice must not move while the body grows, or every round would meet new pinches.
    let reach = [level_set.bounds()[0].add_scalar(-grown.height), level_set.bounds()[1].add_scalar(grown.height)];
    let lattice = Lattice::around(reach, stuffing.cell);
    for round in 0.. {
        let cut = CutLattice::new(lattice.clone(), &grown);
        let mut kept = stencil::clip(&cut);
        if kept.is_empty() {
            return Err(StuffingError::NothingInside { cell: stuffing.cell });
        }
        let position = |key: u32| match key.checked_sub(lattice.vertex_count()) {
            Some(index) => cut.cut_position(index),
            None => cut.vertex_position(key),
        };
        let (dropped_bodies, dropped_volume) =
            if stuffing.keep_largest { keep_largest(&mut kept, &position) } else { (0, 0.0) };
        let pinches = body::pinches(&body::boundary(&kept));
        if !pinches.is_empty() && round < MAX_MENDING_ROUNDS {
            grown.bumps.extend(pinches.iter().map(|&key| position(key)));
            continue;
        }
        let mesh = number_nodes(&kept, &position, lattice.constant());
        let report = StuffingReport {
            cell: stuffing.cell,
            nodes: mesh.nodes.len(),
            tetrahedra: mesh.tetrahedra.len(),
            quality: MeshQuality::of(&mesh.nodes, &mesh.tetrahedra),
            dropped_bodies,
            dropped_volume,
            mended_pinches: grown.bumps.len(),
            pinched_nodes: pinches.len(),
            label_volume: 0.0,
            filled_volume: 0.0,
            shift,
            regions: Vec::new(),
        };
        return Ok((mesh, report));
    }
    Err(StuffingError::NothingInside { cell: stuffing.cell })
}

/// Keeps the body of largest volume; returns the number and the volume of the others.
fn keep_largest(tetrahedra: &mut Vec<[u32; 4]>, position: &impl Fn(u32) -> Vector3<f64>) -> (usize, f64) {
    let (number, count) = body::bodies(tetrahedra);
    let mut volumes = vec![0.0; count];
    for (t, &body) in tetrahedra.iter().zip(&number) {
        volumes[body as usize] += quality::volume(&t.map(position));
    }
    let largest = (0..count).max_by(|&a, &b| volumes[a].total_cmp(&volumes[b]).then(b.cmp(&a))).unwrap_or(0);
    let dropped = (0..count).filter(|&b| b != largest).map(|b| volumes[b]).sum();
    let mut body = number.iter();
    tetrahedra.retain(|_| body.next() == Some(&(largest as u32)));
    (count - 1, dropped)
}

/// Numbers the nodes in use along a Morton curve and the tetrahedra by their lowest nodes, so that neighbours in
/// space are neighbours in memory.
fn number_nodes(tetrahedra: &[[u32; 4]], position: &impl Fn(u32) -> Vector3<f64>, cell: f64) -> TetMesh {
    let mut keys: Vec<u32> = tetrahedra.iter().flatten().copied().collect();
    keys.sort_unstable();
    keys.dedup();
    let low = keys.iter().fold(Vector3::repeat(f64::INFINITY), |low, &key| low.inf(&position(key)));
    let mut order: Vec<(u64, u32)> =
        keys.iter().map(|&key| (morton((position(key) - low) * (4.0 / cell)), key)).collect();
    order.sort_unstable();
    let mut number = vec![0u32; keys.len()];
    for (n, (_, key)) in order.iter().enumerate() {
        if let Ok(i) = keys.binary_search(key) {
            number[i] = n as u32;
        }
    }
    let renumber = |key: u32| keys.binary_search(&key).map_or(0, |i| number[i]);
    let mut tetrahedra: Vec<[u32; 4]> = tetrahedra.iter().map(|t| t.map(renumber)).collect();
    tetrahedra.sort_by_key(|t| {
        let mut nodes = *t;
        nodes.sort_unstable();
        nodes
    });
    TetMesh {
        nodes: order.iter().map(|&(_, key)| position(key)).collect(),
        regions: vec![0; tetrahedra.len()],
        tetrahedra,
        region_names: vec!["body".to_owned()],
        ..TetMesh::default()
    }
}

/// Interleaves the bits of three coordinates (21 bits each).
fn morton(point: Vector3<f64>) -> u64 {
    let mut code = 0;
    for bit in (0..21).rev() {
        for axis in 0..3 {
            code = code << 1 | ((point[axis] as u64) >> bit & 1);
        }
    }
    code
}
