//! The summary of a run as text: does every row say something, and is what went wrong told with its remedy?

use crate::program_runs::{Place, SCENE};
use serde_json::Value;

/// Cells of the rows of all tables in `text`, without headings.
fn rows(text: &str) -> Vec<Vec<&str>> {
    let rows = text.lines().filter_map(|line| line.strip_prefix('│')?.strip_suffix('│'));
    rows.map(|row| row.split('┆').map(str::trim).collect()).collect()
}

/// The value of the row of this name.
fn value<'a>(rows: &[Vec<&'a str>], name: &str) -> Option<&'a str> {
    rows.iter().find(|row| row[0] == name).map(|row| row[1])
}

#[test]
fn rows_that_say_nothing_are_one_line_and_stay_in_json() {
    let place = Place::new();
    let run = place.run("run scene.toml --lockstep --no-trace --quiet");
    let rows = rows(&run.out);
    for row in &rows {
        let says = row[1..].iter().any(|cell| cell.chars().any(|c| ('1'..='9').contains(&c)) || *cell == "p50");
        assert!(says, "a row of zeros: {row:?}");
    }
    assert_eq!(value(&rows, "steps / factors / ticks"), Some("30 / 0 / 1000"));
    assert_eq!(value(&rows, "ticks in which something acted on the force"), Some("fading in 300"));
    assert!(value(&rows, "contacts dropped").is_none());
    let none: Vec<_> = run.out.lines().filter_map(|line| line.strip_prefix("none: ")).collect();
    assert!(none.len() == 1 && none[0].contains("contacts dropped, factors refused, guarded steps, "), "{}", run.out);
    assert!(!run.out.contains("note: "), "{}", run.out);
    let json: Value = serde_json::from_str(&place.run("run scene.toml --lockstep --no-trace --json").out).unwrap();
    for key in ["contacts_dropped", "factors_refused", "shortened", "step_overruns", "inverted"] {
        assert_eq!(json[key], 0, "{key}");
    }
}

#[test]
fn contacts_beyond_their_capacity_are_a_row_and_a_note_with_the_key_that_makes_room() {
    let place = Place::with(&SCENE.replace("friction = 0.3", "friction = 0.3\nmax_contacts = 2"));
    let run = place.run("run scene.toml --lockstep --no-trace --quiet");
    let dropped: u64 = value(&rows(&run.out), "contacts dropped")
        .and_then(|count| count.parse().ok())
        .unwrap_or_else(|| panic!("{}", run.out));
    let note = run.out.lines().find(|line| line.starts_with("note: ")).unwrap_or_else(|| panic!("{}", run.out));
    assert!(dropped > 0 && note.contains(&format!("{dropped} contacts of the tool found no room")), "{note}");
    assert!(note.contains("give [contact] `max_contacts` above 2"), "{note}");
    assert!(
        !run.out.lines().any(|line| line.starts_with("none: ") && line.contains("contacts dropped")),
        "{}",
        run.out
    );
}
