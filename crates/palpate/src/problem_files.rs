//! Contact problems of a run, one file for each that was solved: `step-000042-pass-00001.json` is the first of step 42.
//! A step solves several by Newton's method, whose motion and forces take turns, and in explicit substeps.
//!
//! Each file holds the forces that the solver began with and those that it found, so that `palpate solve --warm` repeats it.

use std::io;
use std::path::{Path, PathBuf};

use palpate_solver::problem::ConstraintProblem;
use palpate_solver::problem_file::{self, Forces};

use crate::counted::counted;

/// The folder they go to, and how that went.
pub(crate) struct ProblemFiles {
    folder: PathBuf,
    saved: usize,
    /// Step of the last problem, and its number in that step.
    last: Option<(u64, u32)>,
    /// Forces that the solver begins with (N).
    start: Vec<f64>,
    /// The first that could not be written; none is tried after it.
    trouble: Option<String>,
}

impl ProblemFiles {
    pub(crate) fn new(folder: PathBuf) -> Self {
        Self { folder, saved: 0, last: None, start: Vec::new(), trouble: None }
    }

    /// Keeps the forces (N) that the solver begins with.
    pub(crate) fn begin(&mut self, lambda: &[f64]) {
        self.start.clear();
        self.start.extend_from_slice(lambda);
    }

    /// Writes a problem of a step with the forces (N) that were found. The step's thread waits for the disk.
    pub(crate) fn save(&mut self, step: u64, problem: &ConstraintProblem, lambda: &[f64]) {
        if self.trouble.is_some() {
            return;
        }
        let pass = self.last.filter(|last| last.0 == step).map_or(1, |last| last.1 + 1);
        self.last = Some((step, pass));
        let path = self.folder.join(format!("step-{step:06}-pass-{pass:05}.json"));
        let forces = Forces { start: Some(self.start.clone()), lambda: Some(lambda.to_vec()) };
        match problem_file::save_with_forces(problem, &forces, &path) {
            Ok(()) => self.saved += 1,
            Err(error) => self.trouble = Some(format!("{}: {error}", path.display())),
        }
    }

    /// What the summary says.
    pub(crate) fn note(&self) -> String {
        let count = counted(self.saved, "contact problem", "contact problems");
        let saved = format!("{count} saved in {}", self.folder.display());
        match &self.trouble {
            Some(trouble) => format!("{saved}; the rest is lost: {trouble}"),
            None => saved,
        }
    }
}

/// Problems that an earlier run saved in this folder, in the order of their names; none where there is no such folder.
///
/// # Errors
/// A folder that cannot be read.
pub fn saved_in(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let entries = match std::fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries?,
    };
    let mut found = Vec::new();
    for entry in entries {
        let path = entry?.path();
        if path.file_name().and_then(|name| name.to_str()).is_some_and(is_ours) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// Whether a file is called as a saved problem is, by this version or by one that saved a problem a step.
fn is_ours(name: &str) -> bool {
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    let Some(name) = name.strip_prefix("step-").and_then(|name| name.strip_suffix(".json")) else { return false };
    match name.split_once("-pass-") {
        Some((step, pass)) => digits(step) && digits(pass),
        None => digits(name),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_of_saved_problems_are_taken_for_ours() {
        for name in ["step-000042-pass-00001.json", "step-1000000-pass-100000.json", "step-000042.json"] {
            assert!(is_ours(name), "{name}");
        }
        for name in ["step-.json", "step-1-pass-.json", "step-4x-pass-1.json", "steps.json", "step-1-pass-1.csv", "a"] {
            assert!(!is_ours(name), "{name}");
        }
    }
}
