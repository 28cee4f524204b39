//! The cell that gives a number of nodes.

use crate::image::LabelImage;

use super::{Stuffing, StuffingError, stuff_image};

/// Trials before the search settles for the nearest.
const MAX_TRIALS: usize = 12;

/// A relative error that is accepted when no trial came within the tolerance: the number of nodes jumps with the cell.
const ACCEPTED: f64 = 0.1;

/// A cell (m) for which `count_nodes(cell)` is within `tolerance` (relative) of `nodes`, or the nearest of twelve
/// trials if it is within a tenth: secant steps on log(nodes) against log(cell), nearly a line of slope -3 to -2.5.
///
/// # Errors
/// [`StuffingError::NoSuchSize`], and what `count_nodes` answers.
pub fn cell_for_nodes(
    nodes: usize,
    first: f64,
    tolerance: f64,
    mut count_nodes: impl FnMut(f64) -> Result<usize, StuffingError>,
) -> Result<f64, StuffingError> {
    let error = |count: usize| (count as f64 / nodes.max(1) as f64).ln();
    let mut cell = first;
    let mut last: Option<(f64, f64)> = None;
    let mut best: Option<(f64, usize)> = None;
    for _ in 0..MAX_TRIALS {
        let count = count_nodes(cell)?;
        if best.is_none_or(|(_, b)| error(count).abs() < error(b).abs()) {
            best = Some((cell, count));
        }
        if error(count).abs() <= tolerance {
            return Ok(cell);
        }
        let slope = match last {
            Some((before, error_before)) if before != cell => {
                ((error(count) - error_before) / (cell / before).ln()).clamp(-4.0, -1.5)
            }
            _ => -2.7,
        };
        last = Some((cell, error(count)));
        cell *= (-error(count) / slope).exp();
    }
    match best {
        Some((cell, count)) if error(count).abs() <= ACCEPTED => Ok(cell),
        _ => Err(StuffingError::NoSuchSize { nodes, nearest: best.map_or(0, |(_, count)| count) }),
    }
}

/// A cell (m) for which the mesh of an image has `nodes` nodes within 2 %, or as near as
/// [`cell_for_nodes`] comes. For the bundled liver: 15.5 mm for 1,500, 12.0 mm for 3,000, 8.4 mm for 8,000, 7.7 mm for
/// 10,000.
///
/// # Errors
/// [`StuffingError::Empty`], [`StuffingError::NoSuchSize`], and as [`stuff_image`](super::stuff_image).
pub fn cell_for_nodes_of_image(image: &LabelImage, nodes: usize, stuffing: &Stuffing) -> Result<f64, StuffingError> {
    let labelled = image.labels.iter().filter(|&&l| l != 0).count() as f64 * image.voxel_volume();
    if labelled == 0.0 {
        return Err(StuffingError::Empty);
    }
    // Two vertices a cube inside, and about as many on the surface of a mesh of some thousand nodes.
    let first = (3.5 * labelled / nodes.max(1) as f64).cbrt();
    cell_for_nodes(nodes, first, 0.02, |cell| {
        stuff_image(image, &Stuffing { cell, ..stuffing.clone() }).map(|(mesh, _)| mesh.nodes.len())
    })
}
