//! What VTK's two formats have in common: cells by offsets into one list, and arrays that tell of regions and sets.

use std::path::Path;

use super::cell::{self, QUADRATIC_TETRAHEDRON, TETRAHEDRON};
use super::raw::RawMesh;
use super::scalar::Values;
use crate::mesh::{At, MeshError, MeshWarning};

/// Arrays per cell that hold regions, in lower case, the first one present counts.
const REGION_ARRAYS: [&str; 18] = [
    "region",
    "regions",
    "regionid",
    "region_id",
    "materialid",
    "materialids",
    "material_id",
    "material",
    "materials",
    "gmsh:physical",
    "medit:ref",
    "tetgen:ref",
    "cellentityids",
    "physicalids",
    "cell_tags",
    "label",
    "labels",
    "attribute",
];

/// Arrays of physical groups, which points, lines and surfaces have as well.
const GROUP_ARRAYS: [&str; 3] = ["gmsh:physical", "medit:ref", "cellentityids"];

/// Names of regions, each ended by a zero byte, in the field data of files written here. Bytes rather than VTK's
/// strings, because meshio refuses those.
pub(super) const REGION_NAMES: &str = "region_names";
/// Names of node sets, each ended by a zero byte.
pub(super) const NODE_SET_NAMES: &str = "node_set_names";
/// Number of nodes of each node set.
pub(super) const NODE_SET_SIZES: &str = "node_set_sizes";
/// Nodes of all node sets, one after the other.
pub(super) const NODE_SET_NODES: &str = "node_set_nodes";

/// Cells as VTK lists them.
#[derive(Default)]
pub(super) struct VtkCells {
    /// Nodes of all cells, one after the other.
    pub(super) connectivity: Vec<i64>,
    /// Start of each cell in `connectivity`, and its end.
    pub(super) offsets: Vec<i64>,
    /// VTK's number of each kind.
    pub(super) types: Vec<i64>,
    /// Line of each cell; empty if unknown.
    pub(super) lines: Vec<u32>,
}

/// Arrays that were kept.
#[derive(Default)]
pub(super) struct VtkArrays {
    cell_data: Vec<(String, Values)>,
    field_data: Vec<(String, Values)>,
}

/// Whether an array per cell may tell of regions.
pub(super) fn is_region_array(name: &str) -> bool {
    rank(name).is_some()
}

fn rank(name: &str) -> Option<usize> {
    REGION_ARRAYS.iter().position(|known| name.eq_ignore_ascii_case(known))
}

/// Whether an array of field data is one of those that are written here.
pub(super) fn is_known_field(name: &str) -> bool {
    [REGION_NAMES, NODE_SET_NAMES, NODE_SET_SIZES, NODE_SET_NODES].contains(&name)
}

impl VtkArrays {
    /// Keeps an array per cell if it may tell of regions. The parts of a file in several pieces are joined.
    pub(super) fn keep_cell_data(&mut self, name: &str, values: Values) {
        if !is_region_array(name) {
            return;
        }
        let Some((_, earlier)) = self.cell_data.iter_mut().find(|kept| kept.0 == name) else {
            self.cell_data.push((name.to_string(), values));
            return;
        };
        match (earlier, values) {
            (Values::Ints(earlier), Values::Ints(later)) => earlier.extend(later),
            (Values::Floats(earlier), Values::Floats(later)) => earlier.extend(later),
            // Pieces disagree on the type: too few numbers remain, which is warned of below.
            _ => {}
        }
    }

    /// Keeps an array of field data if it is one that is written here.
    pub(super) fn keep_field_data(&mut self, name: &str, values: Values) {
        if is_known_field(name) {
            self.field_data.push((name.to_string(), values));
        }
    }

    fn field(&self, name: &str) -> Option<Vec<i64>> {
        self.field_data.iter().find(|field| field.0 == name)?.1.whole()
    }

    fn names(&self, field: &str) -> Option<Vec<String>> {
        let bytes: Option<Vec<u8>> = self.field(field)?.into_iter().map(|byte| u8::try_from(byte).ok()).collect();
        let bytes = bytes?;
        let names = bytes.strip_suffix(b"\0")?.split(|&byte| byte == 0);
        names.map(|name| String::from_utf8(name.to_vec()).ok()).collect()
    }

    /// Sorts the cells into tetrahedra and others, and gives them regions and sets.
    pub(super) fn apply(&self, raw: &mut RawMesh, cells: &VtkCells, path: &Path) -> Result<(), MeshError> {
        let regions = self.regions(raw, cells.types.len());
        let mut starts = cells.offsets.windows(2);
        for (c, &code) in cells.types.iter().enumerate() {
            let at = || match cells.lines.get(c) {
                Some(&line) => At::line(path, line as usize),
                None => At::file(path),
            };
            let syntax = |what: String| MeshError::Syntax { at: at(), what };
            let nodes = starts.next().and_then(|pair| {
                let (start, end) = (usize::try_from(pair[0]).ok()?, usize::try_from(pair[1]).ok()?);
                cells.connectivity.get(start..end)
            });
            let nodes = nodes.ok_or_else(|| syntax(format!("cell {c} has no list of nodes")))?;
            let Some(kind) = cell::vtk(code) else {
                let what = format!("cell {c} of VTK type {code}");
                return Err(MeshError::Unsupported {
                    at: at(),
                    what,
                    remedy: "mesh with linear or quadratic tetrahedra",
                });
            };
            let region = regions.as_ref().and_then(|(_, tags)| tags.get(c)).copied();
            if kind == TETRAHEDRON || kind == QUADRATIC_TETRAHEDRON {
                let wrong = || syntax(format!("tetrahedron of {} nodes with {}", kind.nodes, nodes.len()));
                if kind == TETRAHEDRON {
                    raw.tetrahedra.push(<[i64; 4]>::try_from(nodes).map_err(|_| wrong())?);
                } else {
                    raw.push_ten_nodes(<[i64; 10]>::try_from(nodes).map_err(|_| wrong())?);
                }
                raw.from.tetrahedron_lines.extend(cells.lines.get(c));
                raw.tags.extend(region);
                continue;
            }
            raw.push_other(kind, at);
            let is_group = regions.as_ref().is_some_and(|(name, _)| GROUP_ARRAYS.contains(&name.as_str()));
            if let Some(group) = region.filter(|&group| group != 0 && is_group && kind.dimension < 3) {
                let name = ["point", "line", "surface"][usize::from(kind.dimension.min(2))];
                raw.extend_set(&format!("{name}_{group}"), nodes.iter().copied());
            }
        }
        self.apply_names(raw);
        Ok(())
    }

    /// The array of regions: its name in lower case, and one whole number per cell.
    fn regions(&self, raw: &mut RawMesh, cells: usize) -> Option<(String, Vec<i64>)> {
        let mut candidates: Vec<&(String, Values)> = self.cell_data.iter().collect();
        candidates.sort_by_key(|(name, _)| rank(name));
        for (name, values) in candidates {
            match values.whole().filter(|tags| tags.len() == cells) {
                Some(tags) => return Some((name.to_ascii_lowercase(), tags)),
                None => raw.warnings.push(MeshWarning::RegionsIgnored { array: format!("the array {name:?}") }),
            }
        }
        None
    }

    fn apply_names(&self, raw: &mut RawMesh) {
        if let Some(names) = self.names(REGION_NAMES) {
            raw.names = (0..).zip(names).collect();
        }
        let sets = (self.names(NODE_SET_NAMES), self.field(NODE_SET_SIZES));
        let (Some(names), Some(sizes)) = sets else { return };
        let nodes = self.field(NODE_SET_NODES).unwrap_or_default();
        let mut rest = nodes.as_slice();
        for (name, size) in names.iter().zip(sizes) {
            let Some((set, others)) = usize::try_from(size).ok().and_then(|size| rest.split_at_checked(size)) else {
                let array = format!("node set {name:?}, which is cut off;");
                raw.warnings.push(MeshWarning::RegionsIgnored { array });
                return;
            };
            raw.extend_set(name, set.iter().copied());
            rest = others;
        }
    }
}
