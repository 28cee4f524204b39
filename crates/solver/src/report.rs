//! What a solver says of its run.

use crate::problem::ConstraintProblem;

/// Asymmetry of `W`, relative to `sqrt(W_ii W_jj)`, that is not held against it: files in single precision have 1e-3.
const ASYMMETRY: f64 = 1e-2;

/// How a solve ended. Only [`Solved`](SolveStatus::Solved) meets the tolerance; `lambda` is finite and admissible
/// (inside its cone, block by block) in every case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SolveStatus {
    /// The residual is within the tolerance.
    Solved,
    /// The limit of iterations was reached; `lambda` is the best iterate.
    MaxIterations,
    /// The residual stopped falling (conflicting rows, or no solution near); `lambda` is the best iterate.
    Stalled,
    /// The limit of time was reached; `lambda` is the best iterate.
    TimeLimit,
    /// The method found that there is no solution, or none that it can reach (a ray of Lemke's method, a certificate of a
    /// cone solver); `lambda` is the best iterate.
    NoSolution,
    /// The method does not know a law of the problem, or needs a symmetric `W`; `lambda` is the admissible start.
    Unsupported,
    /// The problem holds or produced numbers that are not finite; `lambda` is zero.
    NotFinite,
    /// Sizes of the problem, of `lambda` or of the workspace's last preparation disagree, or a law's parameter is out of its
    /// range (friction below zero); `lambda` is zero.
    Invalid,
    /// The problem is larger than the workspace; `lambda` is zero. Of Lemke's method also one that its tableau has no room for;
    /// `lambda` is then the admissible start.
    CapacityExceeded,
}

impl SolveStatus {
    /// The status in words.
    #[must_use]
    pub fn in_words(self) -> &'static str {
        match self {
            Self::Solved => "solved",
            Self::MaxIterations => "limit of iterations",
            Self::Stalled => "stalled",
            Self::TimeLimit => "limit of time",
            Self::NoSolution => "no solution found",
            Self::Unsupported => "not for this problem",
            Self::NotFinite => "numbers not finite",
            Self::Invalid => "invalid",
            Self::CapacityExceeded => "too large",
        }
    }
}

/// Outcome of one solve.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct SolveReport {
    /// How it ended.
    pub status: SolveStatus,
    /// Sweeps or iterations done.
    pub iterations: u32,
    /// Natural-map residual of `lambda`, relative (see [`crate::residual`]); infinite where it could not be computed.
    pub residual: f64,
    /// Block with the largest share of the residual.
    pub worst_block: u32,
    /// That block's share, in m.
    pub worst_gap: f64,
}

impl SolveReport {
    /// Whether the tolerance was met.
    #[must_use]
    pub fn is_solved(&self) -> bool {
        self.status == SolveStatus::Solved
    }

    /// The block that is farthest from its law, as a sentence: its number, law and rows, and the gap error that is left. What
    /// is wrong with the problem itself (a law out of its range, a `W` that is no compliance) is named whatever the status.
    #[must_use]
    pub fn explain(&self, problem: &ConstraintProblem) -> String {
        let mistake = problem.validate_symmetric_to(ASYMMETRY).err();
        let Some(block) = problem.blocks().get(self.worst_block as usize) else {
            return mistake.map_or_else(|| "the problem has no rows".to_string(), |mistake| mistake.to_string());
        };
        let (law, first, last) = (block.law.name(), block.start, block.start + block.law.rows() - 1);
        let rows = if last > first { format!("rows {first} to {last}") } else { format!("row {first}") };
        let place = format!("block {} (`{law}`, {rows})", self.worst_block);
        if !self.worst_gap.is_finite() {
            return match (problem.check_finite(), self.status, mistake) {
                (_, SolveStatus::Invalid, Some(mistake)) => format!("the problem was not solved: {mistake}"),
                (Err(number), ..) => format!("{place}: no residual could be computed: {number}"),
                (_, _, Some(mistake)) => format!("{place}: the iteration diverged: {mistake}"),
                (_, SolveStatus::NotFinite, _) => format!(
                    "{place}: forces grew beyond what numbers hold, though the problem is finite: its compliance is too small \
                     for its gaps, or the iteration diverged"
                ),
                _ => format!("{place}: no residual could be computed, the problem is {}", self.status.in_words()),
            };
        }
        let (gap, conflicts) = (self.worst_gap, matches!(self.status, SolveStatus::Stalled | SolveStatus::NoSolution));
        let farthest = match self.status {
            SolveStatus::Solved => format!("{place} has the largest gap error that is left, {gap:.1e} m"),
            _ if conflicts && mistake.is_none() => format!(
                "{place} is farthest from its law, by a gap of {gap:.1e} m that no force was found to remove; it may \
                 conflict with other rows"
            ),
            _ if conflicts => format!("{place} is farthest from its law, by a gap of {gap:.1e} m"),
            _ => format!("{place} is farthest from its law, by a gap of {gap:.1e} m when the run ended"),
        };
        mistake.map_or(farthest.clone(), |mistake| format!("{farthest}; {mistake}"))
    }

    /// A run that ended before a residual could be computed.
    pub(crate) fn failed(status: SolveStatus, iterations: u32) -> Self {
        Self { status, iterations, residual: f64::INFINITY, worst_block: 0, worst_gap: f64::INFINITY }
    }
}
