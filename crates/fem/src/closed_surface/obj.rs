//! Wavefront OBJ, positions and faces only.
//!
//! Own reader: coordinates stay in f64, errors name the line, and `tobj` 4.0.5 overflows on faces whose relative
//! texture index lies before the first one (a panic where overflow checks are on).

use nalgebra::Vector3;

use super::{Soup, SurfaceError};

pub(super) fn read(bytes: &[u8]) -> Result<Soup, SurfaceError> {
    let mut soup = Soup { vertices: Vec::new(), triangles: Vec::new() };
    let mut face = Vec::new();
    // A backslash at the end of a line continues it.
    let text = String::from_utf8_lossy(bytes).replace("\\\r\n", " ").replace("\\\n", " ");
    for (number, line) in text.lines().enumerate() {
        let malformed = |message: String| SurfaceError::Malformed {
            format: "OBJ",
            message: format!("line {}: {message}", number + 1),
        };
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let mut x = Vector3::zeros();
                for c in x.iter_mut() {
                    let word = words.next().unwrap_or("");
                    *c = word.parse().map_err(|_| malformed(format!("'{line}' must have three numbers after v")))?;
                }
                soup.vertices.push(x);
            }
            Some("f") => {
                face.clear();
                for word in words {
                    let index = word.split('/').next().unwrap_or("");
                    let vertex =
                        index.parse::<i64>().ok().and_then(|i| resolve(i, soup.vertices.len())).ok_or_else(|| {
                            malformed(format!("'{word}' names none of the {} vertices so far", soup.vertices.len()))
                        })?;
                    face.push(vertex);
                }
                if face.len() < 3 {
                    return Err(malformed(format!("a face needs three vertices or more, '{line}' has {}", face.len())));
                }
                soup.triangles.extend((2..face.len()).map(|i| [face[0], face[i - 1], face[i]]));
            }
            _ => {}
        }
    }
    Ok(soup)
}

/// Indices count from 1, or backwards from -1.
fn resolve(index: i64, count: usize) -> Option<u32> {
    let from_zero = if index < 0 { index.checked_add(count as i64)? } else { index - 1 };
    u32::try_from(from_zero).ok().filter(|&v| (v as usize) < count)
}
