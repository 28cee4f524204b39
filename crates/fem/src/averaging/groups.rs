//! Which elements share a mean volume ratio.

use serde::{Deserialize, Serialize};

use crate::mesh::sorted_faces;

/// Elements of a patch, about: a mesh has five to six elements per node, so eight leave one constraint of volume per four
/// or five unknowns. With few elements per constraint the body locks, with many the pressure is coarse.
const PATCH: usize = 8;

/// How elements are grouped.
///
/// The convergence study (`cargo run --release -p palpate-fem --example element_study`) favours patches, the default. At
/// Poisson's ratio 0.499 and equal unknowns their error in displacement is that at 0.3 (1.17e-1 against 1.14e-1 with 12 cells
/// along an edge; groups around nodes 1.21e-1, quadratic elements 2.06e-1, linear ones 8.7e-1), and stays so at 0.4999;
/// the pressure is half as far off as with groups around nodes, which begin to oscillate there; and the factor holds 1.1
/// times the numbers of that of linear elements, rather than 2.6 times. Groups around nodes are kept to compare with:
/// they are what explicit codes use, where no matrix fills, and do not depend on how elements are numbered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Grouping {
    /// Disjoint patches of about eight elements that hang together by faces [de Souza Neto, Andrade Pires, Owen 2005].
    #[default]
    Patches,
    /// One group around each node; an element gives a quarter of its volume to each of its four [Bonet, Burton 1998].
    Nodes,
}

/// Groups of elements, none across two materials. Every element gives all its volume, in equal shares.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Groups {
    /// Share of an element's volume that it gives to each of its groups.
    pub(crate) share: f64,
    /// Elements of each group, ascending.
    pub(crate) members: Vec<Vec<u32>>,
}

impl Groups {
    /// Groups over elements of which each run belongs to one material.
    pub(crate) fn new(grouping: Grouping, tetrahedra: &[[u32; 4]], runs: &[std::ops::Range<usize>]) -> Self {
        match grouping {
            Grouping::Nodes => Self { share: 0.25, members: around_nodes(tetrahedra, runs) },
            Grouping::Patches => Self { share: 1.0, members: patches(tetrahedra, runs) },
        }
    }
}

fn around_nodes(tetrahedra: &[[u32; 4]], runs: &[std::ops::Range<usize>]) -> Vec<Vec<u32>> {
    let mut members = Vec::new();
    for run in runs {
        let mut pairs: Vec<(u32, u32)> = run.clone().flat_map(|e| tetrahedra[e].map(|node| (node, e as u32))).collect();
        pairs.sort_unstable();
        members.extend(pairs.chunk_by(|a, b| a.0 == b.0).map(|group| group.iter().map(|pair| pair.1).collect()));
    }
    members
}

const NONE: u32 = u32::MAX;

fn patches(tetrahedra: &[[u32; 4]], runs: &[std::ops::Range<usize>]) -> Vec<Vec<u32>> {
    let mut neighbours = vec![[NONE; 4]; tetrahedra.len()];
    let run_of = |e: u32| runs.partition_point(|run| run.end <= e as usize);
    for pair in sorted_faces(tetrahedra).windows(2).filter(|pair| pair[0].0 == pair[1].0) {
        let (a, b) = (&pair[0], &pair[1]);
        if run_of(a.2) == run_of(b.2) {
            neighbours[a.2 as usize][usize::from(a.3)] = b.2;
            neighbours[b.2 as usize][usize::from(b.3)] = a.2;
        }
    }
    let mut patch_of = vec![NONE; tetrahedra.len()];
    let mut members: Vec<Vec<u32>> = Vec::new();
    for seed in 0..tetrahedra.len() as u32 {
        if patch_of[seed as usize] != NONE {
            continue;
        }
        let patch = grow(seed, tetrahedra, &neighbours, &patch_of);
        // A remainder joins the smallest patch next to it.
        let beside = patch.iter().flat_map(|&e| neighbours[e as usize]).filter(|&n| n != NONE);
        let smallest =
            beside.map(|n| patch_of[n as usize]).filter(|&p| p != NONE).min_by_key(|&p| (members[p as usize].len(), p));
        let number = match smallest {
            Some(other) if 2 * patch.len() < PATCH => other,
            _ => {
                members.push(Vec::new());
                members.len() as u32 - 1
            }
        };
        patch.iter().for_each(|&e| patch_of[e as usize] = number);
        members[number as usize].extend(patch);
        members[number as usize].sort_unstable();
    }
    members
}

/// A compact patch from a seed over elements that are in none: each next element shares most nodes with the patch.
fn grow(seed: u32, tetrahedra: &[[u32; 4]], neighbours: &[[u32; 4]], patch_of: &[u32]) -> Vec<u32> {
    let mut patch = vec![seed];
    let mut nodes = tetrahedra[seed as usize].to_vec();
    while patch.len() < PATCH {
        let free = |&n: &u32| n != NONE && patch_of[n as usize] == NONE && !patch.contains(&n);
        let around = patch.iter().flat_map(|&e| neighbours[e as usize]).filter(free);
        let shared = |n: u32| tetrahedra[n as usize].iter().filter(|node| nodes.contains(node)).count();
        let Some(next) = around.max_by_key(|&n| (shared(n), std::cmp::Reverse(n))) else { break };
        patch.push(next);
        nodes.extend(tetrahedra[next as usize]);
    }
    patch
}
