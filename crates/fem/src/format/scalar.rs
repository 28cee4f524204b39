//! Types of binary numbers in mesh files.

use crate::mesh::{At, MeshError};

/// Order of the bytes of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Endian {
    Little,
    Big,
}

/// Type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Scalar {
    /// Bytes of one number.
    pub(crate) fn size(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::I64 | Scalar::U64 | Scalar::F64 => 8,
        }
    }

    /// Numbers as floating point; whole numbers above 2⁵³ lose digits.
    pub(crate) fn floats(self, bytes: &[u8], endian: Endian) -> impl Iterator<Item = f64> + '_ {
        bytes.chunks_exact(self.size()).map(move |chunk| match self {
            Scalar::F64 => f64::from_bits(unsigned(chunk, endian)),
            Scalar::F32 => f64::from(f32::from_bits(unsigned(chunk, endian) as u32)),
            _ => self.int(chunk, endian) as f64,
        })
    }

    /// Numbers as whole numbers. Floating point is rounded towards zero; what does not fit becomes -1, which is no
    /// valid index anywhere.
    pub(crate) fn ints(self, bytes: &[u8], endian: Endian) -> impl Iterator<Item = i64> + '_ {
        bytes.chunks_exact(self.size()).map(move |chunk| self.int(chunk, endian))
    }

    fn int(self, chunk: &[u8], endian: Endian) -> i64 {
        let bits = unsigned(chunk, endian);
        match self {
            Scalar::I8 => i64::from(bits as i8),
            Scalar::I16 => i64::from(bits as i16),
            Scalar::I32 => i64::from(bits as i32),
            Scalar::I64 => bits as i64,
            Scalar::U8 | Scalar::U16 | Scalar::U32 | Scalar::U64 => i64::try_from(bits).unwrap_or(-1),
            Scalar::F32 => whole(f64::from(f32::from_bits(bits as u32))),
            Scalar::F64 => whole(f64::from_bits(bits)),
        }
    }
}

fn whole(value: f64) -> i64 {
    if value.abs() < 9e18 { value as i64 } else { -1 }
}

/// Up to eight bytes as one unsigned number.
fn unsigned(chunk: &[u8], endian: Endian) -> u64 {
    let shift = |bits: u64, &byte: &u8| bits << 8 | u64::from(byte);
    match endian {
        Endian::Big => chunk.iter().fold(0, shift),
        Endian::Little => chunk.iter().rev().fold(0, shift),
    }
}

/// The numbers of one data array.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Values {
    Ints(Vec<i64>),
    Floats(Vec<f64>),
}

impl Values {
    /// As whole numbers, if all are.
    pub(crate) fn whole(&self) -> Option<Vec<i64>> {
        match self {
            Values::Ints(values) => Some(values.clone()),
            Values::Floats(values) => {
                let exact = |&value: &f64| (value.fract() == 0.0 && value.abs() < 9e15).then_some(value as i64);
                values.iter().map(exact).collect()
            }
        }
    }
}

/// A name of a type as VTK's legacy files or its XML files have it.
pub(crate) fn vtk_scalar(name: &str, at: impl FnOnce() -> At) -> Result<Scalar, MeshError> {
    Ok(match name.to_ascii_lowercase().as_str() {
        "char" | "signed_char" | "int8" | "vtktypeint8" => Scalar::I8,
        "unsigned_char" | "uint8" | "vtktypeuint8" => Scalar::U8,
        "short" | "int16" | "vtktypeint16" => Scalar::I16,
        "unsigned_short" | "uint16" | "vtktypeuint16" => Scalar::U16,
        // Legacy files store vtkIdType in 32 bits.
        "int" | "int32" | "vtktypeint32" | "vtkidtype" => Scalar::I32,
        "unsigned_int" | "uint32" | "vtktypeuint32" => Scalar::U32,
        "long" | "long_long" | "int64" | "vtktypeint64" => Scalar::I64,
        "unsigned_long" | "unsigned_long_long" | "uint64" | "vtktypeuint64" => Scalar::U64,
        "float" | "float32" => Scalar::F32,
        "double" | "float64" => Scalar::F64,
        _ => {
            let what = format!("data of type {name:?}");
            return Err(MeshError::Unsupported { at: at(), what, remedy: "write numbers of a standard type" });
        }
    })
}
