//! Gmsh MSH 4.1, text and binary.

use std::collections::BTreeMap;

use super::cursor::Cursor;
use super::msh::{Fields, MshMesh, element_kind, skip_section};
use super::raw::RawMesh;
use super::scalar::Endian;
use crate::mesh::MeshError;

/// Physical groups of a geometric entity, by its dimension and number.
type Groups = BTreeMap<(u8, i64), Vec<i64>>;

/// Reads what follows `$EndMeshFormat`.
pub(super) fn read(mut cursor: Cursor, endian: Option<Endian>) -> Result<RawMesh, MeshError> {
    let mut mesh = MshMesh::new(cursor.path());
    let mut groups = Groups::new();
    while let Some(word) = cursor.word() {
        match word {
            b"$PhysicalNames" => mesh.read_names(&mut cursor)?,
            b"$Entities" => {
                start_section(&mut cursor, endian);
                read_entities(&mut groups, &mut Fields { cursor: &mut cursor, endian })?;
                cursor.keyword("$EndEntities")?;
            }
            b"$Nodes" => {
                start_section(&mut cursor, endian);
                read_nodes(&mut mesh, &mut Fields { cursor: &mut cursor, endian })?;
                cursor.keyword("$EndNodes")?;
            }
            b"$Elements" => {
                start_section(&mut cursor, endian);
                read_elements(&mut mesh, &groups, &mut Fields { cursor: &mut cursor, endian })?;
                cursor.keyword("$EndElements")?;
            }
            _ if word.starts_with(b"$") => skip_section(&mut cursor, &String::from_utf8_lossy(word))?,
            _ => return Err(cursor.syntax("expected a section that starts with $".to_string())),
        }
    }
    Ok(mesh.finish())
}

/// Binary data starts on the line after the section's name.
fn start_section(cursor: &mut Cursor, endian: Option<Endian>) {
    if endian.is_some() {
        cursor.line();
    }
}

/// Per entity: number, position (points) or box (others), physical groups, and bounding entities (not for points).
fn read_entities(groups: &mut Groups, fields: &mut Fields) -> Result<(), MeshError> {
    let mut counts = [0; 4];
    for count in &mut counts {
        *count = fields.count("a number of entities", 32)?;
    }
    for (dimension, count) in (0..).zip(counts) {
        for _ in 0..count {
            let entity = fields.int("the number of an entity")?;
            for _ in 0..if dimension == 0 { 3 } else { 6 } {
                fields.double("a bound of an entity")?;
            }
            let length = fields.count("the number of physical groups of an entity", 4)?;
            let mut physical = Vec::with_capacity(length);
            for _ in 0..length {
                // The sign tells of the orientation of the entity in the group.
                physical.push(fields.int("a physical group")?.saturating_abs());
            }
            if dimension > 0 {
                for _ in 0..fields.count("the number of bounding entities", 4)? {
                    fields.int("a bounding entity")?;
                }
            }
            groups.insert((dimension, entity), physical);
        }
    }
    Ok(())
}

/// Blocks, each with the numbers of its nodes first and their positions after them.
fn read_nodes(mesh: &mut MshMesh, fields: &mut Fields) -> Result<(), MeshError> {
    let blocks = fields.count("the number of blocks of nodes", 20)?;
    for _ in 0..3 {
        fields.long("the head of $Nodes")?;
    }
    let mut numbers = Vec::new();
    for _ in 0..blocks {
        let dimension = fields.int("the dimension of a block")?;
        fields.int("the entity of a block")?;
        let parametric = fields.int("whether nodes have parameters")? != 0;
        let count = fields.count("the number of nodes of a block", 32)?;
        numbers.clear();
        for _ in 0..count {
            numbers.push(fields.long("the number of a node")?);
        }
        let parameters = if parametric { dimension.clamp(0, 3) } else { 0 };
        for &number in &numbers {
            let x = fields.point()?;
            for _ in 0..parameters {
                fields.double("a parameter of a node")?;
            }
            mesh.push_node(number, x, fields.cursor)?;
        }
    }
    Ok(())
}

/// Blocks of elements of one kind on one entity; per element its number and its nodes.
fn read_elements(mesh: &mut MshMesh, groups: &Groups, fields: &mut Fields) -> Result<(), MeshError> {
    let blocks = fields.count("the number of blocks of elements", 20)?;
    for _ in 0..3 {
        fields.long("the head of $Elements")?;
    }
    let mut nodes = Vec::new();
    for _ in 0..blocks {
        let dimension = fields.int("the dimension of a block")?;
        let entity = fields.int("the entity of a block")?;
        let kind = fields.int("the type of the elements of a block")?;
        let kind = element_kind(kind, fields.cursor)?;
        let count = fields.count("the number of elements of a block", 16)?;
        let key = u8::try_from(dimension).map(|dimension| (dimension, entity));
        let physical = key.ok().and_then(|key| groups.get(&key)).map_or(&[][..], Vec::as_slice);
        for _ in 0..count {
            fields.long("the number of an element")?;
            nodes.clear();
            for _ in 0..kind.nodes {
                nodes.push(fields.long("a node of an element")?);
            }
            mesh.push_element(kind, physical, entity, &nodes, fields.cursor)?;
        }
    }
    Ok(())
}
