//! Counts and extremes of a run, by what they say.

use comfy_table::Table;
use palpate::counted::counted;
use palpate::summary::{ForceCounts, RunSummary};

use crate::screen;

/// Rows that say something, and the names of counts that stayed zero.
#[derive(Default)]
pub(super) struct Facts {
    rows: Vec<[String; 2]>,
    absent: Vec<&'static str>,
}

impl Facts {
    /// The rows.
    pub(super) fn table(&self) -> Table {
        let mut table = screen::table();
        self.rows.iter().for_each(|row| _ = table.add_row(row));
        table
    }

    /// One line for all that did not happen.
    pub(super) fn absent(&self) -> Option<String> {
        (!self.absent.is_empty()).then(|| format!("none: {}", self.absent.join(", ")))
    }

    fn row(&mut self, name: impl Into<String>, value: impl Into<String>) {
        self.rows.push([name.into(), value.into()]);
    }

    /// A row of those counts that are not zero; where all are, `absent` says what there was none of.
    fn counts(&mut self, name: &str, absent: &'static str, counts: &[(&str, u64)]) {
        let some: Vec<_> = counts.iter().filter(|c| c.1 > 0).collect();
        match (some.as_slice(), counts) {
            ([], _) => self.absent.push(absent),
            ([(_, count)], [_]) => self.row(name, count.to_string()),
            _ => self.row(name, some.iter().map(|(what, n)| format!("{what} {n}")).collect::<Vec<_>>().join(", ")),
        }
    }
}

/// What there is to say of a run.
pub(super) fn of(s: &RunSummary) -> Facts {
    let mut facts = Facts::default();
    pace(s, &mut facts);
    contact(s, &mut facts);
    device(s, &mut facts);
    trouble(s, &mut facts);
    facts
}

fn pace(s: &RunSummary, facts: &mut Facts) {
    let real_time = s.wall > 0.0;
    if real_time {
        facts.row(
            "rates reached: step / factor / tick [Hz]",
            format!("{:.2} / {:.2} / {:.1}", s.step_rate, s.factor_rate, s.tick_rate),
        );
    }
    facts.row("steps / factors / ticks", format!("{} / {} / {}", s.steps, s.factors, s.ticks));
    if real_time {
        let overruns = [("step", s.step_overruns), ("tick", s.tick_overruns)];
        facts.counts("missed deadlines", "missed deadlines", &overruns);
    }
    if s.factors_early > 0 {
        facts.row("factors before their turn", s.factors_early.to_string());
    }
}

fn contact(s: &RunSummary, facts: &mut Facts) {
    if s.contacts.max > 0.0 || s.body_contacts.max > 0.0 {
        facts.row(
            "worst residual of contact: step / tick",
            format!("{:.2e} / {:.2e}", s.worst_residual, s.worst_tick_residual),
        );
    } else {
        facts.absent.push("contact");
    }
    let by = |parts: &mut dyn Iterator<Item = (&'static str, u64)>| {
        parts.map(|(name, steps)| format!("{name} {steps}")).collect::<Vec<_>>().join(", ")
    };
    if !s.answered.is_empty() {
        facts.row("steps in contact by solver", by(&mut s.answered.iter().map(|(name, steps)| (*name, *steps))));
    }
    if s.fall_backs > 0 {
        facts.row("steps in which the solver fell back", s.fall_backs.to_string());
    }
    if !s.rungs.is_empty() {
        facts.row("steps in contact by method", by(&mut s.rungs.iter().copied()));
    }
    if s.climbs > 0 {
        facts.row("climbs to a costlier method", s.climbs.to_string());
    }
    if s.accuracy_missed > 0 {
        facts.row("steps in contact that missed the accuracy", s.accuracy_missed.to_string());
    }
    if s.exact_steps > 0 {
        facts.row("steps in contact with exact compliance", s.exact_steps.to_string());
    }
    // What the four digits show.
    if s.overlap >= 5e-8 {
        facts.row("deepest overlap after a correction [mm]", format!("{:.4}", 1e3 * s.overlap));
    }
    if s.impulse.iter().any(|&impulse| impulse > 0.0) {
        let [steps, ticks] = s.impulse;
        facts.row("impulse of contact: steps / ticks [N·s]", format!("{steps:.4} / {ticks:.4}"));
    }
    let c = &s.port.contact;
    let ticks = [("without room for all", c.truncated), ("not converged", c.not_converged)];
    facts.counts("ticks whose contact was", "unsolved contact of ticks", &ticks);
    let patches = [
        ("steps with a full one", s.patches_full),
        ("steps with frozen rows at a rigid body", s.frozen_at_rigid),
        ("ticks beyond theirs", s.beyond_patch),
    ];
    facts.counts("patches of the tick", "patches that were too small", &patches);
}

fn device(s: &RunSummary, facts: &mut Facts) {
    if s.largest_force > 0.0 {
        facts.row("largest force [N]", format!("{:.3}", s.largest_force));
    } else {
        facts.absent.push("force on the device");
    }
    let port = &s.port;
    if port.energy.iter().any(|&energy| energy != 0.0) {
        let [forces, torques] = port.energy.map(|energy| format!("{:.3}", 1e3 * energy));
        let lowest = format!("{:.3}", 1e3 * port.least_account);
        facts.row(
            "energy through the device: forces / torques / lowest of a contact [mJ]",
            format!("{forces} / {torques} / {lowest}"),
        );
    }
    if let Some(gripper) = &port.gripper {
        facts.row(
            "energy through the gripper / lowest of a contact [mJ]",
            format!("{:.3} / {:.3}", 1e3 * gripper.energy, 1e3 * gripper.least_account),
        );
        let withheld = [("ticks", gripper.withheld)];
        facts.counts("ticks with torque of the gripper withheld", "torque withheld", &withheld);
    }
    let acted = acted(&port.counts);
    if acted.is_empty() {
        facts.absent.push("limits of the force");
    } else {
        facts.row("ticks in which something acted on the force", acted);
    }
}

fn trouble(s: &RunSummary, facts: &mut Facts) {
    if s.outdated_steps > 0 {
        let renewed = counted(s.renewed_steps, "factored its own matrix", "factored their own matrices");
        facts.row(
            "steps with a factor that could not follow an event",
            format!("{}, of which {renewed}", s.outdated_steps),
        );
    }
    facts.counts("contacts dropped", "contacts dropped", &[("contacts", s.contacts_dropped)]);
    facts.counts("factors refused", "factors refused", &[("factors", s.factors_refused)]);
    let guarded = [
        ("shortened", s.shortened),
        ("repeated", s.repeated),
        ("with elements held open", s.held_open),
        ("tangled", s.tangled),
        ("led out of it", s.led),
    ];
    facts.counts("steps that were guarded", "guarded steps", &guarded);
    let u = &s.unconverged;
    let parts = [
        ("free motion", u.free_motions, u.free_motion_residual),
        ("correction", u.corrections, u.correction_residual),
        ("comparison", u.comparisons, u.comparison_residual),
    ];
    let some: Vec<_> =
        parts.iter().filter(|p| p.1 > 0).map(|(name, steps, worst)| format!("{name} {steps} ({worst:.1e})")).collect();
    if some.is_empty() {
        facts.absent.push("unconverged solves");
    } else {
        facts.row("steps without convergence (worst residual)", some.join(", "));
    }
    let contact = [("unsolved", s.contact_unsolved), ("unsettled", s.unsettled), ("left out", u.without_contact)];
    facts.counts("steps whose contact forces were", "unsolved contact", &contact);
    if u.rescued > 0 {
        facts.row("steps that factored their own matrix to go on", u.rescued.to_string());
    }
    if s.in_full > 0 {
        facts.row("steps solved without the factor's copy in 16 bits", s.in_full.to_string());
    }
    let per_step = |n: u64| n as f64 / s.steps.max(1) as f64;
    if s.filtered > 0 {
        facts.row("elements per step whose tangent was made definite", format!("{:.1}", per_step(s.filtered)));
    }
    if s.inverted > 0 {
        facts.row("inverted elements per step", format!("{:.3}", per_step(s.inverted)));
    } else {
        facts.absent.push("inverted elements");
    }
}

/// What acted on the force, and in how many ticks.
fn acted(counts: &ForceCounts) -> String {
    let all = ForceCounts::NAMES.iter().zip(counts.values()).filter(|(_, ticks)| *ticks > 0);
    all.map(|(name, ticks)| format!("{} {ticks}", name.replace('_', " "))).collect::<Vec<_>>().join(", ")
}
