//! Contact problems of a run, one file for each step that has contacts: `step-000042.json` is that of step 42.

use std::path::PathBuf;

use palpate_solver::problem::ConstraintProblem;
use palpate_solver::problem_file;

use crate::step::StepReport;

/// The folder they go to, and how that went.
pub(crate) struct ProblemFiles {
    folder: PathBuf,
    saved: usize,
    /// The first that could not be written; none is tried after it.
    trouble: Option<String>,
}

impl ProblemFiles {
    pub(crate) fn new(folder: PathBuf) -> Self {
        Self { folder, saved: 0, trouble: None }
    }

    /// Writes the problem of a step, if it has rows. The step's thread waits for the disk.
    pub(crate) fn save(&mut self, report: &StepReport, problem: &ConstraintProblem) {
        if problem.rows() == 0 || !report.compliance.usable || self.trouble.is_some() {
            return;
        }
        let path = self.folder.join(format!("step-{:06}.json", report.step));
        match problem_file::save(problem, &path) {
            Ok(()) => self.saved += 1,
            Err(error) => self.trouble = Some(format!("{}: {error}", path.display())),
        }
    }

    /// What the summary says.
    pub(crate) fn note(&self) -> String {
        let saved = format!("{} contact problems saved in {}", self.saved, self.folder.display());
        match &self.trouble {
            Some(trouble) => format!("{saved}; the rest is lost: {trouble}"),
            None => saved,
        }
    }
}
