//! Tables of measurements: on the screen for people, as CSV for programs.

use std::path::Path;

use comfy_table::{Cell, CellAlignment};
use miette::{IntoDiagnostic, Result, WrapErr};

use crate::screen;

/// One entry.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Value {
    /// A name.
    Text(String),
    /// A number, with the digits behind the point that the screen shows; the file has all of them.
    Number(f64, usize),
    /// A number that the screen shows as a power of ten.
    Power(f64),
    /// Nothing was measured.
    None,
}

impl From<&str> for Value {
    fn from(text: &str) -> Self {
        Self::Text(text.into())
    }
}

impl From<String> for Value {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl From<usize> for Value {
    fn from(count: usize) -> Self {
        Self::Number(count as f64, 0)
    }
}

/// Rows under named columns.
#[derive(Clone, Debug, Default)]
pub(crate) struct Table {
    columns: Vec<String>,
    rows: Vec<Vec<Value>>,
}

impl Table {
    /// An empty table. Units belong into the names: `force [N]`.
    pub(crate) fn new(columns: &[&str]) -> Self {
        Self { columns: columns.iter().map(ToString::to_string).collect(), rows: Vec::new() }
    }

    /// Adds a row, one value a column.
    pub(crate) fn push(&mut self, row: Vec<Value>) {
        debug_assert_eq!(row.len(), self.columns.len());
        self.rows.push(row);
    }

    /// As text for people.
    pub(crate) fn screen(&self) -> String {
        let mut screen = screen::table();
        screen.set_header(&self.columns);
        for row in &self.rows {
            screen.add_row(row.iter().map(|value| match value {
                Value::Text(text) => Cell::new(text),
                Value::Number(v, digits) => Cell::new(format!("{v:.digits$}")).set_alignment(CellAlignment::Right),
                Value::Power(v) => Cell::new(format!("{v:.1e}")).set_alignment(CellAlignment::Right),
                Value::None => Cell::new("-").set_alignment(CellAlignment::Right),
            }));
        }
        screen.to_string()
    }

    /// Writes the table as CSV: numbers in full, empty where nothing was measured.
    pub(crate) fn write_csv(&self, path: &Path) -> Result<()> {
        let write = || -> csv::Result<()> {
            let mut file = csv::Writer::from_path(path)?;
            file.write_record(&self.columns)?;
            for row in &self.rows {
                file.write_record(row.iter().map(|value| match value {
                    Value::Text(text) => text.clone(),
                    Value::Number(v, _) | Value::Power(v) => format!("{v}"),
                    Value::None => String::new(),
                }))?;
            }
            file.flush()?;
            Ok(())
        };
        write().into_diagnostic().wrap_err_with(|| format!("{} cannot be written", path.display()))
    }
}
