//! The range of every value of a body.

use std::path::Path;

use palpate_constraints::compliance::{ComplianceMethod, MotionCorrection};

use super::super::description::{BodyDescription, IntegratorKind, NodeSelection, Refactor};
use super::super::parse::Source;
use super::super::readable::Readable;
use super::Checked;
use super::number::{at_least_one, finite, not_negative, positive};
use crate::world::is_constant;

/// Most substeps of one explicit step: beyond, an implicit one is cheaper on any machine.
pub(crate) const MOST_SUBSTEPS: u32 = 100_000;

/// Checks every value of a body.
pub(super) fn check(body: &BodyDescription, source: &Source<'_>) -> Checked {
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
        return Err(source.at("body.0.tolerance", format!("{} solves nothing", Readable(body.tolerance)), "use 1e-6"));
    }
    at_least_one(source, "body.0.max_iterations", body.max_iterations)?;
    integrator(body, source)?;
    compliance(body, source)?;
    for (k, selection) in body.fixed.iter().enumerate() {
        self::selection(source, &format!("body.0.fixed.{k}"), selection)?;
    }
    Ok(())
}

/// The numbers of a selection.
pub(super) fn selection(source: &Source<'_>, path: &str, selection: &NodeSelection) -> Checked {
    match selection {
        NodeSelection::Below(plane) | NodeSelection::Above(plane) => finite(source, path, &[plane.at]),
        NodeSelection::Box { min, max } => {
            finite(source, path, min)?;
            finite(source, path, max)?;
            if (0..3).any(|c| min[c] > max[c]) {
                return Err(source.at(path, "the box is empty: min exceeds max", "swap the corners"));
            }
            Ok(())
        }
        NodeSelection::Ball { center, radius } => {
            finite(source, path, center)?;
            positive(source, &format!("{path}.ball.radius"), *radius, "m")
        }
        NodeSelection::NodeSet(_) | NodeSelection::Region(_) => Ok(()),
    }
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
            let message = format!("{} solves nothing", Readable(newton.tolerance));
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
    not_negative(source, "body.0.surface_memory", body.surface_memory, "MB")?;
    if is_kept_blindly(body) {
        let message = "nothing would tell whether `accuracy` is met: correction = \"matching\" measures no error, and \
                       error_sampling = 0 compares no column of the compliance";
        let remedy = "leave `error_sampling` out, set correction = \"exact\", or remove `accuracy`";
        return Err(source.at("body.0.accuracy", message, remedy));
    }
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

/// Whether methods would be chosen by an error that nothing measures.
fn is_kept_blindly(body: &BodyDescription) -> bool {
    let inexact = match body.compliance {
        ComplianceMethod::Exact => false,
        ComplianceMethod::Automatic => !is_constant(body),
        ComplianceMethod::Asynchronous | ComplianceMethod::Warped => true,
    };
    let linearised = body.integrator == IntegratorKind::BackwardEuler;
    let unmeasured = body.correction == MotionCorrection::Matching && body.error_sampling == 0.0;
    body.accuracy.is_some() && inexact && linearised && unmeasured
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
    labels(body, body.image.is_some() && !surface, source)?;
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
            let message = format!("a block of {} × {} × {} cells", block.cells[0], block.cells[1], block.cells[2]);
            return Err(source.at(
                "body.0.block",
                message,
                "give at least 1 along each axis and at most a million in all",
            ));
        }
    }
    Ok(())
}

/// Labels of a label image, each with one name.
fn labels(body: &BodyDescription, has_labels: bool, source: &Source<'_>) -> Checked {
    if !body.labels.is_empty() && !has_labels {
        return Err(source.at("body.0.labels", "`labels` belongs to a label image", "remove it, or name an `image`"));
    }
    for (name, label) in &body.labels {
        if *label == 0 {
            let message = format!("{name} = 0, which is the background");
            return Err(source.at("body.0.labels", message, "give a label from 1 to 255"));
        }
        if let Some((other, _)) = body.labels.iter().find(|(other, of_other)| *other < name && *of_other == label) {
            let message = format!("{other} and {name} both have the label {label}");
            return Err(source.at("body.0.labels", message, "give each label one name"));
        }
    }
    Ok(())
}
