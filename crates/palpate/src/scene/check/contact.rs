//! The range of every value of contact and solvers, and which of them fit one another.

use palpate_constraints::law::{ContactLaw, Coulomb};

use super::super::description::{ContactMethod, IntegratorKind, SceneDescription};
use super::super::parse::Source;
use super::Checked;
use super::number::{at_least_one, not_negative, positive};

/// Checks every value of contact and solvers.
pub(super) fn check(scene: &SceneDescription, source: &Source<'_>) -> Checked {
    let c = &scene.contact;
    friction(source, "contact.friction", c.friction)?;
    not_negative(source, "contact.margin", c.margin, "m")?;
    not_negative(source, "contact.merge_distance", c.merge_distance, "m")?;
    max_contacts(source, "contact.max_contacts", c.max_contacts)?;
    contact_method(scene, source)?;
    positive(source, "solver.tolerance", scene.solver.tolerance, "")?;
    positive(source, "solver.tick_tolerance", scene.solver.tick_tolerance, "")?;
    at_least_one(source, "solver.max_sweeps", scene.solver.max_sweeps as usize)?;
    at_least_one(source, "solver.tick_sweeps", scene.solver.tick_sweeps as usize)
}

/// A number of contacts whose compliance has a sensible size.
pub(super) fn max_contacts(source: &Source<'_>, path: &str, contacts: usize) -> Checked {
    at_least_one(source, path, contacts)?;
    if contacts > 1000 {
        let message = format!("{contacts} contacts make a compliance of {} MB", 9 * contacts.pow(2) / 131_072);
        return Err(source.at(path, message, "use at most 1000; 48 serve a fingertip"));
    }
    Ok(())
}

/// A coefficient of Coulomb friction.
pub(super) fn friction(source: &Source<'_>, path: &str, friction: f64) -> Checked {
    not_negative(source, path, friction, "")?;
    Coulomb { friction }.validate().map_err(|e| source.at(path, e.to_string(), e.remedy))
}

/// The settings of the contact method that is used, and of no other.
fn contact_method(scene: &SceneDescription, source: &Source<'_>) -> Checked {
    let c = &scene.contact;
    let integrator = scene.bodies.first().map_or(IntegratorKind::BackwardEuler, |body| body.integrator);
    if c.method != ContactMethod::Compliance && integrator != IntegratorKind::BackwardEuler {
        let message = format!("`{}` solves for the motion of one linearised step", c.method.name());
        let remedy = "set integrator = \"backward_euler\", or method = \"compliance\"";
        return Err(source.at("contact.method", message, remedy));
    }
    if c.method != ContactMethod::Compliance && !(scene.fixed_bodies.is_empty() && scene.rigid_bodies.is_empty()) {
        let message = format!("`{}` knows the soft body and the tool alone", c.method.name());
        let remedy = "set method = \"compliance\", or remove the fixed and rigid bodies";
        return Err(source.at("contact.method", message, remedy));
    }
    let Some(penalty) = &c.penalty else { return Ok(()) };
    if c.method != ContactMethod::Penalty {
        let message = format!("`penalty` has no effect: the method is `{}`", c.method.name());
        return Err(source.at("contact.penalty", message, "remove it, or set method = \"penalty\""));
    }
    if let Some(stiffness) = penalty.stiffness {
        positive(source, "contact.penalty.stiffness", stiffness, "N/m")?;
    }
    positive(source, "contact.penalty.multiple", penalty.multiple, "")?;
    not_negative(source, "contact.penalty.damping", penalty.damping, "s")
}
