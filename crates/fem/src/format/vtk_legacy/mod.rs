//! VTK's legacy format, versions 1 to 5.1, unstructured grids, text and binary (VTK File Formats, "Simple Legacy").

mod attribute;

use std::path::Path;

use super::cursor::Cursor;
use super::raw::RawMesh;
use super::scalar::{Endian, Scalar, vtk_scalar};
use super::vtk_arrays::{VtkArrays, VtkCells};
use crate::mesh::{At, MeshError, MeshWarning};

/// Which things the arrays that follow belong to.
#[derive(Clone, Copy, PartialEq)]
enum Owner {
    Field,
    Points,
    Cells,
}

struct Reader<'a> {
    cursor: Cursor<'a>,
    binary: bool,
    raw: RawMesh,
    cells: VtkCells,
    arrays: VtkArrays,
    owner: Owner,
    /// Number of points or cells that the arrays that follow belong to.
    owned: usize,
}

/// Reads a file.
pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<RawMesh, MeshError> {
    let mut cursor = Cursor::new(path, bytes);
    if !cursor.line().starts_with(b"# vtk DataFile Version") {
        return Err(cursor.syntax("expected \"# vtk DataFile Version\"".to_string()));
    }
    // The title.
    cursor.line();
    let binary = match cursor.expect_word("ASCII or BINARY")? {
        "ASCII" => false,
        "BINARY" => true,
        other => return Err(cursor.syntax(format!("expected ASCII or BINARY, found {other:?}"))),
    };
    cursor.keyword("DATASET")?;
    match cursor.expect_word("the kind of data set")? {
        "UNSTRUCTURED_GRID" => {}
        "POLYDATA" => return Err(MeshError::NotVolumetric { at: cursor.at(), what: "a surface (POLYDATA)".into() }),
        "STRUCTURED_POINTS" => return Err(MeshError::NotVolumetric { at: cursor.at(), what: "an image".into() }),
        other => {
            let what = format!("a data set of kind {other}");
            let remedy = "convert it to an UNSTRUCTURED_GRID of tetrahedra";
            return Err(MeshError::Unsupported { at: cursor.at(), what, remedy });
        }
    }
    let (raw, cells, arrays) = (RawMesh::new(path), VtkCells::default(), VtkArrays::default());
    let mut reader = Reader { cursor, binary, raw, cells, arrays, owner: Owner::Field, owned: 0 };
    reader.read_sections()?;
    if reader.cells.types.len() + 1 != reader.cells.offsets.len().max(1) {
        let (cells, types) = (reader.cells.offsets.len().saturating_sub(1), reader.cells.types.len());
        return Err(MeshError::Syntax { at: At::file(path), what: format!("{cells} cells, but types for {types}") });
    }
    reader.arrays.apply(&mut reader.raw, &reader.cells, path)?;
    Ok(reader.raw)
}

impl<'a> Reader<'a> {
    fn read_sections(&mut self) -> Result<(), MeshError> {
        while let Some(word) = self.cursor.word() {
            let result = match word {
                b"POINTS" => self.read_points(),
                b"CELLS" => self.read_cells(),
                b"CELL_TYPES" => self.read_types(),
                b"METADATA" => {
                    self.skip_metadata();
                    Ok(())
                }
                _ => self.read_attribute(&String::from_utf8_lossy(word)),
            };
            match result {
                // The geometry is complete and only arrays follow: an exotic one is no reason to refuse the mesh.
                Err(MeshError::Unsupported { what, .. }) if !self.cells.types.is_empty() => {
                    let array = format!("{what} and the arrays after it");
                    self.raw.warnings.push(MeshWarning::RegionsIgnored { array });
                    return Ok(());
                }
                result => result?,
            }
        }
        Ok(())
    }

    fn scalar(&mut self) -> Result<Scalar, MeshError> {
        let name = self.cursor.expect_word("a type of numbers")?;
        vtk_scalar(name, || self.cursor.at())
    }

    fn read_points(&mut self) -> Result<(), MeshError> {
        let count = self.cursor.number::<u64>("the number of points")?;
        let scalar = self.scalar()?;
        if self.binary {
            let values = self.binary_values(count, 3, scalar, "POINTS")?;
            let mut coordinates = scalar.floats(values, Endian::Big);
            while let (Some(x), Some(y), Some(z)) = (coordinates.next(), coordinates.next(), coordinates.next()) {
                self.raw.nodes.push([x, y, z].into());
            }
            return Ok(());
        }
        let count = self.cursor.check_count(count, "the number of points", 6)?;
        for _ in 0..count {
            let mut x = [0.0; 3];
            for value in &mut x {
                *value = self.cursor.number("a coordinate")?;
            }
            self.raw.push_node(x, &self.cursor);
        }
        Ok(())
    }

    /// Up to version 4: cells and the length of the list, in which the number of nodes stands before each cell.
    /// From version 5 on: the lengths of two arrays, OFFSETS (one more than cells) and CONNECTIVITY.
    fn read_cells(&mut self) -> Result<(), MeshError> {
        let first = self.cursor.number::<u64>("the number of cells")?;
        let second = self.cursor.number::<u64>("the length of the list of cells")?;
        self.cells = VtkCells::default();
        if self.cursor.peek() == Some(b"OFFSETS") {
            self.cursor.keyword("OFFSETS")?;
            let scalar = self.scalar()?;
            self.cells.offsets = self.ints(first, scalar, "OFFSETS", None)?;
            self.cursor.keyword("CONNECTIVITY")?;
            let scalar = self.scalar()?;
            let mut lines = Vec::new();
            self.cells.connectivity = self.ints(second, scalar, "CONNECTIVITY", Some(&mut lines))?;
            self.cells.lines = cell_lines(&lines, &self.cells.offsets);
            return Ok(());
        }
        let mut lines = Vec::new();
        let list = self.ints(second, Scalar::I32, "CELLS", Some(&mut lines))?;
        self.split_list(first, &list, &lines)
    }

    /// Takes the numbers of nodes out of the list of cells.
    fn split_list(&mut self, count: u64, list: &[i64], lines: &[u32]) -> Result<(), MeshError> {
        self.cells.offsets.push(0);
        let mut rest = list;
        while let Some((&length, others)) = rest.split_first() {
            let cell = self.cells.offsets.len() - 1;
            let nodes = usize::try_from(length).ok().and_then(|length| others.split_at_checked(length));
            let Some((nodes, others)) = nodes else {
                let line = lines.get(list.len() - rest.len());
                let at = line.map_or(self.cursor.at(), |&line| At::line(self.cursor.path(), line as usize));
                return Err(MeshError::Syntax { at, what: format!("cell {cell} cannot have {length} nodes") });
            };
            self.cells.lines.extend(lines.get(list.len() - rest.len()));
            self.cells.connectivity.extend(nodes);
            self.cells.offsets.push(self.cells.connectivity.len() as i64);
            rest = others;
        }
        if self.cells.offsets.len() as u64 - 1 != count {
            let found = self.cells.offsets.len() - 1;
            return Err(self.cursor.syntax(format!("{count} cells are announced, but the list holds {found}")));
        }
        Ok(())
    }

    fn read_types(&mut self) -> Result<(), MeshError> {
        let count = self.cursor.number::<u64>("the number of cell types")?;
        self.cells.types = self.ints(count, Scalar::I32, "CELL_TYPES", None)?;
        Ok(())
    }

    /// Whole numbers, and their lines if the file is text.
    fn ints(
        &mut self,
        count: u64,
        scalar: Scalar,
        what: &str,
        mut lines: Option<&mut Vec<u32>>,
    ) -> Result<Vec<i64>, MeshError> {
        if self.binary {
            let bytes = self.binary_values(count, 1, scalar, what)?;
            return Ok(scalar.ints(bytes, Endian::Big).collect());
        }
        let count = self.cursor.check_count(count, what, 2)?;
        let mut values = Vec::with_capacity(count);
        for _ in 0..count {
            values.push(self.cursor.number("a whole number")?);
            if let Some(lines) = &mut lines {
                lines.push(self.cursor.word_line());
            }
        }
        Ok(values)
    }

    /// The bytes of `count` times `each` numbers, which start on the next line.
    fn binary_values(&mut self, count: u64, each: u64, scalar: Scalar, what: &str) -> Result<&'a [u8], MeshError> {
        self.cursor.line();
        let count = count.checked_mul(each).ok_or_else(|| self.cursor.syntax(format!("{what} is too long")))?;
        let count = self.cursor.check_count(count, what, scalar.size())?;
        self.cursor.take(count * scalar.size(), what)
    }

    /// Metadata lasts until an empty line.
    fn skip_metadata(&mut self) {
        self.cursor.line();
        while !self.cursor.rest().is_empty() && !self.cursor.line().trim_ascii().is_empty() {}
    }
}

/// The line of the first node of each cell.
pub(super) fn cell_lines(lines: &[u32], offsets: &[i64]) -> Vec<u32> {
    if lines.is_empty() {
        return Vec::new();
    }
    let line = |&offset: &i64| usize::try_from(offset).ok().and_then(|offset| lines.get(offset)).copied().unwrap_or(0);
    let starts = offsets.split_last().map_or(&[][..], |(_, starts)| starts);
    starts.iter().map(line).collect()
}
