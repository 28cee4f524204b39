//! The end of a run: what was gathered, summed up.

use super::Gathering;
use crate::counted::counted;
use crate::record::TraceOutcome;
use crate::step::Tangle;
use crate::summary::RunSummary;
use crate::world::World;

impl Gathering {
    /// The summary; `wall` is the time the run took in real time (s).
    pub(crate) fn summary(mut self, world: &World, wall: Option<f64>, trace: Option<TraceOutcome>) -> RunSummary {
        self.notes.extend(self.tangle_note());
        self.notes.extend(self.climbing.note(world.plan().ladder));
        self.notes.extend(self.unsolved.note(world.description()));
        self.notes.extend(self.room.notes(world.description(), self.port.contact.truncated));
        let counts = self.counts();
        let rate = |n: u64| wall.map_or(0.0, |w| n as f64 / w);
        RunSummary {
            scene: world.scene().name().into(),
            mode: if wall.is_some() { "real time" } else { "lockstep" },
            integrator: world.integration().to_string(),
            contact: world.contact_method(),
            law: world.description().contact.law_in_words(),
            end: self.end,
            simulated: self.time + 1.0 / world.description().rates.tick,
            wall: wall.unwrap_or(0.0),
            nodes: world.mesh().nodes.len(),
            tetrahedra: world.mesh().tetrahedra.len(),
            steps: counts[0],
            factors: counts[1],
            ticks: counts[2],
            step_rate: rate(counts[0]),
            factor_rate: rate(counts[1]),
            tick_rate: rate(counts[2]),
            step_work: self.step_work.percentiles(),
            factor_work: self.factor_work.percentiles(),
            tick_work: self.tick_work.percentiles(),
            tick_latency: self.tick_latency.percentiles(),
            step_overruns: self.step_overruns,
            tick_overruns: self.tick_overruns,
            factor_thread_died: self.factor_thread_death.map(|death| death.time),
            factors_refused: self.factors_refused,
            iterations: self.iterations.percentiles(),
            factor_age: self.factor_age.percentiles(),
            contacts: self.contacts.percentiles(),
            body_contacts: self.body_contacts.percentiles(),
            rigid_bodies: Vec::new(),
            plan: world.plan().to_string(),
            compliance_error: self.compliance_error.percentiles(),
            compliance_errors: self.compliance_error.count(),
            force_error: self.force_error.percentiles(),
            force_errors: self.force_error.count(),
            correction_iterations: self.correction_iterations.percentiles(),
            overlap: self.overlap,
            factors_early: self.early,
            exact_steps: self.exact_steps,
            rungs: self.climbing.rungs.into_iter().map(|(rung, steps)| (rung.name(), steps)).collect(),
            climbs: self.climbing.climbs,
            accuracy_missed: self.climbing.missed,
            contacts_dropped: self.room.dropped(),
            worst_residual: self.worst_residual,
            worst_tick_residual: self.worst_tick_residual,
            fall_backs: self.fall_backs,
            answered: self.answered,
            shortened: self.shortened,
            repeated: self.rescued[0],
            held_open: self.rescued[1],
            tangled: self.rescued[2],
            led: self.rescued[3],
            in_full: self.in_full,
            unsettled: self.unsettled,
            contact_unsolved: self.unsolved.steps,
            filtered: self.filtered,
            inverted: self.inverted,
            largest_force: self.largest_force,
            largest_jump: self.largest_jump,
            events: self.changes,
            outdated_steps: self.outdated[0],
            renewed_steps: self.outdated[1],
            unconverged: self.unconverged,
            force_jump: self.force_jump.percentiles(),
            tick_method: world.tick_method(),
            beyond_patch: self.beyond_patch,
            patches_full: self.patches_full,
            frozen_at_rigid: self.frozen_at_rigid,
            impulse: self.impulse,
            port: self.port,
            records_missed: self.missed,
            files: trace.iter().map(|t| t.path.clone()).collect(),
            trace,
            notes: self.notes,
        }
    }

    /// What there is to say of a body that ends in a tangle.
    fn tangle_note(&self) -> Option<String> {
        let (since, Tangle { edges, winding, place }) = self.tangle?;
        Some(format!(
            "body {} ends tangled, as it has been since {since:.3} s: it passed through itself, and {} not \
             wound round once, the worst {}, {}; try a softer press, a smaller step or a finer mesh",
            self.body,
            counted(edges, "of its inner edges is", "of its inner edges are"),
            counted(winding, "time", "times"),
            self.name(place)
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::Unobserved;
    use crate::scene::Scene;
    use crate::simulation::Simulation;
    use crate::step::{FailedElement, StepReport};

    /// A tangle is a note while it lasts at the end of a run, with the time since when, and counted in either case.
    #[test]
    fn a_body_that_ends_tangled_is_a_note_of_the_summary() {
        let world = Scene::bundled("block").unwrap().build().unwrap();
        let report = Simulation::new(&world).unwrap().step(&world.first_pose());
        let tangle = Tangle { edges: 3, winding: 2, place: FailedElement { tetrahedron: 7, region: 0 } };
        for ends_tangled in [true, false] {
            let mut gathering = Gathering::new(&world);
            for step in 0..6 {
                let seen = (2..if ends_tangled { 6 } else { 5 }).contains(&step).then_some(tangle);
                let time = f64::from(step) / 30.0;
                let (led, in_full) = (step == 4, u32::from(step < 2) * 7);
                gathering.step(&StepReport { tangle: seen, led, in_full, time, ..report }, &mut Unobserved);
            }
            let summary = gathering.summary(&world, None, None);
            assert_eq!((summary.tangled, summary.led), (if ends_tangled { 4 } else { 3 }, 1));
            assert_eq!(summary.in_full, 2, "steps, not solves");
            let said = |words: &str| summary.notes.iter().any(|note| note.contains(words));
            assert_eq!(said("ends tangled, as it has been since 0.067 s"), ends_tangled, "{:?}", summary.notes);
            assert_eq!(said("3 of its inner edges"), ends_tangled);
            assert_eq!(said("at tetrahedron 7"), ends_tangled);
        }
    }
}
