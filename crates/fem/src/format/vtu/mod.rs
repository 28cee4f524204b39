//! VTK's XML format for unstructured grids (VTK File Formats, "XML File Formats").

mod scan;

use std::path::Path;

use super::raw::RawMesh;
use super::scalar::{Endian, Scalar, Values, vtk_scalar};
use super::vtk_arrays::{VtkArrays, VtkCells, is_known_field, is_region_array};
use super::vtk_legacy::cell_lines;
use super::vtu_data::{Appended, Decoded, Encoding, Payload};
use crate::mesh::{At, MeshError};

/// One `DataArray` before its numbers are decoded.
struct Array<'a> {
    /// The element that holds it: Points, Cells, CellData, ...
    section: String,
    piece: usize,
    name: String,
    scalar_name: String,
    components: u64,
    payload: Payload<'a>,
    line: usize,
}

/// The structure of a file.
struct Document<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    encoding: Encoding,
    arrays: Vec<Array<'a>>,
    /// Numbers of points and cells of each piece.
    pieces: Vec<(u64, u64)>,
    appended: Option<Appended<'a>>,
    /// A byte whose line is known.
    known: (usize, usize),
}

/// Reads a file.
pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<RawMesh, MeshError> {
    let mut document = Document::new(path, bytes);
    document.scan()?;
    let (mut raw, mut cells, mut kept) = (RawMesh::new(path), VtkCells::default(), VtkArrays::default());
    for array in document.arrays.iter().filter(|array| array.section == "FieldData" && is_known_field(&array.name)) {
        kept.keep_field_data(&array.name, document.decode(array)?.values);
    }
    for piece in 0..document.pieces.len() {
        document.read_piece(piece, &mut raw, &mut cells, &mut kept)?;
    }
    kept.apply(&mut raw, &cells, path)?;
    Ok(raw)
}

impl<'a> Document<'a> {
    fn new(path: &'a Path, bytes: &'a [u8]) -> Self {
        let encoding = Encoding { endian: Endian::Little, header: Scalar::U32, zlib: false };
        Document { path, bytes, encoding, arrays: Vec::new(), pieces: Vec::new(), appended: None, known: (0, 1) }
    }

    fn syntax(&self, array: &Array, what: String) -> MeshError {
        MeshError::Syntax { at: At::line(self.path, array.line), what }
    }

    fn decode(&self, array: &Array) -> Result<Decoded, MeshError> {
        let at = || At::line(self.path, array.line);
        let scalar = vtk_scalar(&array.scalar_name, at)?;
        array.payload.decode(scalar, &self.encoding, self.appended.as_ref(), self.path, array.line)
    }

    fn find(&self, piece: usize, section: &str, name: Option<&str>) -> Result<&Array<'a>, MeshError> {
        let mut arrays = self.arrays.iter().filter(|array| array.piece == piece && array.section == section);
        let found = arrays.find(|array| name.is_none_or(|name| array.name == name));
        found.ok_or_else(|| {
            let what = format!("piece {piece} has no array {:?} in {section}", name.unwrap_or("of positions"));
            MeshError::Syntax { at: At::file(self.path), what }
        })
    }

    fn read_piece(
        &self,
        piece: usize,
        raw: &mut RawMesh,
        cells: &mut VtkCells,
        kept: &mut VtkArrays,
    ) -> Result<(), MeshError> {
        let (point_count, cell_count) = self.pieces[piece];
        let first_node = raw.nodes.len() as i64;
        if point_count > 0 {
            self.read_points(piece, point_count, raw)?;
        }
        if cell_count == 0 {
            return Ok(());
        }
        self.read_cells(piece, cell_count, first_node, cells)?;
        let of_cells = |array: &&Array| array.piece == piece && array.section == "CellData" && array.components == 1;
        for array in self.arrays.iter().filter(of_cells).filter(|array| is_region_array(&array.name)) {
            kept.keep_cell_data(&array.name, self.decode(array)?.values);
        }
        Ok(())
    }

    fn read_points(&self, piece: usize, count: u64, raw: &mut RawMesh) -> Result<(), MeshError> {
        let array = self.find(piece, "Points", None)?;
        let decoded = self.decode(array)?;
        let coordinates = match decoded.values {
            Values::Floats(values) => values,
            Values::Ints(values) => values.into_iter().map(|value| value as f64).collect(),
        };
        if array.components != 3 || Some(coordinates.len() as u64) != count.checked_mul(3) {
            let (numbers, components) = (coordinates.len(), array.components);
            let what = format!("{count} points, but {numbers} coordinates in {components} components");
            return Err(self.syntax(array, what));
        }
        raw.nodes.extend(coordinates.chunks_exact(3).map(|x| nalgebra::Vector3::new(x[0], x[1], x[2])));
        raw.from.node_lines.extend(decoded.lines.chunks_exact(3).map(|lines| lines[0]));
        Ok(())
    }

    fn read_cells(&self, piece: usize, count: u64, first_node: i64, cells: &mut VtkCells) -> Result<(), MeshError> {
        let whole = |name: &str| -> Result<(Vec<i64>, Vec<u32>), MeshError> {
            let array = self.find(piece, "Cells", Some(name))?;
            let decoded = self.decode(array)?;
            let values = decoded.values.whole().ok_or_else(|| self.syntax(array, format!("{name} is not whole")))?;
            if name != "connectivity" && values.len() as u64 != count {
                return Err(self.syntax(array, format!("{count} cells, but {} {name}", values.len())));
            }
            Ok((values, decoded.lines))
        };
        let (connectivity, lines) = whole("connectivity")?;
        let (ends, _) = whole("offsets")?;
        let (types, _) = whole("types")?;
        // Ends become starts and ends; those of later pieces follow the earlier ones.
        let first = cells.connectivity.len() as i64;
        if cells.offsets.is_empty() {
            cells.offsets.push(0);
        }
        if ends.last() != Some(&(connectivity.len() as i64)) {
            let what = format!("cells end at {:?}, but connectivity has {} numbers", ends.last(), connectivity.len());
            return Err(self.syntax(self.find(piece, "Cells", Some("offsets"))?, what));
        }
        let piece_starts: Vec<i64> = std::iter::once(0).chain(ends.iter().copied()).collect();
        cells.lines.extend(cell_lines(&lines, &piece_starts));
        cells.offsets.extend(ends.iter().map(|end| end.saturating_add(first)));
        cells.connectivity.extend(connectivity.iter().map(|node| node.saturating_add(first_node)));
        cells.types.extend(types);
        Ok(())
    }
}
