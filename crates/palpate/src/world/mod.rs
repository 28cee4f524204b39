//! A scene made ready: mesh, body, symbolic factorisation, tool. Nothing in it changes while a run lasts.

mod bodies;
mod change;
mod course;
mod elements;
mod fixed;
mod geometry;
mod integration;
mod plan;
mod selection;
mod tool;

use std::fmt::Write as _;
use std::sync::Arc;

use nalgebra::{Isometry3, Vector3};
use palpate_collision::broad_phase::SurfaceGeometry;
use palpate_collision::detection::DetectionConfig;
use palpate_collision::solid::Solid;
use palpate_collision::tool::{Tool, ToolPose};
use palpate_fem::factor::SymbolicFactor;
use palpate_fem::mesh::{MeshQuality, TetMesh};
use palpate_fem::model::{FemConfig, FemError, FemModel};
use palpate_fem::sparse::FIXED;
use palpate_fem::surface::Surface;
use palpate_haptics::snapshot::HapticSnapshot;

use crate::scene::{ContactMethod, Scene, SceneDescription, SceneError, TickMethod};
use course::{Stretch, course};
use elements::{locking, with_nodes_for};
use fixed::fixed_nodes;
use geometry::{Loaded, load};

pub use bodies::{Bodies, Far, FixedBody, Near, Pair, RigidBody};
pub use change::Change;
pub use geometry::{is_surface, make};
pub use integration::{EXPLICIT_SAFETY, Integration};
pub use plan::Plan;

/// Most contacts of fixed and rigid bodies in one step: their compliance then takes 72 MB.
const MOST_CONTACTS: usize = 1000;

/// A scene made ready to run.
#[derive(Clone)]
pub struct World {
    scene: Scene,
    mesh: TetMesh,
    quality: MeshQuality,
    surface: Surface,
    model: FemModel,
    symbolic: Arc<SymbolicFactor>,
    geometry: SurfaceGeometry,
    detection: DetectionConfig,
    /// The parts of the tool as other bodies meet them.
    tool: Vec<Solid>,
    bodies: Bodies,
    integration: Integration,
    plan: Plan,
    warnings: Vec<String>,
    changes: Vec<Change>,
    /// After an event: the elements that are left of the scene's mesh.
    left: Option<Vec<u32>>,
}

impl World {
    /// The scene that it was built from.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The description of that scene.
    pub fn description(&self) -> &SceneDescription {
        self.scene.description()
    }

    /// The step (s).
    pub fn dt(&self) -> f64 {
        1.0 / self.description().rates.step
    }

    /// The mesh of the body (m).
    pub fn mesh(&self) -> &TetMesh {
        &self.mesh
    }

    /// The boundary of that mesh.
    pub fn surface(&self) -> &Surface {
        &self.surface
    }

    /// The body.
    pub fn model(&self) -> &FemModel {
        &self.model
    }

    /// The symbolic factorisation of its system matrix.
    pub fn symbolic(&self) -> &Arc<SymbolicFactor> {
        &self.symbolic
    }

    /// The boundary as detection sees it, at rest.
    pub fn geometry(&self) -> &SurfaceGeometry {
        &self.geometry
    }

    /// The shape of the tool.
    pub fn tool(&self) -> &Tool {
        &self.description().tools[0].shape
    }

    /// A part of it as other bodies meet it.
    pub fn tool_solid(&self, part: usize) -> Option<&Solid> {
        self.tool.get(part)
    }

    /// Fixed and rigid bodies, and the pairs of bodies that can touch.
    pub fn bodies(&self) -> &Bodies {
        &self.bodies
    }

    /// Most contacts of one step, those of the tool among them.
    pub fn contact_capacity(&self) -> usize {
        let others = self.bodies.contact_capacity();
        self.detection.max_contacts + others.min(MOST_CONTACTS)
    }

    /// How contacts with the tool are found.
    pub fn detection(&self) -> &DetectionConfig {
        &self.detection
    }

    /// Nodes of the tissue around the tool that a snapshot carries; 0 where the tick has frozen rows.
    pub fn patch_nodes(&self) -> usize {
        let tick = &self.description().tick;
        if tick.method == TickMethod::Local { tick.patch_nodes } else { 0 }
    }

    /// A snapshot with the room that this scene needs, for programs that bring their own loop.
    pub fn empty_snapshot(&self) -> HapticSnapshot {
        HapticSnapshot::with_patch(self.detection.max_contacts, self.patch_nodes())
    }

    /// How the body moves in time.
    pub fn integration(&self) -> &Integration {
        &self.integration
    }

    /// How contact forces are found at step rate, with the parameters of the method.
    pub fn contact_method(&self) -> String {
        let contact = &self.description().contact;
        let penalty = contact.penalty.unwrap_or_default();
        match (contact.method, penalty.stiffness) {
            (ContactMethod::Penalty, Some(k)) => format!("penalty ({k} N/m, damping {} s)", penalty.damping),
            (ContactMethod::Penalty, None) => {
                format!("penalty ({} times the body's stiffness, damping {} s)", penalty.multiple, penalty.damping)
            }
            (method, _) => method.name().into(),
        }
    }

    /// What contact problem the tick solves, with the parameters of the method.
    pub fn tick_method(&self) -> String {
        let tick = &self.description().tick;
        match tick.method {
            TickMethod::Local => {
                format!("local ({} nodes at most, hand-over {} ms)", tick.patch_nodes, tick.hand_over * 1e3)
            }
            TickMethod::Frozen => "frozen rows".into(),
        }
    }

    /// The methods of a run, and why.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// The body after each event, in the order of their times.
    pub fn changes(&self) -> &[Change] {
        &self.changes
    }

    /// The world after the first `phase` events: this one after none, the last one beyond.
    pub fn phase(&self, phase: usize) -> &World {
        let after = phase.min(self.changes.len()).checked_sub(1);
        after.and_then(|last| self.changes.get(last)).map_or(self, Change::world)
    }

    /// After an event: for each element its number in the scene's mesh. `None` for the whole body.
    pub fn left(&self) -> Option<&[u32]> {
        self.left.as_deref()
    }

    /// What is odd but no mistake.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// The pose of the tool before the device has told one: where the hand's path begins, or without one the device's
    /// origin.
    pub fn first_pose(&self) -> Isometry3<f64> {
        self.first_tool().frame
    }

    /// The same with the opening of its jaws.
    pub fn first_tool(&self) -> ToolPose {
        tool::first(self.description())
    }

    /// What was understood of the scene, as text for people.
    pub fn understood(&self) -> String {
        let d = self.description();
        let body = &d.bodies[0];
        let q = &self.quality;
        let mut text = String::new();
        let fixed = self.model.free_of_node().iter().filter(|&&free| free == FIXED).count();
        // Writing to a string cannot fail.
        let _ = writeln!(text, "scene {}: {}", d.name, d.description);
        let _ = writeln!(
            text,
            "body {}: {} nodes ({fixed} fixed), {} tetrahedra ({}), {:.1} cm³, {:.3} kg",
            body.name,
            self.mesh.nodes.len(),
            self.mesh.tetrahedra.len(),
            body.element.name(),
            q.volume * 1e6,
            self.model.mass().iter().sum::<f64>(),
        );
        for (k, name) in self.mesh.region_names.iter().enumerate() {
            let count = self.mesh.regions.iter().filter(|&&r| usize::from(r) == k).count();
            let _ = writeln!(text, "  region {name}: {count} tetrahedra, {}", material_of(body, name));
        }
        let _ = writeln!(text, "  dihedral angles {:.1}° to {:.1}°", q.dihedral[0], q.dihedral[2]);
        let mass = body.total_mass.map_or(format!("{} kg/m³", body.density), |m| format!("{m} kg in equal shares"));
        let [x, y, z] = d.gravity;
        let _ = writeln!(
            text,
            "  {mass}; Rayleigh damping {} 1/s by mass, {} s by stiffness; gravity [{x}, {y}, {z}] m/s², {}",
            body.rayleigh_mass,
            body.rayleigh_stiffness,
            if body.settle { "settled before the run" } else { "begins as its mesh" },
        );
        let on = |on: bool| if on { "on" } else { "off" };
        let _ = writeln!(
            text,
            "  definiteness filter {}, guard {}; conjugate gradients to {:e} in at most {} iterations",
            on(body.definiteness_filter),
            on(body.guard),
            body.tolerance,
            body.max_iterations,
        );
        text.push_str(&self.bodies.to_string());
        let _ = writeln!(text, "tool {}: {}", d.tools[0].name, one_line(&d.tools[0].shape));
        let c = &d.contact;
        let _ = writeln!(
            text,
            "contact at {} by {} within {:.1} mm, at most {} contacts; law {}",
            format!("{:?}", c.at).to_lowercase(),
            self.contact_method(),
            c.margin * 1e3,
            c.max_contacts,
            c.law_in_words()
        );
        for change in &self.changes {
            let _ = writeln!(text, "event at {} s: {}", change.time(), change.text());
        }
        let _ = writeln!(text, "solver: {}", one_line(&d.solver));
        let _ = writeln!(text, "tick: {}", self.tick_method());
        let _ = writeln!(text, "integrator: {}", self.integration);
        let _ = writeln!(
            text,
            "rates: step {} Hz, factor {} Hz, tick {} Hz; compliance {}",
            d.rates.step,
            d.rates.factor,
            d.rates.tick,
            match self.integration {
                Integration::BackwardEuler => self.plan.compliance.name(),
                Integration::Newton(_) => "of the step's own matrix",
                Integration::Explicit { .. } => "of the lumped mass, in every substep",
            }
        );
        let _ = writeln!(text, "plan: {}", self.plan);
        let _ = write!(
            text,
            "factor: {:.2} million nonzeros, {:.0} million operations; device {}, hand {}, {} s",
            self.symbolic.nonzeros() as f64 / 1e6,
            self.symbolic.flops() / 1e6,
            d.device.kind,
            d.hand.preset,
            d.seconds
        );
        text
    }
}

fn material_of(body: &crate::scene::BodyDescription, region: &str) -> String {
    let tissue = body.regions.get(region).unwrap_or(&body.material);
    let mut text = one_line(&tissue.law);
    for (k, term) in tissue.viscosity.iter().enumerate() {
        let lead = if k == 0 { "; of the shear modulus relax" } else { "," };
        // Writing to a string cannot fail.
        let _ = write!(text, "{lead} {:.1} % in {} s", 100.0 * term.modulus, term.time);
    }
    text
}

/// A value as a scene file would say it, on one line.
fn one_line(value: &impl serde::Serialize) -> String {
    toml::to_string(value).unwrap_or_default().trim_end().replace('\n', ", ")
}

/// Builds the world of a checked scene.
pub(crate) fn build(scene: &Scene) -> Result<World, SceneError> {
    let Loaded { mesh, warnings, unit } = load(scene)?;
    // A wrong unit shows as tools inside the body, or as planes that hold every node.
    assemble(scene, mesh, warnings).map_err(|error| match &unit {
        Some(warning) => error.hint(&warning.to_string()),
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
    // What an event releases keeps its rows from the start.
    let mut released = vec![false; fixed.len()];
    for (node, released) in released.iter_mut().enumerate() {
        *released = course.iter().any(|stretch| !stretch.held[node]);
    }
    for name in body.regions.keys() {
        if !mesh.region_names.contains(name) {
            let known = mesh.region_names.join(", ");
            let message = format!("the mesh has no region `{name}`");
            return Err(scene.at(&format!("body.0.regions.{name}"), message, format!("its regions are {known}")));
        }
    }
    warnings.extend(locking(body, &mesh));
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
    if !fixed.contains(&true) && description.fixed_bodies.is_empty() {
        warnings.push("no node is fixed: nothing holds the body; hold it with `fixed = [...]`".into());
    }
    let model = FemModel::new(&mesh, &config).map_err(|e| match e {
        FemError::NoBulk { .. } => scene.at("body.0.element", e.to_string(), "change the element or the law"),
        FemError::Material { ref place, .. } => {
            let region = body.regions.keys().find(|name| *place == format!("region `{name}`"));
            let key = region.map_or("material".into(), |name| format!("regions.{name}"));
            scene.at(&format!("body.0.{key}"), e.to_string(), "correct the value")
        }
        _ => scene.at("body.0", e.to_string(), "correct the body's materials, density or fixed nodes"),
    })?;
    let positions: Vec<_> = model.node_of_free().iter().map(|&n| mesh.nodes[n as usize]).collect();
    let symbolic = SymbolicFactor::new(model.pattern(), &positions)
        .map_err(|e| scene.at("body.0", e.to_string(), "use a smaller mesh"))?;
    let symbolic = Arc::new(symbolic);
    let integration = Integration::new(scene, &model, &symbolic, 1.0 / description.rates.step)?;
    let plan = Plan::new(description, &integration, &symbolic);
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
    let world = World {
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
        left: None,
    };
    tool::outside(&world)?;
    bodies::apart(&world)?;
    with_changes(world, &config, course)
}

/// The nodes that are fixed and that an event releases, or does not.
fn nodes_where(fixed: &[bool], released: &[bool], value: bool) -> Vec<u32> {
    let nodes = fixed.iter().zip(released).enumerate();
    nodes.filter(|(_, (fixed, released))| **fixed && **released == value).map(|(node, _)| node as u32).collect()
}

/// The world with the bodies that its events leave, and room in its factors to pass from one to the next.
fn with_changes(mut world: World, config: &FemConfig, course: Vec<Stretch>) -> Result<World, SceneError> {
    if course.is_empty() {
        return Ok(world);
    }
    let seconds = world.description().seconds;
    let late = course.iter().filter(|stretch| stretch.time >= seconds);
    let late: Vec<_> =
        late.map(|s| format!("the event at {} s is after the end of the run, {seconds} s", s.time)).collect();
    world.warnings.extend(late);
    let later = change::bodies(&world, config, course)?;
    let room = change::most_touched(&world.model, &later).min(world.plan.room_for_changes(world.dt()));
    // Nothing else has the symbolic factor yet.
    if let Some(symbolic) = Arc::get_mut(&mut world.symbolic) {
        symbolic.make_room_for_changes(room);
    }
    world.changes = change::changes(&world, later)?;
    Ok(world)
}
