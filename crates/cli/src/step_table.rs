//! The CSV table of steps.

use std::fs::File;
use std::path::{Path, PathBuf};

use palpate::step::{StepReport, StepTimes};
use palpate::summary::{ContactCounts, ForceCounts};
use palpate::tick::TickReport;

/// One row per step, with the ticks since the row before in which something acted on the force, and those whose contact was
/// not solved as a whole. Writing errors are kept and told at the end: a full disk does not end a simulation.
pub(crate) struct StepTable {
    path: PathBuf,
    keep_times: bool,
    /// Of the ticks since the last row.
    acted: ForceCounts,
    contact: ContactCounts,
    writer: Option<csv::Writer<File>>,
    error: Option<csv::Error>,
}

impl StepTable {
    /// A table that is made with its first row. Without `keep_times` the column of wall times is 0, so that equal runs
    /// give equal tables.
    pub(crate) fn new(path: &Path, keep_times: bool) -> Self {
        let (acted, contact) = (ForceCounts::default(), ContactCounts::default());
        Self { path: path.into(), keep_times, acted, contact, writer: None, error: None }
    }

    /// Counts a tick for the next row.
    pub(crate) fn tick(&mut self, report: &TickReport) {
        self.acted.add(report.record.flags);
        self.contact.add(report.record.flags);
    }

    /// Adds a row.
    pub(crate) fn write(&mut self, report: &StepReport) {
        if self.error.is_some() {
            return;
        }
        let times = if self.keep_times { report.times } else { StepTimes::default() };
        let row = StepReport { times, ..*report }.row();
        let acted = std::mem::take(&mut self.acted).values();
        let contact = std::mem::take(&mut self.contact).values();
        let row = row.iter().map(f64::to_string).chain(acted.iter().chain(&contact).map(u64::to_string));
        self.error = self.writer().and_then(|w| w.write_record(row)).err();
    }

    fn writer(&mut self) -> csv::Result<&mut csv::Writer<File>> {
        if self.writer.is_none() {
            let mut writer = csv::Writer::from_path(&self.path)?;
            let ticks = ForceCounts::NAMES.iter().chain(&ContactCounts::NAMES).map(|name| format!("ticks_{name}"));
            writer.write_record(StepReport::COLUMNS.iter().map(ToString::to_string).chain(ticks))?;
            self.writer = Some(writer);
        }
        self.writer.as_mut().ok_or_else(|| std::io::Error::other("no table").into())
    }

    /// Ends the table: its file, or what is wrong with it.
    pub(crate) fn finish(mut self) -> Result<PathBuf, String> {
        let flushed = self.writer().and_then(|w| w.flush().map_err(csv::Error::from));
        match self.error.map_or(flushed, Err) {
            Ok(()) => Ok(self.path),
            Err(error) => Err(format!("{}: the table of steps is incomplete: {error}", self.path.display())),
        }
    }
}
