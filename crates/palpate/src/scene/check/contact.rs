//! The range of every value of contact and solvers, and which of them fit one another.

use palpate_constraints::law::{ContactLaw, Coulomb};

use super::super::description::{ContactMethod, IntegratorKind, SceneDescription};
use super::super::parse::Source;
use super::Checked;
use super::number::{at_least_one, not_negative, positive};

/// Checks every value of contact and solvers.
pub(super) fn check(scene: &SceneDescription, source: &Source<'_>) -> Checked {
    let c = &scene.contact;
    not_negative(source, "contact.friction", c.friction, "")?;
    Coulomb { friction: c.friction }.validate().map_err(|e| source.at("contact.friction", e.to_string(), e.remedy))?;
    not_negative(source, "contact.margin", c.margin, "m")?;
    not_negative(source, "contact.merge_distance", c.merge_distance, "m")?;
    at_least_one(source, "contact.max_contacts", c.max_contacts)?;
    if c.max_contacts > 1000 {
        let message =
            format!("{} contacts make a compliance of {} MB", c.max_contacts, 9 * c.max_contacts.pow(2) / 131_072);
        return Err(source.at("contact.max_contacts", message, "use at most 1000; 48 serve a fingertip"));
    }
    contact_method(scene, source)?;
    positive(source, "solver.tolerance", scene.solver.tolerance, "")?;
    positive(source, "solver.tick_tolerance", scene.solver.tick_tolerance, "")?;
    at_least_one(source, "solver.max_sweeps", scene.solver.max_sweeps as usize)?;
    at_least_one(source, "solver.tick_sweeps", scene.solver.tick_sweeps as usize)
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
