//! From a checked scene to its world.

use std::sync::Arc;

use nalgebra::Vector3;
use palpate_collision::broad_phase::SurfaceGeometry;
use palpate_collision::contact::ContactSet;
use palpate_collision::detection::{DetectionConfig, DetectionWorkspace, detect_tool};
use palpate_fem::factor::{FactorPrecision, SymbolicFactor};
use palpate_fem::mesh::TetMesh;
use palpate_fem::model::{FemConfig, FemError, FemModel};

use super::course::{Stretch, course};
use super::elements::{locking, with_nodes_for};
use super::fixed::fixed_nodes;
use super::geometry::{Loaded, load};
use super::haptics::late_hand_over;
use super::outside::Basis;
use super::pairs::apart;
use super::precomputed::skin_nodes;
use super::units::{implausible, vast_tool};
use super::{Bodies, CouplingChoice, Integration, Plan, World, change};
use crate::scene::{Readable, Scene, SceneError, staleness};

/// Nodes that a change from outside may touch for a factor to follow it at once: a clamp, or a cut through some sixty
/// elements. What touches more waits for the next factor.
const MOST_TOUCHED: usize = 120;

/// Overlap of tool and skin at the start (m) that is not worth a word.
const SHALLOW: f64 = 1e-4;

/// Builds the world of a checked scene.
pub(crate) fn build(scene: &Scene) -> Result<World, SceneError> {
    let Loaded { mesh, warnings, unit } = load(scene)?;
    // A wrong unit shows as tools inside the body, or as planes that hold every node.
    let unit = unit.map(|warning| warning.to_string()).or_else(|| vast_tool(scene, &mesh));
    assemble(scene, mesh, warnings).map_err(|error| match &unit {
        Some(warning) => error.hint(warning),
        None => error,
    })
}

/// Builds the world of a checked scene on tetrahedra of the caller.
pub(crate) fn build_on(scene: &Scene, mesh: TetMesh) -> Result<World, SceneError> {
    // Before anything is derived from it: mid-nodes are made of nodes that must exist.
    mesh.validate()?;
    assemble(scene, mesh, Vec::new())
}

fn assemble(scene: &Scene, mesh: TetMesh, mut warnings: Vec<String>) -> Result<World, SceneError> {
    let description = scene.description();
    let body = &description.bodies[0];
    let mesh = with_nodes_for(body.element, mesh, &mut warnings);
    let quality = mesh.validate()?;
    warnings.extend(quality.warnings().iter().map(ToString::to_string));
    warnings.dedup();
    let surface = mesh.surface();
    let fixed = fixed_nodes(scene, &mesh)?;
    let course = course(scene, &mesh, &fixed)?;
    // What may be released keeps its rows from the start.
    let mut released = vec![false; fixed.len()];
    for (node, released) in released.iter_mut().enumerate() {
        *released = body.changes > 0 || course.iter().any(|stretch| !stretch.held[node]);
    }
    for name in body.regions.keys() {
        if !mesh.region_names.contains(name) {
            let known = mesh.region_names.join(", ");
            let message = format!("the mesh has no region `{name}`");
            return Err(scene.at(&format!("body.0.regions.{name}"), message, format!("its regions are {known}")));
        }
    }
    warnings.extend(locking(body, &mesh));
    warnings.extend(vast_tool(scene, &mesh));
    warnings.extend(implausible(scene, &mesh));
    let config = FemConfig {
        element: body.element,
        material: body.material.law,
        viscosity: body.material.viscosity.clone(),
        region_materials: body.regions.iter().map(|(name, tissue)| (name.clone(), tissue.law)).collect(),
        region_viscosities: body.regions.iter().map(|(name, t)| (name.clone(), t.viscosity.clone())).collect(),
        density: body.density,
        total_mass: body.total_mass,
        rayleigh_mass: body.rayleigh_mass,
        rayleigh_stiffness: body.rayleigh_stiffness,
        gravity: Vector3::from(description.gravity),
        fixed: nodes_where(&fixed, &released, false),
        held: nodes_where(&fixed, &released, true),
        filter: body.definiteness_filter,
        ..FemConfig::default()
    };
    warnings.extend(body.keys_without_effect().map(|key| {
        format!("`{key}` of body {} has no effect: only integrator = \"backward_euler\" reads it; remove it", body.name)
    }));
    warnings.extend(staleness(description).map(|(_, sentence)| sentence));
    if !fixed.contains(&true) && description.fixed_bodies.is_empty() {
        warnings.push("no node is fixed: nothing holds the body; hold it with `fixed = [...]`".into());
    }
    warnings.extend(CouplingChoice::new(description).iter().flat_map(CouplingChoice::warnings));
    warnings.extend(late_hand_over(description));
    let model = FemModel::new(&mesh, &config).map_err(|e| match e {
        FemError::NoBulk { .. } => scene.at("body.0.element", e.to_string(), "change the element or the law"),
        FemError::Material { ref place, ref error } => {
            let region = body.regions.keys().find(|name| *place == format!("region `{name}`"));
            let key = region.map_or("material".into(), |name| format!("regions.{name}"));
            let entry = error.key().map(|entry| format!(".{entry}")).unwrap_or_default();
            scene.at(&format!("body.0.{key}{entry}"), e.to_string(), "correct the value")
        }
        _ => scene.at("body.0", e.to_string(), "correct the body's materials, density or fixed nodes"),
    })?;
    let positions: Vec<_> = model.node_of_free().iter().map(|&n| mesh.nodes[n as usize]).collect();
    let symbolic = SymbolicFactor::new(model.pattern(), &positions)
        .map_err(|e| scene.at("body.0", e.to_string(), "use a smaller mesh"))?;
    let symbolic = Arc::new(symbolic);
    let integration = Integration::new(scene, &model, &symbolic, 1.0 / description.rates.step)?;
    let skin = skin_nodes(&model, &surface).len();
    let plan = Plan::new(description, &integration, &symbolic, model.pattern(), skin);
    warnings.extend(plan.ladder.and_then(|ladder| ladder.warning(plan.factorization, 1.0 / description.rates.step)));
    let contact = &description.contact;
    let detection = DetectionConfig {
        kind: contact.at,
        margin: contact.margin,
        reach: contact.reach,
        merge_distance: contact.merge_distance,
        max_contacts: contact.max_contacts,
        ..DetectionConfig::default()
    };
    detection.validate().map_err(|e| scene.at("contact", e.to_string(), "correct the value"))?;
    let geometry = SurfaceGeometry::new(surface.triangles.clone(), &mesh.nodes)
        .map_err(|e| scene.at("body.0", e.to_string(), "use a mesh with a closed boundary"))?;
    let bodies = Bodies::new(scene, &detection)?;
    let mut world = World {
        start: Arc::default(),
        tool: description.tools[0].shape.parts().iter().map(|part| part.shape.clone().into()).collect(),
        bodies,
        scene: scene.clone(),
        mesh,
        quality,
        surface,
        model,
        symbolic,
        geometry,
        detection,
        integration,
        plan,
        warnings,
        changes: Vec::new(),
        basis: None,
        left: None,
    };
    let mut skin = world.geometry.clone();
    skin.refit(&world.start().q);
    let within = tool_outside(&world, &skin)?;
    world.warnings.extend(within);
    apart(&world, &skin)?;
    with_changes(world, config, course, &fixed)
}

/// The nodes that are fixed and that an event releases, or does not.
fn nodes_where(fixed: &[bool], released: &[bool], value: bool) -> Vec<u32> {
    let nodes = fixed.iter().zip(released).enumerate();
    nodes.filter(|(_, (fixed, released))| **fixed && **released == value).map(|(node, _)| node as u32).collect()
}

/// The world with the bodies that its events leave, and room in its factors to pass from one to the next.
fn with_changes(
    mut world: World,
    config: FemConfig,
    course: Vec<Stretch>,
    fixed: &[bool],
) -> Result<World, SceneError> {
    let outside = world.description().bodies[0].changes > 0;
    if course.is_empty() && !outside {
        return Ok(world);
    }
    // What follows a change to 1e-9 begins with a factor as exact.
    world.plan.precision = FactorPrecision::Double;
    let left = (0..world.mesh.tetrahedra.len() as u32).collect();
    let whole = || Stretch { event: 0, time: 0.0, held: fixed.to_vec(), left, text: String::new() };
    let last = course.last().cloned().unwrap_or_else(whole);
    let seconds = world.description().seconds;
    let late = course.iter().filter(|stretch| stretch.time >= seconds);
    let late: Vec<_> = late
        .map(|s| {
            let [event, end] = [s.time, seconds].map(Readable);
            format!("the event at {event} s is after the end of the run, {end} s")
        })
        .collect();
    world.warnings.extend(late);
    if let Some(event) = course.last().filter(|_| outside) {
        let time = Readable(event.time);
        world.warnings.push(format!("changes from outside wait for the last event of the scene, at {time} s"));
    }
    let later = change::bodies(&world, &config, course)?;
    let unknown = if outside { MOST_TOUCHED } else { 0 };
    let most = change::most_touched(&world.model, &later).max(unknown);
    let room = most.min(world.plan.room_for_changes(world.dt()));
    // Nothing else has the symbolic factor yet.
    if let Some(symbolic) = Arc::get_mut(&mut world.symbolic) {
        symbolic.make_room_for_changes(room);
    }
    world.changes = change::changes(&world, later)?;
    world.basis = outside.then(|| Arc::new(Basis { config, last }));
    Ok(world)
}

/// Refuses a tool that begins deep inside the body, whose `skin` is where a run begins: there is no skin that it came
/// through. Of one that begins in the skin it returns a warning.
/// Where a real hand begins is its own affair.
fn tool_outside(world: &World, skin: &SurfaceGeometry) -> Result<Option<String>, SceneError> {
    if world.description().hand.path.is_empty() {
        return Ok(None);
    }
    let mut ws = DetectionWorkspace::new(skin);
    let mut contacts = ContactSet::with_capacity(world.detection.max_contacts);
    let pose = world.first_tool();
    let report = detect_tool(skin, &world.start().q, world.tool(), &pose, &world.detection, &mut ws, &mut contacts);
    // What is deeper than the range in which contact is looked for was not touched on the way there.
    let overlap = -report.deepest_gap;
    let deep = overlap > world.detection.margin;
    if !report.tool_inside && !deep {
        let shallow = overlap > SHALLOW;
        return Ok(shallow.then(|| {
            let overlap = 1e3 * overlap;
            format!(
                "the tool begins {overlap:.1} mm within the skin, which the first step pushes away; begin outside it"
            )
        }));
    }
    let p = pose.frame.translation.vector;
    let how = match report.tool_inside {
        true => "inside the body".into(),
        false => format!("{:.1} mm within the skin", 1e3 * overlap),
    };
    let message = format!("the tool begins {how}, at {:.4}, {:.4}, {:.4} m", p.x, p.y, p.z);
    let remedy = match world.settled() {
        Some(_) => {
            "begin outside the skin of the body that has settled, then press, or set settle = false for the body"
        }
        None => "begin outside the skin, then press",
    };
    Err(world.scene.at("hand.path.0", message, remedy))
}
