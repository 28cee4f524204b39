//! NIfTI-1 in a single file (`n+1`). The header is the `nifti` crate's; the voxels are read here, because the crate
//! reserves whatever volume a header claims before it has seen the data, and labels need a check of every value.

use nalgebra::{Matrix3, Vector3};
use nifti::{Endianness, NiftiHeader, NiftiType};

use super::{ImageError, LabelImage, inflate, read_exactly, voxel_count};

const FORMAT: &str = "NIfTI-1";
const HEADER_SIZE: usize = 348;

pub(super) fn read(bytes: &[u8]) -> Result<LabelImage, ImageError> {
    let (mut source, bound) = inflate(bytes);
    let head = read_exactly(&mut *source, HEADER_SIZE, bound, FORMAT)?;
    let header = NiftiHeader::from_reader(head.as_slice())
        .map_err(|e| malformed(format!("{e}; give a NIfTI-1 file (NIfTI-2 and Analyze are not read)")))?;
    if &header.magic != b"n+1\0" {
        return Err(malformed("the voxels lie in a separate .img; convert to a single .nii".into()));
    }
    let dims = dimensions(&header)?;
    let count = voxel_count(dims).ok_or_else(|| {
        malformed(format!("dim = {dims:?}: at most {} voxels are read; crop or coarsen the image", super::MAX_VOXELS))
    })?;
    let kind = Number::of(&header)?;
    let gap = header.vox_offset as f64 - HEADER_SIZE as f64;
    if !(0.0..1e9).contains(&gap) || gap.fract() != 0.0 {
        return Err(malformed(format!("vox_offset = {} must be a whole number from 348 up", header.vox_offset)));
    }
    read_exactly(&mut *source, gap as usize, bound, FORMAT)?;
    let size = kind.size();
    let raw = read_exactly(&mut *source, count.saturating_mul(size), bound, FORMAT)?;

    let (slope, offset) = scaling(&header);
    let little = header.endianness == Endianness::Little;
    let mut labels = Vec::with_capacity(count);
    for (voxel, raw) in raw.chunks_exact(size).enumerate() {
        let value = kind.decode(raw, little) * slope + offset;
        if !(0.0..=255.0).contains(&value) || value.fract() != 0.0 {
            return Err(malformed(format!(
                "voxel {voxel} has the value {value}; labels must be whole numbers from 0 to 255: renumber them"
            )));
        }
        labels.push(value as u8);
    }
    if handedness(&header) < 0.0 {
        labels.chunks_exact_mut(dims[0]).for_each(|row| row.reverse());
    }
    LabelImage::new(dims, spacing(&header)?, Vector3::zeros(), labels)
}

/// Three dimensions; further ones must be 1.
fn dimensions(header: &NiftiHeader) -> Result<[usize; 3], ImageError> {
    let dim = header.dim().map_err(|e| malformed(format!("{e}; the header is damaged")))?;
    if dim.len() < 3 || dim[3..].iter().any(|&d| d != 1) {
        return Err(malformed(format!("dim = {dim:?}: a label image has three dimensions; extract one volume")));
    }
    Ok([usize::from(dim[0]), usize::from(dim[1]), usize::from(dim[2])])
}

/// Voxel edges (m); an unstated unit means millimetres, as everywhere in NIfTI's practice.
fn spacing(header: &NiftiHeader) -> Result<[f64; 3], ImageError> {
    let unit = match header.xyzt_units & 0o7 {
        1 => 1.0,
        0 | 2 => 1e-3,
        3 => 1e-6,
        other => return Err(malformed(format!("xyzt_units = {other} names no unit of length"))),
    };
    let spacing = [1, 2, 3].map(|axis| f64::from(header.pixdim[axis]).abs() * unit);
    if spacing.iter().any(|s| !(s.is_finite() && *s > 0.0)) {
        return Err(malformed(format!("pixdim = {:?} must be positive", &header.pixdim[1..4])));
    }
    Ok(spacing)
}

/// `scl_slope` 0 means no scaling, by the standard.
fn scaling(header: &NiftiHeader) -> (f64, f64) {
    if header.scl_slope == 0.0 { (1.0, 0.0) } else { (f64::from(header.scl_slope), f64::from(header.scl_inter)) }
}

/// Sign of the determinant of the map from voxels to the patient's axes: sform if there is one, else qform, else +1.
fn handedness(header: &NiftiHeader) -> f64 {
    if header.sform_code > 0 {
        let rows = [header.srow_x, header.srow_y, header.srow_z];
        let affine = Matrix3::from_fn(|i, j| f64::from(rows[i][j]));
        return affine.determinant();
    }
    if header.qform_code > 0 {
        // The quaternion is a proper rotation; pixdim[0] = qfac = -1 reverses z.
        return if header.pixdim[0] < 0.0 { -1.0 } else { 1.0 };
    }
    1.0
}

/// The stored number types that can hold labels.
#[derive(Clone, Copy)]
enum Number {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    F32,
    F64,
}

impl Number {
    fn of(header: &NiftiHeader) -> Result<Self, ImageError> {
        Ok(match header.data_type() {
            Ok(NiftiType::Uint8) => Self::U8,
            Ok(NiftiType::Int8) => Self::I8,
            Ok(NiftiType::Uint16) => Self::U16,
            Ok(NiftiType::Int16) => Self::I16,
            Ok(NiftiType::Uint32) => Self::U32,
            Ok(NiftiType::Int32) => Self::I32,
            Ok(NiftiType::Float32) => Self::F32,
            Ok(NiftiType::Float64) => Self::F64,
            _ => {
                return Err(malformed(format!(
                    "datatype {} holds no labels; convert the image to unsigned 8-bit",
                    header.datatype
                )));
            }
        })
    }

    fn size(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// One number from `size()` bytes.
    fn decode(self, raw: &[u8], little: bool) -> f64 {
        let mut bits = 0u64;
        for i in 0..raw.len() {
            let byte = if little { raw[raw.len() - 1 - i] } else { raw[i] };
            bits = bits << 8 | u64::from(byte);
        }
        match self {
            Self::U8 | Self::U16 | Self::U32 => bits as f64,
            Self::I8 => f64::from(bits as u8 as i8),
            Self::I16 => f64::from(bits as u16 as i16),
            Self::I32 => f64::from(bits as u32 as i32),
            Self::F32 => f64::from(f32::from_bits(bits as u32)),
            Self::F64 => f64::from_bits(bits),
        }
    }
}

fn malformed(message: String) -> ImageError {
    ImageError::Malformed { format: FORMAT, message }
}
