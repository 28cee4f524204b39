//! Writes Gmsh MSH 2.2 as text: read by every version of Gmsh and by meshio.

use std::fmt::Write;
use std::path::Path;

use super::write_bytes;
use crate::mesh::{At, MeshError, TetMesh};

/// Writes a mesh as MSH 2.2 text. Regions become physical volumes; node sets become physical groups of points.
///
/// Every digit is kept: reading the file gives the same mesh, if its node sets are ascending.
///
/// # Errors
/// A file that cannot be written; names that hold a quotation mark or a line break, which the format has no way to
/// express, or that begin or end with white space.
pub fn write_msh(path: impl AsRef<Path>, mesh: &TetMesh) -> Result<(), MeshError> {
    let path = path.as_ref();
    write_bytes(path, msh_text(path, mesh)?.as_bytes())
}

fn msh_text(path: &Path, mesh: &TetMesh) -> Result<String, MeshError> {
    for name in mesh.region_names.iter().chain(mesh.node_sets.keys()) {
        if name.is_empty() || name.trim() != name || name.contains(['"', '\n', '\r']) {
            let what = format!("the name {name:?} cannot be written in MSH");
            return Err(MeshError::Inconsistent { at: At::file(path), what });
        }
    }
    let mut text = String::from("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n");
    // Writing to a string cannot fail.
    let _ = write_sections(&mut text, mesh);
    Ok(text)
}

fn write_sections(text: &mut String, mesh: &TetMesh) -> std::fmt::Result {
    writeln!(text, "$PhysicalNames\n{}", mesh.region_names.len() + mesh.node_sets.len())?;
    for (number, name) in (1..).zip(mesh.node_sets.keys()) {
        writeln!(text, "0 {number} \"{name}\"")?;
    }
    for (number, name) in (1..).zip(&mesh.region_names) {
        writeln!(text, "3 {number} \"{name}\"")?;
    }
    writeln!(text, "$EndPhysicalNames\n$Nodes\n{}", mesh.nodes.len())?;
    for (number, x) in (1..).zip(&mesh.nodes) {
        // The exponent form is the shortest that keeps every digit of small numbers.
        writeln!(text, "{number} {:e} {:e} {:e}", x.x, x.y, x.z)?;
    }
    let points: usize = mesh.node_sets.values().map(Vec::len).sum();
    writeln!(text, "$EndNodes\n$Elements\n{}", points + mesh.tetrahedra.len())?;
    let mut number = 1;
    for (group, set) in (1..).zip(mesh.node_sets.values()) {
        for node in set {
            writeln!(text, "{number} 15 2 {group} {group} {}", node + 1)?;
            number += 1;
        }
    }
    let kind = if mesh.is_quadratic() { 11 } else { 4 };
    for (t, (corners, region)) in mesh.tetrahedra.iter().zip(&mesh.regions).enumerate() {
        let group = u32::from(*region) + 1;
        let [a, b, c, d] = corners.map(|node| node + 1);
        write!(text, "{number} {kind} 2 {group} {group} {a} {b} {c} {d}")?;
        if let Some(mids) = mesh.mid_nodes.get(t) {
            // Gmsh has the mid-node of edge 23 before that of edge 13.
            let [e, f, g, h, i, j] = mids.map(|node| node + 1);
            write!(text, " {e} {f} {g} {h} {j} {i}")?;
        }
        writeln!(text)?;
        number += 1;
    }
    writeln!(text, "$EndElements")
}
