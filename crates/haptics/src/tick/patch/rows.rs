//! Rows of the contacts of a tick on a patch, and their compliance `W = B C Bᵀ`.

use nalgebra::{Matrix3, Vector3};
use palpate_collision::Contact;
use palpate_constraints::frame::ContactFrame;
use palpate_constraints::law::{Law, Signorini};
use palpate_solver::problem::Block;

use super::ToolPoses;
use super::creep::Moment;
use super::jaws::Jaws;
use super::known::Owed;
use super::memory::PatchMemory;
use crate::patch::HapticPatch;
use crate::snapshot::ROWS_PER_CONTACT;
use crate::wrench::Wrench;

/// One contact with its directions on nodes and tool.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub(super) feature: u64,
    /// Number among the patch's contacts of bodies, for one of those.
    pub(super) body: Option<usize>,
    /// Places of the patch with a share in the contact's point, each once, and their shares.
    pub(super) places: [(usize, f64); 3],
    pub(super) count: usize,
    /// Whether the tool is a part of it.
    pub(super) touches: bool,
    /// Columns: normal and tangents.
    pub(super) frame: Matrix3<f64>,
    /// The same as seen from its places: the frame for nodes, which have world axes; 1 for contacts of bodies.
    pub(super) local: Matrix3<f64>,
    /// From the tool's origin \[m\].
    pub(super) lever: Vector3<f64>,
    /// Velocity of the tool's point per rad that the jaws open \[m\].
    pub(super) opens: Vector3<f64>,
    /// Force on tissue or body \[N\], the same in the axes of its places, and, where it sticks, what is left of its
    /// displacement along the tangents \[m\].
    pub(super) force: Vector3<f64>,
    pub(super) load: Vector3<f64>,
    pub(super) slip: Vector3<f64>,
    /// Snapshots that came while it stuck.
    pub(super) stuck: u32,
    /// Gap that the forces leave \[m\].
    pub(super) gap: f64,
    pub(super) owed: Owed,
}

/// Rows of all contacts of a tick: workspace.
#[derive(Clone, Debug)]
pub(super) struct Rows {
    pub(super) contact: Vec<Row>,
    pub(super) blocks: Vec<Block>,
    /// Gap without contact forces \[m\], and forces \[N\], one a row.
    pub(super) delta_free: Vec<f64>,
    pub(super) lambda: Vec<f64>,
    /// Gap at the nodal forces of the tick before \[m\]: those of its contacts leave another where a contact is now another.
    pub(super) before: Vec<f64>,
    law: Law,
    max_contacts: usize,
}

impl Rows {
    /// Memory for so many contacts on the skin, and of bodies.
    pub(super) fn new(contacts: usize, bodies: usize) -> Self {
        let all = contacts + bodies;
        let rows = ROWS_PER_CONTACT * all;
        Self {
            contact: Vec::with_capacity(all),
            blocks: Vec::with_capacity(all),
            delta_free: Vec::with_capacity(rows),
            lambda: Vec::with_capacity(rows),
            before: Vec::with_capacity(rows),
            law: Signorini.into(),
            max_contacts: contacts,
        }
    }

    pub(super) fn len(&self) -> usize {
        self.delta_free.len()
    }

    /// Contacts of the tool.
    pub(super) fn contacts(&self) -> usize {
        self.at_tool().count()
    }

    /// Rows of one contact.
    fn rows_each(&self) -> usize {
        if self.law.rows() > 1 { ROWS_PER_CONTACT } else { 1 }
    }

    /// Refills the rows; as many contacts as there is memory for.
    pub(super) fn build(
        &mut self,
        contacts: &[Contact],
        shape: &[Vector3<f64>],
        (memory, now): (&PatchMemory, &Moment),
        patch: &HapticPatch,
        (jaws, poses): (&Jaws, &ToolPoses),
    ) {
        self.contact.clear();
        self.blocks.clear();
        self.delta_free.clear();
        self.before.clear();
        self.law = patch.law;
        let (each, bodies) = (self.rows_each(), patch.bodies.yielding());
        for contact in contacts.iter().take(self.max_contacts) {
            let directions = ContactFrame::new(contact.normal).directions();
            let path = jaws.of(contact.feature);
            let lever = contact.tissue_point - jaws.origin();
            let (slip, stuck, owed) = memory.slip(contact.feature);
            let mut row = Row {
                feature: contact.feature,
                body: None,
                places: [(0, 0.0); 3],
                count: 0,
                touches: true,
                frame: Matrix3::from_columns(&directions),
                local: Matrix3::from_columns(&directions),
                lever,
                opens: path.opens(&contact.tissue_point),
                force: Vector3::zeros(),
                load: Vector3::zeros(),
                slip: Vector3::zeros(),
                stuck,
                gap: f64::INFINITY,
                owed,
            };
            // How the point yields to the forces of the tick before, and how it has moved since without them.
            let (mut yielded, mut moved) = (Vector3::zeros(), Vector3::zeros());
            // What it is led by.
            let leads = if each > 1 { memory.leads(contact.feature, now) } else { 0.0 };
            let mut drift = Vector3::zeros();
            let mut loaded = Vector3::zeros();
            for (&node, &weight) in contact.nodes.iter().zip(&contact.weights) {
                let node = node as usize;
                let (Some(here), Some(y), Some(then)) = (shape.get(node), memory.yielded(node), memory.shape(node))
                else {
                    continue;
                };
                if weight != 0.0 {
                    row.add(bodies + node, weight);
                    yielded += y * weight;
                    loaded += memory.moved(node) * weight;
                    moved += (here - y - then) * weight;
                    if leads > 0.0 {
                        drift += memory.drift(node).unwrap_or_else(Vector3::zeros) * weight;
                    }
                }
            }
            let held = |k: usize| directions[k].dot(&loaded) - jaws.closing(&directions[k], &lever, &row.opens);
            let normal = &directions[0];
            let gap =
                contact.gap - normal.dot(&yielded) + jaws.closing(normal, &lever, &row.opens) - owed.gap * now.fade;
            self.blocks.push(Block { start: self.delta_free.len(), law: self.law.at_free_gap(gap) });
            self.delta_free.push(gap);
            self.before.push(gap + held(0));
            if each > 1 {
                let mut along = moved - path.of_point(&contact.tissue_point) + slip + owed.slip * now.faded;
                if leads > 0.0 {
                    along += (drift - path.until_hand_over(&contact.tissue_point)) * leads;
                }
                let along = [directions[1].dot(&along), directions[2].dot(&along)];
                self.delta_free.extend(along);
                self.before.extend([along[0] + held(1), along[1] + held(2)]);
            }
            self.contact.push(row);
        }
        self.build_bodies(memory, now, patch, poses);
        self.lambda.clear();
        self.lambda.resize(self.delta_free.len(), 0.0);
    }

    /// Notes what the forces leave open, and what slips.
    pub(super) fn note_gaps(&mut self, delta: &[f64]) {
        for (row, block) in self.contact.iter_mut().zip(&self.blocks) {
            let each = block.law.rows();
            let (Some(gap), Some(lambda)) =
                (delta.get(block.start..), self.lambda.get(block.start..block.start + each))
            else {
                continue;
            };
            row.gap = gap.first().copied().unwrap_or(f64::INFINITY);
            let mut local = Vector3::zeros();
            local.iter_mut().zip(lambda).for_each(|(to, l)| *to = *l);
            (row.force, row.load) = (row.frame * local, row.local * local);
            // What slides has a slip, which is forgotten.
            let holds = local.x > 0.0 && block.law.sticks(&local);
            row.slip = match gap {
                [_, t, s, ..] if holds && each == 3 => row.frame.column(1) * *t + row.frame.column(2) * *s,
                _ => Vector3::zeros(),
            };
            if !holds {
                (row.stuck, row.owed.slip) = (0, Vector3::zeros());
            }
        }
    }

    /// Adds the forces of the contacts to their places \[N\].
    pub(super) fn spread(&self, force: &mut [Vector3<f64>]) {
        for row in &self.contact {
            for &(place, weight) in &row.places[..row.count] {
                if let Some(f) = force.get_mut(place) {
                    *f += row.load * weight;
                }
            }
        }
    }

    /// What the contacts do to the tool, about its origin.
    pub(super) fn wrench(&self) -> Wrench {
        let mut wrench = Wrench::zero();
        for row in self.at_tool() {
            wrench.force -= row.force;
            wrench.torque -= row.lever.cross(&row.force);
        }
        wrench
    }

    /// What the contacts do to the opening of the jaws \[N m\].
    pub(super) fn gripper_torque(&self) -> f64 {
        self.at_tool().map(|row| -row.opens.dot(&row.force)).sum()
    }

    /// Smallest gap at the forces \[m\].
    pub(super) fn least_gap(&self) -> f64 {
        self.at_tool().map(|row| row.gap).fold(f64::INFINITY, f64::min)
    }

    /// Contacts that carry force.
    pub(super) fn active(&self) -> usize {
        self.at_tool().filter(|row| row.force != Vector3::zeros()).count()
    }

    /// The rows that the tool is a part of.
    fn at_tool(&self) -> impl Iterator<Item = &Row> {
        self.contact.iter().filter(|row| row.touches)
    }
}

impl Row {
    fn add(&mut self, node: usize, weight: f64) {
        match self.places[..self.count].iter_mut().find(|(n, _)| *n == node) {
            Some((_, sum)) => *sum += weight,
            None if self.count < 3 => {
                self.places[self.count] = (node, weight);
                self.count += 1;
            }
            None => {}
        }
    }

    /// What the sweeps left of the gap \[m\]: all of it under a force, and what is overlap without.
    pub(super) fn rest(&self) -> f64 {
        if self.force == Vector3::zeros() { self.gap.min(0.0) } else { self.gap }
    }

    /// Whether it pushes, overlaps, or is owed something.
    pub(super) fn is_worth_knowing(&self) -> bool {
        self.force != Vector3::zeros() || self.rest() < 0.0 || self.owed.gap != 0.0
    }

    /// Torque about the tool's origin per newton along direction `k` \[m\].
    pub(super) fn turn(&self, k: usize) -> Vector3<f64> {
        self.lever.cross(&self.frame.column(k))
    }
}
