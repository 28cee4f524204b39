//! Charts of speed against accuracy: measured by the program, drawn as SVG, with their data as CSV.
//!
//! A chart is a function from [`Settings`] and [`Work`] to a [`Chart`]; `command::chart` registers it by name.

mod axis;
pub(crate) mod compliance;
pub(crate) mod haptics;
mod legend;
pub(crate) mod plot;
pub(crate) mod solvers;
pub(crate) mod table;
pub(crate) mod tissue;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use indicatif::{ProgressBar, ProgressStyle};

use plot::{Layout, Panel};
use table::Table;

/// What every chart is asked.
#[derive(Clone, Debug)]
pub(crate) struct Settings {
    /// Only the smallest problems: a look at what comes out, in seconds.
    pub(crate) quick: bool,
    /// Folder of reference data, where there is one.
    pub(crate) data: Option<PathBuf>,
}

/// A table with the name of its file, without ending, and its heading on the screen.
#[derive(Clone, Debug)]
pub(crate) struct NamedTable {
    /// Name of the CSV file, without ending.
    pub(crate) file: &'static str,
    /// Heading on the screen; a table without one is for programs, and only written.
    pub(crate) title: String,
    /// The measurements.
    pub(crate) table: Table,
}

/// What was measured.
#[derive(Clone, Debug)]
pub(crate) struct Chart {
    /// Above the panels.
    pub(crate) title: String,
    /// The picture.
    pub(crate) panels: Vec<Panel>,
    /// How they lie.
    pub(crate) layout: Layout,
    /// The data.
    pub(crate) tables: Vec<NamedTable>,
    /// What a reader should know: what was left out, and why.
    pub(crate) notes: Vec<String>,
}

/// The progress of a chart, and whether somebody wants it to end early.
pub(crate) struct Work {
    bar: ProgressBar,
    stop: Arc<AtomicBool>,
}

impl Work {
    /// Work that `stop` ends; silent where asked for, and where standard error is no terminal.
    pub(crate) fn new(stop: Arc<AtomicBool>, quiet: bool) -> Self {
        let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(0) };
        if let Ok(style) = ProgressStyle::with_template("{bar:20} {pos}/{len} {msg}") {
            bar.set_style(style);
        }
        Self { bar, stop }
    }

    /// So many more pieces of work are known.
    pub(crate) fn expect(&self, pieces: usize) {
        self.bar.inc_length(pieces as u64);
    }

    /// Begins the next piece; false where the work shall end.
    pub(crate) fn next(&self, what: &str) -> bool {
        self.bar.inc(1);
        self.bar.set_message(what.to_string());
        !self.stopped()
    }

    /// Whether the work was ended early.
    pub(crate) fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Takes the progress line off the screen.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
