//! Rows of the contacts of a tick on a patch, and their compliance `W = B C Bᵀ`.

use nalgebra::{Matrix3, Vector3};
use palpate_collision::Contact;
use palpate_constraints::frame::ContactFrame;
use palpate_constraints::law::{Law, Signorini};
use palpate_solver::problem::Block;

use super::jaws::Jaws;
use super::memory::PatchMemory;
use crate::coupling::Coupling;
use crate::patch::HapticPatch;
use crate::snapshot::ROWS_PER_CONTACT;
use crate::wrench::Wrench;

/// One contact with its directions on nodes and tool.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub(super) feature: u64,
    /// Nodes of the patch with a share in the contact's point, each once, and their shares.
    nodes: [(usize, f64); 3],
    count: usize,
    /// Columns: normal and tangents.
    pub(super) frame: Matrix3<f64>,
    /// From the tool's origin \[m\].
    lever: Vector3<f64>,
    /// Velocity of the tool's point per rad that the jaws open \[m\].
    opens: Vector3<f64>,
    /// Force on the tissue \[N\] and, where it sticks, what is left of its displacement along the tangents \[m\].
    pub(super) force: Vector3<f64>,
    pub(super) slip: Vector3<f64>,
    /// Gap that the forces leave \[m\].
    gap: f64,
}

/// Rows of all contacts of a tick: workspace.
#[derive(Clone, Debug)]
pub(super) struct Rows {
    pub(super) contact: Vec<Row>,
    pub(super) blocks: Vec<Block>,
    /// Gap without contact forces \[m\], and forces \[N\], one a row.
    pub(super) delta_free: Vec<f64>,
    pub(super) lambda: Vec<f64>,
    law: Law,
    max_contacts: usize,
}

impl Rows {
    pub(super) fn new(contacts: usize) -> Self {
        let rows = ROWS_PER_CONTACT * contacts;
        Self {
            contact: Vec::with_capacity(contacts),
            blocks: Vec::with_capacity(contacts),
            delta_free: Vec::with_capacity(rows),
            lambda: Vec::with_capacity(rows),
            law: Signorini.into(),
            max_contacts: contacts,
        }
    }

    pub(super) fn len(&self) -> usize {
        self.delta_free.len()
    }

    pub(super) fn contacts(&self) -> usize {
        self.contact.len()
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
        memory: &PatchMemory,
        patch: &HapticPatch,
        jaws: &Jaws,
    ) {
        self.contact.clear();
        self.blocks.clear();
        self.delta_free.clear();
        self.law = patch.law;
        let each = self.rows_each();
        for contact in contacts.iter().take(self.max_contacts) {
            let directions = ContactFrame::new(contact.normal).directions();
            let path = jaws.of(contact.feature);
            let lever = contact.tissue_point - jaws.origin();
            let mut row = Row {
                feature: contact.feature,
                nodes: [(0, 0.0); 3],
                count: 0,
                frame: Matrix3::from_columns(&directions),
                lever,
                opens: path.opens(&contact.tissue_point),
                force: Vector3::zeros(),
                slip: Vector3::zeros(),
                gap: f64::INFINITY,
            };
            // How the point yields to the forces of the tick before, and how it has moved since without them.
            let (mut yielded, mut moved) = (Vector3::zeros(), Vector3::zeros());
            for (&node, &weight) in contact.nodes.iter().zip(&contact.weights) {
                let node = node as usize;
                let (Some(now), Some(y), Some(then)) = (shape.get(node), memory.yielded(node), memory.shape(node))
                else {
                    continue;
                };
                if weight != 0.0 {
                    row.add(node, weight);
                    yielded += y * weight;
                    moved += (now - y - then) * weight;
                }
            }
            let normal = &directions[0];
            let gap = contact.gap - normal.dot(&yielded) + jaws.closing(normal, &lever, &row.opens);
            self.blocks.push(Block { start: self.delta_free.len(), law: self.law.at_free_gap(gap) });
            self.delta_free.push(gap);
            if each > 1 {
                let along = moved - path.of_point(&contact.tissue_point) + memory.slip(contact.feature);
                self.delta_free.extend([directions[1].dot(&along), directions[2].dot(&along)]);
            }
            self.contact.push(row);
        }
        self.lambda.clear();
        self.lambda.resize(self.delta_free.len(), 0.0);
    }

    /// W \[m/N\], by columns without padding, with the compliances of the tool's pose and of its opening \[rad/(N m)\]. False where a number is not finite.
    pub(super) fn compliance_into(
        &self,
        patch: &HapticPatch,
        (coupling, opening): (&Coupling, f64),
        w: &mut [f64],
    ) -> bool {
        let (m, each) = (self.len(), self.rows_each());
        let (c, turning) = (coupling.compliance(), coupling.rotational_compliance());
        let blocks = NodeBlocks::new(patch);
        let mut finite = true;
        for (j, b) in self.contact.iter().enumerate() {
            for (i, a) in self.contact.iter().enumerate().skip(j) {
                let mut between = blocks.between(a, b) + Matrix3::from_diagonal_element(c);
                if opening > 0.0 {
                    between += a.opens * b.opens.transpose() * opening;
                }
                if each == 1 {
                    let mut entry = a.frame.column(0).dot(&(between * b.frame.column(0)));
                    if turning > 0.0 {
                        entry += turning * a.turn(0).dot(&b.turn(0));
                    }
                    finite &= entry.is_finite();
                    (w[j * m + i], w[i * m + j]) = (entry, entry);
                    continue;
                }
                let mut block = a.frame.tr_mul(&(between * b.frame));
                if turning > 0.0 {
                    block += Matrix3::from_fn(|r, s| turning * a.turn(r).dot(&b.turn(s)));
                }
                finite &= block.sum().is_finite();
                for s in 0..3 {
                    for r in 0..3 {
                        // Symmetric to the bit: the upper triangle is the lower one's mirror, on the diagonal too.
                        let (row, column) = (3 * i + r, 3 * j + s);
                        if row >= column {
                            (w[column * m + row], w[row * m + column]) = (block[(r, s)], block[(r, s)]);
                        }
                    }
                }
            }
        }
        finite
    }

    /// Notes what the forces leave open, and what slips.
    pub(super) fn note_gaps(&mut self, delta: &[f64]) {
        let each = self.rows_each();
        for (k, (row, block)) in self.contact.iter_mut().zip(&self.blocks).enumerate() {
            let (Some(gap), Some(lambda)) = (delta.get(each * k..), self.lambda.get(each * k..each * (k + 1))) else {
                continue;
            };
            row.gap = gap.first().copied().unwrap_or(f64::INFINITY);
            let mut local = Vector3::zeros();
            local.iter_mut().zip(lambda).for_each(|(to, l)| *to = *l);
            row.force = row.frame * local;
            // What slides has a slip, which is forgotten.
            let holds = local.x > 0.0 && block.law.sticks(&local);
            row.slip = match gap {
                [_, t, s, ..] if holds && each == 3 => row.frame.column(1) * *t + row.frame.column(2) * *s,
                _ => Vector3::zeros(),
            };
        }
    }

    /// Adds the forces of the contacts to their nodes \[N\].
    pub(super) fn spread(&self, force: &mut [Vector3<f64>]) {
        for row in &self.contact {
            for &(node, weight) in &row.nodes[..row.count] {
                if let Some(f) = force.get_mut(node) {
                    *f += row.force * weight;
                }
            }
        }
    }

    /// What the contacts do to the tool, about its origin.
    pub(super) fn wrench(&self) -> Wrench {
        let mut wrench = Wrench::zero();
        for row in &self.contact {
            wrench.force -= row.force;
            wrench.torque -= row.lever.cross(&row.force);
        }
        wrench
    }

    /// What the contacts do to the opening of the jaws \[N m\].
    pub(super) fn gripper_torque(&self) -> f64 {
        self.contact.iter().map(|row| -row.opens.dot(&row.force)).sum()
    }

    /// Smallest gap at the forces \[m\].
    pub(super) fn least_gap(&self) -> f64 {
        self.contact.iter().map(|row| row.gap).fold(f64::INFINITY, f64::min)
    }

    /// Contacts that carry force.
    pub(super) fn active(&self) -> usize {
        self.contact.iter().filter(|row| row.force != Vector3::zeros()).count()
    }
}

impl Row {
    fn add(&mut self, node: usize, weight: f64) {
        match self.nodes[..self.count].iter_mut().find(|(n, _)| *n == node) {
            Some((_, sum)) => *sum += weight,
            None if self.count < 3 => {
                self.nodes[self.count] = (node, weight);
                self.count += 1;
            }
            None => {}
        }
    }

    /// Torque about the tool's origin per newton along direction `k` \[m\].
    fn turn(&self, k: usize) -> Vector3<f64> {
        self.lever.cross(&self.frame.column(k))
    }
}

/// C by blocks of two nodes.
struct NodeBlocks<'a> {
    compliance: &'a [f64],
    stride: usize,
}

impl<'a> NodeBlocks<'a> {
    fn new(patch: &'a HapticPatch) -> Self {
        Self { compliance: patch.compliance(), stride: patch.degrees_of_freedom() }
    }

    /// Displacement of the point of `a` per force at the point of `b` \[m/N\].
    #[inline]
    fn between(&self, a: &Row, b: &Row) -> Matrix3<f64> {
        let mut sum = Matrix3::zeros();
        for &(q, share) in &b.nodes[..b.count] {
            for &(p, weight) in &a.nodes[..a.count] {
                // Nodes that are held fixed come last and have no compliance.
                if 3 * p.max(q) < self.stride {
                    for column in 0..3 {
                        let at = (3 * q + column) * self.stride + 3 * p;
                        if let Some([x, y, z]) = self.compliance.get(at..at + 3) {
                            let share = weight * share;
                            sum[(0, column)] += share * x;
                            sum[(1, column)] += share * y;
                            sum[(2, column)] += share * z;
                        }
                    }
                }
            }
        }
        sum
    }
}
