//! Averaged dilatation: linear tetrahedra without volumetric locking.
//!
//! A law is split into `Ψ(F) = rest(F) + U(J)` ([`without_bulk`]), and `U` sees the mean volume ratio of a group of
//! elements instead of each element's own. With element volumes `v_e` (m³, of the deformed element), rest volumes `V_e`
//! and shares `w_ge`, `Σ_g w_ge = 1`,
//! ```text
//! E = Σ_e V_e rest(F_e) + Σ_g V_g U(J_g),      V_g = Σ_e w_ge V_e,   J_g = Σ_e w_ge v_e / V_g
//! f_i = -Σ_e (V_e ∂rest/∂q_i + p_e ∂v_e/∂q_i),                       p_e = Σ_g w_ge U'(J_g)
//! K_ij = Σ_e (V_e ∂²rest/∂q_i∂q_j + p_e ∂²v_e/∂q_i∂q_j) + Σ_g U''(J_g) / V_g a_gi a_gjᵀ,   a_gi = Σ_e w_ge ∂v_e/∂q_i
//! ```
//! Forces and tangent are derivatives of one energy; the tangent is symmetric, and uniform strain is exact. The element
//! part is an ordinary element under the pressure `p_e` ([`element_under_pressure`]), in packs like linear ones; the filter
//! treats it as such and drops groups with `U'' < 0`. The group part couples all nodes of a group. How elements are grouped, and why:
//! [`Grouping`].
//!
//! [`without_bulk`]: crate::material::Law::without_bulk
//! [`element_under_pressure`]: crate::material::Law::element_under_pressure

#![allow(non_snake_case)]

mod groups;
mod volumes;

use nalgebra::{Matrix3, Vector3};
use pulp::Arch;
use rayon::prelude::*;

pub use self::groups::Grouping;
pub(crate) use self::groups::Groups;
use self::volumes::{PackVolumes, pack_volumes};
use crate::{
    assembly::{UpperBlocks, sum_by_halves},
    element::Tetrahedron,
    material::Bulk,
    pack::{PACK, Pack, Row},
    sparse::{BlockPattern, FIXED},
};

/// Entries that one task handles.
const CHUNK: usize = 256;

/// Ranges into a list of values.
#[derive(Clone, Debug, PartialEq)]
struct Table<T> {
    start: Vec<u32>,
    values: Vec<T>,
}

impl<T> Table<T> {
    fn new(rows: impl Iterator<Item = Vec<T>>) -> Self {
        let mut table = Self { start: vec![0], values: Vec::new() };
        for row in rows {
            table.values.extend(row);
            table.start.push(table.values.len() as u32);
        }
        table
    }

    fn row(&self, i: usize) -> &[T] {
        &self.values[self.start[i] as usize..self.start[i + 1] as usize]
    }

    fn rows(&self) -> usize {
        self.start.len() - 1
    }
}

/// The groups of a body and where their blocks go: description.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Averaging {
    share: f64,
    /// Elements of each group.
    members: Table<u32>,
    /// Slot of each element, `PACK pack + place`.
    slot_of: Vec<u32>,
    /// Groups of the elements by slot; none in places without an element.
    groups_of: Table<u32>,
    /// Rest volume of each group (m³).
    volume: Vec<f64>,
    bulk: Vec<Bulk>,
    /// Group of each entry; an entry is a free node of a group.
    group_of_entry: Vec<u32>,
    /// Elements of the group around the entry's node: `slot << 2 | local node` of the pack.
    sources: Table<u32>,
    /// For each upper block the pairs of entries that add to it: row, column.
    pairs: Table<[u32; 2]>,
}

/// Scratch of the groups.
#[derive(Clone, Debug, Default)]
pub(crate) struct AveragingWorkspace {
    /// Volumes and their gradients by pack.
    volumes: Vec<PackVolumes>,
    /// `U'` (Pa) and `U'' / V` (Pa/m³) of each group.
    slopes: Vec<[f64; 2]>,
    /// Whether groups with `U'' < 0` add no blocks.
    filter: bool,
    /// `p_e` (Pa) by pack.
    pub(crate) pressures: Vec<Row>,
    /// `a` of each entry (m²).
    areas: Vec<Vector3<f64>>,
}

/// The free nodes of each group, ascending: they are all coupled.
pub(crate) fn cliques(groups: &Groups, elements: &[[u32; 4]], free_of_node: &[u32]) -> Vec<Vec<u32>> {
    let of_group = |members: &Vec<u32>| {
        let nodes = members.iter().flat_map(|&e| elements[e as usize]).map(|i| free_of_node[i as usize]);
        let mut nodes: Vec<u32> = nodes.filter(|&i| i != FIXED).collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes
    };
    groups.members.iter().map(of_group).collect()
}

impl Averaging {
    /// Lists over groups with their bulk terms; `cliques` as from [`cliques`], held by `pattern`. The packs hold the elements
    /// in their order.
    pub(crate) fn new(
        groups: Groups,
        bulk: Vec<Bulk>,
        cliques: &[Vec<u32>],
        packs: &[Pack],
        free_of_node: &[u32],
        pattern: &BlockPattern,
        upper: &UpperBlocks,
    ) -> Self {
        let share = groups.share;
        let slot_of: Vec<u32> = (0..)
            .zip(packs)
            .flat_map(|(p, pack)| (0..pack.len as u32).map(move |lane| PACK as u32 * p + lane))
            .collect();
        let at = |e: u32| {
            let slot = slot_of[e as usize] as usize;
            (&packs[slot / PACK], slot % PACK)
        };
        let rest_volume = |&e: &u32| {
            let (pack, lane) = at(e);
            pack.volume[lane]
        };
        let volume = groups.members.iter().map(|m| share * m.iter().map(rest_volume).sum::<f64>()).collect();
        let mut groups_of = vec![Vec::new(); PACK * packs.len()];
        for (g, members) in (0..).zip(&groups.members) {
            members.iter().for_each(|&e| groups_of[slot_of[e as usize] as usize].push(g));
        }
        let (mut group_of_entry, mut sources) = (Vec::new(), Vec::new());
        let mut pairs = vec![Vec::new(); upper.count()];
        for (g, (members, nodes)) in groups.members.iter().zip(cliques).enumerate() {
            let first = group_of_entry.len();
            for &node in nodes {
                let around = members.iter().flat_map(|&e| (0..4).map(move |a| (e, a)));
                let of_node = |&(e, a): &(u32, u32)| {
                    let (pack, lane) = at(e);
                    free_of_node[pack.nodes[lane][a as usize] as usize] == node
                };
                sources.push(around.filter(of_node).map(|(e, a)| slot_of[e as usize] << 2 | a).collect());
                group_of_entry.push(g as u32);
            }
            for (i, &row) in nodes.iter().enumerate() {
                for (j, &column) in nodes.iter().enumerate().skip(i) {
                    if let Some(p) = upper.position(pattern, row, column) {
                        pairs[p as usize].push([(first + i) as u32, (first + j) as u32]);
                    }
                }
            }
        }
        Self {
            share,
            members: Table::new(groups.members.into_iter()),
            slot_of,
            groups_of: Table::new(groups_of.into_iter()),
            volume,
            bulk,
            group_of_entry,
            sources: Table::new(sources.into_iter()),
            pairs: Table::new(pairs.into_iter()),
        }
    }

    /// Memory for the groups.
    pub(crate) fn workspace(&self) -> AveragingWorkspace {
        AveragingWorkspace {
            volumes: vec![PackVolumes::ZERO; self.groups_of.rows() / PACK],
            slopes: vec![[0.0; 2]; self.members.rows()],
            filter: false,
            pressures: vec![[0.0; PACK]; self.groups_of.rows() / PACK],
            areas: vec![Vector3::zeros(); self.group_of_entry.len()],
        }
    }

    /// Mean volume ratio of a group from the volumes of the elements.
    fn ratio(&self, g: usize, volume_of: impl Fn(usize) -> f64) -> f64 {
        self.share * self.members.row(g).iter().map(|&e| volume_of(e as usize)).sum::<f64>() / self.volume[g]
    }

    /// Volume ratio that the bulk term of each element sees: the mean of its groups.
    pub(crate) fn ratios(&self, elements: &[Tetrahedron], q: &[Vector3<f64>]) -> Vec<f64> {
        let volume_of = |e: usize| elements[e].edges(q).determinant() / 6.0;
        let of_groups: Vec<f64> = (0..self.volume.len()).map(|g| self.ratio(g, volume_of)).collect();
        let mean = |&slot: &u32| {
            self.share * self.groups_of.row(slot as usize).iter().map(|&g| of_groups[g as usize]).sum::<f64>()
        };
        self.slot_of.iter().map(mean).collect()
    }

    /// Energy of the groups (J).
    pub(crate) fn energy(&self, elements: &[Tetrahedron], q: &[Vector3<f64>]) -> f64 {
        let volume_of = |e: usize| elements[e].edges(q).determinant() / 6.0;
        let of_group = |g: usize| self.volume[g] * self.bulk[g].at(self.ratio(g, volume_of)).value;
        sum_by_halves(0..self.volume.len(), CHUNK, rayon::current_num_threads() > 1, &|groups| {
            groups.map(of_group).sum()
        })
    }

    /// Marks elements of which the filter drops a group, after [`Averaging::pressures`].
    pub(crate) fn mark_dropped(&self, pack: usize, ws: &AveragingWorkspace, filtered: &mut Row) {
        if !ws.filter {
            return;
        }
        for (lane, filtered) in filtered.iter_mut().enumerate() {
            if self.groups_of.row(PACK * pack + lane).iter().any(|&g| ws.slopes[g as usize][1] < 0.0) {
                *filtered = 1.0;
            }
        }
    }

    /// Pressures of the elements; with `filter`, groups with `U'' < 0` will add no blocks.
    pub(crate) fn pressures(
        &self,
        packs: &[Pack],
        q: &[Vector3<f64>],
        filter: bool,
        parallel: bool,
        ws: &mut AveragingWorkspace,
    ) {
        update(parallel, &mut ws.volumes, |p, out| pack_volumes(Arch::new(), &packs[p].at(q), out));
        let volumes = &ws.volumes;
        fill(parallel, &mut ws.slopes, |g| {
            let volume_of = |e: usize| {
                let slot = self.slot_of[e] as usize;
                volumes[slot / PACK].volume[slot % PACK]
            };
            let U = self.bulk[g].at(self.ratio(g, volume_of));
            [U.first, U.second / self.volume[g]]
        });
        ws.filter = filter;
        let slopes = &ws.slopes;
        update(parallel, &mut ws.pressures, |p, pressures| {
            for (lane, pressure) in pressures.iter_mut().enumerate() {
                let groups = self.groups_of.row(PACK * p + lane).iter();
                *pressure = self.share * groups.map(|&g| slopes[g as usize][0]).sum::<f64>();
            }
        });
    }

    /// Adds the blocks of the groups to the upper half, after [`Averaging::pressures`].
    pub(crate) fn add_blocks(&self, parallel: bool, ws: &mut AveragingWorkspace, upper: &mut [Matrix3<f64>]) {
        let volumes = &ws.volumes;
        fill(parallel, &mut ws.areas, |entry| {
            let mut area = Vector3::zeros();
            for &source in self.sources.row(entry) {
                let (slot, a) = ((source >> 2) as usize, (source & 3) as usize);
                let rows = &volumes[slot / PACK].gradients[a];
                for c in 0..3 {
                    area[c] += rows[c][slot % PACK];
                }
            }
            area * self.share
        });
        let (areas, slopes, filter) = (&ws.areas, &ws.slopes, ws.filter);
        update(parallel, upper, |p, block| {
            for &[row, column] in self.pairs.row(p) {
                let [_, stiffness] = slopes[self.group_of_entry[row as usize] as usize];
                let stiffness = if filter && stiffness < 0.0 { 0.0 } else { stiffness };
                *block += (areas[row as usize] * stiffness) * areas[column as usize].transpose();
            }
        });
    }
}

/// Sets every value to that of its place.
fn fill<T: Send>(parallel: bool, values: &mut [T], value: impl Fn(usize) -> T + Sync) {
    update(parallel, values, |i, slot| *slot = value(i));
}

/// Changes every value by its place: the same bits in any order.
fn update<T: Send>(parallel: bool, values: &mut [T], change: impl Fn(usize, &mut T) + Sync) {
    if parallel {
        values.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, values)| {
            values.iter_mut().enumerate().for_each(|(k, value)| change(CHUNK * chunk + k, value));
        });
    } else {
        values.iter_mut().enumerate().for_each(|(i, value)| change(i, value));
    }
}
