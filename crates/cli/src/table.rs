//! The summary of a run as text: what there is to say, and in one line what did not happen.

mod facts;

use comfy_table::{Cell, CellAlignment, Table};
use palpate::counted::counted;
use palpate::summary::{Percentiles, RunSummary};

use crate::screen;

/// The summary as text.
pub(crate) fn summary(s: &RunSummary) -> String {
    let mut lines = vec![format!(
        "{} ({}, {}, {}): {:.2} s, {}",
        s.scene,
        s.mode,
        counted(s.nodes, "node", "nodes"),
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
    let facts = facts::of(s);
    lines.push(facts.table().to_string());
    lines.extend(facts.absent());
    lines.extend(s.rigid_bodies.iter().map(|body| format!("rigid body {body}")));
    lines.extend(s.events.iter().map(|event| format!("event at {event}")));
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

/// Medians and tails of what was not zero throughout.
fn tails(s: &RunSummary) -> Table {
    let mut table = screen::table();
    table.set_header(["", "p50", "p99", "p99.9", "max"]);
    let mut row = |name: &str, p: &Percentiles, scale: f64, digits: usize| {
        if p.max <= 0.0 {
            return;
        }
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
    row("error of the contact forces [%]", &s.force_error, 1e2, 2);
    row("contacts", &s.contacts, 1.0, 0);
    row("contacts of fixed and rigid bodies", &s.body_contacts, 1.0, 0);
    row("jump of the force at a new snapshot [mN]", &s.force_jump, 1e3, 2);
    table
}
