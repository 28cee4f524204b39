//! Half solves that are made beside the steps with the factor that they are of ([`palpate_fem::factor::NodalCompliance`]).
//!
//! A step tells with its matrix which nodes its compliances wanted; the factor stage solves for them as soon as it has the
//! factor, and the first step with that factor finds them done.

use palpate_fem::factor::NodalCompliance;

use super::StepWorkspace;
use crate::refresh::FactorSample;
use crate::world::World;

impl StepWorkspace {
    /// Memory for a factor stage to prepare half solves in; `None` where there is no such stage.
    pub(crate) fn room_for_prepared(&self, world: &World) -> Option<Box<NodalCompliance>> {
        self.compliance.inverse().reach().room_for_prepared().filter(|_| world.plan().has_factor_thread())
    }

    /// Lists the free nodes that the step's compliances wanted, as many as `into` has room for.
    pub(crate) fn latest_nodes(&self, into: &mut Vec<u32>) {
        self.compliance.inverse().reach().latest_nodes(into);
    }

    /// Takes over what was prepared with the factor, and leaves it memory for the next time.
    pub(super) fn take_prepared(&mut self, factor: &mut FactorSample) {
        if let Some(prepared) = &mut factor.prepared {
            self.compliance.inverse_mut().reach_mut().take_prepared(&factor.factor, prepared);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use nalgebra::Isometry3;

    use crate::scene::Scene;
    use crate::simulation::Simulation;

    /// A block under a ball, with a factor thread.
    const SLIDE: &str = r#"
        name = "slide"
        [[body]]
        name = "block"
        block = { min = [0, 0, 0], max = [0.06, 0.04, 0.04], cells = [9, 6, 6] }
        material = { law = "neo_hookean", young = 5e3, poisson = 0.4 }
        rayleigh_stiffness = 0.005
        compliance = "async"
        fixed = [{ below = { axis = "z", at = 0.0 } }]
        [[tool]]
        name = "ball"
        shape = { kind = "sphere", radius = 0.012 }
        [hand]
        path = [{ time = 0.0, position = [0.02, 0.02, 0.053] }]
    "#;

    #[test]
    fn a_step_with_a_new_factor_finds_nearly_all_of_its_nodes_solved_for_and_answers_the_same() {
        let world = Scene::from_toml(SLIDE, Path::new("")).unwrap().build().unwrap();
        let run = |prepares: bool| {
            let mut simulation = Simulation::new(&world).unwrap().refresh_every(3);
            assert!(simulation.factor.prepared.is_some());
            let (mut wanted, mut solved, mut forces) = (0, 0, Vec::new());
            for k in 0..30 {
                if !prepares {
                    simulation.factor.prepared = None;
                }
                let begins = simulation.factor.prepared.as_ref().filter(|p| p.is_of(&simulation.factor.factor));
                let ready = begins.map_or(0, |prepared| prepared.len());
                let pose = Isometry3::translation(0.02 + 2e-4 * f64::from(k), 0.02, 0.052 - 1e-4 * f64::from(k));
                forces.push(simulation.step_alone(&pose));
                let kept = simulation.workspace().compliance.inverse().reach().kept_nodes();
                if ready > 0 {
                    (wanted, solved) = (wanted + kept, solved + kept - ready);
                }
                simulation.refresh_if_due(&forces[k as usize]);
            }
            (wanted, solved, forces)
        };
        let (wanted, solved, with) = run(true);
        println!("{solved} of {wanted} nodes were solved for in steps with a new factor");
        assert!(wanted > 100 && 10 * solved < wanted, "{solved} of {wanted}");
        let (ready, .., without) = run(false);
        assert_eq!(ready, 0);
        let largest = with.iter().map(|r| r.force.norm()).fold(0.0, f64::max);
        assert!(largest > 0.1, "{largest} N");
        for (with, without) in with.iter().zip(&without) {
            // nodes that are solved for together decide the last digits, and these where iterations to 1e-6 end
            assert!((with.force - without.force).norm() < 1e-5 * largest, "step {}", with.step);
        }
    }
}
