//! Label images: a box of voxels, each with the number of the tissue that it shows.
//!
//! Voxel `(i, j, k)` is the box of edges `spacing` whose centre lies at
//! `origin + ((i + 1/2) dx, (j + 1/2) dy, (k + 1/2) dz)`, so `origin` is the outer corner of the first voxel.
//! `i` runs fastest in `labels`. Label 0 is background; everything else belongs to the organ.

mod inrimage;
mod nifti1;
mod occupancy;

use std::fs::File;
use std::io::Read;
use std::path::Path;

use nalgebra::Vector3;

pub use occupancy::SmoothedOccupancy;

/// Most voxels that a reader accepts: 2³⁰, one gibibyte of labels.
pub const MAX_VOXELS: usize = 1 << 30;

/// A box of labelled voxels, axis-aligned, in metres.
#[derive(Clone, Debug, PartialEq)]
pub struct LabelImage {
    /// Voxels along x, y, z; all positive.
    pub dims: [usize; 3],
    /// Edges of a voxel (m); all positive.
    pub spacing: [f64; 3],
    /// Outer corner of voxel (0, 0, 0) (m).
    pub origin: Vector3<f64>,
    /// One label per voxel, x fastest, then y, then z; 0 is background.
    pub labels: Vec<u8>,
}

/// Why an image was refused.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// The file could not be opened or read.
    #[error("{file}: {source}; check that the path is right and the file readable")]
    Io {
        /// The file as it was named.
        file: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The extension names no image format that is read here.
    #[error(
        "{file}: not a label image that is read here; give an INRIMAGE-4 (.inr, .inr.gz) or NIfTI-1 (.nii, .nii.gz)"
    )]
    UnknownFormat {
        /// The file as it was named.
        file: String,
    },
    /// The content breaks its format; the message says where and what to do.
    #[error("{format}: {message}")]
    Malformed {
        /// Name of the format.
        format: &'static str,
        /// What is wrong, with the value, and the remedy.
        message: String,
    },
    /// An image made in memory whose parts do not fit each other.
    #[error("label image: {message}")]
    Inconsistent {
        /// What does not fit.
        message: String,
    },
    /// The same, within a named file.
    #[error("{file}: {source}")]
    InFile {
        /// The file as it was named.
        file: String,
        /// What is wrong in it.
        source: Box<ImageError>,
    },
}

impl LabelImage {
    /// Makes an image and checks that dimensions, spacing and number of labels fit.
    ///
    /// # Errors
    /// [`ImageError::Inconsistent`] with the number that does not fit.
    pub fn new(dims: [usize; 3], spacing: [f64; 3], origin: Vector3<f64>, labels: Vec<u8>) -> Result<Self, ImageError> {
        let wrong = |message: String| Err(ImageError::Inconsistent { message });
        if spacing.iter().any(|s| !(s.is_finite() && *s > 0.0)) {
            return wrong(format!("spacing {spacing:?} m must be positive and finite"));
        }
        if origin.iter().any(|x| !x.is_finite()) {
            return wrong(format!("origin {:?} m must be finite", origin.as_slice()));
        }
        match voxel_count(dims) {
            None => wrong(format!("dimensions {dims:?} must be positive, with at most {MAX_VOXELS} voxels in all")),
            Some(count) if count != labels.len() => {
                wrong(format!("dimensions {dims:?} ask for {count} labels, but there are {}", labels.len()))
            }
            Some(_) => Ok(Self { dims, spacing, origin, labels }),
        }
    }

    /// Reads `.inr`, `.inr.gz`, `.nii` or `.nii.gz`, by the name's ending.
    ///
    /// # Errors
    /// [`ImageError::Io`], [`ImageError::UnknownFormat`], or [`ImageError::InFile`] with what is wrong in the file.
    pub fn from_path(path: impl AsRef<Path>) -> Result<Self, ImageError> {
        let path = path.as_ref();
        let file = path.display().to_string();
        let name = path.file_name().map(|n| n.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        let stem = name.strip_suffix(".gz").unwrap_or(&name);
        let read: fn(&[u8]) -> Result<Self, ImageError> = if stem.ends_with(".inr") {
            Self::from_inrimage_bytes
        } else if stem.ends_with(".nii") {
            Self::from_nifti_bytes
        } else {
            return Err(ImageError::UnknownFormat { file });
        };
        let mut bytes = Vec::new();
        File::open(path)
            .and_then(|mut f| f.read_to_end(&mut bytes))
            .map_err(|source| ImageError::Io { file: file.clone(), source })?;
        read(&bytes).map_err(|source| ImageError::InFile { file, source: Box::new(source) })
    }

    /// Reads an INRIMAGE-4 of unsigned bytes, plain or compressed with gzip. `VX VY VZ` are taken as millimetres.
    ///
    /// # Errors
    /// [`ImageError::Malformed`] or [`ImageError::Inconsistent`], with the value that is wrong.
    pub fn from_inrimage_bytes(bytes: &[u8]) -> Result<Self, ImageError> {
        inrimage::read(bytes)
    }

    /// Reads a single-file NIfTI-1, plain or compressed with gzip. Any number type, if all values are whole numbers
    /// from 0 to 255. A left-handed voxel order is reversed along x, so that anatomy is never mirrored; the rotation
    /// of the scanner's affine is not applied, and `origin` is zero.
    ///
    /// # Errors
    /// [`ImageError::Malformed`] or [`ImageError::Inconsistent`], with the value that is wrong.
    pub fn from_nifti_bytes(bytes: &[u8]) -> Result<Self, ImageError> {
        nifti1::read(bytes)
    }

    /// Volume of one voxel (m³).
    pub fn voxel_volume(&self) -> f64 {
        self.spacing.iter().product()
    }

    /// Voxels of each label; the index is the label.
    pub fn histogram(&self) -> [u64; 256] {
        let mut counts = [0u64; 256];
        for &label in &self.labels {
            counts[usize::from(label)] += 1;
        }
        counts
    }

    /// Makes everything background but the given labels.
    pub fn retain_labels(&mut self, labels: &[u8]) {
        let mut keep = [0u8; 256];
        labels.iter().for_each(|&label| keep[usize::from(label)] = label);
        self.labels.iter_mut().for_each(|label| *label = keep[usize::from(*label)]);
    }

    /// Label at a point (m) (nearest voxel); background outside the box.
    pub fn label_at(&self, point: &Vector3<f64>) -> u8 {
        let mut index = 0;
        for axis in (0..3).rev() {
            let x = ((point[axis] - self.origin[axis]) / self.spacing[axis]).floor();
            if !(x >= 0.0 && x < self.dims[axis] as f64) {
                return 0;
            }
            index = index * self.dims[axis] + x as usize;
        }
        self.labels[index]
    }
}

/// Product of the dimensions, if all are positive and it is at most [`MAX_VOXELS`].
fn voxel_count(dims: [usize; 3]) -> Option<usize> {
    let count = dims.iter().try_fold(1usize, |n, &d| n.checked_mul(d))?;
    (count > 0 && count <= MAX_VOXELS).then_some(count)
}

/// A reader over plain or gzip-compressed bytes, and the most bytes that it can yield: deflate cannot compress by
/// more than 1032 to 1, which bounds an allocation by the size of the input and not only by what a header claims.
fn inflate<'a>(bytes: &'a [u8]) -> (Box<dyn Read + 'a>, usize) {
    if bytes.starts_with(&[0x1f, 0x8b]) {
        (Box::new(flate2::read::MultiGzDecoder::new(bytes)), bytes.len().saturating_mul(1032))
    } else {
        (Box::new(bytes), bytes.len())
    }
}

/// Reads exactly `count` bytes; `bound` is what the source can yield at most.
fn read_exactly(
    source: &mut dyn Read,
    count: usize,
    bound: usize,
    format: &'static str,
) -> Result<Vec<u8>, ImageError> {
    let malformed = |message: String| ImageError::Malformed { format, message };
    if count > bound {
        return Err(malformed(format!(
            "the header asks for {count} bytes, more than the file can hold; it is cut short or its header is wrong"
        )));
    }
    let mut data = Vec::new();
    data.try_reserve_exact(count).map_err(|e| malformed(format!("cannot hold {count} bytes: {e}")))?;
    source
        .take(count as u64)
        .read_to_end(&mut data)
        .map_err(|e| malformed(format!("cannot decompress after {} of {count} bytes: {e}", data.len())))?;
    if data.len() < count {
        return Err(malformed(format!("ends after {} of {count} bytes; the file is cut short", data.len())));
    }
    Ok(data)
}
