//! Arguments of `palpate solve`.

use std::path::PathBuf;

use clap::Args;

use super::values::{count, positive, relaxation, solver_names, sweep_orders, tolerance};

pub(super) const SOLVE_EXAMPLES: &str = "Examples:
  palpate run block --lockstep --save-problems problems
  palpate solve problems/step-000050-pass-00001.json --solver all
  palpate solve problems/*.json --warm --solver gauss_seidel --json > runs.json
  palpate solve problems/*.json --solver gauss_seidel --sweep-order shuffled --relaxation 0.8
  palpate solve friction.dat --tol 1e-10 --max-iter 500 --out solution.json

Exit codes:
    0  every problem was solved to the tolerance
    1  the same, but --out could not be written whole
    2  a mistake in the command line or in a file; nothing was solved
    6  a problem was not solved to the tolerance
  129  ended by HUP; what was solved up to there was written, as for the next two
  130  ended by Ctrl-C (INT)
  143  ended by TERM";

#[derive(Debug, Args)]
pub(crate) struct SolveArguments {
    /// Problem files, as `palpate run --save-problems` writes them, friction-contact and LCP texts of Siconos, or local problems of FCLIB (HDF5).
    #[arg(required = true, value_name = "FILE")]
    pub(crate) files: Vec<PathBuf>,
    /// Solver, or `all`. With `all`, a problem counts as solved if one of them solves it.
    #[arg(long, value_name = "NAME", default_value = "automatic", value_parser = solver_names())]
    pub(crate) solver: String,
    /// Residual to reach (natural map, relative to the violated gaps).
    #[arg(long, value_name = "T", default_value = "1e-6", value_parser = tolerance, allow_negative_numbers = true)]
    pub(crate) tol: f64,
    /// Limit of iterations, of each attempt where `automatic` makes several; the solver's own by default. `conic_qp` is one
    /// program, which it does not limit.
    #[arg(long, value_name = "N", value_parser = count, allow_negative_numbers = true)]
    pub(crate) max_iter: Option<u32>,
    /// Part of each local change that Gauss-Seidel takes, above 0 and at most 1.
    #[arg(long, value_name = "R", value_parser = relaxation, allow_negative_numbers = true)]
    pub(crate) relaxation: Option<f64>,
    /// Order in which Gauss-Seidel visits the blocks; `forward` by default.
    #[arg(long, value_name = "ORDER", value_parser = sweep_orders())]
    pub(crate) sweep_order: Option<String>,
    /// Begin with the forces that the file holds (`start`, as `palpate run --save-problems` writes it) instead of none.
    #[arg(long)]
    pub(crate) warm: bool,
    /// Limit of time for each solver and problem, in seconds.
    #[arg(long, value_name = "S", value_parser = positive, allow_negative_numbers = true)]
    pub(crate) time_limit: Option<f64>,
    /// Print reports and residual histories as JSON, and nothing else on standard output.
    #[arg(long)]
    pub(crate) json: bool,
    /// Write forces and gaps of the best answer as JSON; for one FILE.
    #[arg(long, value_name = "SOLUTION")]
    pub(crate) out: Option<PathBuf>,
}
