//! The range of every value of contact and solvers, and which of them fit one another.

use nalgebra::Isometry3;
use palpate_collision::detection::ContactKind;
use palpate_constraints::law::{ConicForm, ContactLaw, Coulomb};
use palpate_constraints::penalty::PenaltyConfig;
use palpate_solver::solver::SolverKind;

use super::super::description::{ContactDescription, ContactLawKind, ContactMethod, IntegratorKind, SceneDescription};
use super::super::parse::Source;
use super::Checked;
use super::number::{at_least_one, not_negative, positive};

/// Largest stiffness (N/m) of a penalty. The rounding of a gap times a stiffness ten times as large is a force that the
/// motion of soft tissue does not balance in every step, at a hundred times it is of tens of newtons.
const STIFFEST: f64 = 1e11;

/// The same as a multiple of the body's own stiffness at a contact, some tens to thousands of N/m.
const MOST_TIMES: f64 = 1e9;

/// Checks every value of contact and solvers.
pub(super) fn check(scene: &SceneDescription, source: &Source<'_>) -> Checked {
    let c = &scene.contact;
    not_negative(source, "contact.friction", c.friction, "")?;
    not_negative(source, "contact.margin", c.margin, "m")?;
    not_negative(source, "contact.merge_distance", c.merge_distance, "m")?;
    max_contacts(source, "contact.max_contacts", c.max_contacts)?;
    hold(scene, source)?;
    law(c, source)?;
    contact_method(scene, source)?;
    solver(scene, source)?;
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

/// Only points of faces move with the tool, and only those of a tool with an axis are held.
fn hold(scene: &SceneDescription, source: &Source<'_>) -> Checked {
    let unused = |why: &str, remedy: &str| {
        Err(source.at("contact.hold", format!("hold = true has no effect: {why}"), format!("remove it, or {remedy}")))
    };
    if !scene.contact.hold {
        return Ok(());
    }
    if scene.contact.at == ContactKind::Nodes {
        return unused("contacts are at nodes, which stay the same", "set at = \"faces\"");
    }
    if scene
        .tools
        .iter()
        .any(|tool| tool.shape.parts().iter().any(|part| part.shape.axis(&Isometry3::identity()).is_none()))
    {
        return unused("the tool is a hull, whose points are not held", "give the tool a sphere or a capsule");
    }
    Ok(())
}

/// The parameters of the law that is used, and of no other.
fn law(c: &ContactDescription, source: &Source<'_>) -> Checked {
    use ContactLawKind::{Coulomb, FacetedCoulomb, Signorini, Threshold, Tresca};
    let name = c.law.name();
    let unused = |key: &str, value: f64, remedy: &str| {
        let message = format!("{key} = {value} has no effect: the law is `{name}`");
        Err(source.at(&format!("contact.{key}"), message, remedy))
    };
    let missing = |key: &str, remedy: &str| Err(source.at("contact.law", format!("`{name}` needs `{key}`"), remedy));
    match (c.law, c.facets, c.limit) {
        (Coulomb | Signorini | Tresca | Threshold, Some(facets), _) => {
            return unused("facets", facets as f64, "remove it, or set law = \"faceted_coulomb\"");
        }
        (Coulomb | Signorini | FacetedCoulomb, _, Some(limit)) => {
            return unused("limit", limit, "remove it, or set law = \"tresca\" or \"threshold\"");
        }
        (FacetedCoulomb, None, _) => {
            return missing("facets", "add `facets = 16`; the more, the nearer to law = \"coulomb\"");
        }
        (Tresca, _, None) => return missing("limit", "add `limit = 0.2`, the largest friction of a contact in N"),
        (Threshold, _, None) => return missing("limit", "add `limit = 1.0`, the force in N at which skin gives way"),
        _ => {}
    }
    if c.friction > 0.0 && !matches!(c.law, Coulomb | FacetedCoulomb) {
        return unused("friction", c.friction, "remove it, or set law = \"coulomb\"");
    }
    if c.friction == 0.0 && c.law == FacetedCoulomb {
        let remedy = "add `friction = 0.3`, or set law = \"signorini\"";
        return Err(source.at("contact.law", "`faceted_coulomb` without friction has no facets", remedy));
    }
    if let Some(limit) = c.limit {
        positive(source, "contact.limit", limit, "N")?;
    }
    c.contact_law().validate().map_err(|e| {
        let message = format!("{} = {} is outside the range of the law `{name}`", e.parameter, e.value);
        source.at(&format!("contact.{}", e.parameter), message, e.remedy)
    })
}

/// A solver that takes the law.
fn solver(scene: &SceneDescription, source: &Source<'_>) -> Checked {
    let c = &scene.contact;
    let has_friction = !matches!(c.contact_law().conic_form(), ConicForm::NonNegative | ConicForm::Interval { .. });
    if scene.solver.kind == SolverKind::ConicQp && c.method == ContactMethod::Compliance && has_friction {
        let message = format!("`conic_qp` solves contact without friction; the law is {}", c.law_in_words());
        return Err(source.at("solver.kind", message, "set kind = \"conic_friction\" or \"automatic\""));
    }
    let s = &scene.solver;
    let kind = (s.kind != SolverKind::Automatic).then(|| ("kind", format!("kind = \"{}\"", s.kind.solver().name())));
    let relaxation = s.relaxation.map(|r| ("relaxation", format!("relaxation = {r}")));
    let order = s.sweep_order.map(|order| ("sweep_order", format!("sweep_order = \"{}\"", order.name())));
    if let Some((key, given)) = kind.or(relaxation).or(order).filter(|_| c.method != ContactMethod::Compliance) {
        let message = format!("{given} has no effect at step rate: the method is `{}`", c.method.name());
        return Err(source.at(&format!("solver.{key}"), message, "remove it, or set method = \"compliance\""));
    }
    let given = [("relaxation", s.relaxation.is_some()), ("sweep_order", s.sweep_order.is_some())];
    if let Some((key, _)) = given.iter().find(|(_, given)| *given && s.kind != SolverKind::GaussSeidel) {
        let message = format!("`{key}` has no effect: it belongs to Gauss-Seidel");
        return Err(source.at(&format!("solver.{key}"), message, "remove it, or set kind = \"gauss_seidel\""));
    }
    match s.relaxation {
        Some(r) if !(r > 0.0 && r <= 1.0) => Err(source.at(
            "solver.relaxation",
            format!("{r} is not above 0 and at most 1"),
            "use 1, or 0.8 against cycling",
        )),
        _ => Ok(()),
    }
}

/// No accuracy where forces come from no compliance: the methods that keep it differ in nothing else.
fn accuracy(scene: &SceneDescription, source: &Source<'_>) -> Checked {
    let c = &scene.contact;
    match scene.bodies.first().and_then(|body| body.accuracy) {
        Some(accuracy) if c.method != ContactMethod::Compliance => {
            let name = c.method.name();
            let message =
                format!("accuracy = {accuracy} has no effect: `{name}` finds the contact forces without compliance");
            let remedy = match c.method {
                ContactMethod::Penalty => {
                    "remove it, or set method = \"compliance\"; a stiffer `penalty` is nearer to the law of contact"
                }
                _ => {
                    "remove it, or set method = \"compliance\"; the `tolerance` of [solver] bounds the error of `lagrange`"
                }
            };
            Err(source.at("body.0.accuracy", message, remedy))
        }
        _ => Ok(()),
    }
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
    if c.method != ContactMethod::Compliance && !matches!(c.law, ContactLawKind::Coulomb | ContactLawKind::Signorini) {
        let message = format!("`{}` knows the laws `coulomb` and `signorini`, not `{}`", c.method.name(), c.law.name());
        return Err(source.at("contact.law", message, "set one of the two, or method = \"compliance\""));
    }
    accuracy(scene, source)?;
    let Some(penalty) = &c.penalty else { return Ok(()) };
    if c.method != ContactMethod::Penalty {
        let message = format!("`penalty` has no effect: the method is `{}`", c.method.name());
        return Err(source.at("contact.penalty", message, "remove it, or set method = \"penalty\""));
    }
    if let Some(stiffness) = penalty.stiffness {
        positive(source, "contact.penalty.stiffness", stiffness, "N/m")?;
        if penalty.multiple != PenaltyConfig::default().multiple {
            let message = format!("multiple = {} has no effect: the stiffness is given", penalty.multiple);
            return Err(source.at("contact.penalty.multiple", message, "remove one of the two"));
        }
    }
    positive(source, "contact.penalty.multiple", penalty.multiple, "")?;
    let given = [("stiffness", penalty.stiffness, STIFFEST), ("multiple", Some(penalty.multiple), MOST_TIMES)];
    if let Some((key, Some(value), most)) = given.iter().find(|(_, value, most)| value.is_some_and(|v| v > *most)) {
        let message = format!("{key} = {value:e} makes forces of the rounding of gaps");
        let remedy = format!("give at most {most:e}: a larger one is no nearer to the law of contact");
        return Err(source.at(&format!("contact.penalty.{key}"), message, remedy));
    }
    not_negative(source, "contact.penalty.damping", penalty.damping, "s")
}
