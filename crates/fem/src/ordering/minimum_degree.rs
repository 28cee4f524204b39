//! Minimum-degree ordering: exact on small subgraphs, faer's AMD on whole graphs.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::SymbolicSparseColMat;
use faer::sparse::linalg::amd;

use crate::sparse::BlockPattern;

/// Orders `nodes` by exact minimum degree. Neighbours outside (the separators around a leaf) count in the degree
/// but are not eliminated, as in the halo of Pellegrini, Roman and Amestoy (2000). Ties go to the earlier node.
pub(super) fn exact(pattern: &BlockPattern, nodes: &[u32]) -> Vec<u32> {
    let mut members: Vec<u32> = nodes.to_vec();
    for &node in nodes {
        members.extend(pattern.columns()[pattern.row(node as usize)].iter().copied());
    }
    members.sort_unstable();
    members.dedup();
    let inside: Vec<bool> = {
        let mut sorted = nodes.to_vec();
        sorted.sort_unstable();
        members.iter().map(|k| sorted.binary_search(k).is_ok()).collect()
    };

    // adjacency of the leaf and its halo as rows of bits
    let words = members.len().div_ceil(64);
    let mut adjacent = vec![0u64; members.len() * words];
    for (i, &node) in members.iter().enumerate().filter(|&(i, _)| inside[i]) {
        for &other in &pattern.columns()[pattern.row(node as usize)] {
            if let (Ok(j), true) = (members.binary_search(&other), other != node) {
                adjacent[i * words + j / 64] |= 1 << (j % 64);
                adjacent[j * words + i / 64] |= 1 << (i % 64);
            }
        }
    }

    let mut order = Vec::with_capacity(nodes.len());
    let mut waiting: Vec<usize> = (0..members.len()).filter(|&i| inside[i]).collect();
    let mut pivot_row = vec![0u64; words];
    while !waiting.is_empty() {
        let degree = |i: usize| adjacent[i * words..(i + 1) * words].iter().map(|w| w.count_ones()).sum::<u32>();
        let Some((place, &pivot)) = waiting.iter().enumerate().min_by_key(|&(_, &i)| (degree(i), i)) else {
            break;
        };
        waiting.remove(place);
        order.push(members[pivot]);
        // eliminating the pivot joins its neighbours to each other
        pivot_row.copy_from_slice(&adjacent[pivot * words..(pivot + 1) * words]);
        for j in (0..members.len()).filter(|j| pivot_row[j / 64] >> (j % 64) & 1 == 1) {
            let row = &mut adjacent[j * words..(j + 1) * words];
            for (word, pivot_word) in row.iter_mut().zip(&pivot_row) {
                *word |= pivot_word;
            }
            row[j / 64] &= !(1 << (j % 64));
            row[pivot / 64] &= !(1 << (pivot % 64));
        }
    }
    order
}

/// Orders `nodes` by approximate minimum degree in their own subgraph; `None` if faer refuses (the graph exceeds its
/// index type).
pub(super) fn approximate(pattern: &BlockPattern, nodes: &[u32]) -> Option<Vec<u32>> {
    let n = nodes.len();
    let mut local = vec![u32::MAX; pattern.rows()];
    for (i, &node) in nodes.iter().enumerate() {
        local[node as usize] = i as u32;
    }
    let mut column_start = vec![0u32];
    let mut rows: Vec<u32> = Vec::new();
    for &node in nodes {
        let start = rows.len();
        let neighbours = &pattern.columns()[pattern.row(node as usize)];
        rows.extend(neighbours.iter().map(|&j| local[j as usize]).filter(|&j| j != u32::MAX));
        rows[start..].sort_unstable();
        column_start.push(u32::try_from(rows.len()).ok()?);
    }
    let mut memory = MemBuffer::new(amd::order_scratch::<u32>(n, rows.len()));
    let graph = SymbolicSparseColMat::new_checked(n, n, column_start, None, rows);
    let mut order = vec![0u32; n];
    let mut inverse = vec![0u32; n];
    amd::order(&mut order, &mut inverse, graph.as_ref(), amd::Control::default(), MemStack::new(&mut memory)).ok()?;
    Some(order.into_iter().map(|i| nodes[i as usize]).collect())
}
