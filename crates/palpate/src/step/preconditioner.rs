//! The preconditioner of a step's linear solves: its own factor where there is one, else the latest.

use nalgebra::Matrix3;
use palpate_fem::factor::{Factor, SolveStatus, SolveWorkspace};
use palpate_fem::preconditioner::{FactorPreconditioner, Preconditioner, WarpedPreconditioner};

use crate::refresh::FactorSample;

/// Either of the two.
pub(super) enum StepPreconditioner<'a> {
    Own(FactorPreconditioner<'a>),
    Latest(WarpedPreconditioner<'a>),
}

impl<'a> StepPreconditioner<'a> {
    /// From this step's factor, or else from the latest, warped by the rotations since it was taken.
    pub(super) fn new(
        own: Option<&'a Factor>,
        latest: &'a FactorSample,
        rotations: &'a [Matrix3<f64>],
        workspace: &'a mut SolveWorkspace,
    ) -> Self {
        match own {
            Some(factor) => Self::Own(FactorPreconditioner { factor, workspace }),
            None => Self::Latest(WarpedPreconditioner { factor: &latest.factor, rotations, workspace }),
        }
    }
}

impl Preconditioner for StepPreconditioner<'_> {
    fn apply(&mut self, r: &[f64], z: &mut [f64]) -> SolveStatus {
        match self {
            Self::Own(own) => own.apply(r, z),
            Self::Latest(latest) => latest.apply(r, z),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use nalgebra::Vector3;
    use palpate_fem::factor::FactorStatus;

    use crate::scene::Scene;
    use crate::simulation::Simulation;

    /// A block that begins to sink under its weight, with a factor that is never made anew.
    const SINK: &str = r#"
        name = "sink"
        gravity = [0, 0, -9.81]
        [[body]]
        name = "block"
        block = { min = [0, 0, 0], max = [0.04, 0.04, 0.04], cells = [4, 4, 4] }
        material = { law = "neo_hookean", young = 5e3, poisson = 0.4 }
        compliance = "async"
        settle = false
        fixed = [{ below = { axis = "z", at = 0.0 } }]
        [[tool]]
        name = "ball"
        shape = { kind = "sphere", radius = 0.012 }
        [hand]
        path = [{ time = 0.0, position = [0.02, 0.02, 0.08] }]
    "#;

    /// Conjugate gradients do not see the size of a preconditioner; its copy in 16 bits does.
    #[test]
    fn a_factor_beyond_the_range_of_its_copy_serves_as_well_and_the_step_says_so() {
        let world = Scene::from_toml(SINK, Path::new("")).unwrap().build().unwrap();
        let run = |size: f64| {
            let mut simulation = Simulation::new(&world).unwrap().refresh_every(0);
            let mut system = simulation.workspace().fem.system.clone();
            system.blocks.iter_mut().for_each(|block| *block *= size);
            let factored = simulation.factor.factor.refactor(&system);
            assert_eq!((factored.status, factored.copy_refused), (FactorStatus::Ok, size < 1.0));
            let reports = [0, 1].map(|_| simulation.step_alone(&world.first_pose()));
            (reports, simulation.positions().to_vec())
        };
        let (([with, _], sunk), (without, expected)) = (run(1.0), run(1e-30));
        assert_eq!(with.in_full, 0);
        for report in without {
            let solves = report.free_motion.iterations as u32;
            assert!(solves > 0 && report.in_full >= solves, "{} of {solves}", report.in_full);
        }
        let far =
            |a: &[Vector3<f64>], b: &[Vector3<f64>]| a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        let all = far(&expected, &world.mesh().nodes);
        assert!(all > 1e-4, "{all} m");
        // the residual of the motion is 1e-6 in either, times the condition of this body
        assert!(far(&sunk, &expected) < 1e-3 * all, "{:e} of {all:e}", far(&sunk, &expected));
    }
}
