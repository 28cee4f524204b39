//! Contacts that found no room.

use crate::counted::counted;
use crate::scene::SceneDescription;
use crate::step::{BODY_CONTACTS, StepReport};
use crate::tick::{TickFlags, TickRecord};

/// Contacts beyond the capacity that the scene states: those of the tool with the tissue, and those of other bodies; and those
/// beyond what a patch holds.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Room {
    tool: Dropped,
    bodies: Dropped,
    /// Of the tool with rigid bodies, which the tick does without.
    patch: Dropped,
    /// Time of the first tick that had more contacts than room (s).
    first_tick: Option<f64>,
}

/// Contacts that were dropped at one capacity.
#[derive(Clone, Copy, Debug, Default)]
struct Dropped {
    contacts: u64,
    steps: u64,
    /// The most of one step.
    most: u64,
    /// Begin of the first step with any (s).
    first: Option<f64>,
}

impl Room {
    /// Counts those of a step.
    pub(super) fn add(&mut self, report: &StepReport) {
        let tool = report.detection.dropped as u64;
        self.tool.add(tool, report.time);
        self.bodies.add(report.dropped() - tool, report.time);
        self.patch.add(report.bodies.left_of_tool.into(), report.time);
    }

    /// Notes the first tick that had more contacts than room; the port counts them.
    pub(super) fn tick(&mut self, record: &TickRecord) {
        if record.flags.contains(TickFlags::TRUNCATED) {
            self.first_tick.get_or_insert(record.time);
        }
    }

    /// All of those of steps.
    pub(super) fn dropped(&self) -> u64 {
        self.tool.contacts + self.bodies.contacts + self.patch.contacts
    }

    /// What there is to say of them and of so many ticks, with the keys that make room.
    pub(super) fn notes(&self, scene: &SceneDescription, ticks: u64) -> Vec<String> {
        let room = scene.contact.max_contacts;
        let tool = self.tool.sentence("of the tool").map(|dropped| {
            format!("{dropped}; the deepest were kept: give [contact] `max_contacts` above {room}, or coarser cells to the body")
        });
        let fixed = scene.fixed_bodies.iter().map(|body| ("fixed_body", &body.name, body.max_contacts));
        let rigid = scene.rigid_bodies.iter().map(|body| ("rigid_body", &body.name, body.max_contacts));
        let bodies = self.bodies.sentence("of fixed and rigid bodies").map(|dropped| {
            let rooms: Vec<_> = fixed
                .chain(rigid)
                .map(|(kind, name, most)| format!("{kind} `{name}` {}", most.unwrap_or(room)))
                .collect();
            format!("{dropped}: give them a greater `max_contacts` (now {})", rooms.join(", "))
        });
        let patch = self.patch.sentence("of the tool with rigid bodies").map(|dropped| {
            format!(
                "{dropped}; the tick had the {BODY_CONTACTS} deepest: give the tool, or those bodies, fewer corners"
            )
        });
        let ticks = self.first_tick.map(|first| {
            format!(
                "{} had more contacts than room, the first at {first:.3} s; the deepest were kept: give [contact] \
                 `max_contacts` above {room}",
                counted(ticks, "tick", "ticks")
            )
        });
        tool.into_iter().chain(bodies).chain(patch).chain(ticks).collect()
    }
}

impl Dropped {
    fn add(&mut self, contacts: u64, time: f64) {
        if contacts > 0 {
            self.contacts += contacts;
            self.steps += 1;
            self.most = self.most.max(contacts);
            self.first.get_or_insert(time);
        }
    }

    fn sentence(&self, whose: &str) -> Option<String> {
        let first = self.first?;
        let (contacts, steps) = (counted(self.contacts, "contact", "contacts"), counted(self.steps, "step", "steps"));
        let most = self.most;
        Some(format!("{contacts} {whose} found no room, in {steps}, up to {most} at once, the first at {first:.3} s"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;
    use crate::simulation::Simulation;

    /// The key that the note names is that of the contacts which were dropped, with its value in the scene.
    #[test]
    fn what_found_no_room_is_told_with_the_key_that_makes_room() {
        let world = Scene::bundled("grasp").unwrap().build().unwrap();
        let scene = world.description();
        let mut report = Simulation::new(&world).unwrap().step(&world.first_pose());
        let mut room = Room::default();
        room.add(&report);
        assert!(room.notes(scene, 0).is_empty() && room.dropped() == 0);
        (report.detection.dropped, report.time) = (3, 0.5);
        room.add(&report);
        (report.detection.dropped, report.time) = (5, 0.6);
        room.add(&report);
        let told = room.notes(scene, 0);
        assert!(told.len() == 1 && room.dropped() == 8, "{told:?}");
        for words in ["8 contacts of the tool", "in 2 steps, up to 5 at once, the first at 0.500 s", "above 64"] {
            assert!(told[0].contains(words), "{words}: {}", told[0]);
        }
        (report.detection.dropped, report.bodies.dropped) = (0, 1);
        room.add(&report);
        let told = room.notes(scene, 0);
        assert!(told.len() == 2 && room.dropped() == 9, "{told:?}");
        assert!(told[1].contains("1 contact of fixed and rigid bodies"), "{}", told[1]);
        assert!(told[1].contains("fixed_body `table` 64"), "{}", told[1]);
    }
}
