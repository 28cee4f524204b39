//! The summary of a run as a table.

use comfy_table::{Cell, CellAlignment, Table};
use palpate::counted::counted;
use palpate::summary::{ForceCounts, Percentiles, RunSummary};

use crate::screen;

/// The summary as text.
pub(crate) fn summary(s: &RunSummary) -> String {
    let mut lines = vec![format!(
        "{} ({}, {} nodes, {}): {:.2} s, {}",
        s.scene,
        s.mode,
        s.nodes,
        counted(s.tetrahedra, "tetrahedron", "tetrahedra"),
        s.simulated,
        s.end
    )];
    lines.push(format!(
        "integrator: {}; contact by {}; law {}; tick: {}",
        s.integrator, s.contact, s.law, s.tick_method
    ));
    lines.push(format!("plan: {}", s.plan));
    lines.push(tails(s).to_string());
    lines.push(facts(s).to_string());
    lines.extend(s.rigid_bodies.iter().map(|body| format!("rigid body {body}")));
    lines.extend(s.events.iter().map(|event| format!("event at {event}")));
    if s.outdated_steps > 0 {
        lines.push(format!(
            "steps with a factor that could not follow an event: {}, of which {} factored their own matrix",
            s.outdated_steps, s.renewed_steps
        ));
    }
    if let Some(trace) = &s.trace {
        let trouble = trace.error.as_deref().map(|e| format!("; {e}")).unwrap_or_default();
        lines.push(format!(
            "trace: {}, {:.1} kB, {} dropped{trouble}",
            counted(trace.messages, "message", "messages"),
            trace.bytes as f64 / 1e3,
            trace.dropped
        ));
    }
    lines.extend(s.notes.iter().map(|n| format!("note: {n}")));
    lines.extend(s.files.iter().map(|f| format!("wrote {}", f.display())));
    lines.join("\n")
}

fn tails(s: &RunSummary) -> Table {
    let mut table = screen::table();
    table.set_header(["", "p50", "p99", "p99.9", "max"]);
    let mut row = |name: &str, p: &Percentiles, scale: f64, digits: usize| {
        let value = |v: f64| Cell::new(format!("{:.digits$}", v * scale)).set_alignment(CellAlignment::Right);
        table.add_row([Cell::new(name), value(p.p50), value(p.p99), value(p.p999), value(p.max)]);
    };
    // Virtual time has no wake-ups, and its ticks are not timed.
    if s.wall > 0.0 {
        row("tick work [µs]", &s.tick_work, 1e6, 1);
        row("tick wake-up latency [µs]", &s.tick_latency, 1e6, 1);
    }
    row("step work [ms]", &s.step_work, 1e3, 2);
    row("factorisation [ms]", &s.factor_work, 1e3, 2);
    row("age of the factor [ms]", &s.factor_age, 1e3, 0);
    row("CG iterations", &s.iterations, 1.0, 0);
    if s.compliance_errors > 0 {
        row("CG iterations of the correction", &s.correction_iterations, 1.0, 0);
        row("error of the compliance [%]", &s.compliance_error, 1e2, 2);
    }
    row("contacts", &s.contacts, 1.0, 0);
    if s.body_contacts.max > 0.0 {
        row("contacts of fixed and rigid bodies", &s.body_contacts, 1.0, 0);
    }
    row("jump of the force at a new snapshot [mN]", &s.force_jump, 1e3, 2);
    table
}

fn facts(s: &RunSummary) -> Table {
    let mut table = screen::table();
    if s.wall > 0.0 {
        table.add_row([
            "rates reached: step / factor / tick [Hz]".to_string(),
            format!("{:.2} / {:.2} / {:.1}", s.step_rate, s.factor_rate, s.tick_rate),
        ]);
    }
    table.add_row(["steps / factors / ticks".to_string(), format!("{} / {} / {}", s.steps, s.factors, s.ticks)]);
    if s.wall > 0.0 {
        table.add_row(["overruns: step / tick".to_string(), format!("{} / {}", s.step_overruns, s.tick_overruns)]);
    }
    table.add_row([
        "worst complementarity residual: step / tick".to_string(),
        format!("{:.2e} / {:.2e}", s.worst_residual, s.worst_tick_residual),
    ]);
    if !s.answered.is_empty() {
        let by: Vec<_> = s.answered.iter().map(|(solver, steps)| format!("{solver} {steps}")).collect();
        table.add_row([
            "steps in contact by solver / with a fall-back".to_string(),
            format!("{} / {}", by.join(", "), s.fall_backs),
        ]);
    }
    table.add_row(["deepest overlap after a correction [mm]".to_string(), format!("{:.4}", 1e3 * s.overlap)]);
    table.add_row([
        "factors before their turn / steps in contact with exact compliance".to_string(),
        format!("{} / {}", s.factors_early, s.exact_steps),
    ]);
    if !s.rungs.is_empty() {
        let by: Vec<_> = s.rungs.iter().map(|(rung, steps)| format!("{rung} {steps}")).collect();
        table.add_row(["steps in contact by method / climbs".to_string(), format!("{} / {}", by.join(", "), s.climbs)]);
    }
    table.add_row(["largest force [N]".to_string(), format!("{:.3}", s.largest_force)]);
    table.add_row([
        "impulse of contact: steps / ticks [N s]".to_string(),
        format!("{:.4} / {:.4}", s.impulse[0], s.impulse[1]),
    ]);
    table.add_row([
        "steps: full patch / frozen rows at a rigid body; ticks beyond their patch".to_string(),
        format!("{} / {}; {}", s.patches_full, s.frozen_at_rigid, s.beyond_patch),
    ]);
    let port = &s.port;
    table.add_row([
        "energy through the device: forces / torques / lowest of a contact [mJ]".to_string(),
        format!("{:.3} / {:.3} / {:.3}", 1e3 * port.energy[0], 1e3 * port.energy[1], 1e3 * port.least_account),
    ]);
    if let Some(gripper) = &port.gripper {
        table.add_row([
            "energy through the gripper / lowest of a contact [mJ]; ticks with torque withheld".to_string(),
            format!("{:.3} / {:.3}; {}", 1e3 * gripper.energy, 1e3 * gripper.least_account, gripper.withheld),
        ]);
    }
    table.add_row(["ticks in which something acted on the force".to_string(), acted(&port.counts)]);
    table.add_row([
        "contacts dropped / factors refused".to_string(),
        format!("{} / {}", s.contacts_dropped, s.factors_refused),
    ]);
    table.add_row([
        "steps shortened / repeated / with elements held open / tangled / led out of it".to_string(),
        format!("{} / {} / {} / {} / {}", s.shortened, s.repeated, s.held_open, s.tangled, s.led),
    ]);
    let u = &s.unconverged;
    table.add_row([
        "steps without convergence: free motion / correction / comparison (worst residual); factored to go on"
            .to_string(),
        format!(
            "{} ({:.1e}) / {} ({:.1e}) / {} ({:.1e}); {}",
            u.free_motions,
            u.free_motion_residual,
            u.corrections,
            u.correction_residual,
            u.comparisons,
            u.comparison_residual,
            u.rescued
        ),
    ]);
    if u.without_contact > 0 {
        table.add_row(["steps whose contacts were left out".to_string(), u.without_contact.to_string()]);
    }
    table.add_row([
        "steps with contact forces unsolved / unsettled; solved without the factor's copy in 16 bits".to_string(),
        format!("{} / {}; {}", s.contact_unsolved, s.unsettled, s.in_full),
    ]);
    let per_step = |n: u64| n as f64 / s.steps.max(1) as f64;
    table.add_row([
        "elements per step: tangent made definite / inverted".to_string(),
        format!("{:.0} / {:.2}", per_step(s.filtered), per_step(s.inverted)),
    ]);
    table
}

/// What acted on the force, and in how many ticks.
fn acted(counts: &ForceCounts) -> String {
    let all = ForceCounts::NAMES.iter().zip(counts.values()).filter(|(_, ticks)| *ticks > 0);
    let all: Vec<_> = all.map(|(name, ticks)| format!("{} {ticks}", name.replace('_', " "))).collect();
    if all.is_empty() { "none".into() } else { all.join(", ") }
}
