//! The XML of a file, up to the numbers in its arrays.

use quick_xml::Reader;
use quick_xml::XmlVersion;
use quick_xml::events::{BytesStart, Event};

use super::{Array, Document};
use crate::format::scalar::{Endian, Scalar};
use crate::format::vtu_data::{Appended, Payload};
use crate::mesh::{At, MeshError};

impl<'a> Document<'a> {
    /// The place of a byte. Bytes must be asked for in ascending order.
    fn at(&mut self, position: usize) -> At {
        let (known, line) = self.known;
        let between = self.bytes.get(known..position).unwrap_or_default();
        self.known = (known.max(position), line + between.iter().filter(|&&byte| byte == b'\n').count());
        At::line(self.path, self.known.1)
    }

    /// Finds the arrays, up to the appended data, which are not XML.
    pub(super) fn scan(&mut self) -> Result<(), MeshError> {
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
}
