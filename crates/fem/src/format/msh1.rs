//! Gmsh MSH 1 (text): `$NOD` and `$ELM`. SOFA's meshes are in this format.

use super::cursor::Cursor;
use super::msh::{Fields, MshMesh, element_kind, skip_section};
use super::raw::RawMesh;
use crate::mesh::MeshError;

/// Reads what follows `$NOD`.
pub(super) fn read(mut cursor: Cursor) -> Result<RawMesh, MeshError> {
    let mut mesh = MshMesh::new(cursor.path());
    let count = cursor.count("the number of nodes", 8)?;
    for _ in 0..count {
        let number = cursor.number("the number of a node")?;
        let x = Fields { cursor: &mut cursor, endian: None }.point()?;
        mesh.push_node(number, x, &cursor)?;
    }
    cursor.keyword("$ENDNOD")?;
    while let Some(word) = cursor.word() {
        match word {
            b"$ELM" => read_elements(&mut mesh, &mut cursor)?,
            _ if word.starts_with(b"$") => skip_section(&mut cursor, &String::from_utf8_lossy(word))?,
            _ => return Err(cursor.syntax("expected $ELM".to_string())),
        }
    }
    Ok(mesh.finish())
}

/// Per element: number, type, physical group, geometric entity, number of nodes, nodes.
fn read_elements(mesh: &mut MshMesh, cursor: &mut Cursor) -> Result<(), MeshError> {
    let count = cursor.count("the number of elements", 12)?;
    let mut nodes = Vec::new();
    for _ in 0..count {
        cursor.number::<i64>("the number of an element")?;
        let kind = cursor.number("the type of an element")?;
        let kind = element_kind(kind, cursor)?;
        let physical = cursor.number::<i64>("a physical group")?;
        let entity = cursor.number("a geometric entity")?;
        let length = cursor.count("the number of nodes of an element", 2)?;
        nodes.clear();
        for _ in 0..length {
            nodes.push(cursor.number("a node of an element")?);
        }
        mesh.push_element(kind, &[physical], entity, &nodes, cursor)?;
    }
    cursor.keyword("$ENDELM")
}
