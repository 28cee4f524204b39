//! Kinds of cells that mesh files hold, and which of them a simulation uses.

/// What is known of a kind of cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Cell {
    /// Its name in the plural.
    pub(crate) name: &'static str,
    /// 0 point, 1 line, 2 surface, 3 solid.
    pub(crate) dimension: u8,
    /// Its nodes; 0 where the number varies.
    pub(crate) nodes: usize,
}

/// The cells that are simulated.
pub(crate) const TETRAHEDRON: Cell = cell("tetrahedra", 3, 4);
pub(crate) const QUADRATIC_TETRAHEDRON: Cell = cell("quadratic tetrahedra (10 nodes)", 3, 10);

const fn cell(name: &'static str, dimension: u8, nodes: usize) -> Cell {
    Cell { name, dimension, nodes }
}

/// VTK's cell types (vtkCellType.h).
pub(crate) fn vtk(code: i64) -> Option<Cell> {
    Some(match code {
        0 => cell("empty cells", 0, 0),
        1 => cell("vertices", 0, 1),
        2 => cell("poly-vertices", 0, 0),
        3 => cell("lines", 1, 2),
        4 => cell("poly-lines", 1, 0),
        5 => cell("triangles", 2, 3),
        6 => cell("triangle strips", 2, 0),
        7 => cell("polygons", 2, 0),
        8 => cell("pixels", 2, 4),
        9 => cell("quadrilaterals", 2, 4),
        10 => TETRAHEDRON,
        11 => cell("voxels (8 nodes)", 3, 8),
        12 => cell("hexahedra (8 nodes)", 3, 8),
        13 => cell("wedges (6 nodes)", 3, 6),
        14 => cell("pyramids (5 nodes)", 3, 5),
        15 => cell("pentagonal prisms", 3, 10),
        16 => cell("hexagonal prisms", 3, 12),
        21 => cell("quadratic lines", 1, 3),
        22 => cell("quadratic triangles", 2, 6),
        23 => cell("quadratic quadrilaterals", 2, 8),
        24 => QUADRATIC_TETRAHEDRON,
        25 => cell("quadratic hexahedra (20 nodes)", 3, 20),
        26 => cell("quadratic wedges (15 nodes)", 3, 15),
        27 => cell("quadratic pyramids (13 nodes)", 3, 13),
        28 => cell("biquadratic quadrilaterals", 2, 9),
        29 => cell("triquadratic hexahedra (27 nodes)", 3, 27),
        34 => cell("biquadratic triangles", 2, 7),
        35 => cell("cubic lines", 1, 4),
        36 => cell("quadratic polygons", 2, 0),
        41 => cell("convex point sets", 3, 0),
        42 => cell("polyhedra", 3, 0),
        68 => cell("Lagrange curves", 1, 0),
        69 => cell("Lagrange triangles", 2, 0),
        70 => cell("Lagrange quadrilaterals", 2, 0),
        71 => cell("Lagrange tetrahedra", 3, 0),
        72 => cell("Lagrange hexahedra", 3, 0),
        75 => cell("Bezier curves", 1, 0),
        76 => cell("Bezier triangles", 2, 0),
        77 => cell("Bezier quadrilaterals", 2, 0),
        78 => cell("Bezier tetrahedra", 3, 0),
        79 => cell("Bezier hexahedra", 3, 0),
        _ => return None,
    })
}

/// Gmsh's element types (Gmsh reference manual, "MSH file format").
pub(crate) fn gmsh(code: i64) -> Option<Cell> {
    Some(match code {
        1 => cell("lines", 1, 2),
        2 => cell("triangles", 2, 3),
        3 => cell("quadrilaterals", 2, 4),
        4 => TETRAHEDRON,
        5 => cell("hexahedra (8 nodes)", 3, 8),
        6 => cell("prisms (6 nodes)", 3, 6),
        7 => cell("pyramids (5 nodes)", 3, 5),
        8 => cell("quadratic lines", 1, 3),
        9 => cell("quadratic triangles", 2, 6),
        10 => cell("quadratic quadrilaterals", 2, 9),
        11 => QUADRATIC_TETRAHEDRON,
        12 => cell("quadratic hexahedra (27 nodes)", 3, 27),
        13 => cell("quadratic prisms (18 nodes)", 3, 18),
        14 => cell("quadratic pyramids (14 nodes)", 3, 14),
        15 => cell("points", 0, 1),
        16 => cell("quadratic quadrilaterals", 2, 8),
        17 => cell("quadratic hexahedra (20 nodes)", 3, 20),
        18 => cell("quadratic prisms (15 nodes)", 3, 15),
        19 => cell("quadratic pyramids (13 nodes)", 3, 13),
        20 => cell("cubic triangles", 2, 9),
        21 => cell("cubic triangles", 2, 10),
        22 => cell("quartic triangles", 2, 12),
        23 => cell("quartic triangles", 2, 15),
        24 => cell("quintic triangles", 2, 15),
        25 => cell("quintic triangles", 2, 21),
        26 => cell("cubic lines", 1, 4),
        27 => cell("quartic lines", 1, 5),
        28 => cell("quintic lines", 1, 6),
        29 => cell("cubic tetrahedra (20 nodes)", 3, 20),
        30 => cell("quartic tetrahedra (35 nodes)", 3, 35),
        31 => cell("quintic tetrahedra (56 nodes)", 3, 56),
        92 => cell("cubic hexahedra (64 nodes)", 3, 64),
        93 => cell("quartic hexahedra (125 nodes)", 3, 125),
        _ => return None,
    })
}
