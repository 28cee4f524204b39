//! TetGen's `.node` and `.ele` (TetGen manual, "File formats").

use std::path::Path;

use super::cell::Cell;
use super::cursor::Cursor;
use super::raw::{Numbering, RawMesh};
use crate::mesh::{At, MeshError};

/// What `.ele` holds with option `-o2`.
const QUADRATIC: Cell = Cell { name: "quadratic tetrahedra (10 nodes)", dimension: 3, nodes: 10 };

/// Reads the two files. Nodes count from zero or one, as the first of them does.
pub(super) fn read(
    node_path: &Path,
    node_bytes: &[u8],
    ele_path: &Path,
    ele_bytes: &[u8],
) -> Result<RawMesh, MeshError> {
    let mut raw = RawMesh::new(ele_path);
    raw.from.node_file = Some(node_path.to_path_buf());
    read_nodes(&mut raw, Cursor::new(node_path, node_bytes).with_comments(b'#'))?;
    read_elements(&mut raw, Cursor::new(ele_path, ele_bytes).with_comments(b'#'))?;
    Ok(raw)
}

/// Head: nodes, dimension, attributes, markers (0 or 1). Per node: number, position, attributes, marker.
fn read_nodes(raw: &mut RawMesh, mut cursor: Cursor) -> Result<(), MeshError> {
    let count = cursor.number::<u64>("the number of nodes")?;
    let dimension = cursor.number::<u32>("the dimension")?;
    let attributes = cursor.number::<u32>("the number of attributes of a node")?;
    let markers = cursor.number::<u32>("the number of markers of a node")?;
    if dimension != 3 || markers > 1 {
        return Err(cursor.syntax(format!("dimension {dimension} with {markers} markers is not of TetGen")));
    }
    let count = cursor.check_count(count, "the number of nodes", 8)?;
    let mut base = None;
    for index in 0..count as i64 {
        let number = cursor.number::<i64>("the number of a node")?;
        let base = *base.get_or_insert(number);
        if number.checked_sub(base) != Some(index) || !(0..=1).contains(&base) {
            return Err(cursor.syntax(format!("node number {number} is out of order")));
        }
        let mut x = [0.0; 3];
        for value in &mut x {
            *value = cursor.number("a coordinate")?;
        }
        raw.push_node(x, &cursor);
        for _ in 0..attributes {
            cursor.number::<f64>("an attribute of a node")?;
        }
        if markers == 1 {
            let marker = cursor.number::<i64>("the marker of a node")?;
            if marker != 0 {
                raw.extend_set(&format!("marker_{marker}"), [number]);
            }
        }
    }
    raw.numbering = Numbering::From(base.unwrap_or(0));
    Ok(())
}

/// Head: tetrahedra, nodes of each, attributes. Per tetrahedron: number, nodes, attributes; the first is the region.
fn read_elements(raw: &mut RawMesh, mut cursor: Cursor) -> Result<(), MeshError> {
    let count = cursor.number::<u64>("the number of tetrahedra")?;
    let nodes_each = cursor.number::<u32>("the number of nodes of a tetrahedron")?;
    let attributes = cursor.number::<u32>("the number of attributes of a tetrahedron")?;
    let count = cursor.check_count(count, "the number of tetrahedra", 10)?;
    if nodes_each != 4 {
        if nodes_each == 10 {
            let at = At::line(cursor.path(), cursor.word_line() as usize);
            (0..count).for_each(|_| raw.push_other(QUADRATIC, || at.clone()));
            return Ok(());
        }
        return Err(cursor.syntax(format!("tetrahedra of {nodes_each} nodes are not of TetGen")));
    }
    for _ in 0..count {
        cursor.number::<i64>("the number of a tetrahedron")?;
        let mut nodes = [0; 4];
        for node in &mut nodes {
            *node = cursor.number("a node of a tetrahedron")?;
        }
        raw.push_tetrahedron(nodes, &cursor);
        for attribute in 0..attributes {
            let value = cursor.number::<f64>("an attribute of a tetrahedron")?;
            if attribute == 0 {
                if value.fract() != 0.0 || value.abs() > 9e15 {
                    return Err(cursor.syntax(format!("the region {value} is not a whole number")));
                }
                raw.tags.push(value as i64);
            }
        }
    }
    Ok(())
}
