//! How a body is stuffed, and which sizes are sound.

use nalgebra::Vector3;

use super::lattice::Lattice;
use super::report::StuffingError;

/// Most vertices of the lattice around a body; half of them, roughly, become nodes.
pub const MAX_LATTICE_VERTICES: usize = 4_000_000;

/// Labels of the bundled liver (`examples/scenes/liver.inr.gz`), by the names in its note, where their meaning was
/// inferred from volumes. By shape, place and neighbours (nine tenths of the boundary of 127 and six tenths of that of
/// 85 is background) they are as likely the right kidney and the gall bladder;
/// [`Stuffing::of_labels`] with the first takes the liver alone.
pub const LIVER_LABELS: [(u8, &str); 3] = [(255, "parenchyma"), (127, "vessels"), (85, "lesion")];

/// How a body is stuffed.
#[derive(Clone, Debug, PartialEq)]
pub struct Stuffing {
    /// Lattice constant (m): edge of the cubes of the body-centred cubic lattice. Positive.
    pub cell: f64,
    /// Names of the regions of a label image. A label without a name N becomes the region `label_N`.
    pub labels: Vec<(u8, String)>,
    /// Whether labels without a name are background.
    pub named_only: bool,
    /// Whether to keep the largest body only (connected through faces).
    pub keep_largest: bool,
    /// Standard deviation of the blur of a label image, in cells, between 0 and 2. It is raised to two and a half
    /// voxels, below which the steps between slices show on the surface, unless that is more than 0.4 cells, and to
    /// one voxel in any case.
    pub smoothing: f64,
    /// Whether the level set of a label image is shifted until the mesh has the volume of the labels.
    pub match_volume: bool,
}

impl Default for Stuffing {
    /// 15.5 mm cells, about 1,500 nodes for the bundled liver; the labels of the bundled one; the largest body only.
    fn default() -> Self {
        Self {
            cell: 0.0155,
            labels: LIVER_LABELS.map(|(label, name)| (label, name.to_owned())).into(),
            named_only: false,
            keep_largest: true,
            smoothing: 0.3,
            match_volume: true,
        }
    }
}

impl Stuffing {
    /// Cells of this size (m) of the named labels alone; where none is named, of all, by the names of the bundled image.
    pub fn of_labels<'a>(cell: f64, labels: impl IntoIterator<Item = (&'a str, u8)>) -> Self {
        let labels: Vec<_> = labels.into_iter().map(|(name, label)| (label, name.to_owned())).collect();
        let all = Self { cell, ..Self::default() };
        if labels.is_empty() { all } else { Self { labels, named_only: true, ..all } }
    }

    /// The name of a label's region.
    pub fn name_of(&self, label: u8) -> String {
        let named = self.labels.iter().find(|(l, _)| *l == label);
        named.map_or_else(|| format!("label_{label}"), |(_, name)| name.clone())
    }

    /// Refuses sizes that are no lengths, larger than the body, or beyond the lattice's limit.
    pub(super) fn check(&self, bounds: [Vector3<f64>; 2]) -> Result<(), StuffingError> {
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
        if vertices > MAX_LATTICE_VERTICES as f64 {
            // Six per cent to spare for the rounding of each axis up to whole cells.
            let usable = 1.06 * (2.0 * size.add_scalar(5.0 * cell).product() / MAX_LATTICE_VERTICES as f64).cbrt();
            return Err(StuffingError::CellTooSmall { cell, vertices, usable });
        }
        Ok(())
    }
}
