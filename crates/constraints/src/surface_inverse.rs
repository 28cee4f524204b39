//! Precomputed compliance of the skin: `A₀⁻¹` between the nodes that can be touched.
//!
//! ```text
//! C₀ = S A₀⁻¹ Sᵀ                    made once, from a factor of A₀
//! W  = h² (H R) C₀ (H R)ᵀ           gathered: only the blocks of touched nodes are read
//! ```
//! (Saupin, Duriez, Cotin, Grisoni, CGI 2008.) A row touches one to three nodes, so that `W` costs some thousand products
//! of 3 x 3 blocks, microseconds, whatever the size of the body; half solves with the same factor cost milliseconds. The
//! correction belongs to the whole body and is one solve with the factor that `C₀` was made from: the same `A₀`.
//!
//! Of the symmetric matrix one triangle is kept, in single precision: 18 bytes per pair of nodes where a full matrix in
//! double precision takes 72. Its rounding, 6e-8 of an entry, is far below the error of an inverse that is old; the error
//! is relative to each entry and the matrix stays symmetric to the bit.

use nalgebra::{DMatrixViewMut, Vector3};
use palpate_fem::factor::{Factor, SolveWorkspace};
use palpate_fem::nodal_rows::NodalRows;

/// A 3 x 3 block by columns.
type Block = [f32; 9];

/// Nodes whose columns are solved for together.
const NODES_AT_ONCE: usize = 16;

/// No place.
const NONE: u32 = u32::MAX;

/// Why there is no precomputed compliance.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SurfaceInverseError {
    /// It would take too much memory.
    #[error(
        "the inverse between {nodes} nodes of the skin takes {:.0} MB, more than the {:.0} MB that it may take; \
         allow it more, or leave W to half solves",
        *bytes as f64 / 1e6,
        *most as f64 / 1e6
    )]
    TooLarge {
        /// Nodes that can be touched.
        nodes: usize,
        /// What they would take.
        bytes: usize,
        /// What was allowed.
        most: usize,
    },
    /// A node is not one of the factor's.
    #[error("node {node} is not one of the {nodes} free nodes of the factor; name free nodes by their numbers")]
    UnknownNode {
        /// The node.
        node: u32,
        /// Free nodes of the factor.
        nodes: usize,
    },
    /// The factor has no valid numbers.
    #[error("there is no valid factor to invert; factor the matrix first")]
    InvalidFactor,
}

/// `C₀ = S A₀⁻¹ Sᵀ` (1/kg) of chosen free nodes.
#[derive(Clone, Debug)]
pub struct SurfaceInverse {
    /// Where each free node is among the chosen ones.
    place: Vec<u32>,
    nodes: usize,
    /// Lower triangle of blocks by rows: block `(i, j)`, `j ≤ i`, at `i (i + 1) / 2 + j`.
    blocks: Vec<Block>,
    /// The factor's revision.
    revision: u64,
}

/// Memory for gathering, and the rows that it was done for.
#[derive(Clone, Debug)]
pub struct GatherWorkspace {
    /// Where each chosen node is among the touched ones of the rows at hand.
    slot: Vec<u32>,
    /// The touched ones, in order of their first row.
    touched: Vec<u32>,
    /// `C₀ Hᵀ` of one row on the touched nodes.
    column: Vec<Vector3<f64>>,
    rows: NodalRows,
}

impl GatherWorkspace {
    /// Memory for up to `rows` rows of up to three nodes.
    pub fn new(inverse: &SurfaceInverse, rows: usize) -> Self {
        let touched = inverse.nodes.min(3 * rows);
        Self {
            slot: vec![NONE; inverse.nodes],
            touched: Vec::with_capacity(touched),
            column: vec![Vector3::zeros(); touched],
            rows: NodalRows::with_capacity(rows, 3),
        }
    }

    /// The rows of the latest gathering.
    pub fn rows(&self) -> &NodalRows {
        &self.rows
    }
}

impl SurfaceInverse {
    /// What the inverse between `nodes` nodes takes (bytes).
    pub fn bytes(nodes: usize) -> usize {
        nodes * (nodes + 1) / 2 * size_of::<Block>()
    }

    /// Inverts a factor between `nodes`, free nodes in any order, each once: `3 x nodes` solves. Takes at most `most` bytes.
    ///
    /// # Errors
    /// More memory than allowed, a node that the factor does not have, or a factor without numbers.
    pub fn new(factor: &Factor, nodes: &[u32], most: usize) -> Result<Self, SurfaceInverseError> {
        let symbolic = factor.symbolic();
        let unknowns = symbolic.degrees_of_freedom();
        let bytes = Self::bytes(nodes.len());
        if bytes > most {
            return Err(SurfaceInverseError::TooLarge { nodes: nodes.len(), bytes, most });
        }
        let mut place = vec![NONE; unknowns / 3];
        for (k, &node) in nodes.iter().enumerate() {
            let unknown = SurfaceInverseError::UnknownNode { node, nodes: unknowns / 3 };
            *place.get_mut(node as usize).ok_or(unknown)? = k as u32;
        }
        let mut blocks = vec![Block::default(); nodes.len() * (nodes.len() + 1) / 2];
        let width = NODES_AT_ONCE.min(nodes.len());
        let mut ws = SolveWorkspace::with_columns(symbolic, 3 * width);
        let mut columns = vec![0.0; 3 * width * unknowns];
        for begin in (0..nodes.len()).step_by(width.max(1)) {
            let some = &nodes[begin..nodes.len().min(begin + width)];
            let columns = &mut columns[..3 * some.len() * unknowns];
            columns.fill(0.0);
            for (column, k) in columns.chunks_exact_mut(unknowns).zip(0..) {
                column[3 * some[k / 3] as usize + k % 3] = 1.0;
            }
            if !factor.solve_columns(columns, &mut ws).is_ok() {
                return Err(SurfaceInverseError::InvalidFactor);
            }
            for (three, j) in columns.chunks_exact(3 * unknowns).zip(begin..) {
                for i in j..nodes.len() {
                    let entry = |r: usize, c: usize| three[c * unknowns + 3 * nodes[i] as usize + r];
                    let block = &mut blocks[i * (i + 1) / 2 + j];
                    for (c, column) in block.chunks_exact_mut(3).enumerate() {
                        for (r, to) in column.iter_mut().enumerate() {
                            // A solve rounds (r, c) of a block on the diagonal otherwise than (c, r).
                            let mirrored = if i == j { entry(c, r) } else { entry(r, c) };
                            *to = (0.5 * (entry(r, c) + mirrored)) as f32;
                        }
                    }
                }
            }
        }
        Ok(Self { place, nodes: nodes.len(), blocks, revision: factor.revision() })
    }

    /// Nodes between which it is known.
    pub fn nodes(&self) -> usize {
        self.nodes
    }

    /// Whether it was made from this factor, as it is now.
    pub fn is_of(&self, factor: &Factor) -> bool {
        self.revision == factor.revision() && factor.is_valid()
    }

    /// Whether all nodes of the rows are known.
    pub fn covers(&self, rows: &NodalRows) -> bool {
        (0..rows.len()).all(|r| rows.row(r).all(|(node, _)| self.place_of(node) != NONE))
    }

    fn place_of(&self, node: u32) -> u32 {
        self.place.get(node as usize).copied().unwrap_or(NONE)
    }

    /// `C₀` of the places `i` and `j` times a vector at `j`.
    fn apply(&self, i: u32, j: u32, x: &Vector3<f64>) -> Vector3<f64> {
        let (low, high) = (i.min(j) as usize, i.max(j) as usize);
        let Some(b) = self.blocks.get(high * (high + 1) / 2 + low) else { return Vector3::zeros() };
        let b = b.map(f64::from);
        if i < j {
            Vector3::new(
                b[0] * x.x + b[1] * x.y + b[2] * x.z,
                b[3] * x.x + b[4] * x.y + b[5] * x.z,
                b[6] * x.x + b[7] * x.y + b[8] * x.z,
            )
        } else {
            Vector3::new(
                b[0] * x.x + b[3] * x.y + b[6] * x.z,
                b[1] * x.x + b[4] * x.y + b[7] * x.z,
                b[2] * x.x + b[5] * x.y + b[8] * x.z,
            )
        }
    }

    /// `w = scale H C₀ Hᵀ` of an `m x m` matrix, symmetric to the bit; false where a row touches a node that is not known,
    /// or where there is no room. Allocates nothing. The rows stay in the workspace for a correction.
    pub fn gather_into(
        &self,
        rows: &NodalRows,
        scale: f64,
        mut w: DMatrixViewMut<'_, f64>,
        ws: &mut GatherWorkspace,
    ) -> bool {
        let m = rows.len();
        ws.rows.clear();
        if w.shape() != (m, m) || ws.slot.len() != self.nodes || !self.covers(rows) {
            return false;
        }
        ws.touched.clear();
        let mut room = true;
        for s in 0..m {
            ws.rows.push_row(rows.row(s));
            for (node, _) in rows.row(s) {
                let place = self.place_of(node);
                let slot = &mut ws.slot[place as usize];
                if *slot == NONE && ws.touched.len() < ws.column.len() {
                    *slot = ws.touched.len() as u32;
                    ws.touched.push(place);
                }
                room &= *slot != NONE;
            }
            if !room {
                break;
            }
            // Rows up to this one touch the nodes known so far and no others.
            for (y, &i) in ws.column.iter_mut().zip(&ws.touched) {
                *y = rows.row(s).map(|(node, value)| self.apply(i, self.place_of(node), &value)).sum();
            }
            for r in 0..=s {
                let at = |node: u32| ws.column[ws.slot[self.place_of(node) as usize] as usize];
                let value = scale * rows.row(r).map(|(node, value)| value.dot(&at(node))).sum::<f64>();
                (w[(r, s)], w[(s, r)]) = (value, value);
            }
        }
        ws.touched.iter().for_each(|&place| ws.slot[place as usize] = NONE);
        room
    }
}
