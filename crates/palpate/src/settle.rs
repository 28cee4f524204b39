//! The state in which a run begins, at rest under gravity, and the equilibrium of a scene.

use palpate_fem::integrator::equilibrium::{
    EquilibriumConfig, EquilibriumError, EquilibriumReport, Loads, equilibrium,
};
use palpate_fem::integrator::newton::{ImplicitWorkspace, NewtonConfig};
use palpate_fem::model::FemState;

use crate::world::World;

/// Relative residual of a settled body: three digits below the tolerance of the steps that follow.
const SETTLED: f64 = 1e-9;

/// The static equilibrium of the scene's body under gravity, without contact, whatever the scene says about settling.
///
/// # Errors
/// A body that nothing holds. That the load could not be carried is in the report: the state then is the last
/// equilibrium on the way.
pub fn at_rest(world: &World) -> Result<(FemState, EquilibriumReport), EquilibriumError> {
    if let Some((state, report)) = world.known_rest() {
        return Ok((state.clone(), *report));
    }
    let model = world.model();
    let mut state = model.rest_state();
    let mut ws = ImplicitWorkspace::new(model, world.symbolic());
    let newton = NewtonConfig { tolerance: SETTLED, ..EquilibriumConfig::default().newton };
    let config = EquilibriumConfig { newton, ..EquilibriumConfig::default() };
    let report = equilibrium(model, &Loads::default(), &config, &mut state, &mut ws)?;
    Ok((state, report))
}

/// The body as a run begins, and how it came to rest under its own weight.
///
/// Without gravity, without fixed nodes (a free body only falls), or where the scene says so, it is the mesh itself.
pub(crate) fn settle(world: &World) -> (FemState, Option<EquilibriumReport>) {
    let heavy = world.description().gravity != [0.0; 3];
    if !world.description().bodies[0].settle || !heavy {
        return (world.model().rest_state(), None);
    }
    match at_rest(world) {
        Ok((state, report)) => (state, Some(report)),
        Err(_) => (world.model().rest_state(), None),
    }
}
