//! What a solver says of its run.

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
    /// Sizes of the problem, of `lambda` or of the workspace's last preparation disagree; `lambda` is zero.
    Invalid,
    /// The problem is larger than the workspace; `lambda` is zero.
    CapacityExceeded,
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

    /// A run that ended before a residual could be computed.
    pub(crate) fn failed(status: SolveStatus, iterations: u32) -> Self {
        Self { status, iterations, residual: f64::INFINITY, worst_block: 0, worst_gap: f64::INFINITY }
    }
}
