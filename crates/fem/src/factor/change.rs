//! What differs between the matrix that was factored and the matrix of the same body after a cut or a change of what is
//! held.

use nalgebra::Vector3;

use crate::sparse::SystemMatrix;

/// `A₁ = A₀ + S N Sᵀ` with `S` the unit columns of the nodes that a change touches, and the nodes that it holds fast.
#[derive(Clone, Debug)]
pub struct MatrixChange {
    capacity: usize,
    nodes: Vec<u32>,
    /// Whether each of the nodes is held fast by the change.
    held: Vec<bool>,
    /// `N`: square, three rows and columns a node, by columns.
    values: Vec<f64>,
    /// Place in `nodes` of each free node, [`NOT_TOUCHED`] for the others.
    place: Vec<u32>,
}

const NOT_TOUCHED: u32 = u32::MAX;

/// Difference of a block, relative to its row's diagonal one, that is none: the same elements summed in another order.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// How a change was taken in.
#[must_use]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChangeStatus {
    /// The change is at hand; it may be none.
    Ok,
    /// More nodes are touched than there is memory for: wait for the next factorisation.
    TooManyNodes {
        /// Nodes that the change has room for.
        capacity: u32,
    },
    /// The matrices are not over the same pattern, or the list of held nodes is not one entry a free node.
    WrongSize,
}

impl MatrixChange {
    /// Memory for changes that touch up to `capacity` of the `free_nodes` nodes of a body.
    pub fn with_capacity(free_nodes: usize, capacity: usize) -> Self {
        let capacity = capacity.min(free_nodes);
        Self {
            capacity,
            nodes: Vec::with_capacity(capacity),
            held: Vec::with_capacity(capacity),
            values: Vec::with_capacity(9 * capacity * capacity),
            place: vec![NOT_TOUCHED; free_nodes],
        }
    }

    /// The most nodes that a change touches.
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// Free nodes that the change touches.
    pub fn nodes(&self) -> &[u32] {
        &self.nodes
    }

    /// For each of [`Self::nodes`]: whether the change holds it fast.
    pub fn held(&self) -> &[bool] {
        &self.held
    }

    /// `N`, three rows and columns a touched node, by columns (the matrix's unit). Rows and columns of held nodes are zero.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// True where there is nothing to change.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Forgets the change and keeps the memory.
    pub fn clear(&mut self) {
        for &node in &self.nodes {
            self.place[node as usize] = NOT_TOUCHED;
        }
        self.nodes.clear();
        self.held.clear();
        self.values.clear();
    }

    /// Takes the change from `before`, the matrix that was factored, to `after`, the matrix of the changed body at the same
    /// configuration. `newly_held` tells for each free node whether it is held in `after` and was free in `before`: what its
    /// row and column are in `after` does not matter. Allocates nothing; where it does not fit, the change is empty.
    pub fn between(&mut self, before: &SystemMatrix, after: &SystemMatrix, newly_held: &[bool]) -> ChangeStatus {
        self.clear();
        let pattern = &before.pattern;
        let n = pattern.rows();
        let fits = after.pattern.rows() == n
            && after.blocks.len() == before.blocks.len()
            && after.pattern.columns() == pattern.columns()
            && newly_held.len() == n
            && self.place.len() == n;
        if !fits {
            return ChangeStatus::WrongSize;
        }
        for i in 0..n {
            let held = newly_held[i];
            let size = |a: &SystemMatrix| pattern.find(i as u32, i as u32).map_or(0.0, |p| a.blocks[p].amax());
            let rounding = ROUNDING * size(before).max(size(after));
            // Written so that NaN differs.
            let same = |p: usize| (after.blocks[p] - before.blocks[p]).iter().all(|d| d.abs() <= rounding);
            let differs = |p: usize| !newly_held[pattern.columns()[p] as usize] && !same(p);
            if !held && !pattern.row(i).any(differs) {
                continue;
            }
            if self.nodes.len() == self.capacity {
                self.clear();
                return ChangeStatus::TooManyNodes { capacity: self.capacity as u32 };
            }
            self.place[i] = self.nodes.len() as u32;
            self.nodes.push(i as u32);
            self.held.push(held);
        }
        let rows = 3 * self.nodes.len();
        self.values.resize(rows * rows, 0.0);
        for (a, &i) in self.nodes.iter().enumerate().filter(|(a, _)| !self.held[*a]) {
            for p in pattern.row(i as usize) {
                let b = self.place[pattern.columns()[p] as usize] as usize;
                // A column whose node is not touched is the same in both matrices.
                if b >= self.nodes.len() || self.held[b] {
                    continue;
                }
                let block = after.blocks[p] - before.blocks[p];
                for c in 0..3 {
                    let column: Vector3<f64> = block.column(c).into();
                    let start = (3 * b + c) * rows + 3 * a;
                    self.values[start..start + 3].copy_from_slice(column.as_slice());
                }
            }
        }
        ChangeStatus::Ok
    }
}
