//! PLY through `ply-rs-bw`.

use std::io::{BufReader, Cursor};

use nalgebra::Vector3;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Encoding, Property, PropertyAccess, PropertyAccessResult};

use super::{Soup, SurfaceError};

/// The properties of a vertex or a face that matter here.
struct Element {
    position: Vector3<f64>,
    /// Vertices of a face as they are stored; negative ones become invalid.
    vertices: Vec<u32>,
}

impl PropertyAccess for Element {
    fn new() -> Self {
        Self { position: Vector3::repeat(f64::NAN), vertices: Vec::new() }
    }

    fn set_property(&mut self, key: &str, property: Property) -> PropertyAccessResult {
        match key {
            "x" => self.position.x = number(&property),
            "y" => self.position.y = number(&property),
            "z" => self.position.z = number(&property),
            "vertex_indices" | "vertex_index" => self.vertices = indices(property),
            _ => {}
        }
        PropertyAccessResult::Set
    }
}

pub(super) fn read(bytes: &[u8]) -> Result<Soup, SurfaceError> {
    let malformed = |message: String| SurfaceError::Malformed { format: "PLY", message };
    let mut reader = Reader::new(BufReader::new(Cursor::new(bytes)));
    let parser = Parser::<Element>::new();
    let header = parser.read_header(&mut reader).map_err(|e| malformed(e.to_string()))?;

    let mut soup = Soup { vertices: Vec::new(), triangles: Vec::new() };
    for (name, definition) in &header.elements {
        // Every element takes at least a byte (a line end, if it has no properties), so that a count beyond the
        // length of the file is a lie; without properties a binary element would take none.
        let binary = header.encoding != Encoding::Ascii;
        if definition.count > bytes.len() || (binary && definition.properties.is_empty() && definition.count > 0) {
            return Err(malformed(format!(
                "the header states {} elements '{name}', more than the {} bytes can hold",
                definition.count,
                bytes.len()
            )));
        }
        let elements = read_elements(&parser, &mut reader, definition, &header).map_err(malformed)?;
        match name.as_str() {
            "vertex" => soup.vertices = elements.into_iter().map(|e| e.position).collect(),
            "face" => {
                for (number, face) in elements.iter().enumerate() {
                    let v = &face.vertices;
                    if v.len() < 3 {
                        return Err(malformed(format!(
                            "face {number} has {} vertices; it needs three or more",
                            v.len()
                        )));
                    }
                    soup.triangles.extend((2..v.len()).map(|i| [v[0], v[i - 1], v[i]]));
                }
            }
            _ => {}
        }
    }
    Ok(soup)
}

fn read_elements(
    parser: &Parser<Element>,
    reader: &mut Reader<BufReader<Cursor<&[u8]>>>,
    definition: &ElementDef,
    header: &ply_rs_bw::ply::Header,
) -> Result<Vec<Element>, String> {
    parser.read_payload_for_element(reader, definition, header).map_err(|e| e.to_string())
}

/// A scalar of any type; a list is no number.
fn number(property: &Property) -> f64 {
    match *property {
        Property::Char(x) => f64::from(x),
        Property::UChar(x) => f64::from(x),
        Property::Short(x) => f64::from(x),
        Property::UShort(x) => f64::from(x),
        Property::Int(x) => f64::from(x),
        Property::UInt(x) => f64::from(x),
        Property::Float(x) => f64::from(x),
        Property::Double(x) => x,
        _ => f64::NAN,
    }
}

/// A list of whole numbers of any type; what cannot be an index becomes one out of range.
fn indices(property: Property) -> Vec<u32> {
    fn valid<T: TryInto<u32>>(list: Vec<T>) -> Vec<u32> {
        list.into_iter().map(|i| i.try_into().unwrap_or(u32::MAX)).collect()
    }
    match property {
        Property::ListChar(list) => valid(list),
        Property::ListUChar(list) => valid(list),
        Property::ListShort(list) => valid(list),
        Property::ListUShort(list) => valid(list),
        Property::ListInt(list) => valid(list),
        Property::ListUInt(list) => list,
        _ => Vec::new(),
    }
}
