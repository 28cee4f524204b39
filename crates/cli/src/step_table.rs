//! The CSV table of steps.

use std::fs::File;
use std::path::{Path, PathBuf};

use palpate::step::{StepReport, StepTimes};

/// One row per step. Writing errors are kept and told at the end: a full disk does not end a simulation.
pub(crate) struct StepTable {
    path: PathBuf,
    keep_times: bool,
    writer: Option<csv::Writer<File>>,
    error: Option<csv::Error>,
}

impl StepTable {
    /// A table that is made with its first row. Without `keep_times` the column of wall times is 0, so that equal runs
    /// give equal tables.
    pub(crate) fn new(path: &Path, keep_times: bool) -> Self {
        Self { path: path.into(), keep_times, writer: None, error: None }
    }

    /// Adds a row.
    pub(crate) fn write(&mut self, report: &StepReport) {
        if self.error.is_some() {
            return;
        }
        let times = if self.keep_times { report.times } else { StepTimes::default() };
        let row = StepReport { times, ..*report }.row();
        self.error = self.writer().and_then(|w| w.write_record(row.iter().map(f64::to_string))).err();
    }

    fn writer(&mut self) -> csv::Result<&mut csv::Writer<File>> {
        if self.writer.is_none() {
            let mut writer = csv::Writer::from_path(&self.path)?;
            writer.write_record(StepReport::COLUMNS)?;
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
