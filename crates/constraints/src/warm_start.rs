//! Forces carried from step to step by contact feature.
//!
//! Forces are kept as vectors in the world frame, since frames turn with the contact. A new contact takes the force of
//! the old contact with the same feature; failing that, of the nearest old contact within a radius, as when a contact
//! slides over an edge. An old force is given once, so the total never grows. Without a match a contact starts from
//! zero: nothing is invented. What is fetched is a first guess; the law's projection makes it admissible.

use std::ops::Range;

use nalgebra::Vector3;
use palpate_collision::{Contact, SolidContact};

use crate::frame::ContactFrame;
use crate::rows::{ContactRows, RowBlock};

/// A contact whose force can be remembered.
pub trait Remembered {
    /// Identifies it from step to step.
    fn feature(&self) -> u64;
    /// Where it is \[m\].
    fn point(&self) -> Vector3<f64>;
}

impl Remembered for Contact {
    fn feature(&self) -> u64 {
        self.feature
    }

    fn point(&self) -> Vector3<f64> {
        self.tissue_point
    }
}

impl Remembered for SolidContact {
    fn feature(&self) -> u64 {
        self.feature
    }

    fn point(&self) -> Vector3<f64> {
        self.point
    }
}

/// One remembered force.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Entry {
    feature: u64,
    point: Vector3<f64>,
    force: Vector3<f64>,
    used: bool,
}

/// Forces of the step before between one pair of bodies. State: a run that is to continue bit for bit saves it.
#[derive(Clone, Debug)]
pub struct WarmStart {
    entries: Vec<Entry>,
    capacity: usize,
}

/// How the contacts of a step were matched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WarmStartReport {
    /// Contacts with the same feature as before.
    pub same: usize,
    /// Contacts that took the force of a near one.
    pub near: usize,
    /// Contacts that start from zero.
    pub fresh: usize,
}

impl WarmStart {
    /// Memory for `contacts` contacts.
    pub fn with_capacity(contacts: usize) -> Self {
        Self { entries: Vec::with_capacity(contacts), capacity: contacts }
    }

    /// Forgets all forces and keeps the memory.
    pub fn clear(&mut self) {
        self.entries.clear();
    }

    /// Number of remembered forces.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// True where nothing is remembered.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Remembers the row forces `λ` \[N\] of `blocks`, a range of `rows.blocks` that was built from `contacts`.
    ///
    /// Returns the number of forces beyond the capacity, which are forgotten. Forces that are not finite are too.
    pub fn store<C: Remembered>(
        &mut self,
        contacts: &[C],
        rows: &ContactRows,
        blocks: Range<usize>,
        lambda: &[f64],
    ) -> usize {
        self.entries.clear();
        let mut forgotten = 0;
        for (block, frame) in part(rows, &blocks) {
            let (Some(contact), Some(force)) = (contacts.get(block.contact as usize), lambda.get(block.range())) else {
                continue;
            };
            let force = frame.to_world(force);
            if !force.iter().chain(contact.point().iter()).all(|x| x.is_finite()) {
                continue;
            }
            if self.entries.len() == self.capacity {
                forgotten += 1;
                continue;
            }
            self.entries.push(Entry { feature: contact.feature(), point: contact.point(), force, used: false });
        }
        self.entries.sort_unstable_by_key(|e| e.feature);
        forgotten
    }

    /// Writes a first guess of the row forces \[N\] of `blocks` into `lambda` (one per row of `rows`).
    ///
    /// `blocks` is the range of `rows.blocks` that was built from `contacts`; a feature occurs in them at most once.
    ///
    /// `radius` \[m\] bounds the distance of a match by place. A force whose normal part would pull becomes zero.
    pub fn fetch<C: Remembered>(
        &mut self,
        contacts: &[C],
        rows: &ContactRows,
        blocks: Range<usize>,
        radius: f64,
        lambda: &mut [f64],
    ) -> WarmStartReport {
        self.entries.iter_mut().for_each(|e| e.used = false);
        let mut report = WarmStartReport::default();
        // The same feature first, for every contact, so that a near match never takes what belongs to another.
        for pass in [Match::Feature, Match::Place] {
            for (block, frame) in part(rows, &blocks) {
                if pass == Match::Feature {
                    lambda.get_mut(block.range()).into_iter().for_each(|l| l.fill(0.0));
                }
                let Some(contact) = contacts.get(block.contact as usize) else { continue };
                let found = match pass {
                    Match::Feature => self.same_feature(contact.feature()),
                    Match::Place if self.same_feature(contact.feature()).is_some() => continue,
                    Match::Place => self.nearest(&contact.point(), radius),
                };
                let Some(entry) = found.and_then(|k| self.entries.get_mut(k)) else {
                    report.fresh += usize::from(pass == Match::Place);
                    continue;
                };
                entry.used = true;
                write(block, frame, &entry.force, lambda);
                match pass {
                    Match::Feature => report.same += 1,
                    Match::Place => report.near += 1,
                }
            }
        }
        report
    }

    fn same_feature(&self, feature: u64) -> Option<usize> {
        self.entries.binary_search_by_key(&feature, |e| e.feature).ok()
    }

    fn nearest(&self, point: &Vector3<f64>, radius: f64) -> Option<usize> {
        let mut best = None;
        let mut least = radius * radius;
        for (k, entry) in self.entries.iter().enumerate().filter(|(_, e)| !e.used) {
            let distance = (entry.point - point).norm_squared();
            if distance < least || (best.is_none() && distance == least) {
                best = Some(k);
                least = distance;
            }
        }
        best
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Match {
    Feature,
    Place,
}

/// The blocks of one tool, with their frames.
fn part<'a>(rows: &'a ContactRows, blocks: &Range<usize>) -> impl Iterator<Item = (&'a RowBlock, &'a ContactFrame)> {
    let skip = blocks.start;
    let take = blocks.len();
    rows.blocks.iter().zip(&rows.frames).skip(skip).take(take)
}

fn write(block: &RowBlock, frame: &ContactFrame, force: &Vector3<f64>, lambda: &mut [f64]) {
    let local = frame.to_local(force);
    let Some(rows) = lambda.get_mut(block.range()) else { return };
    if local[0] > 0.0 {
        rows.iter_mut().zip(local).for_each(|(l, x)| *l = x);
    }
}
