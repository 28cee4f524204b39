//! STL through `stl_io`.

use std::io::Cursor;

use nalgebra::Vector3;

use super::{Soup, SurfaceError};

/// A binary file is a header of 80 bytes, the number of triangles, and 50 bytes for each.
const BINARY_HEADER: usize = 84;
const BINARY_TRIANGLE: usize = 50;

pub(super) fn read(bytes: &[u8]) -> Result<Soup, SurfaceError> {
    let malformed = |message: String| SurfaceError::Malformed { format: "STL", message };
    let mut owned = bytes.to_vec();
    let stated = bytes.get(80..84).and_then(|n| n.try_into().ok()).map(u32::from_le_bytes);
    let binary_length = stated.and_then(|n| (n as usize).checked_mul(BINARY_TRIANGLE)?.checked_add(BINARY_HEADER));
    if binary_length == Some(bytes.len()) {
        // Many binary files begin with "solid", by which readers know the text form; the length decides.
        owned[0] = b' ';
    } else if !bytes.starts_with(b"solid") {
        return Err(malformed(format!(
            "neither text (it does not start with 'solid') nor binary (its {} bytes are not 84 and 50 for each of {} \
             triangles); the file is cut short or of another kind",
            bytes.len(),
            stated.unwrap_or(0)
        )));
    } else if bytes.get(5).is_some_and(|b| *b != b' ') {
        // A solid without a name: `stl_io` asks for a space.
        owned.insert(5, b' ');
    }
    let mesh = stl_io::read_stl(&mut Cursor::new(owned)).map_err(|e| malformed(e.to_string()))?;
    let vertices = mesh.vertices.iter().map(|v| Vector3::from(v.0.map(f64::from))).collect();
    let triangles = mesh.faces.iter().map(|f| f.vertices.map(|v| v as u32)).collect();
    Ok(Soup { vertices, triangles })
}
