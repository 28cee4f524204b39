//! Writes VTU: for ParaView, meshio, and for reading back without losing a bit.
//!
//! Numbers are appended raw, little-endian, each array behind its length in 64 bits. Regions are an array per cell,
//! `region`; their names and the node sets are field data, names as bytes that end in zero (VTK's own strings are not
//! read by meshio).

use std::path::Path;

use nalgebra::Vector3;

use super::vtk_arrays::{NODE_SET_NAMES, NODE_SET_NODES, NODE_SET_SIZES, REGION_NAMES};
use super::write_bytes;
use crate::mesh::{At, MeshError, TetMesh};

/// Values at the nodes, in the order of the nodes.
#[derive(Clone, Copy, Debug)]
pub enum PointData<'a> {
    /// One number each.
    Scalars(&'a [f64]),
    /// One vector each.
    Vectors(&'a [Vector3<f64>]),
}

impl PointData<'_> {
    fn len(&self) -> usize {
        match self {
            PointData::Scalars(values) => values.len(),
            PointData::Vectors(values) => values.len(),
        }
    }
}

/// VTK's numbers for linear and quadratic tetrahedra.
const VTK_TETRA: u8 = 10;
const VTK_QUADRATIC_TETRA: u8 = 24;

/// Writes a mesh with data at its nodes.
///
/// Reading the file gives the same mesh to the bit, if its node sets are ascending.
///
/// # Errors
/// A file that cannot be written; data whose length is not the number of nodes; names that hold a zero byte.
pub fn write_vtu(
    path: impl AsRef<Path>,
    mesh: &TetMesh,
    point_data: &[(&str, PointData<'_>)],
) -> Result<(), MeshError> {
    let path = path.as_ref();
    let inconsistent = |what| Err(MeshError::Inconsistent { at: At::file(path), what });
    if let Some((name, data)) = point_data.iter().find(|(_, data)| data.len() != mesh.nodes.len()) {
        return inconsistent(format!("{} values of {name:?} for {} nodes", data.len(), mesh.nodes.len()));
    }
    if mesh.regions.len() != mesh.tetrahedra.len() {
        return inconsistent(format!("{} tetrahedra, but regions for {}", mesh.tetrahedra.len(), mesh.regions.len()));
    }
    if mesh.is_quadratic() && mesh.mid_nodes.len() != mesh.tetrahedra.len() {
        let (tetrahedra, mids) = (mesh.tetrahedra.len(), mesh.mid_nodes.len());
        return inconsistent(format!("{tetrahedra} tetrahedra, but mid-nodes for {mids}"));
    }
    if let Some(name) = mesh.region_names.iter().chain(mesh.node_sets.keys()).find(|name| name.contains('\0')) {
        return inconsistent(format!("the name {name:?} holds a zero byte"));
    }
    write_bytes(path, &vtu_bytes(mesh, point_data))
}

fn vtu_bytes(mesh: &TetMesh, point_data: &[(&str, PointData<'_>)]) -> Vec<u8> {
    let mut file = VtuText::default();
    file.text.push_str(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" \
         header_type=\"UInt64\">\n<UnstructuredGrid>\n<FieldData>\n",
    );
    file.names(REGION_NAMES, mesh.region_names.iter());
    if !mesh.node_sets.is_empty() {
        file.names(NODE_SET_NAMES, mesh.node_sets.keys());
        let sizes = mesh.node_sets.values().map(|set| set.len() as u64);
        file.array("UInt64", NODE_SET_SIZES, Length::Tuples(mesh.node_sets.len()), sizes.map(u64::to_le_bytes));
        let nodes = mesh.node_sets.values().map(Vec::len).sum();
        let values = mesh.node_sets.values().flatten().map(|node| node.to_le_bytes());
        file.array("UInt32", NODE_SET_NODES, Length::Tuples(nodes), values);
    }
    file.text.push_str(&format!(
        "</FieldData>\n<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\">\n<PointData>\n",
        mesh.nodes.len(),
        mesh.tetrahedra.len()
    ));
    for (name, data) in point_data {
        match data {
            PointData::Scalars(values) => {
                file.array("Float64", name, Length::Components(1), values.iter().map(|value| value.to_le_bytes()));
            }
            PointData::Vectors(values) => file.vectors(name, values),
        }
    }
    file.text.push_str("</PointData>\n<CellData>\n");
    file.array("UInt16", "region", Length::Components(1), mesh.regions.iter().map(|region| region.to_le_bytes()));
    file.text.push_str("</CellData>\n<Points>\n");
    file.vectors("Points", &mesh.nodes);
    file.text.push_str("</Points>\n<Cells>\n");
    let mids = |t: usize| mesh.mid_nodes.get(t).into_iter().flatten();
    let cells = mesh.tetrahedra.iter().enumerate().flat_map(|(t, corners)| corners.iter().chain(mids(t)));
    file.array("Int64", "connectivity", Length::Components(1), cells.map(|&node| i64::from(node).to_le_bytes()));
    let (nodes, kind) = if mesh.is_quadratic() { (10, VTK_QUADRATIC_TETRA) } else { (4, VTK_TETRA) };
    let ends = (1..=mesh.tetrahedra.len()).map(|cell| (nodes * cell as i64).to_le_bytes());
    file.array("Int64", "offsets", Length::Components(1), ends);
    file.array("UInt8", "types", Length::Components(1), mesh.tetrahedra.iter().map(|_| [kind]));
    file.finish()
}

/// How an array states its length: per point or cell, or on its own.
enum Length {
    Components(usize),
    Tuples(usize),
}

/// The XML so far, and the data that will be appended to it.
#[derive(Default)]
struct VtuText {
    text: String,
    appended: Vec<u8>,
}

impl VtuText {
    fn array<const N: usize>(
        &mut self,
        scalar: &str,
        name: &str,
        length: Length,
        values: impl Iterator<Item = [u8; N]>,
    ) {
        let length = match length {
            Length::Components(components) => format!("NumberOfComponents=\"{components}\""),
            Length::Tuples(tuples) => format!("NumberOfTuples=\"{tuples}\""),
        };
        let name = quick_xml::escape::escape(name);
        let start = self.appended.len();
        self.text.push_str(&format!(
            "<DataArray type=\"{scalar}\" Name=\"{name}\" {length} format=\"appended\" offset=\"{start}\"/>\n"
        ));
        self.appended.extend([0; 8]);
        values.for_each(|value| self.appended.extend(value));
        let bytes = (self.appended.len() - start - 8) as u64;
        self.appended[start..start + 8].copy_from_slice(&bytes.to_le_bytes());
    }

    fn vectors(&mut self, name: &str, values: &[Vector3<f64>]) {
        let components = values.iter().flat_map(|v| [v.x, v.y, v.z]).map(f64::to_le_bytes);
        self.array("Float64", name, Length::Components(3), components);
    }

    fn names<'n>(&mut self, array: &str, names: impl Iterator<Item = &'n String>) {
        let bytes: Vec<[u8; 1]> = names.flat_map(|name| name.bytes().chain([0])).map(|byte| [byte]).collect();
        self.array("UInt8", array, Length::Tuples(bytes.len()), bytes.into_iter());
    }

    fn finish(mut self) -> Vec<u8> {
        self.text.push_str("</Cells>\n</Piece>\n</UnstructuredGrid>\n<AppendedData encoding=\"raw\">\n_");
        let mut bytes = self.text.into_bytes();
        bytes.append(&mut self.appended);
        bytes.extend(b"\n</AppendedData>\n</VTKFile>\n");
        bytes
    }
}
