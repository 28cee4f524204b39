//! What the step hands to the tick: the local contact problem, in memory of fixed size.
//!
//! ```text
//! δ = W λ + δ_free + J (tool pose − reference pose)          m, per row
//! ```
//! `tool_rows` holds J: for each row, the direction of the force on the tool per unit λ (−, 3 entries) and of the
//! torque about the tool's origin (m, 3 entries), both in world axes. The same six numbers take a twist of the tool to
//! the rate of the gap, so the wrench on the tool is Jᵀ λ. A row between two bodies has zeros there, and acts on the
//! tool through W alone.
//!
//! Beside these rows, which are frozen from one step to the next, a snapshot may carry the tissue around the tool
//! ([`HapticPatch`]), on which the tick finds contacts anew each time.
//!
//! The step fills it in place: [`HapticSnapshot::clear`], then [`HapticSnapshot::push`] for each contact, then
//! [`HapticSnapshot::compliance_mut`] and the public fields. Nothing is allocated after [`HapticSnapshot::new`]; a
//! clone has the same capacity.

use nalgebra::Isometry3;
use palpate_collision::ToolPose;
use palpate_constraints::law::Law;
use palpate_solver::problem::Block;

use crate::patch::HapticPatch;

/// Most rows that one law couples.
pub const ROWS_PER_CONTACT: usize = palpate_constraints::law::MAX_BLOCK_ROWS;

/// One contact, as it is pushed.
#[derive(Clone, Copy, Debug)]
pub struct SnapshotContact<'a> {
    /// Its law; says how many rows there are.
    pub law: Law,
    /// Identity of the contact from step to step: the same pair of features has the same number.
    pub feature: u64,
    /// J, one line a row.
    pub tool_rows: &'a [[f64; 6]],
    /// δ_free at the reference tool pose \[m\], one a row.
    pub delta_free: &'a [f64],
    /// λ that the step found \[N\], one a row: where the tick starts when it does not know the contact.
    pub lambda: &'a [f64],
}

/// The local problem of one step.
#[derive(Clone, Debug, PartialEq)]
pub struct HapticSnapshot {
    /// Number of the step that made it; a new number is a new snapshot.
    pub step: u64,
    /// Time of the step's end \[s\].
    pub time: f64,
    /// The step's length h \[s\].
    pub dt: f64,
    /// Whether the step was sound. If not, the tick sends no force.
    pub valid: bool,
    /// Tool pose that `delta_free` is for.
    pub tool_pose: Isometry3<f64>,
    /// Opening of the tool's jaws that it is for \[rad\]; 0 for a tool without.
    pub opening: f64,
    /// The numbering of the skin's edges and triangles that features are named by, counted by the cuts before it. Where it is
    /// another than that of the snapshot before, so are the names; nodes keep theirs.
    pub numbering: u32,
    /// Epoch of the factor behind W.
    pub factor_epoch: u64,
    /// Its age when the step used it \[s\].
    pub factor_age: f64,
    /// Contacts of the step that found no room here.
    pub dropped: u32,
    /// The tissue around the tool.
    pub patch: HapticPatch,
    contacts: usize,
    rows: usize,
    blocks: Vec<Block>,
    features: Vec<u64>,
    tool_rows: Vec<[f64; 6]>,
    gripper_rows: Vec<f64>,
    delta_free: Vec<f64>,
    lambda: Vec<f64>,
    w: Vec<f64>,
}

impl HapticSnapshot {
    /// An empty snapshot, not valid, with room for `max_contacts` contacts of three rows and for no patch.
    #[must_use]
    pub fn new(max_contacts: usize) -> Self {
        Self::with_patch(max_contacts, 0)
    }

    /// An empty snapshot, not valid, with room for `max_contacts` contacts of three rows and a patch of `max_nodes` nodes.
    #[must_use]
    pub fn with_patch(max_contacts: usize, max_nodes: usize) -> Self {
        Self::with_bodies(max_contacts, max_nodes, 0)
    }

    /// The same with a patch that has room for so many contacts of fixed and rigid bodies.
    #[must_use]
    pub fn with_bodies(max_contacts: usize, max_nodes: usize, max_bodies: usize) -> Self {
        let rows = ROWS_PER_CONTACT * max_contacts;
        let no_block = Block { start: 0, law: palpate_constraints::law::Signorini.into() };
        Self {
            step: 0,
            time: 0.0,
            dt: 0.0,
            valid: false,
            tool_pose: Isometry3::identity(),
            opening: 0.0,
            numbering: 0,
            factor_epoch: 0,
            factor_age: 0.0,
            dropped: 0,
            patch: HapticPatch::with_bodies(max_nodes, max_bodies),
            contacts: 0,
            rows: 0,
            blocks: vec![no_block; max_contacts],
            features: vec![0; max_contacts],
            tool_rows: vec![[0.0; 6]; rows],
            gripper_rows: vec![0.0; rows],
            delta_free: vec![0.0; rows],
            lambda: vec![0.0; rows],
            w: vec![0.0; rows * rows],
        }
    }

    /// Contacts that fit.
    #[must_use]
    pub fn max_contacts(&self) -> usize {
        self.blocks.len()
    }

    /// Takes all contacts out and marks the snapshot as not valid.
    pub fn clear(&mut self) {
        self.contacts = 0;
        self.rows = 0;
        self.dropped = 0;
        self.valid = false;
        self.patch.clear();
    }

    /// Adds a contact. Returns false, and counts it in `dropped`, if there is no room or if the slices do not have the
    /// law's number of rows. Push the deepest first.
    pub fn push(&mut self, contact: &SnapshotContact<'_>) -> bool {
        let (begin, rows) = (self.rows, contact.law.rows());
        let lengths = [contact.tool_rows.len(), contact.delta_free.len(), contact.lambda.len()];
        if self.contacts == self.max_contacts() || rows > ROWS_PER_CONTACT || lengths != [rows; 3] {
            self.dropped = self.dropped.saturating_add(1);
            return false;
        }
        self.blocks[self.contacts] = Block { start: begin, law: contact.law };
        self.features[self.contacts] = contact.feature;
        self.tool_rows[begin..begin + rows].copy_from_slice(contact.tool_rows);
        self.gripper_rows[begin..begin + rows].fill(0.0);
        self.delta_free[begin..begin + rows].copy_from_slice(contact.delta_free);
        self.lambda[begin..begin + rows].copy_from_slice(contact.lambda);
        self.contacts += 1;
        self.rows += rows;
        true
    }

    /// W \[m/N\], `rows() × rows()` without padding, to be filled after the last push; symmetric, so by rows and by
    /// columns are the same. Holds old numbers.
    pub fn compliance_mut(&mut self) -> &mut [f64] {
        &mut self.w[..self.rows * self.rows]
    }

    /// Makes this a copy of `other` without allocating. Returns false, and is left cleared, if `other` does not fit.
    pub fn copy_from(&mut self, other: &Self) -> bool {
        self.clear();
        if other.contacts > self.max_contacts() || !self.patch.copy_from(&other.patch) {
            return false;
        }
        (self.contacts, self.rows, self.dropped) = (other.contacts, other.rows, other.dropped);
        (self.step, self.time, self.dt, self.valid) = (other.step, other.time, other.dt, other.valid);
        (self.tool_pose, self.factor_epoch, self.factor_age) = (other.tool_pose, other.factor_epoch, other.factor_age);
        (self.opening, self.numbering) = (other.opening, other.numbering);
        self.gripper_rows[..self.rows].copy_from_slice(other.gripper_rows());
        self.blocks[..self.contacts].copy_from_slice(other.blocks());
        self.features[..self.contacts].copy_from_slice(other.features());
        self.tool_rows[..self.rows].copy_from_slice(other.tool_rows());
        self.delta_free[..self.rows].copy_from_slice(other.delta_free());
        self.lambda[..self.rows].copy_from_slice(other.lambda());
        self.compliance_mut().copy_from_slice(other.compliance());
        true
    }

    /// Number of contacts.
    #[must_use]
    pub fn contacts(&self) -> usize {
        self.contacts
    }

    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// First row and law of each contact.
    #[must_use]
    pub fn blocks(&self) -> &[Block] {
        &self.blocks[..self.contacts]
    }

    /// Identity of each contact.
    #[must_use]
    pub fn features(&self) -> &[u64] {
        &self.features[..self.contacts]
    }

    /// J, one line a row.
    #[must_use]
    pub fn tool_rows(&self) -> &[[f64; 6]] {
        &self.tool_rows[..self.rows]
    }

    /// Rate of the gap per rad that the jaws open \[m\], one a row: the torque on the opening per unit λ.
    #[must_use]
    pub fn gripper_rows(&self) -> &[f64] {
        &self.gripper_rows[..self.rows]
    }

    /// The same, to be filled after the last push; zero until then.
    pub fn gripper_rows_mut(&mut self) -> &mut [f64] {
        &mut self.gripper_rows[..self.rows]
    }

    /// Tool pose with the opening of its jaws.
    #[must_use]
    pub fn tool(&self) -> ToolPose {
        ToolPose { frame: self.tool_pose, opening: self.opening }
    }

    /// δ_free at the reference tool pose \[m\].
    #[must_use]
    pub fn delta_free(&self) -> &[f64] {
        &self.delta_free[..self.rows]
    }

    /// λ that the step found \[N\].
    #[must_use]
    pub fn lambda(&self) -> &[f64] {
        &self.lambda[..self.rows]
    }

    /// W \[m/N\], `rows() × rows()`, symmetric.
    #[must_use]
    pub fn compliance(&self) -> &[f64] {
        &self.w[..self.rows * self.rows]
    }
}
