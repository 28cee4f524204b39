//! VTK's XML format for unstructured grids (VTK File Formats, "XML File Formats").

use std::path::Path;

use quick_xml::Reader;
use quick_xml::XmlVersion;
use quick_xml::events::{BytesStart, Event};

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

    /// The place of a byte. Bytes must be asked for in ascending order.
    fn at(&mut self, position: usize) -> At {
        let (known, line) = self.known;
        let between = self.bytes.get(known..position).unwrap_or_default();
        self.known = (known.max(position), line + between.iter().filter(|&&byte| byte == b'\n').count());
        At::line(self.path, self.known.1)
    }

    /// Finds the arrays, up to the appended data, which are not XML.
    fn scan(&mut self) -> Result<(), MeshError> {
        let mut reader = Reader::from_reader(self.bytes);
        let mut sections: Vec<String> = Vec::new();
        let mut open: Option<(Array<'a>, usize)> = None;
        loop {
            let before = reader.buffer_position() as usize;
            let event = reader.read_event().map_err(|error| {
                let at = self.at(reader.error_position() as usize);
                MeshError::Syntax { at, what: format!("the XML is broken: {error}") }
            })?;
            let after = reader.buffer_position() as usize;
            match event {
                Event::Start(element) => {
                    let name = element.name().0.to_string();
                    match name.as_str() {
                        "DataArray" | "Array" => open = Some((self.array(&element, &sections, before)?, after)),
                        "AppendedData" => {
                            self.open_appended(&element, before, after)?;
                            return Ok(());
                        }
                        _ => self.enter(&element, &name, before)?,
                    }
                    sections.push(name);
                }
                Event::Empty(element) => match element.name().0 {
                    "DataArray" | "Array" => {
                        let array = self.array(&element, &sections, before)?;
                        self.arrays.push(array);
                    }
                    name => self.enter(&element, name, before)?,
                },
                Event::End(_) => {
                    if let Some((mut array, start)) = open.take() {
                        // Numbers come first; VTK puts elements that describe them behind.
                        let text = self.bytes.get(start..before).unwrap_or_default();
                        let length = text.iter().position(|&byte| byte == b'<').unwrap_or(text.len());
                        array.payload.set_text(&text[..length]);
                        self.arrays.push(array);
                    }
                    sections.pop();
                }
                Event::Eof => break,
                _ => {}
            }
        }
        if sections.is_empty() && !self.pieces.is_empty() {
            return Ok(());
        }
        let at = self.at(self.bytes.len());
        let what = if sections.is_empty() { "the file has no Piece" } else { "the file ends inside of its XML" };
        Err(MeshError::Syntax { at, what: what.to_string() })
    }

    fn attribute(&mut self, element: &BytesStart, name: &str, position: usize) -> Result<Option<String>, MeshError> {
        let broken = |at: At, error: String| MeshError::Syntax { at, what: format!("the XML is broken: {error}") };
        for attribute in element.attributes() {
            let attribute = attribute.map_err(|error| broken(self.at(position), error.to_string()))?;
            if attribute.key.0 == name {
                let value = attribute.normalized_value(XmlVersion::Implicit1_0);
                let value = value.map_err(|error| broken(self.at(position), error.to_string()))?;
                return Ok(Some(value.into_owned()));
            }
        }
        Ok(None)
    }

    fn number(&mut self, element: &BytesStart, name: &str, position: usize) -> Result<Option<u64>, MeshError> {
        let Some(text) = self.attribute(element, name, position)? else { return Ok(None) };
        let what = || format!("the attribute {name} is {:?}", text.chars().take(24).collect::<String>());
        let number = text.trim().parse().map_err(|_| MeshError::Syntax { at: self.at(position), what: what() })?;
        Ok(Some(number))
    }

    /// Elements that are not arrays.
    fn enter(&mut self, element: &BytesStart, name: &str, position: usize) -> Result<(), MeshError> {
        match name {
            "VTKFile" => self.enter_file(element, position),
            "Piece" => {
                let points = self.number(element, "NumberOfPoints", position)?;
                let cells = self.number(element, "NumberOfCells", position)?;
                let (Some(points), Some(cells)) = (points, cells) else {
                    let what = "a Piece without NumberOfPoints and NumberOfCells".to_string();
                    return Err(MeshError::Syntax { at: self.at(position), what });
                };
                self.pieces.push((points, cells));
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn enter_file(&mut self, element: &BytesStart, position: usize) -> Result<(), MeshError> {
        let kind = self.attribute(element, "type", position)?.unwrap_or_default();
        let at = self.at(position);
        match kind.as_str() {
            "UnstructuredGrid" => {}
            "PolyData" => return Err(MeshError::NotVolumetric { at, what: "a surface (PolyData)".into() }),
            "ImageData" => return Err(MeshError::NotVolumetric { at, what: "an image".into() }),
            _ => {
                let what = format!("a VTK file of type {kind:?}");
                return Err(MeshError::Unsupported { at, what, remedy: "write one file of type UnstructuredGrid" });
            }
        }
        if self.attribute(element, "byte_order", position)?.as_deref() == Some("BigEndian") {
            self.encoding.endian = Endian::Big;
        }
        if self.attribute(element, "header_type", position)?.as_deref() == Some("UInt64") {
            self.encoding.header = Scalar::U64;
        }
        match self.attribute(element, "compressor", position)?.as_deref() {
            None | Some("") => Ok(()),
            Some("vtkZLibDataCompressor") => {
                self.encoding.zlib = true;
                Ok(())
            }
            Some(other) => {
                let what = format!("data compressed by {other}");
                Err(MeshError::Unsupported { at, what, remedy: "write it with zlib or without compression" })
            }
        }
    }

    fn array(&mut self, element: &BytesStart, sections: &[String], position: usize) -> Result<Array<'a>, MeshError> {
        let format = self.attribute(element, "format", position)?;
        let offset = self.number(element, "offset", position)?;
        let payload = match format.as_deref().unwrap_or("ascii") {
            "ascii" => Payload::Text(&[]),
            "binary" => Payload::Base64(&[]),
            "appended" => Payload::Appended(offset.unwrap_or(0)),
            other => {
                let what = format!("an array of format {other:?}");
                return Err(MeshError::Unsupported { at: self.at(position), what, remedy: "write ascii or binary" });
            }
        };
        Ok(Array {
            section: sections.last().cloned().unwrap_or_default(),
            piece: self.pieces.len().saturating_sub(1),
            name: self.attribute(element, "Name", position)?.unwrap_or_default(),
            scalar_name: self.attribute(element, "type", position)?.unwrap_or_default(),
            components: self.number(element, "NumberOfComponents", position)?.unwrap_or(1),
            payload,
            line: self.at(position).line.unwrap_or(1),
        })
    }

    fn open_appended(&mut self, element: &BytesStart, before: usize, after: usize) -> Result<(), MeshError> {
        let raw = match self.attribute(element, "encoding", before)?.as_deref() {
            Some("raw") => true,
            None | Some("base64") => false,
            Some(other) => {
                let what = format!("appended data in the encoding {other:?}");
                return Err(MeshError::Unsupported { at: self.at(before), what, remedy: "write raw or base64" });
            }
        };
        let rest = self.bytes.get(after..).unwrap_or_default();
        let Some(mark) = rest.iter().position(|&byte| byte == b'_') else {
            let what = "appended data do not start with an underscore".to_string();
            return Err(MeshError::Syntax { at: self.at(before), what });
        };
        let mut starts: Vec<u64> = self.arrays.iter().filter_map(|array| array.payload.offset()).collect();
        starts.sort_unstable();
        self.appended = Some(Appended { raw, bytes: &rest[mark + 1..], starts });
        Ok(())
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
