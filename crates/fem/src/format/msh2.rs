//! Gmsh MSH 2.0 to 2.2, text and binary.

use super::cell::Cell;
use super::cursor::Cursor;
use super::msh::{Fields, MshMesh, element_kind, skip_section};
use super::raw::RawMesh;
use super::scalar::Endian;
use crate::mesh::MeshError;

/// Most tags that an element may carry: group, entity and partitions.
const MOST_TAGS: i64 = 1 << 16;

/// Reads what follows `$EndMeshFormat`.
pub(super) fn read(mut cursor: Cursor, endian: Option<Endian>) -> Result<RawMesh, MeshError> {
    let mut mesh = MshMesh::new(cursor.path());
    while let Some(word) = cursor.word() {
        match word {
            b"$PhysicalNames" => mesh.read_names(&mut cursor)?,
            b"$Nodes" => read_nodes(&mut mesh, &mut cursor, endian)?,
            b"$Elements" => match endian {
                Some(endian) => read_binary_elements(&mut mesh, &mut cursor, endian)?,
                None => read_elements(&mut mesh, &mut cursor)?,
            },
            _ if word.starts_with(b"$") => skip_section(&mut cursor, &String::from_utf8_lossy(word))?,
            _ => return Err(cursor.syntax("expected a section that starts with $".to_string())),
        }
    }
    Ok(mesh.finish())
}

fn read_nodes(mesh: &mut MshMesh, cursor: &mut Cursor, endian: Option<Endian>) -> Result<(), MeshError> {
    let count = cursor.count("the number of nodes", if endian.is_some() { 28 } else { 8 })?;
    if endian.is_some() {
        cursor.line();
    }
    for _ in 0..count {
        let mut fields = Fields { cursor, endian };
        let number = fields.int("the number of a node")?;
        let x = fields.point()?;
        mesh.push_node(number, x, cursor)?;
    }
    cursor.keyword("$EndNodes")
}

/// Per element: number, type, number of tags, tags (physical group, geometric entity, ...), nodes.
fn read_elements(mesh: &mut MshMesh, cursor: &mut Cursor) -> Result<(), MeshError> {
    let count = cursor.count("the number of elements", 8)?;
    for _ in 0..count {
        let mut fields = Fields { cursor, endian: None };
        fields.int("the number of an element")?;
        let kind = fields.int("the type of an element")?;
        let kind = element_kind(kind, fields.cursor)?;
        let tags = fields.int("the number of tags of an element")?;
        read_element(mesh, &mut fields, kind, tags)?;
    }
    cursor.keyword("$EndElements")
}

/// Elements in runs: type, length of the run, number of tags; then per element number, tags, nodes.
fn read_binary_elements(mesh: &mut MshMesh, cursor: &mut Cursor, endian: Endian) -> Result<(), MeshError> {
    let count = cursor.count("the number of elements", 8)? as i64;
    cursor.line();
    let mut read = 0;
    while read < count {
        let mut fields = Fields { cursor, endian: Some(endian) };
        let kind = fields.int("the type of elements")?;
        let kind = element_kind(kind, fields.cursor)?;
        let run = fields.int("the length of a run of elements")?;
        let tags = fields.int("the number of tags of elements")?;
        if run < 1 || run > count - read {
            return Err(cursor.syntax(format!("a run of {run} elements, but {} are left", count - read)));
        }
        for _ in 0..run {
            fields.int("the number of an element")?;
            read_element(mesh, &mut fields, kind, tags)?;
        }
        read += run;
    }
    cursor.keyword("$EndElements")
}

/// Tags and nodes of one element.
fn read_element(mesh: &mut MshMesh, fields: &mut Fields, kind: Cell, tags: i64) -> Result<(), MeshError> {
    if !(0..=MOST_TAGS).contains(&tags) {
        return Err(fields.cursor.syntax(format!("an element has {tags} tags")));
    }
    let (mut physical, mut entity) = (0, 0);
    for tag in 0..tags {
        let value = fields.int("a tag of an element")?;
        match tag {
            0 => physical = value,
            1 => entity = value,
            _ => {}
        }
    }
    let mut nodes = [0; 125];
    // No kind has more nodes than cubes of fourth order, 125.
    let nodes = &mut nodes[..kind.nodes.min(125)];
    for node in nodes.iter_mut() {
        *node = fields.int("a node of an element")?;
    }
    mesh.push_element(kind, &[physical], entity, nodes, fields.cursor)
}
