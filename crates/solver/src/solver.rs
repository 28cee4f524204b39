//! The register of solvers.

use crate::accelerated_gradient::{AcceleratedGradientConfig, AcceleratedGradientWorkspace};
use crate::automatic::{AutomaticConfig, AutomaticWorkspace};
use crate::conic_friction::{ConicFrictionConfig, ConicFrictionWorkspace};
use crate::conic_qp::{ConicQpConfig, ConicQpWorkspace};
use crate::gauss_seidel::{GaussSeidelConfig, GaussSeidelWorkspace};
use crate::lemke::{LemkeConfig, LemkeWorkspace};
use crate::newton::{NewtonConfig, NewtonWorkspace};
use crate::nncg::{NncgConfig, NncgWorkspace};
use crate::problem::ProblemView;
use crate::report::{SolveReport, SolveStatus};
use crate::watch::Watch;
use serde::{Deserialize, Serialize};

/// What a solver must offer: its parameters are the implementing type, its memory is `Workspace`.
pub trait ConstraintSolver: Copy + Default {
    /// Name in scenes and on the command line.
    const NAME: &'static str;
    /// Memory of a run, sized once.
    type Workspace;

    /// Memory for problems of up to `rows` rows.
    fn workspace(&self, rows: usize) -> Self::Workspace;

    /// The same with another tolerance (natural-map residual, relative) and, if given, another limit of iterations.
    #[must_use]
    fn limited(self, tolerance: f64, max_iterations: Option<u32>) -> Self;

    /// Makes the memory whose size hangs on the laws of a problem and on their order: programs for the cone solvers,
    /// room for facets beyond four in Lemke's, nothing in the others. Solving this problem, or one with the same laws and
    /// other numbers, then allocates nothing. The cone solvers keep the last eight such sequences of laws. These
    /// solve a program for it, and allocate: for where a scene is set up, not for a thread that must be in time.
    ///
    /// # Errors
    /// Why a solve would not begin: [`SolveStatus::Invalid`], [`SolveStatus::CapacityExceeded`],
    /// [`SolveStatus::Unsupported`] or [`SolveStatus::NotFinite`].
    fn prepare(&self, _view: &ProblemView<'_>, _ws: &mut Self::Workspace) -> Result<(), SolveStatus> {
        Ok(())
    }

    /// Solves from the forces in `lambda` (N) and leaves the answer there: finite and admissible whatever the status.
    ///
    /// Allocates nothing, where [`ConstraintSolver::prepare`] has been called for the sequence of laws, or a problem with it
    /// has been solved before; without, the cone solvers and Lemke make their memory here. On another thread than the one
    /// that made the workspace see [`warm_thread`].
    fn solve_watched(
        &self,
        view: &ProblemView<'_>,
        lambda: &mut [f64],
        ws: &mut Self::Workspace,
        watch: &mut Watch<'_>,
    ) -> SolveReport;
}

/// Prepares the calling thread for solvers that factor (Newton, the automatic choice): matrix products keep packing memory
/// for each thread, made at their first use. The making of a workspace does it for its own thread; another thread that must
/// not allocate calls this before it begins. Takes about a millisecond.
pub fn warm_thread() {
    crate::dense::warm_thread();
}

macro_rules! solvers {
    ($($(#[$doc:meta])* $variant:ident($config:ty, $workspace:ty)),+ $(,)?) => {
        /// Any registered solver with its parameters. In text: `{ type = "gauss_seidel", tolerance = 1e-6 }`.
        #[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(tag = "type", rename_all = "snake_case")]
        pub enum Solver {
            $($(#[$doc])* $variant($config),)+
        }

        /// The name of a registered solver, for descriptions that leave its parameters at their defaults.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
        #[serde(rename_all = "snake_case")]
        pub enum SolverKind {
            $($(#[$doc])* $variant,)+
        }

        impl SolverKind {
            /// The solver with default parameters.
            #[must_use]
            pub fn solver(self) -> Solver {
                match self { $(SolverKind::$variant => Solver::$variant(<$config>::default()),)+ }
            }
        }

        /// Memory of any registered solver.
        #[derive(Clone, Debug)]
        #[allow(clippy::large_enum_variant)] // one for a run, never moved in it
        pub enum SolverWorkspace {
            $($(#[$doc])* $variant($workspace),)+
        }

        impl Solver {
            /// Names of all registered solvers.
            pub const NAMES: &'static [&'static str] = &[$(<$config>::NAME),+];

            /// The solver of that name with default parameters.
            #[must_use]
            pub fn from_name(name: &str) -> Option<Self> {
                $(if name == <$config>::NAME {
                    return Some(Solver::$variant(<$config>::default()));
                })+
                None
            }

            /// Register name.
            #[must_use]
            pub fn name(&self) -> &'static str {
                match self { $(Solver::$variant(_) => <$config>::NAME,)+ }
            }

            /// Memory for problems of up to `rows` rows.
            #[must_use]
            pub fn workspace(&self, rows: usize) -> SolverWorkspace {
                match self {
                    $(Solver::$variant(config) => SolverWorkspace::$variant(config.workspace(rows)),)+
                }
            }

            /// [`ConstraintSolver::limited`]
            #[must_use]
            pub fn limited(self, tolerance: f64, max_iterations: Option<u32>) -> Self {
                match self {
                    $(Solver::$variant(config) => Solver::$variant(config.limited(tolerance, max_iterations)),)+
                }
            }

            /// [`ConstraintSolver::prepare`]
            ///
            /// # Errors
            /// As there; [`SolveStatus::Invalid`] for a workspace of another solver.
            pub fn prepare(&self, view: &ProblemView<'_>, ws: &mut SolverWorkspace) -> Result<(), SolveStatus> {
                match (self, ws) {
                    $((Solver::$variant(config), SolverWorkspace::$variant(ws)) => config.prepare(view, ws),)+
                    _ => Err(SolveStatus::Invalid),
                }
            }

            /// [`Solver::solve_watched`] without limit of time and record.
            pub fn solve(&self, view: &ProblemView<'_>, lambda: &mut [f64], ws: &mut SolverWorkspace) -> SolveReport {
                self.solve_watched(view, lambda, ws, &mut Watch::none())
            }

            /// [`ConstraintSolver::solve_watched`]; a workspace of another solver ends as [`SolveStatus::Invalid`].
            pub fn solve_watched(
                &self,
                view: &ProblemView<'_>,
                lambda: &mut [f64],
                ws: &mut SolverWorkspace,
                watch: &mut Watch<'_>,
            ) -> SolveReport {
                match (self, ws) {
                    $((Solver::$variant(config), SolverWorkspace::$variant(ws)) => {
                        config.solve_watched(view, lambda, ws, watch)
                    })+
                    _ => {
                        lambda.fill(0.0);
                        SolveReport::failed(SolveStatus::Invalid, 0)
                    }
                }
            }
        }
    };
}

solvers! {
    /// Block Gauss-Seidel.
    GaussSeidel(GaussSeidelConfig, GaussSeidelWorkspace),
    /// Nonsmooth nonlinear conjugate gradients over sweeps of Gauss-Seidel.
    Nncg(NncgConfig, NncgWorkspace),
    /// Semismooth Newton on the equations of Alart and Curnier.
    SemismoothNewton(NewtonConfig, NewtonWorkspace),
    /// Lemke's pivoting method on the linear complementarity problem with a faceted cone.
    Lemke(LemkeConfig, LemkeWorkspace),
    /// One quadratic program, for problems without friction (Clarabel).
    ConicQp(ConicQpConfig, ConicQpWorkspace),
    /// Second-order cone programs with De Saxcé's correction (Clarabel).
    ConicFriction(ConicFrictionConfig, ConicFrictionWorkspace),
    /// Accelerated projected gradient with restart.
    AcceleratedGradient(AcceleratedGradientConfig, AcceleratedGradientWorkspace),
    /// The cheapest that solves the problem.
    Automatic(AutomaticConfig, AutomaticWorkspace),
}

impl From<GaussSeidelConfig> for Solver {
    fn from(config: GaussSeidelConfig) -> Self {
        Solver::GaussSeidel(config)
    }
}

impl From<AutomaticConfig> for Solver {
    fn from(config: AutomaticConfig) -> Self {
        Solver::Automatic(config)
    }
}

impl Default for Solver {
    fn default() -> Self {
        Solver::GaussSeidel(GaussSeidelConfig::default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_finds_its_solver() {
        for name in Solver::NAMES {
            assert_eq!(Solver::from_name(name).map(|solver| solver.name()), Some(*name));
            let kind: SolverKind = serde_json::from_value(serde_json::json!(name)).unwrap();
            assert_eq!(kind.solver().name(), *name);
            // The text form of the solver carries the same name.
            assert_eq!(serde_json::to_value(kind.solver()).unwrap()["type"], *name);
        }
        assert_eq!(Solver::from_name("gaussseidel"), None);
    }

    #[test]
    fn text_form_takes_defaults_and_refuses_unknown_keys() {
        let solver: Solver = serde_json::from_str(r#"{"type": "gauss_seidel", "tolerance": 1e-3}"#).unwrap();
        let expected = GaussSeidelConfig { tolerance: 1e-3, ..GaussSeidelConfig::default() };
        assert_eq!(solver, Solver::GaussSeidel(expected));
        assert!(serde_json::from_str::<Solver>(r#"{"type": "gauss_seidel", "tolerence": 1e-3}"#).is_err());
    }
}
