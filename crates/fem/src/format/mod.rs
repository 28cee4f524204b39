//! Mesh file formats.
//!
//! Read: Gmsh MSH 1, 2.2 and 4.1 (text and binary), VTK legacy 1 to 5.1 (text and binary), VTU (text, base64, raw,
//! zlib), MEDIT `.mesh` (text), TetGen `.node` with `.ele`. Written: VTU and MSH 2.2 (text).
//!
//! Linear tetrahedra become elements, and from Gmsh's and VTK's formats quadratic ones (10 nodes), not both in one file.
//! Points, lines and triangles beside them are left out, but their groups become node sets; other solid cells are refused. Regions come from physical groups (Gmsh), references (MEDIT),
//! the first attribute (TetGen) or an array of whole numbers per cell with one of the usual names (VTK); a number
//! without a name becomes "region_N", and a file without regions has one called "body".
//!
//! Readers work on the bytes in memory. A count is compared with the bytes that follow before memory is reserved, so
//! that a damaged file costs a small multiple of its size; compressed VTU may grow as zlib allows, a thousandfold.

mod cell;
mod cursor;
mod medit;
mod msh;
mod msh1;
mod msh2;
mod msh4;
mod msh_write;
mod raw;
mod scalar;
mod tetgen;
mod vtk_arrays;
mod vtk_legacy;
mod vtu;
mod vtu_data;
mod vtu_write;

use std::fmt;
use std::path::{Path, PathBuf};

pub use msh_write::write_msh;
pub use vtu_write::{PointData, write_vtu};

use crate::mesh::{At, MeshError, MeshQuality, MeshWarning, TetMesh, check};
use cursor::{Cursor, find};
use raw::RawMesh;

/// A format that meshes are read from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[non_exhaustive]
pub enum Format {
    /// Gmsh, `.msh`.
    Gmsh,
    /// VTK's legacy format, `.vtk`.
    VtkLegacy,
    /// VTK's XML format for unstructured grids, `.vtu`.
    Vtu,
    /// MEDIT, `.mesh`.
    Medit,
    /// TetGen, `.node` with `.ele`.
    TetGen,
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Format::Gmsh => "Gmsh MSH",
            Format::VtkLegacy => "VTK legacy",
            Format::Vtu => "VTU",
            Format::Medit => "MEDIT",
            Format::TetGen => "TetGen",
        })
    }
}

/// A mesh as it was read, with everything that is to be said about it.
#[derive(Debug)]
#[non_exhaustive]
pub struct MeshFile {
    /// The mesh, in the units of the file.
    pub mesh: TetMesh,
    /// Its format.
    pub format: Format,
    /// Its measures.
    pub quality: MeshQuality,
    /// What is odd about it.
    pub warnings: Vec<MeshWarning>,
    /// Why the mesh cannot be simulated, where it cannot; always `None` from [`read`].
    pub refusal: Option<MeshError>,
}

/// Reads a mesh file and refuses it if it cannot be simulated.
///
/// # Errors
/// See [`TetMesh::load`].
pub fn read(path: &Path) -> Result<MeshFile, MeshError> {
    let mut file = inspect(path)?;
    match file.refusal.take() {
        Some(refusal) => Err(refusal),
        None => Ok(file),
    }
}

/// Reads a mesh file to look at it: geometric faults are reported beside the mesh rather than refused.
///
/// # Errors
/// Files that are missing, damaged, of another kind, or that refer to nodes that do not exist.
pub fn inspect(path: &Path) -> Result<MeshFile, MeshError> {
    let (node_path, ele_path) = (path.with_extension("node"), path.with_extension("ele"));
    if path == node_path || path == ele_path {
        return inspect_tetgen(&node_path, &read_bytes(&node_path)?, &ele_path, &read_bytes(&ele_path)?);
    }
    inspect_bytes(path, &read_bytes(path)?)
}

/// As [`inspect`], for the content of a file; `path` is used for its extension and for messages.
///
/// # Errors
/// As [`inspect`].
pub fn inspect_bytes(path: &Path, bytes: &[u8]) -> Result<MeshFile, MeshError> {
    let format = detect(path, bytes)?;
    let raw = match format {
        Format::Gmsh => msh::read(path, bytes)?,
        Format::VtkLegacy => vtk_legacy::read(path, bytes)?,
        Format::Vtu => vtu::read(path, bytes)?,
        Format::Medit => medit::read(path, bytes)?,
        Format::TetGen => return Err(MeshError::UnknownFormat { at: At::file(path) }),
    };
    finish(raw, format)
}

/// As [`inspect`], for the contents of TetGen's two files.
///
/// # Errors
/// As [`inspect`].
pub fn inspect_tetgen(
    node_path: &Path,
    node_bytes: &[u8],
    ele_path: &Path,
    ele_bytes: &[u8],
) -> Result<MeshFile, MeshError> {
    finish(tetgen::read(node_path, node_bytes, ele_path, ele_bytes)?, Format::TetGen)
}

fn finish(raw: RawMesh, format: Format) -> Result<MeshFile, MeshError> {
    let (mesh, from, mut warnings) = raw.finish()?;
    let refusal = check(&mesh, &from).err();
    let quality = MeshQuality::measure(&mesh);
    warnings.extend(quality.warnings());
    Ok(MeshFile { mesh, format, quality, warnings, refusal })
}

fn read_bytes(path: &Path) -> Result<Vec<u8>, MeshError> {
    std::fs::read(path).map_err(|source| MeshError::Io { path: path.to_path_buf(), source })
}

pub(crate) fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), MeshError> {
    std::fs::write(path, bytes).map_err(|source| MeshError::Io { path: PathBuf::from(path), source })
}

/// Finds the format by content first: extensions are shared (`.mesh`, `.vtk`) and mistaken.
fn detect(path: &Path, bytes: &[u8]) -> Result<Format, MeshError> {
    let head = bytes.get(..bytes.len().min(512)).unwrap_or_default();
    let mut cursor = Cursor::new(path, head).with_comments(b'#');
    let word = cursor.word().unwrap_or_default();
    if head.starts_with(b"# vtk DataFile") {
        return Ok(Format::VtkLegacy);
    }
    if word.starts_with(b"$") {
        return Ok(Format::Gmsh);
    }
    if word.starts_with(b"MeshVersion") {
        return Ok(Format::Medit);
    }
    if find(head, b"<VTKFile").is_some() || word.starts_with(b"<?xml") {
        return Ok(Format::Vtu);
    }
    detect_by_extension(path, head)
}

fn detect_by_extension(path: &Path, head: &[u8]) -> Result<Format, MeshError> {
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    let not_volumetric = |what: &str| Err(MeshError::NotVolumetric { at: At::file(path), what: what.to_string() });
    match extension.to_ascii_lowercase().as_str() {
        "stl" | "obj" | "ply" | "vtp" | "off" => not_volumetric("a surface"),
        "inr" | "nii" | "gz" | "nrrd" | "mha" => not_volumetric("an image"),
        "meshb" => Err(MeshError::Unsupported {
            at: At::file(path),
            what: "binary MEDIT".to_string(),
            remedy: "write MEDIT as text (.mesh)",
        }),
        // An extension that promises a format whose first word is missing: let its reader say so.
        "msh" => Ok(Format::Gmsh),
        "vtk" => Ok(Format::VtkLegacy),
        "vtu" => Ok(Format::Vtu),
        "mesh" => Ok(Format::Medit),
        _ if head.starts_with(b"solid") || head.starts_with(b"ply") => not_volumetric("a surface"),
        _ => Err(MeshError::UnknownFormat { at: At::file(path) }),
    }
}
