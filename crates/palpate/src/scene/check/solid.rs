//! The range of every value of fixed and rigid bodies.

use std::collections::BTreeSet;

use nalgebra::Matrix3;
use palpate_rigid::RigidModel;

use super::super::description::{ContactLawKind, SceneDescription, SolidShape};
use super::super::parse::Source;
use super::Checked;
use super::contact::{friction, max_contacts};
use super::number::{finite, positive};

/// Checks every value of the fixed and rigid bodies, and that no two bodies have one name.
pub(super) fn check(scene: &SceneDescription, source: &Source<'_>) -> Checked {
    law(scene, source)?;
    for (k, body) in scene.fixed_bodies.iter().enumerate() {
        let path = format!("fixed_body.{k}");
        shape(source, &path, &body.shape)?;
        finite(source, &format!("{path}.position"), &body.position)?;
        finite(source, &format!("{path}.rotation"), &body.rotation)?;
        contacts(source, &path, body.friction, body.max_contacts)?;
    }
    for (k, body) in scene.rigid_bodies.iter().enumerate() {
        let path = format!("rigid_body.{k}");
        if matches!(body.shape, SolidShape::Plane { .. }) {
            let message = "a half-space has no mass";
            return Err(source.at(&format!("{path}.shape"), message, "move it to [[fixed_body]], or give it a size"));
        }
        shape(source, &path, &body.shape)?;
        positive(source, &format!("{path}.mass"), body.mass, "kg")?;
        if let Some(moments) = body.inertia {
            let inertia = Matrix3::from_diagonal(&moments.into());
            let remedy = "correct them, or leave `inertia` out for that of the shape";
            RigidModel::new(body.mass, inertia)
                .map_err(|e| source.at(&format!("{path}.inertia"), e.to_string(), remedy))?;
        }
        for (key, values) in [
            ("position", &body.position),
            ("rotation", &body.rotation),
            ("velocity", &body.velocity),
            ("angular_velocity", &body.angular_velocity),
        ] {
            finite(source, &format!("{path}.{key}"), values)?;
        }
        contacts(source, &path, body.friction, body.max_contacts)?;
    }
    names(scene, source)
}

/// The law of `[contact]` is that of these bodies too.
fn law(scene: &SceneDescription, source: &Source<'_>) -> Checked {
    let law = scene.contact.law;
    let of_fixed = scene.fixed_bodies.iter().enumerate().map(|(k, body)| ("fixed_body", k, body.friction));
    let of_rigid = scene.rigid_bodies.iter().enumerate().map(|(k, body)| ("rigid_body", k, body.friction));
    for (kind, k, friction) in of_fixed.chain(of_rigid) {
        if law == ContactLawKind::Threshold {
            let message =
                format!("`threshold` would let bodies fall through [[{kind}]]: it is the law of every contact");
            return Err(source.at("contact.law", message, "set another law, or remove the fixed and rigid bodies"));
        }
        let rubs = matches!(law, ContactLawKind::Coulomb | ContactLawKind::FacetedCoulomb);
        if let Some(mu) = friction.filter(|mu| *mu > 0.0 && !rubs) {
            let message = format!("friction = {mu} has no effect: the law is `{}`", law.name());
            let remedy = "remove it, or set law = \"coulomb\", whose friction may be 0 in [contact]";
            return Err(source.at(&format!("{kind}.{k}.friction"), message, remedy));
        }
    }
    Ok(())
}

fn shape(source: &Source<'_>, path: &str, shape: &SolidShape) -> Checked {
    let path = format!("{path}.shape");
    match shape.solid() {
        Some(Err(e)) => Err(source.at(&path, e.to_string(), "correct the value")),
        Some(Ok(_)) => Ok(()),
        None => match shape {
            SolidShape::Mesh { scale, .. } => positive(source, &format!("{path}.scale"), *scale, ""),
            _ => Ok(()),
        },
    }
}

fn contacts(source: &Source<'_>, path: &str, mu: Option<f64>, most: Option<usize>) -> Checked {
    if let Some(mu) = mu {
        friction(source, &format!("{path}.friction"), mu)?;
    }
    most.map_or(Ok(()), |most| max_contacts(source, &format!("{path}.max_contacts"), most))
}

/// Reports and traces tell bodies by name.
fn names(scene: &SceneDescription, source: &Source<'_>) -> Checked {
    let soft = scene.bodies.iter().enumerate().map(|(k, b)| (format!("body.{k}.name"), &b.name));
    let fixed = scene.fixed_bodies.iter().enumerate().map(|(k, b)| (format!("fixed_body.{k}.name"), &b.name));
    let rigid = scene.rigid_bodies.iter().enumerate().map(|(k, b)| (format!("rigid_body.{k}.name"), &b.name));
    let tools = scene.tools.iter().enumerate().map(|(k, b)| (format!("tool.{k}.name"), &b.name));
    // Scenes without these bodies may call tool and tissue as they please.
    if scene.fixed_bodies.is_empty() && scene.rigid_bodies.is_empty() {
        return Ok(());
    }
    let mut seen = BTreeSet::new();
    for (path, name) in soft.chain(tools).chain(fixed).chain(rigid) {
        if !seen.insert(name) {
            return Err(source.at(&path, format!("there is a body named `{name}` already"), "give it another name"));
        }
    }
    Ok(())
}
