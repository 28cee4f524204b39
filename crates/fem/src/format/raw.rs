//! What a reader found in a file, with the numbers and lines of the file, and how it becomes a mesh.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use nalgebra::Vector3;

use super::cell::Cell;
use super::cursor::Cursor;
use crate::mesh::{At, MeshError, MeshWarning, Provenance, TetMesh, check_nodes, corners, is_flat, signed_volume};

/// Name of the region of a mesh whose file tells of none.
const ONLY_REGION: &str = "body";

/// At most this share of the nodes is dropped for lack of tetrahedra. Construction points of a geometry are a handful;
/// when more is unused, the cells of the file are not what its nodes were made for.
const DROPPED_SHARE: f64 = 0.1;

/// How the cells of a file name its nodes.
pub(crate) enum Numbering {
    /// In order, counted from this number.
    From(i64),
    /// By numbers of their own.
    Map(HashMap<i64, u32>),
}

/// A file's nodes and cells as they stand there.
pub(crate) struct RawMesh {
    pub(crate) nodes: Vec<Vector3<f64>>,
    pub(crate) numbering: Numbering,
    pub(crate) tetrahedra: Vec<[i64; 4]>,
    /// Mid-nodes of the tetrahedra that have any, in VTK's order; of all of them or of none.
    mid_nodes: Vec<[i64; 6]>,
    /// The region of each tetrahedron, by the file's number; empty if the file tells of none.
    pub(crate) tags: Vec<i64>,
    /// Names of regions, by the file's number. Named regions are kept even if no tetrahedron is in them.
    pub(crate) names: BTreeMap<i64, String>,
    pub(crate) node_sets: BTreeMap<String, Vec<i64>>,
    pub(crate) warnings: Vec<MeshWarning>,
    pub(crate) from: Provenance,
    /// Cells that are not tetrahedra, by name; solid ones are refused.
    others: BTreeMap<&'static str, (Cell, usize)>,
    /// The first solid cell that is not a tetrahedron.
    first_unsupported: Option<At>,
}

impl RawMesh {
    pub(crate) fn new(path: &Path) -> Self {
        let file = Some(path.to_path_buf());
        RawMesh {
            nodes: Vec::new(),
            numbering: Numbering::From(0),
            tetrahedra: Vec::new(),
            mid_nodes: Vec::new(),
            tags: Vec::new(),
            names: BTreeMap::new(),
            node_sets: BTreeMap::new(),
            warnings: Vec::new(),
            from: Provenance { node_file: file.clone(), tetrahedron_file: file, ..Provenance::default() },
            others: BTreeMap::new(),
            first_unsupported: None,
        }
    }

    /// Adds a node at the cursor's place.
    pub(crate) fn push_node(&mut self, x: [f64; 3], cursor: &Cursor) {
        self.nodes.push(x.into());
        if !cursor.is_binary() {
            self.from.node_lines.push(cursor.word_line());
        }
    }

    /// Adds a tetrahedron at the cursor's place.
    pub(crate) fn push_tetrahedron(&mut self, nodes: [i64; 4], cursor: &Cursor) {
        self.tetrahedra.push(nodes);
        if !cursor.is_binary() {
            self.from.tetrahedron_lines.push(cursor.word_line());
        }
    }

    /// Adds a tetrahedron with mid-nodes, in VTK's order, at the cursor's place.
    pub(crate) fn push_quadratic(&mut self, nodes: [i64; 10], cursor: &Cursor) {
        self.push_ten_nodes(nodes);
        if !cursor.is_binary() {
            self.from.tetrahedron_lines.push(cursor.word_line());
        }
    }

    /// Adds a tetrahedron with mid-nodes, in VTK's order, whose line is kept elsewhere.
    pub(crate) fn push_ten_nodes(&mut self, nodes: [i64; 10]) {
        self.tetrahedra.push(std::array::from_fn(|i| nodes[i]));
        self.mid_nodes.push(std::array::from_fn(|i| nodes[i + 4]));
    }

    /// Counts a cell that is not a tetrahedron.
    pub(crate) fn push_other(&mut self, cell: Cell, at: impl FnOnce() -> At) {
        self.others.entry(cell.name).or_insert((cell, 0)).1 += 1;
        if cell.dimension == 3 && self.first_unsupported.is_none() {
            self.first_unsupported = Some(at());
        }
    }

    /// Adds nodes to a set, by the file's numbers.
    pub(crate) fn extend_set(&mut self, name: &str, nodes: impl IntoIterator<Item = i64>) {
        match self.node_sets.get_mut(name) {
            Some(set) => set.extend(nodes),
            None => _ = self.node_sets.insert(name.to_string(), nodes.into_iter().collect()),
        }
    }

    fn index(&self, number: i64) -> Option<u32> {
        match &self.numbering {
            Numbering::From(base) => {
                let index = u32::try_from(number.checked_sub(*base)?).ok()?;
                ((index as usize) < self.nodes.len()).then_some(index)
            }
            Numbering::Map(map) => map.get(&number).copied(),
        }
    }

    /// The mesh, its lines and its warnings, with tetrahedra of any sign and nodes of any use.
    pub(crate) fn finish(mut self) -> Result<(TetMesh, Provenance, Vec<MeshWarning>), MeshError> {
        self.refuse_other_cells()?;
        check_nodes(&self.nodes, &self.from)?;
        let (regions, region_names) = self.regions()?;
        let tetrahedra = self.resolve(&self.tetrahedra)?;
        let mid_nodes = self.resolve(&self.mid_nodes)?;
        let node_sets = self.resolve_sets()?;
        let mut mesh = TetMesh { nodes: self.nodes, tetrahedra, mid_nodes, regions, region_names, node_sets };
        drop_stray_nodes(&mut mesh, &mut self.from, &mut self.warnings);
        turn_round_if_all_inverted(&mut mesh, &mut self.warnings);
        Ok((mesh, self.from, self.warnings))
    }

    fn refuse_other_cells(&self) -> Result<(), MeshError> {
        let list = |cells: &[&(Cell, usize)]| {
            let counts: Vec<String> = cells.iter().map(|(cell, count)| format!("{count} {}", cell.name)).collect();
            counts.join(", ")
        };
        let solid: Vec<_> = self.others.values().filter(|(cell, _)| cell.dimension == 3).collect();
        if let Some(at) = &self.first_unsupported {
            return Err(MeshError::UnsupportedCells { at: at.clone(), cells: list(&solid) });
        }
        let (tetrahedra, quadratic) = (self.tetrahedra.len(), self.mid_nodes.len());
        if quadratic != 0 && quadratic != tetrahedra {
            let what = format!("{} linear beside {quadratic} quadratic tetrahedra", tetrahedra - quadratic);
            let remedy = "mesh the whole body in one order";
            return Err(MeshError::Unsupported { at: self.from.file(), what, remedy });
        }
        if !self.tetrahedra.is_empty() {
            return Ok(());
        }
        let at = self.from.file();
        let all: Vec<_> = self.others.values().collect();
        if self.others.values().any(|(cell, _)| cell.dimension == 2) {
            return Err(MeshError::NotVolumetric { at, what: list(&all) });
        }
        let found = if all.is_empty() { format!("{} nodes", self.nodes.len()) } else { list(&all) };
        Err(MeshError::NoTetrahedra { at, found })
    }

    /// Regions in the order of the file's numbers.
    fn regions(&self) -> Result<(Vec<u16>, Vec<String>), MeshError> {
        let count = self.tetrahedra.len();
        if self.tags.len() != count {
            return Ok((vec![0; count], vec![ONLY_REGION.to_string()]));
        }
        let mut numbers: Vec<i64> = self.tags.clone();
        numbers.sort_unstable();
        numbers.dedup();
        numbers.extend(self.names.keys());
        numbers.sort_unstable();
        numbers.dedup();
        if numbers.len() > usize::from(u16::MAX) + 1 {
            let what = format!("{} regions", numbers.len());
            let remedy = "at most 65536 regions are possible; write fewer, or leave the array out";
            return Err(MeshError::Unsupported { at: self.from.file(), what, remedy });
        }
        // Present by construction: every tag is among the numbers.
        let region = |tag: &i64| numbers.binary_search(tag).unwrap_or(0) as u16;
        let regions = self.tags.iter().map(region).collect();
        Ok((regions, self.region_names(&numbers)))
    }

    /// The file's name for each number, or "region_N"; where two are the same, the number is added.
    fn region_names(&self, numbers: &[i64]) -> Vec<String> {
        let mut seen = BTreeMap::new();
        let mut names = Vec::with_capacity(numbers.len());
        for number in numbers {
            let mut name = self.names.get(number).cloned().unwrap_or_else(|| format!("region_{number}"));
            while seen.contains_key(&name) {
                name = format!("{name}_{number}");
            }
            seen.insert(name.clone(), ());
            names.push(name);
        }
        names
    }

    /// Nodes by index, of the corners or of the mid-nodes of all tetrahedra.
    fn resolve<const N: usize>(&self, lists: &[[i64; N]]) -> Result<Vec<[u32; N]>, MeshError> {
        let mut all = Vec::with_capacity(lists.len());
        for (t, numbers) in lists.iter().enumerate() {
            let mut resolved = [0; N];
            for (slot, &number) in resolved.iter_mut().zip(numbers) {
                *slot = self.index(number).ok_or_else(|| MeshError::NodeOutOfRange {
                    at: self.from.tetrahedron(t),
                    what: format!("tetrahedron {t}"),
                    node: number,
                    nodes: self.nodes.len(),
                })?;
            }
            all.push(resolved);
        }
        Ok(all)
    }

    /// Node sets in ascending order without repetition.
    fn resolve_sets(&self) -> Result<BTreeMap<String, Vec<u32>>, MeshError> {
        let resolve_set = |(name, numbers): (&String, &Vec<i64>)| {
            let mut set = Vec::with_capacity(numbers.len());
            for &number in numbers {
                let out = || MeshError::NodeOutOfRange {
                    at: self.from.file(),
                    what: format!("node set {name:?}"),
                    node: number,
                    nodes: self.nodes.len(),
                };
                set.push(self.index(number).ok_or_else(out)?);
            }
            set.sort_unstable();
            set.dedup();
            Ok((name.clone(), set))
        };
        self.node_sets.iter().map(resolve_set).collect()
    }
}

/// Leaves out nodes without tetrahedra, if they are few.
fn drop_stray_nodes(mesh: &mut TetMesh, from: &mut Provenance, warnings: &mut Vec<MeshWarning>) {
    let unused = mesh.used_nodes().iter().filter(|used| !**used).count();
    if unused == 0 || unused as f64 > DROPPED_SHARE * mesh.nodes.len() as f64 {
        return;
    }
    let renumbered = mesh.compact_nodes();
    let mut kept = renumbered.iter();
    from.node_lines.retain(|_| kept.next().is_some_and(Option::is_some));
    warnings.push(MeshWarning::UnusedNodesDropped { nodes: unused });
}

/// A file in which every tetrahedron has negative volume follows the other convention of numbering.
fn turn_round_if_all_inverted(mesh: &mut TetMesh, warnings: &mut Vec<MeshWarning>) {
    let inverted = |&t: &[u32; 4]| {
        let x = corners(&mesh.nodes, t);
        let volume = signed_volume(&x);
        volume < 0.0 && !is_flat(&x, volume).0
    };
    if mesh.tetrahedra.iter().all(inverted) {
        let tetrahedra = mesh.reorient();
        warnings.push(MeshWarning::Reoriented { tetrahedra });
    }
}
