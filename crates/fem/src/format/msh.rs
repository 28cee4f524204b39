//! Gmsh's MSH format: what its versions have in common.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use super::cell::{self, Cell, QUADRATIC_TETRAHEDRON, TETRAHEDRON};
use super::cursor::Cursor;
use super::raw::{Numbering, RawMesh};
use super::scalar::{Endian, Scalar};
use super::{msh1, msh2, msh4};
use crate::mesh::MeshError;

/// Reads any version.
pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<RawMesh, MeshError> {
    let mut cursor = Cursor::new(path, bytes);
    loop {
        match cursor.expect_word("$MeshFormat or $NOD")? {
            "$NOD" => return msh1::read(cursor),
            "$MeshFormat" => return read_format(cursor),
            section if section.starts_with('$') => skip_section(&mut cursor, section)?,
            other => return Err(cursor.syntax(format!("expected $MeshFormat or $NOD, found {other:?}"))),
        }
    }
}

fn read_format(mut cursor: Cursor) -> Result<RawMesh, MeshError> {
    let version = cursor.expect_word("the version")?;
    let at = cursor.at();
    let binary = cursor.number::<u32>("the file type")? == 1;
    let data_size = cursor.number::<usize>("the data size")?;
    let mut endian = None;
    if binary {
        cursor.line();
        let one = cursor.take(4, "$MeshFormat")?;
        endian = Some(if one == 1_i32.to_be_bytes() { Endian::Big } else { Endian::Little });
    }
    cursor.keyword("$EndMeshFormat")?;
    match version {
        "2" | "2.0" | "2.1" | "2.2" if !binary || data_size == 8 => msh2::read(cursor, endian),
        "4.1" if !binary || data_size == 8 => msh4::read(cursor, endian),
        _ => Err(MeshError::Unsupported {
            at,
            what: format!("MSH version {version} with data size {data_size}"),
            remedy: "save it with `gmsh -save -format msh41` or `-format msh22`",
        }),
    }
}

/// Skips a section that holds nothing of use here.
pub(super) fn skip_section(cursor: &mut Cursor, section: &str) -> Result<(), MeshError> {
    let name = section.trim_start_matches('$');
    let unsupported = match name {
        "PartitionedEntities" => Some(("a partitioned mesh", "save the mesh without partitions")),
        "ParametricNodes" | "PARANOD" => Some(("a mesh with parametric nodes", "save it with Mesh.SaveParametric = 0")),
        _ => None,
    };
    if let Some((what, remedy)) = unsupported {
        return Err(MeshError::Unsupported { at: cursor.at(), what: what.into(), remedy });
    }
    cursor.skip_past(format!("$End{name}").as_bytes())
}

/// Numbers that are words in a text file and bytes in a binary one.
pub(super) struct Fields<'c, 'a> {
    pub(super) cursor: &'c mut Cursor<'a>,
    pub(super) endian: Option<Endian>,
}

impl Fields<'_, '_> {
    /// A number of 32 bits.
    pub(super) fn int(&mut self, what: &str) -> Result<i64, MeshError> {
        match self.endian {
            Some(endian) => self.cursor.binary_int(Scalar::I32, endian, what),
            None => self.cursor.number(what),
        }
    }

    /// A number of 64 bits.
    pub(super) fn long(&mut self, what: &str) -> Result<i64, MeshError> {
        match self.endian {
            Some(endian) => self.cursor.binary_int(Scalar::U64, endian, what),
            None => self.cursor.number(what),
        }
    }

    /// A count of 64 bits of things that take `least` bytes each in a binary file.
    pub(super) fn count(&mut self, what: &str, least: usize) -> Result<usize, MeshError> {
        match self.endian {
            Some(endian) => self.cursor.binary_count(Scalar::U64, endian, what, least),
            // A word and a separator.
            None => self.cursor.count(what, 2),
        }
    }

    pub(super) fn double(&mut self, what: &str) -> Result<f64, MeshError> {
        let Some(endian) = self.endian else { return self.cursor.number(what) };
        let bytes = self.cursor.take(8, what)?;
        Ok(Scalar::F64.floats(bytes, endian).next().unwrap_or(f64::NAN))
    }

    pub(super) fn point(&mut self) -> Result<[f64; 3], MeshError> {
        Ok([self.double("a coordinate")?, self.double("a coordinate")?, self.double("a coordinate")?])
    }
}

/// Collects nodes and elements under Gmsh's numbers and groups.
pub(super) struct MshMesh {
    raw: RawMesh,
    numbers: HashMap<i64, u32>,
    /// Names of physical groups by dimension and number.
    names: BTreeMap<(u8, i64), String>,
    /// Nodes of the physical groups of points, lines and surfaces.
    groups: BTreeMap<(u8, i64), Vec<i64>>,
    /// Physical group of each tetrahedron, 0 if it is in none.
    physical: Vec<i64>,
    /// Geometric entity of each tetrahedron.
    entity: Vec<i64>,
}

impl MshMesh {
    pub(super) fn new(path: &Path) -> Self {
        MshMesh {
            raw: RawMesh::new(path),
            numbers: HashMap::new(),
            names: BTreeMap::new(),
            groups: BTreeMap::new(),
            physical: Vec::new(),
            entity: Vec::new(),
        }
    }

    /// `$PhysicalNames`: dimension, number and quoted name of each group; always text.
    pub(super) fn read_names(&mut self, cursor: &mut Cursor) -> Result<(), MeshError> {
        let count = cursor.count("the number of physical names", 4)?;
        for _ in 0..count {
            let dimension = cursor.number::<u8>("the dimension of a physical group")?;
            let number = cursor.number::<i64>("the number of a physical group")?;
            let line = String::from_utf8_lossy(cursor.line());
            let name = line.trim().trim_matches('"');
            if name.is_empty() || dimension > 3 {
                return Err(cursor.syntax("a physical group has no name or a dimension above 3".to_string()));
            }
            self.names.insert((dimension, number), name.to_string());
        }
        cursor.keyword("$EndPhysicalNames")
    }

    pub(super) fn push_node(&mut self, number: i64, x: [f64; 3], cursor: &Cursor) -> Result<(), MeshError> {
        let index = u32::try_from(self.raw.nodes.len()).unwrap_or(u32::MAX);
        if self.numbers.insert(number, index).is_some() {
            return Err(MeshError::RepeatedNodeNumber { at: cursor.at(), number });
        }
        self.raw.push_node(x, cursor);
        Ok(())
    }

    /// Adds an element of a known kind with the physical groups and the geometric entity that it is in.
    pub(super) fn push_element(
        &mut self,
        cell: Cell,
        physical: &[i64],
        entity: i64,
        nodes: &[i64],
        cursor: &Cursor,
    ) -> Result<(), MeshError> {
        if cell == TETRAHEDRON || cell == QUADRATIC_TETRAHEDRON {
            let wrong = || cursor.syntax(format!("a tetrahedron of {} nodes has {}", cell.nodes, nodes.len()));
            if cell == TETRAHEDRON {
                self.raw.push_tetrahedron(<[i64; 4]>::try_from(nodes).map_err(|_| wrong())?, cursor);
            } else {
                let mut nodes = <[i64; 10]>::try_from(nodes).map_err(|_| wrong())?;
                // Gmsh has the mid-node of edge 23 before that of edge 13.
                nodes.swap(8, 9);
                self.raw.push_quadratic(nodes, cursor);
            }
            self.physical.push(physical.first().copied().unwrap_or(0));
            self.entity.push(entity);
            return Ok(());
        }
        self.raw.push_other(cell, || cursor.at());
        for &number in physical.iter().filter(|&&number| number != 0 && cell.dimension < 3) {
            self.groups.entry((cell.dimension, number)).or_default().extend(nodes);
        }
        Ok(())
    }

    /// Groups become regions and node sets. Without any physical group, the volumes of the geometry are the regions,
    /// if there are several.
    pub(super) fn finish(mut self) -> RawMesh {
        let has_groups = self.physical.iter().any(|&number| number != 0);
        let several = self.entity.windows(2).any(|pair| pair[0] != pair[1]);
        if has_groups {
            self.raw.tags = self.physical;
        } else if several {
            self.raw.tags = self.entity;
        }
        if has_groups {
            let solid = self.names.iter().filter(|((dimension, _), _)| *dimension == 3);
            self.raw.names = solid.map(|((_, number), name)| (*number, name.clone())).collect();
        }
        for (key, nodes) in self.groups {
            let name = match self.names.get(&key) {
                Some(name) => name.clone(),
                None => format!("{}_{}", ["point", "line", "surface"][usize::from(key.0.min(2))], key.1),
            };
            self.raw.extend_set(&name, nodes);
        }
        self.raw.numbering = Numbering::Map(self.numbers);
        self.raw
    }
}

/// The kind of an element by its number.
pub(super) fn element_kind(code: i64, cursor: &Cursor) -> Result<Cell, MeshError> {
    cell::gmsh(code).ok_or_else(|| MeshError::Unsupported {
        at: cursor.at(),
        what: format!("Gmsh element type {code}"),
        remedy: "mesh with linear or quadratic tetrahedra",
    })
}
