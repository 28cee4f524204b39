//! The range of every value of a scene.

use palpate_constraints::compliance::ComplianceMethod;
use palpate_constraints::law::{ContactLaw, Coulomb};
use std::path::Path;

use palpate_haptics::SetupError;
use palpate_haptics::limits::Limits;
use palpate_haptics::script::HandScript;

use super::description::{
    BodyDescription, ContactMethod, IntegratorKind, NodeSelection, Refactor, SceneDescription, TickDescription,
    TickMethod,
};
use super::error::SceneError;
use super::parse::Source;

/// Most substeps of one explicit step: beyond, an implicit one is cheaper on any machine.
pub(crate) const MOST_SUBSTEPS: u32 = 100_000;

type Checked = Result<(), SceneError>;

/// Checks every value; the first that is out of range is the error.
pub(super) fn check(scene: &SceneDescription, source: &Source<'_>) -> Checked {
    if scene.name.is_empty() || scene.name.contains(['/', '\\']) {
        return Err(source.at(
            "name",
            format!("`{}` cannot be part of a file name", scene.name),
            "use letters and `_`",
        ));
    }
    positive(source, "seconds", scene.seconds, "s")?;
    finite(source, "gravity", &scene.gravity)?;
    rates(scene, source)?;
    match scene.bodies.as_slice() {
        [body] => check_body(body, source)?,
        [] => return Err(source.at("body", "there is no body", "add a [[body]] with a mesh and a material")),
        more => {
            let message = format!("{} bodies, but this version simulates one", more.len());
            return Err(source.at("body", message, "keep one [[body]]; regions carry different materials"));
        }
    }
    match scene.tools.as_slice() {
        [_] => {}
        [] => return Err(source.at("tool", "there is no tool", "add a [[tool]] with a shape")),
        more => {
            let message = format!("{} tools, but this version moves one", more.len());
            return Err(source.at("tool", message, "keep one [[tool]]"));
        }
    }
    contact(scene, source)?;
    tick(scene, source)?;
    device(scene, source)
}

/// Most nodes of a patch: its compliance, which the step makes and the tick reads, grows with their square.
const MOST_PATCH_NODES: usize = 512;

fn tick(scene: &SceneDescription, source: &Source<'_>) -> Checked {
    let tick = &scene.tick;
    if !(3..=MOST_PATCH_NODES).contains(&tick.patch_nodes) {
        let message = format!("patch_nodes = {} is not a number from 3 to {MOST_PATCH_NODES}", tick.patch_nodes);
        return Err(source.at("tick.patch_nodes", message, "use 48, or set method = \"frozen\" for no patch"));
    }
    not_negative(source, "tick.hand_over", tick.hand_over, "s")?;
    let default = TickDescription::default();
    for (key, differs) in
        [("patch_nodes", tick.patch_nodes != default.patch_nodes), ("hand_over", tick.hand_over != default.hand_over)]
    {
        if differs && tick.method == TickMethod::Frozen {
            let message = format!("`{key}` has no effect: the tick's rows are frozen");
            return Err(source.at(&format!("tick.{key}"), message, "remove it, or set method = \"local\""));
        }
    }
    Ok(())
}

fn rates(scene: &SceneDescription, source: &Source<'_>) -> Checked {
    let r = &scene.rates;
    positive(source, "rates.step", r.step, "Hz")?;
    positive(source, "rates.factor", r.factor, "Hz")?;
    positive(source, "rates.tick", r.tick, "Hz")?;
    not_negative(source, "rates.factor_delay", r.factor_delay, "s")?;
    if r.tick < r.step {
        let message = format!("the tick rate {} Hz is below the step rate {} Hz", r.tick, r.step);
        return Err(source.at("rates.tick", message, "use 1000 Hz for haptics, at least the step rate"));
    }
    if r.tick > 20_000.0 {
        return Err(source.at("rates.tick", format!("{} Hz leaves no time to work in", r.tick), "use at most 20000"));
    }
    Ok(())
}

fn check_body(body: &BodyDescription, source: &Source<'_>) -> Checked {
    geometry(body, source)?;
    if let Some(cell) = body.cell {
        positive(source, "body.0.cell", cell, "m")?;
    }
    positive(source, "body.0.scale", body.scale, "")?;
    positive(source, "body.0.density", body.density, "kg/m³")?;
    if let Some(mass) = body.total_mass {
        positive(source, "body.0.total_mass", mass, "kg")?;
    }
    not_negative(source, "body.0.rayleigh_mass", body.rayleigh_mass, "1/s")?;
    not_negative(source, "body.0.rayleigh_stiffness", body.rayleigh_stiffness, "s")?;
    positive(source, "body.0.tolerance", body.tolerance, "")?;
    if body.tolerance >= 1.0 {
        return Err(source.at("body.0.tolerance", format!("{} solves nothing", body.tolerance), "use 1e-6"));
    }
    at_least_one(source, "body.0.max_iterations", body.max_iterations)?;
    integrator(body, source)?;
    compliance(body, source)?;
    for (k, selection) in body.fixed.iter().enumerate() {
        let path = format!("body.0.fixed.{k}");
        match selection {
            NodeSelection::Below(plane) | NodeSelection::Above(plane) => finite(source, &path, &[plane.at])?,
            NodeSelection::Box { min, max } => {
                finite(source, &path, min)?;
                finite(source, &path, max)?;
                if (0..3).any(|c| min[c] > max[c]) {
                    return Err(source.at(&path, "the box is empty: min exceeds max", "swap the corners"));
                }
            }
            NodeSelection::Ball { center, radius } => {
                finite(source, &path, center)?;
                positive(source, &path, *radius, "m")?;
            }
            NodeSelection::NodeSet(_) | NodeSelection::Region(_) => {}
        }
    }
    Ok(())
}

/// The settings of the integrator that is used, and of no other.
fn integrator(body: &BodyDescription, source: &Source<'_>) -> Checked {
    let unused = |name: &str, kind: &str| {
        let message = format!("`{name}` has no effect: the integrator is another one");
        Err(source.at(&format!("body.0.{name}"), message, format!("remove it, or set integrator = \"{kind}\"")))
    };
    if body.newton.is_some() && body.integrator != IntegratorKind::Newton {
        return unused("newton", "newton");
    }
    if body.explicit.is_some() && body.integrator != IntegratorKind::Explicit {
        return unused("explicit", "explicit");
    }
    if let Some(newton) = &body.newton {
        at_least_one(source, "body.0.newton.iterations", newton.iterations as usize)?;
        positive(source, "body.0.newton.tolerance", newton.tolerance, "")?;
        if newton.tolerance >= 1.0 {
            let message = format!("{} solves nothing", newton.tolerance);
            return Err(source.at("body.0.newton.tolerance", message, "use 1e-9"));
        }
    }
    if let Some(substeps) = body.explicit.and_then(|e| e.substeps) {
        at_least_one(source, "body.0.explicit.substeps", substeps as usize)?;
        if substeps > MOST_SUBSTEPS {
            let message = format!("{substeps} substeps of one step");
            return Err(source.at(
                "body.0.explicit.substeps",
                message,
                format!("use at most {MOST_SUBSTEPS}, or an implicit integrator"),
            ));
        }
    }
    Ok(())
}

/// Methods that fit one another.
fn compliance(body: &BodyDescription, source: &Source<'_>) -> Checked {
    if let Some(accuracy) = body.accuracy {
        positive(source, "body.0.accuracy", accuracy, "")?;
    }
    not_negative(source, "body.0.error_sampling", body.error_sampling, "")?;
    let refuse = |message: &str, remedy: &str| Err(source.at("body.0.refactor", message, remedy));
    match (body.compliance, body.refactor) {
        (ComplianceMethod::Asynchronous, Some(Refactor::Step | Refactor::Once)) => {
            refuse("`async` compliance needs the factor thread", "set refactor = \"thread\", or leave it out")
        }
        (ComplianceMethod::Warped, Some(Refactor::Step | Refactor::Thread)) => {
            refuse("`warped` compliance keeps the first factor", "leave it out, or set compliance = \"async\"")
        }
        (ComplianceMethod::Exact, Some(Refactor::Once)) => {
            refuse("`exact` compliance needs the matrix of every step", "leave it out, or set compliance = \"warped\"")
        }
        (ComplianceMethod::Automatic, Some(_)) => {
            refuse("the plan chooses when to factor", "leave it out, or name the method with `compliance`")
        }
        _ => Ok(()),
    }
}

/// Exactly one of mesh, image and block; `cell` with an image only.
fn geometry(body: &BodyDescription, source: &Source<'_>) -> Checked {
    let given = [body.mesh.is_some(), body.image.is_some(), body.block.is_some()];
    match given.iter().filter(|&&g| g).count() {
        1 => {}
        0 => {
            let remedy = "add `mesh = \"file\"`, `image = \"file\"` with `cell`, or `block`";
            return Err(source.at("body.0", "the body has no geometry", remedy));
        }
        _ => return Err(source.at("body.0", "the body has more than one geometry", "keep one of mesh, image, block")),
    }
    match (body.image.is_some(), body.cell) {
        (true, None) => {
            return Err(source.at("body.0.image", "an image needs the size of its elements", "add `cell = 0.012`"));
        }
        (false, Some(_)) => {
            return Err(source.at(
                "body.0.cell",
                "`cell` belongs to `image`",
                "remove it: this body has its own elements",
            ));
        }
        _ => {}
    }
    let surface = body.image.as_ref().is_some_and(|name| crate::world::is_surface(Path::new(name)));
    if body.image.is_some() && !surface && body.scale != 1.0 {
        let message = format!("scale = {} with a label image, which states the size of its voxels itself", body.scale);
        return Err(source.at("body.0.scale", message, "remove it"));
    }
    if let Some(block) = &body.block {
        finite(source, "body.0.block", &block.min)?;
        finite(source, "body.0.block", &block.max)?;
        if (0..3).any(|c| block.min[c] >= block.max[c]) {
            return Err(source.at("body.0.block", "the block is empty: min is not below max", "swap the corners"));
        }
        let cells = block.cells.iter().try_fold(1usize, |n, &c| n.checked_mul(c)).unwrap_or(usize::MAX);
        if cells == 0 || cells > 1_000_000 {
            let message = format!("{:?} cells", block.cells);
            return Err(source.at(
                "body.0.block",
                message,
                "give at least 1 along each axis and at most a million in all",
            ));
        }
    }
    Ok(())
}

fn contact(scene: &SceneDescription, source: &Source<'_>) -> Checked {
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

fn device(scene: &SceneDescription, source: &Source<'_>) -> Checked {
    let known: Vec<_> = crate::devices::device_names().collect();
    named(source, "device.kind", &scene.device.kind, &known)?;
    let hands: Vec<_> = crate::devices::hand_names().collect();
    named(source, "hand.preset", &scene.hand.preset, &hands)?;
    let refused = |path: &str, e: SetupError| source.at(path, e.to_string(), "correct the value");
    let spec = crate::devices::spec(&scene.device).map_err(|e| refused("device.preset", e))?;
    scene.device.mechanics.validate().map_err(|e| refused("device.mechanics", e))?;
    if let Some(coupling) = &scene.coupling {
        coupling.validate().map_err(|e| refused("coupling", e))?;
    }
    Limits::new(&scene.limits, &spec).map_err(|e| refused("limits", e))?;
    HandScript::new(scene.hand.path.clone()).map_err(|e| {
        let entry = match e {
            SetupError::ScriptGap { entry, .. }
            | SetupError::ScriptOrder { entry, .. }
            | SetupError::ScriptNumber { entry, .. }
            | SetupError::ScriptSpeed { entry, .. } => format!("hand.path.{entry}"),
            _ => "hand.path".to_string(),
        };
        source.at(&entry, e.to_string(), "give strictly increasing times from 0 and positions in metres")
    })?;
    Ok(())
}

fn named(source: &Source<'_>, path: &str, name: &str, known: &[&str]) -> Checked {
    if known.contains(&name) {
        return Ok(());
    }
    let remedy = match super::error::nearest(name, known.iter().copied()) {
        Some(best) => format!("did you mean `{best}`?"),
        None => format!("known are {}", known.join(", ")),
    };
    Err(source.at(path, format!("there is no `{name}`"), remedy))
}

fn positive(source: &Source<'_>, path: &str, value: f64, unit: &str) -> Checked {
    if value > 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(source.at(
        path,
        format!("{} = {value} {unit} is not a positive number", last(path)).replace("  ", " "),
        "give a positive number",
    ))
}

fn not_negative(source: &Source<'_>, path: &str, value: f64, unit: &str) -> Checked {
    if value >= 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(source.at(
        path,
        format!("{} = {value} {unit} is negative or not finite", last(path)).replace("  ", " "),
        "give zero or a positive number",
    ))
}

fn at_least_one(source: &Source<'_>, path: &str, value: usize) -> Checked {
    if value > 0 { Ok(()) } else { Err(source.at(path, format!("{} = 0", last(path)), "give at least 1")) }
}

fn finite(source: &Source<'_>, path: &str, values: &[f64]) -> Checked {
    match values.iter().find(|v| !v.is_finite()) {
        None => Ok(()),
        Some(v) => Err(source.at(path, format!("{v} is not a finite number"), "give finite numbers")),
    }
}

fn last(path: &str) -> &str {
    path.rsplit('.').next().unwrap_or(path)
}
