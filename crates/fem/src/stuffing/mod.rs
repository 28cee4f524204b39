//! Isosurface stuffing: label images and closed surfaces to tetrahedra of guaranteed quality.
//!
//! F. Labelle and J. R. Shewchuk, "Isosurface stuffing: fast tetrahedral meshes with good dihedral angles", ACM
//! Transactions on Graphics 26(3), 2007. A body-centred cubic lattice covers the body; lattice vertices close to the
//! surface are warped onto it; the tetrahedra that the surface still cuts are replaced by stencils. All dihedral
//! angles of the result lie between 10.7° and 164.8°, whatever the body.
//!
//! Departures from the paper: the lattice is uniform (no octree); where warping leaves two parts of the boundary
//! touching at a node or an edge, the body is grown there by a fraction of a cell and stuffed again, so that the
//! boundary is a closed 2-manifold; the level set of an image may be shifted to keep the volume of its labels.
//!
//! The lattice constant `cell` is the edge of the lattice's cubes. A cube holds two lattice vertices and twelve
//! tetrahedra, with edges of `cell` and 0.866 `cell`.

mod body;
mod config;
mod cut;
mod lattice;
mod level_set;
mod numbering;
mod quality;
mod regions;
mod report;
mod sizing;
mod stencil;

use nalgebra::Vector3;

use crate::closed_surface::ClosedSurface;
use crate::image::{LabelImage, SmoothedOccupancy};
use crate::mesh::TetMesh;
use cut::CutLattice;
use lattice::Lattice;
use level_set::Grown;
use numbering::number_nodes;

pub use config::{LIVER_LABELS, MAX_LATTICE_VERTICES, Stuffing};
pub use level_set::LevelSet;
pub use quality::StuffingQuality;
pub use report::{RegionReport, StuffingError, StuffingReport};
pub use sizing::{cell_for_nodes, cell_for_nodes_of_image};

/// Blur that hides the steps between slices, in voxels along the coarsest axis.
const SMOOTH_BLUR_VOXELS: f64 = 2.5;
/// Most that is blurred for that purpose, in cells.
const SMOOTH_BLUR_CELLS: f64 = 0.4;
/// Grid cells of the blurred field per standard deviation.
const GRID_CELLS_PER_SIGMA: f64 = 1.5;
/// Trials of a shift that keeps the volume.
const MAX_SHIFTS: usize = 3;
/// A shift is not worth a trial below this relative error of the volume.
const VOLUME_TOLERANCE: f64 = 1e-3;

/// Meshes the labelled part of an image, with one region per label.
///
/// The body is the blurred occupancy of all labels but 0, or of the named ones ([`Stuffing::named_only`]), without voids
/// ([`SmoothedOccupancy`]).
///
/// # Errors
/// [`StuffingError`]: a cell or smoothing out of its range, too large or too small for the body, a named label that the image
/// has not, or nothing to mesh.
pub fn stuff_image(image: &LabelImage, stuffing: &Stuffing) -> Result<(TetMesh, StuffingReport), StuffingError> {
    let retained;
    let image = if stuffing.named_only {
        retained = with_named_labels(image, stuffing)?;
        &retained
    } else {
        image
    };
    let extent = Vector3::from_fn(|a, _| image.dims[a] as f64 * image.spacing[a]);
    stuffing.check([image.origin, image.origin + extent])?;
    let voxel = image.spacing.iter().copied().fold(0.0, f64::max);
    let steps_gone = (SMOOTH_BLUR_VOXELS * voxel).min(SMOOTH_BLUR_CELLS * stuffing.cell);
    let sigma = (stuffing.smoothing * stuffing.cell).max(steps_gone).max(voxel);
    let field = SmoothedOccupancy::new(image, sigma / GRID_CELLS_PER_SIGMA, sigma).ok_or(StuffingError::Empty)?;
    stuffing.check(field.bounds())?;

    let target = field.label_volume() + field.filled_volume();
    let (mut mesh, mut report) = stuff_shifted(&field, stuffing, 0.0)?;
    // Polyhedra lose volume where the surface is convex; a shift by the missing volume over the area restores it but
    // for an error of second order. A small shift may also make or mend a pinch, so that the best trial is kept.
    let missing = |report: &StuffingReport| target - report.dropped_volume - report.quality.volume;
    for _ in 0..MAX_SHIFTS {
        if !stuffing.match_volume || missing(&report).abs() <= VOLUME_TOLERANCE * target {
            break;
        }
        let step = missing(&report) / report.quality.boundary_area;
        let shift = report.shift + step.clamp(-0.25 * stuffing.cell, 0.25 * stuffing.cell);
        let trial = stuff_shifted(&field, stuffing, shift)?;
        if missing(&trial.1).abs() >= missing(&report).abs() {
            break;
        }
        (mesh, report) = trial;
    }
    report.label_volume = target;
    report.filled_volume = field.filled_volume();
    report.regions = regions::assign(&mut mesh, image, stuffing);
    Ok((mesh, report))
}

/// The image with every label but the named ones as background.
fn with_named_labels(image: &LabelImage, stuffing: &Stuffing) -> Result<LabelImage, StuffingError> {
    let voxels = image.histogram();
    if let Some((label, name)) = stuffing.labels.iter().find(|(label, _)| voxels[usize::from(*label)] == 0) {
        let present: Vec<_> = (1..=255).filter(|&l: &u8| voxels[usize::from(l)] > 0).map(|l| l.to_string()).collect();
        return Err(StuffingError::NoSuchLabel { label: *label, name: name.clone(), present: present.join(", ") });
    }
    let mut retained = image.clone();
    retained.retain_labels(&stuffing.labels.iter().map(|(label, _)| *label).collect::<Vec<_>>());
    Ok(retained)
}

/// Meshes the inside of a closed surface as one region, `body`. Nodes of the boundary lie on the surface, except
/// where the boundary had to be parted (`mended_pinches`); edges and corners of the surface are cut off within a cell.
///
/// # Errors
/// As [`stuff_image`].
pub fn stuff_surface(surface: &ClosedSurface, stuffing: &Stuffing) -> Result<(TetMesh, StuffingReport), StuffingError> {
    stuff_level_set(surface, stuffing)
}

/// Meshes the inside of a level set as one region, `body`.
///
/// # Errors
/// As [`stuff_image`].
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
            quality: StuffingQuality::of(&mesh.nodes, &mesh.tetrahedra),
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
    let dropped = (0..count).filter(|&b| b != largest).map(|b| volumes[b]).fold(0.0, |sum, v| sum + v);
    let mut body = number.iter();
    tetrahedra.retain(|_| body.next() == Some(&(largest as u32)));
    (count - 1, dropped)
}
