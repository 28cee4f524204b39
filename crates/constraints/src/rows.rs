//! Rows of contacts between tissue and tool.
//!
//! A contact joins the tissue point `x = Σ w_k q_k` with the point of the tool at the same place. Along a direction `d`
//! of its frame, the velocity of the gap is that of the tissue point as seen from the tool,
//!
//! ```text
//! δ̇ = d · (Σ w_k v_k) - d · (v_tool + ω x r),      r = x - reference point of the tool
//!   = H v + force · v_tool + torque · ω,            force = -d,  torque = -(r x d)
//! ```
//!
//! so the tissue's row is `w_k d` at node `k`, and [`ToolRow`] is the rest. By virtual power a row force `λ` \[N\] puts
//! `w_k d λ` on node `k` and the wrench `(force λ, torque λ)` on the tool about its reference point. Both act at `x`:
//! the forces add up to zero, and so do their moments about any point. `d` points from the tool to the tissue, so a
//! positive normal force pushes the tissue away and the tool back.
//!
//! `δ_free` \[m\] is the gap at the end of the step if nothing touched. The tool is already at its pose of the end of the
//! step when the gap is measured, the tissue still at its beginning:
//!
//! ```text
//! normal:   δ_free = gap + H (q_free - q)                q_free - q = h v_free
//! tangents: δ_free = H (q_free - q) - d · u              u = displacement of the tool's point during the step
//! ```
//!
//! `u` is taken exactly from the two poses rather than as `force · translation + torque · rotation`, from which it
//! differs by `|rotation|² |r| / 2`: 5 % of the path of a tool that turns by 0.1 rad a step.
//! Nodes without a row in the system (fixed) do not move and get no entry. A contact on fixed nodes alone has no
//! compliance of its own: it is no part of the tissue's problem, where its force has no bound, and its rows are built
//! apart by [`build_fixed_rows`] for a problem in which the tool yields.

use nalgebra::{Isometry3, Matrix3, Vector3};
use palpate_collision::Contact;
use palpate_fem::nodal_rows::NodalRows;
use palpate_fem::sparse::FIXED;

use crate::frame::ContactFrame;

/// The tool's part of a row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolRow {
    /// `-d`: change of the row's gap per metre of the tool's translation [-]; force on the tool per newton of the row.
    pub force: Vector3<f64>,
    /// `-(r x d)` \[m\]: change of the row's gap per radian of the tool's rotation about its reference point; torque on
    /// the tool about that point per newton of the row.
    pub torque: Vector3<f64>,
}

impl ToolRow {
    /// The row of direction `d` (unit vector) at lever `r` \[m\] from the tool's reference point.
    pub fn new(direction: &Vector3<f64>, lever: &Vector3<f64>) -> Self {
        Self { force: -direction, torque: -lever.cross(direction) }
    }

    /// Velocity of the row's gap [m/s] from the tool's velocity [m/s] and angular velocity [rad/s].
    pub fn dot(&self, velocity: &Vector3<f64>, angular_velocity: &Vector3<f64>) -> f64 {
        self.force.dot(velocity) + self.torque.dot(angular_velocity)
    }
}

/// A wrench on a tool about its reference point, in the world frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ToolWrench {
    /// Force \[N\].
    pub force: Vector3<f64>,
    /// Torque about the reference point [N m].
    pub torque: Vector3<f64>,
}

/// How a tool moved during a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolMotion {
    translation: Vector3<f64>,
    /// `1 - Rᵀ` for the rotation `R` of the step: a lever at the end of the step times this is its displacement.
    turn: Matrix3<f64>,
}

impl ToolMotion {
    /// A tool at rest.
    pub fn none() -> Self {
        Self { translation: Vector3::zeros(), turn: Matrix3::zeros() }
    }

    /// The motion from one pose to another.
    pub fn between(previous: &Isometry3<f64>, current: &Isometry3<f64>) -> Self {
        let step = current.rotation * previous.rotation.inverse();
        Self {
            translation: current.translation.vector - previous.translation.vector,
            turn: Matrix3::identity() - step.inverse().to_rotation_matrix().into_inner(),
        }
    }

    /// Displacement \[m\] during the step of the tool's point that ends it at `lever` \[m\] from the reference point.
    pub fn displacement(&self, lever: &Vector3<f64>) -> Vector3<f64> {
        self.translation + self.turn * lever
    }
}

/// The rows of one contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RowBlock {
    /// Position of the contact in the list it was built from.
    pub contact: u32,
    /// First row.
    pub first_row: u32,
    /// 1 (normal) or 3 (normal and two tangents).
    pub rows: u32,
}

impl RowBlock {
    /// The rows as a range.
    pub fn range(&self) -> std::ops::Range<usize> {
        self.first_row as usize..(self.first_row + self.rows) as usize
    }
}

/// Rows of the contacts of one body. Workspace: refilled at every step.
#[derive(Clone, Debug)]
pub struct ContactRows {
    /// `H` over the free nodes of the body [-].
    pub tissue: NodalRows,
    /// The tool's part of each row.
    pub tool: Vec<ToolRow>,
    /// `δ_free` of each row \[m\].
    pub delta_free: Vec<f64>,
    /// One block per contact that has rows.
    pub blocks: Vec<RowBlock>,
    /// Frame of each block.
    pub frames: Vec<ContactFrame>,
    capacity: usize,
}

impl ContactRows {
    /// Memory for `contacts` contacts with three rows each.
    pub fn with_capacity(contacts: usize) -> Self {
        Self {
            tissue: NodalRows::with_capacity(3 * contacts, 3),
            tool: Vec::with_capacity(3 * contacts),
            delta_free: Vec::with_capacity(3 * contacts),
            blocks: Vec::with_capacity(contacts),
            frames: Vec::with_capacity(contacts),
            capacity: contacts,
        }
    }

    /// Removes all rows and keeps the memory.
    pub fn clear(&mut self) {
        self.tissue.clear();
        self.tool.clear();
        self.delta_free.clear();
        self.blocks.clear();
        self.frames.clear();
    }

    /// Number of rows `m`.
    pub fn len(&self) -> usize {
        self.delta_free.len()
    }

    /// True without rows.
    pub fn is_empty(&self) -> bool {
        self.delta_free.is_empty()
    }

    /// The wrench on the tool from row forces `λ` \[N\]: what the tissue does to the tool.
    pub fn wrench(&self, lambda: &[f64]) -> ToolWrench {
        let mut wrench = ToolWrench::default();
        for (row, l) in self.tool.iter().zip(lambda) {
            wrench.force += row.force * *l;
            wrench.torque += row.torque * *l;
        }
        wrench
    }
}

/// What rows are built from, besides the contacts.
#[derive(Clone, Copy, Debug)]
pub struct RowInput<'a> {
    /// Free node of each node of the body, or [`FIXED`].
    pub free_of_node: &'a [u32],
    /// Free velocity of the free nodes [m/s], three numbers each.
    pub v_free: &'a [f64],
    /// Step `h` \[s\].
    pub dt: f64,
    /// Reference point of the tool at the end of the step: the translation of its pose \[m\].
    pub tool_reference: Vector3<f64>,
    /// Motion of the tool during the step.
    pub tool_motion: ToolMotion,
    /// Three rows a contact with friction, one without.
    pub friction: bool,
}

/// What became of the contacts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RowReport {
    /// Contacts that got rows.
    pub contacts: usize,
    /// Rows built.
    pub rows: usize,
    /// Contacts on fixed nodes alone: nothing there can move; see [`build_fixed_rows`].
    pub rigid: usize,
    /// Contacts beyond the capacity stated at set-up.
    pub dropped: usize,
    /// Contacts with a number that is not finite or a node that the body does not have.
    pub invalid: usize,
}

/// Replaces the rows by those of `contacts`, in their order.
pub fn build_rows(contacts: &[Contact], input: &RowInput, rows: &mut ContactRows) -> RowReport {
    rows.clear();
    append_rows(contacts, input, rows)
}

/// Appends the rows of `contacts`, in their order: for a second tool on the same body.
///
/// `contact` in the new blocks counts within `contacts`.
pub fn append_rows(contacts: &[Contact], input: &RowInput, rows: &mut ContactRows) -> RowReport {
    let mut report = RowReport::default();
    for (index, contact) in contacts.iter().enumerate() {
        let Some(support) = Support::new(contact, input) else {
            report.invalid += 1;
            continue;
        };
        if support.len == 0 {
            report.rigid += 1;
            continue;
        }
        if rows.blocks.len() == rows.capacity {
            report.dropped += 1;
            continue;
        }
        report.contacts += 1;
        report.rows += push_contact(index, contact, &support, input, rows);
    }
    report
}

/// Replaces the rows by those of the contacts on fixed nodes alone, in their order; the tissue's part of each is empty.
///
/// Returns how many contacts got rows: all of them, up to the capacity.
pub fn build_fixed_rows(contacts: &[Contact], input: &RowInput, rows: &mut ContactRows) -> usize {
    rows.clear();
    for (index, contact) in contacts.iter().enumerate() {
        match Support::new(contact, input) {
            Some(support) if support.len == 0 && rows.blocks.len() < rows.capacity => {
                push_contact(index, contact, &support, input, rows);
            }
            _ => {}
        }
    }
    rows.blocks.len()
}

/// Appends the rows of one contact and returns their number.
fn push_contact(index: usize, contact: &Contact, support: &Support, input: &RowInput, rows: &mut ContactRows) -> usize {
    let frame = ContactFrame::new(contact.normal);
    let lever = contact.tissue_point - input.tool_reference;
    let tissue_motion = support.velocity * input.dt;
    let tool_motion = input.tool_motion.displacement(&lever);
    let count = if input.friction { 3 } else { 1 };
    rows.blocks.push(RowBlock { contact: index as u32, first_row: rows.len() as u32, rows: count });
    rows.frames.push(frame);
    for (k, d) in frame.directions().iter().enumerate().take(count as usize) {
        rows.tissue.push_row(support.entries().map(|(node, weight)| (node, d * weight)));
        rows.tool.push(ToolRow::new(d, &lever));
        let free_motion = d.dot(&tissue_motion);
        rows.delta_free.push(if k == 0 { contact.gap + free_motion } else { free_motion - d.dot(&tool_motion) });
    }
    count as usize
}

/// The free nodes that carry a contact, each once, and the velocity of its point in the free motion.
struct Support {
    nodes: [(u32, f64); 3],
    len: usize,
    velocity: Vector3<f64>,
}

impl Support {
    /// None where a node is unknown or a number is not finite.
    fn new(contact: &Contact, input: &RowInput) -> Option<Self> {
        let finite =
            contact.gap.is_finite() && contact.normal.iter().chain(contact.tissue_point.iter()).all(|x| x.is_finite());
        if !finite {
            return None;
        }
        let mut support = Self { nodes: [(0, 0.0); 3], len: 0, velocity: Vector3::zeros() };
        for (&node, &weight) in contact.nodes.iter().zip(&contact.weights) {
            let free = *input.free_of_node.get(node as usize)?;
            if free == FIXED || weight == 0.0 {
                continue;
            }
            let at = 3 * free as usize;
            let v = input.v_free.get(at..at + 3)?;
            support.velocity += Vector3::new(v[0], v[1], v[2]) * weight;
            // A row holds a node once: weights of a repeated node add up.
            match support.nodes[..support.len].iter_mut().find(|(n, _)| *n == free) {
                Some((_, sum)) => *sum += weight,
                None => {
                    support.nodes[support.len] = (free, weight);
                    support.len += 1;
                }
            }
        }
        support.velocity.iter().all(|x| x.is_finite()).then_some(support)
    }

    fn entries(&self) -> impl Iterator<Item = (u32, f64)> + '_ {
        self.nodes[..self.len].iter().copied()
    }
}
