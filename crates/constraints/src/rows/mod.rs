//! Rows of contacts: between tissue and what it meets, and between rigid bodies and what they meet.
//!
//! A tool, a fixed body and a rigid body differ only in what their part of a row does. A tool's is kept for the wrench
//! that the hand feels and moves `δ_free`; a fixed body has none; a rigid body's joins `W` and `δ_free` as the tissue's
//! does ([`RigidRows`]), measured like the tissue at the begin of the step. Everything below is said of a tool.
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

mod motion;
mod report;
mod rigid;
mod support;
mod twist;

use nalgebra::Vector3;
use palpate_collision::Contact;
use palpate_collision::solid_contact::SolidContact;
use palpate_fem::nodal_rows::NodalRows;

use crate::frame::ContactFrame;
use support::Support;

pub use motion::ToolMotion;
pub use report::RowReport;
pub use rigid::RigidRows;
pub use twist::{ToolRow, ToolWrench, Twist, TwistRow};

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

/// Rows of all contacts of a step. Workspace: refilled at every step.
#[derive(Clone, Debug, Default)]
pub struct ContactRows {
    /// `H` over the free nodes of the body [-].
    pub tissue: NodalRows,
    /// Their part on rigid bodies.
    pub rigid: RigidRows,
    /// The tool's part of each row; zero where the tool has none.
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
            rigid: RigidRows::with_capacity(3 * contacts),
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
        self.rigid.clear();
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

/// A rigid body as its rows see it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidSide {
    /// Number of the body.
    pub body: u32,
    /// Its centre of mass at the begin of the step \[m\]: the reference point of its twist.
    pub centre: Vector3<f64>,
    /// Its twist in the free motion: the step times this is its displacement.
    pub free: Twist,
}

/// What the normals of contacts point away from.
// There is one for all contacts of a pair of bodies.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Counterpart {
    /// A tool, already at its pose of the end of the step.
    Tool {
        /// Its reference point there: the translation of its pose \[m\].
        reference: Vector3<f64>,
        /// Its motion during the step.
        motion: ToolMotion,
    },
    /// A body that never moves.
    Fixed,
    /// A rigid body, at the begin of the step.
    Rigid(RigidSide),
}

/// What rows are built from, besides the contacts.
#[derive(Clone, Copy, Debug)]
pub struct RowInput<'a> {
    /// Free node of each node of the body, or [`FIXED`](palpate_fem::sparse::FIXED).
    pub free_of_node: &'a [u32],
    /// Free velocity of the free nodes [m/s], three numbers each.
    pub v_free: &'a [f64],
    /// Step `h` \[s\].
    pub dt: f64,
    /// What the contacts are with.
    pub counterpart: Counterpart,
    /// Three rows a contact with friction, one without.
    pub friction: bool,
}

/// Replaces the rows by those of `contacts`, in their order.
pub fn build_rows(contacts: &[Contact], input: &RowInput, rows: &mut ContactRows) -> RowReport {
    rows.clear();
    append_rows(contacts, input, rows)
}

/// Appends the rows of `contacts`, in their order: for a second counterpart of the same body.
///
/// `contact` in the new blocks counts within `contacts`.
pub fn append_rows(contacts: &[Contact], input: &RowInput, rows: &mut ContactRows) -> RowReport {
    let mut report = RowReport::default();
    for (index, contact) in contacts.iter().enumerate() {
        let Some(support) = Support::new(contact, input) else {
            report.invalid += 1;
            continue;
        };
        if support.is_empty() && !matches!(input.counterpart, Counterpart::Rigid(_)) {
            report.rigid += 1;
            continue;
        }
        report.push(rows, |rows| push_contact(index, contact, &support, input, rows));
    }
    report
}

/// Appends the rows of contacts of a rigid body with `counterpart` in a step `dt` \[s\]: their normals point to `body`.
pub fn append_solid_rows(
    contacts: &[SolidContact],
    body: &RigidSide,
    counterpart: &Counterpart,
    dt: f64,
    friction: bool,
    rows: &mut ContactRows,
) -> RowReport {
    let mut report = RowReport::default();
    for (index, contact) in contacts.iter().enumerate() {
        let numbers = [contact.gap, contact.normal.sum(), contact.point.sum()];
        if !numbers.iter().all(|x| x.is_finite()) {
            report.invalid += 1;
            continue;
        }
        let feature = contact.feature;
        let place = Place { index, feature, normal: contact.normal, point: contact.point, gap: contact.gap };
        let lever = contact.point - body.centre;
        report.push(rows, |rows| {
            push_rows(&place, counterpart, dt, friction, rows, |d, rows| {
                let row = TwistRow::towards(d, &lever);
                rows.tissue.push_row([]);
                (Some((body.body, row)), dt * row.dot(&body.free.linear, &body.free.angular))
            })
        });
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
            Some(support) if support.is_empty() && rows.blocks.len() < rows.capacity => {
                push_contact(index, contact, &support, input, rows);
            }
            _ => {}
        }
    }
    rows.blocks.len()
}

/// Appends the rows of one contact of the tissue and returns their number.
fn push_contact(index: usize, contact: &Contact, support: &Support, input: &RowInput, rows: &mut ContactRows) -> usize {
    let feature = contact.feature;
    let place = Place { index, feature, normal: contact.normal, point: contact.tissue_point, gap: contact.gap };
    let motion = support.velocity * input.dt;
    push_rows(&place, &input.counterpart, input.dt, input.friction, rows, |d, rows| {
        rows.tissue.push_row(support.entries().map(|(node, weight)| (node, d * weight)));
        (None, d.dot(&motion))
    })
}

/// Where a contact is.
struct Place {
    index: usize,
    feature: u64,
    normal: Vector3<f64>,
    point: Vector3<f64>,
    gap: f64,
}

/// Appends the rows of one contact. `near` appends the tissue's part of a row along a direction, and answers the part of
/// a rigid body that the normal points to and how far the free motion opens the gap on this side \[m\].
fn push_rows(
    place: &Place,
    counterpart: &Counterpart,
    dt: f64,
    friction: bool,
    rows: &mut ContactRows,
    near: impl Fn(&Vector3<f64>, &mut ContactRows) -> (Option<(u32, TwistRow)>, f64),
) -> usize {
    let frame = ContactFrame::new(place.normal);
    let count = if friction { 3 } else { 1 };
    rows.blocks.push(RowBlock { contact: place.index as u32, first_row: rows.len() as u32, rows: count });
    rows.frames.push(frame);
    for (k, d) in frame.directions().iter().enumerate().take(count as usize) {
        let (body, near_motion) = near(d, rows);
        let mut tool = ToolRow::default();
        let mut other = None;
        let far_motion = match counterpart {
            Counterpart::Fixed => 0.0,
            Counterpart::Tool { reference, motion } => {
                let lever = place.point - reference;
                tool = ToolRow::new(d, &lever);
                // The gap is measured with the tool at the end of its way.
                if k == 0 { 0.0 } else { -d.dot(&motion.displacement_at(place.feature, &lever)) }
            }
            Counterpart::Rigid(side) => {
                let row = TwistRow::new(d, &(place.point - side.centre));
                other = Some((side.body, row));
                dt * row.dot(&side.free.linear, &side.free.angular)
            }
        };
        rows.tool.push(tool);
        rows.rigid.push_row(body.into_iter().chain(other));
        let gap = if k == 0 { place.gap } else { 0.0 };
        rows.delta_free.push(gap + near_motion + far_motion);
    }
    count as usize
}
