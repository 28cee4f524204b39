//! Contact problems in files: our own format, those of Siconos in [`siconos`], and FCLIB's.
//!
//! Ours is JSON, so that any language reads it: `format` (always `palpate-contact-problem`), `version` (1), `blocks`
//! (`start` and `law` each), `delta_free` (m), `compliance` (m/N, an array of columns), and where they are known the forces
//! that a solver began with and found (`start` and `lambda`, N, one per row). Numbers are written in the
//! shortest form that reads back to the same bits. A problem that does not validate for its numbers' sake (negative
//! diagonal, asymmetry) can be written and read, since such problems are what one wants to look at; numbers that are not
//! finite cannot, since JSON has none.
//!
//! [`open`] tells the formats apart by their content. Files of FCLIB are HDF5, and read where the feature `fclib` is on: by
//! `hdf5-reader`, which is pure Rust, needs no library of the system, and is hardened against malformed files.

#[cfg(feature = "fclib")]
pub mod fclib;
pub mod siconos;

use crate::problem::{Block, ConstraintProblem, ProblemError};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

const FORMAT: &str = "palpate-contact-problem";
const VERSION: u32 = 1;

/// Largest number of rows a file may ask for: 0.5 GB of compliance.
pub const MAX_ROWS: usize = 8192;

/// Why a problem file could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum ProblemFileError {
    /// The file could not be opened, read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The text is not JSON of the expected shape; the message names line and column.
    #[error("not a contact problem: {0}")]
    Json(#[from] serde_json::Error),
    /// The file is JSON of another kind or of a later version.
    #[error("expected `{FORMAT}` version {VERSION}, found `{format}` version {version}")]
    Format {
        /// What the file calls itself.
        format: String,
        /// Its version.
        version: u32,
    },
    /// The file is HDF5, and this build cannot read it.
    #[cfg(not(feature = "fclib"))]
    #[error("HDF5 files (FCLIB) are not read by this build; build it with the feature `fclib`")]
    Hdf5,
    /// The file is HDF5 but not a problem of FCLIB that is read.
    #[cfg(feature = "fclib")]
    #[error("HDF5 (FCLIB): {what}")]
    Fclib {
        /// What is wrong, with the path within the file.
        what: String,
    },
    /// There is nothing in the file.
    #[error("the file is empty")]
    Empty,
    /// The file is neither JSON nor text.
    #[error("line {line}: neither JSON nor text: byte {at} of the file is not UTF-8")]
    Binary {
        /// Line, from one.
        line: usize,
        /// First byte that no text has.
        at: usize,
    },
    /// A line of a text format cannot be understood.
    #[error("line {line}: expected {expected}, found {found}")]
    Text {
        /// Line, from one.
        line: usize,
        /// What should stand there.
        expected: String,
        /// What does.
        found: String,
    },
    /// The file asks for more rows than [`MAX_ROWS`].
    #[error("{rows} rows are more than the {MAX_ROWS} that are accepted")]
    TooLarge {
        /// Rows asked for.
        rows: usize,
    },
    /// Forces that do not fit the problem.
    #[error("`{name}` has {forces} forces for {rows} rows; give one per row, or leave it out")]
    Forces {
        /// Which forces.
        name: &'static str,
        /// How many there are.
        forces: usize,
        /// Rows of the problem.
        rows: usize,
    },
    /// A force that is not a number.
    #[error("{name}[{row}] = {value} N is not finite; look for the problem that its solver left unsolved")]
    NonFiniteForce {
        /// Which forces.
        name: &'static str,
        /// Row.
        row: usize,
        /// The force.
        value: f64,
    },
    /// The numbers are not a contact problem.
    #[error(transparent)]
    Problem(#[from] ProblemError),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    format: String,
    version: u32,
    blocks: Vec<Block>,
    delta_free: Vec<f64>,
    compliance: Vec<Vec<f64>>,
    #[serde(default)]
    start: Option<Vec<f64>>,
    #[serde(default)]
    lambda: Option<Vec<f64>>,
}

/// Forces that belong to a problem, N, one per row. Not part of it: where another solver begins and ends is its own affair.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Forces {
    /// Those that a solver began with.
    pub start: Option<Vec<f64>>,
    /// Those that it found.
    pub lambda: Option<Vec<f64>>,
}

impl Forces {
    /// As many finite forces as the problem has rows.
    fn check(&self, rows: usize) -> Result<(), ProblemFileError> {
        for (name, forces) in [("start", &self.start), ("lambda", &self.lambda)] {
            let Some(forces) = forces else { continue };
            if forces.len() != rows {
                return Err(ProblemFileError::Forces { name, forces: forces.len(), rows });
            }
            if let Some((row, &value)) = forces.iter().enumerate().find(|(_, force)| !force.is_finite()) {
                return Err(ProblemFileError::NonFiniteForce { name, row, value });
            }
        }
        Ok(())
    }
}

#[derive(Serialize)]
struct FileRef<'a> {
    format: &'static str,
    version: u32,
    blocks: &'a [Block],
    delta_free: &'a [f64],
    compliance: Vec<&'a [f64]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    start: &'a Option<Vec<f64>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    lambda: &'a Option<Vec<f64>>,
}

/// Writes a problem in our format.
///
/// # Errors
/// Blocks that do not tile the rows, numbers that are not finite, and what the writer reports.
pub fn write(problem: &ConstraintProblem, writer: impl Write) -> Result<(), ProblemFileError> {
    write_with_forces(problem, &Forces::default(), writer)
}

/// [`write()`] with forces.
///
/// # Errors
/// As [`write()`], and forces that are not as many as rows or not finite.
pub fn write_with_forces(
    problem: &ConstraintProblem,
    forces: &Forces,
    writer: impl Write,
) -> Result<(), ProblemFileError> {
    forces.check(problem.rows())?;
    problem.check_blocks()?;
    problem.check_finite()?;
    let view = problem.view();
    let file = FileRef {
        format: FORMAT,
        version: VERSION,
        blocks: problem.blocks(),
        delta_free: problem.delta_free(),
        compliance: (0..problem.rows()).map(|j| view.column(j)).collect(),
        start: &forces.start,
        lambda: &forces.lambda,
    };
    Ok(serde_json::to_writer(writer, &file)?)
}

/// Reads a problem in our format. Its sizes agree; [`ConstraintProblem::validate`] checks its values.
///
/// # Errors
/// Text that is not a problem, and sizes that disagree.
pub fn read(reader: impl Read) -> Result<ConstraintProblem, ProblemFileError> {
    Ok(read_with_forces(reader)?.0)
}

/// [`read`] with the forces that the file holds.
///
/// # Errors
/// As [`read`], and forces that are not as many as rows.
pub fn read_with_forces(reader: impl Read) -> Result<(ConstraintProblem, Forces), ProblemFileError> {
    let file: File = serde_json::from_reader(reader)?;
    if file.format != FORMAT || file.version != VERSION {
        return Err(ProblemFileError::Format { format: file.format, version: file.version });
    }
    let rows = file.delta_free.len();
    let w_columns = file.compliance.len();
    let wrong = file.compliance.iter().find(|column| column.len() != rows);
    if let Some(w_rows) = wrong.map(Vec::len).or((w_columns != rows).then_some(rows)) {
        return Err(ProblemError::WrongSize { w_rows, w_columns, rows }.into());
    }
    let compliance = DMatrix::from_vec(rows, rows, file.compliance.concat());
    let problem =
        ConstraintProblem::new(compliance, DVector::from_vec(file.delta_free), file.blocks.iter().map(|b| b.law))?;
    // `new` places the blocks itself: they must be where the file says.
    if let Some((block, (b, placed))) =
        file.blocks.iter().zip(problem.blocks()).enumerate().find(|(_, (b, placed))| b.start != placed.start)
    {
        let end = b.start.saturating_add(b.law.rows());
        let (law, expected) = (b.law.name(), placed.start);
        return Err(ProblemError::WrongBlock { block, law, start: b.start, end, expected, rows }.into());
    }
    let forces = Forces { start: file.start, lambda: file.lambda };
    forces.check(rows)?;
    Ok((problem, forces))
}

/// [`write()`] to a file.
///
/// # Errors
/// As [`write()`], and the file.
pub fn save(problem: &ConstraintProblem, path: &Path) -> Result<(), ProblemFileError> {
    save_with_forces(problem, &Forces::default(), path)
}

/// [`write_with_forces`] to a file.
///
/// # Errors
/// As [`write_with_forces`], and the file.
pub fn save_with_forces(problem: &ConstraintProblem, forces: &Forces, path: &Path) -> Result<(), ProblemFileError> {
    let io = |source| ProblemFileError::Io { path: path.to_path_buf(), source };
    let mut writer = std::io::BufWriter::new(std::fs::File::create(path).map_err(io)?);
    write_with_forces(problem, forces, &mut writer)?;
    writer.flush().map_err(io)
}

/// [`read`] from a file.
///
/// # Errors
/// As [`read`], and the file.
pub fn load(path: &Path) -> Result<ConstraintProblem, ProblemFileError> {
    let file = std::fs::File::open(path).map_err(|source| ProblemFileError::Io { path: path.to_path_buf(), source })?;
    read(std::io::BufReader::new(file))
}

/// Reads a problem from a file of any format that is known: ours where it begins with `{`, HDF5 by its signature, else one of
/// Siconos.
///
/// # Errors
/// As [`read`] and [`siconos::read`], and the file.
pub fn open(path: &Path) -> Result<ConstraintProblem, ProblemFileError> {
    Ok(open_with_forces(path)?.0)
}

/// [`open`] with the forces that the file holds; the texts of Siconos hold none.
///
/// # Errors
/// As [`open`].
pub fn open_with_forces(path: &Path) -> Result<(ConstraintProblem, Forces), ProblemFileError> {
    let io = |source| ProblemFileError::Io { path: path.to_path_buf(), source };
    let bytes = std::fs::read(path).map_err(io)?;
    if bytes.starts_with(b"\x89HDF\r\n\x1a\n") {
        #[cfg(feature = "fclib")]
        return fclib::read(bytes);
        #[cfg(not(feature = "fclib"))]
        return Err(ProblemFileError::Hdf5);
    }
    if bytes.trim_ascii_start().first() == Some(&b'{') {
        return read_with_forces(bytes.as_slice());
    }
    if bytes.trim_ascii().is_empty() {
        return Err(ProblemFileError::Empty);
    }
    let text = String::from_utf8(bytes).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        let line = e.as_bytes().iter().take(at).filter(|byte| **byte == b'\n').count() + 1;
        ProblemFileError::Binary { line, at }
    })?;
    Ok((siconos::read(&text)?, Forces::default()))
}
