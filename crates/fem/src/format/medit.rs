//! MEDIT's `.mesh` as text (INRIA technical report RT-0253; Medit, Mmg, TetGen, Freefem write it).

use std::path::Path;

use super::cell::Cell;
use super::cursor::Cursor;
use super::raw::{Numbering, RawMesh};
use crate::mesh::MeshError;

/// Sections of cells that are not tetrahedra: keyword, cell, and the name of their node sets.
const OTHER_CELLS: [(&str, Cell, &str); 6] = [
    ("Edges", Cell { name: "lines", dimension: 1, nodes: 2 }, "line"),
    ("Triangles", Cell { name: "triangles", dimension: 2, nodes: 3 }, "surface"),
    ("Quadrilaterals", Cell { name: "quadrilaterals", dimension: 2, nodes: 4 }, "surface"),
    ("Hexahedra", Cell { name: "hexahedra (8 nodes)", dimension: 3, nodes: 8 }, "volume"),
    ("Hexaedra", Cell { name: "hexahedra (8 nodes)", dimension: 3, nodes: 8 }, "volume"),
    ("Prisms", Cell { name: "prisms (6 nodes)", dimension: 3, nodes: 6 }, "volume"),
];

/// Sections of no use here, with the words of each of their lines.
const IGNORED: [(&str, usize); 10] = [
    ("Corners", 1),
    ("Ridges", 1),
    ("RequiredVertices", 1),
    ("RequiredEdges", 1),
    ("RequiredTriangles", 1),
    ("Normals", 3),
    ("Tangents", 3),
    ("NormalAtVertices", 2),
    ("TangentAtVertices", 2),
    ("NormalAtTriangleVertices", 3),
];

/// Reads a file.
pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<RawMesh, MeshError> {
    let mut cursor = Cursor::new(path, bytes).with_comments(b'#');
    let mut raw = RawMesh::new(path);
    raw.numbering = Numbering::From(1);
    while cursor.peek().is_some() {
        match cursor.expect_word("a keyword")? {
            "MeshVersionFormatted" => _ = cursor.number::<u32>("the version")?,
            "Dimension" => read_dimension(&mut cursor)?,
            "Vertices" => read_vertices(&mut raw, &mut cursor)?,
            "Tetrahedra" => read_tetrahedra(&mut raw, &mut cursor)?,
            "End" => break,
            keyword => read_other(&mut raw, &mut cursor, keyword)?,
        }
    }
    // Zero is the reference of what has none.
    if raw.tags.iter().all(|&tag| tag == 0) {
        raw.tags.clear();
    }
    Ok(raw)
}

fn read_dimension(cursor: &mut Cursor) -> Result<(), MeshError> {
    match cursor.number::<u32>("the dimension")? {
        3 => Ok(()),
        dimension => {
            let what = format!("a mesh of dimension {dimension}");
            Err(MeshError::Unsupported { at: cursor.at(), what, remedy: "write a volume mesh" })
        }
    }
}

fn read_vertices(raw: &mut RawMesh, cursor: &mut Cursor) -> Result<(), MeshError> {
    let count = cursor.count("the number of vertices", 8)?;
    for _ in 0..count {
        let mut x = [0.0; 3];
        for value in &mut x {
            *value = cursor.number("a coordinate")?;
        }
        raw.push_node(x, cursor);
        cursor.number::<i64>("the reference of a vertex")?;
    }
    Ok(())
}

fn read_tetrahedra(raw: &mut RawMesh, cursor: &mut Cursor) -> Result<(), MeshError> {
    let count = cursor.count("the number of tetrahedra", 10)?;
    for _ in 0..count {
        let mut nodes = [0; 4];
        for node in &mut nodes {
            *node = cursor.number("a node of a tetrahedron")?;
        }
        raw.push_tetrahedron(nodes, cursor);
        raw.tags.push(cursor.number("the reference of a tetrahedron")?);
    }
    Ok(())
}

fn read_other(raw: &mut RawMesh, cursor: &mut Cursor, keyword: &str) -> Result<(), MeshError> {
    if let Some((_, cell, set)) = OTHER_CELLS.iter().find(|section| section.0 == keyword) {
        return read_other_cells(raw, cursor, *cell, set);
    }
    let Some((_, words)) = IGNORED.iter().find(|section| section.0 == keyword) else {
        return Err(cursor.syntax(format!("unknown keyword {keyword:?}")));
    };
    let count = cursor.count("the length of a section", 2)?;
    for _ in 0..count.saturating_mul(*words) {
        cursor.number::<f64>("a number")?;
    }
    Ok(())
}

fn read_other_cells(raw: &mut RawMesh, cursor: &mut Cursor, cell: Cell, set: &str) -> Result<(), MeshError> {
    let count = cursor.count("the number of cells", 4)?;
    let mut nodes = Vec::new();
    for _ in 0..count {
        nodes.clear();
        for _ in 0..cell.nodes {
            nodes.push(cursor.number("a node of a cell")?);
        }
        let reference = cursor.number::<i64>("the reference of a cell")?;
        raw.push_other(cell, || cursor.at());
        if reference != 0 && cell.dimension < 3 {
            raw.extend_set(&format!("{set}_{reference}"), nodes.iter().copied());
        }
    }
    Ok(())
}
