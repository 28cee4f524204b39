//! The body after each event, made at set-up so that a run only passes from one to the next.
//!
//! All have one numbering and one pattern, that of the whole body with all its elements and without what is never
//! released, so that matrices, factors and states of one fit the others.

use std::sync::Arc;

use palpate_collision::broad_phase::SurfaceGeometry;
use palpate_collision::contact::{FeatureKind, feature_kind};
use palpate_fem::mesh::TetMesh;
use palpate_fem::model::{CarriedMemory, FemConfig, FemModel};
use palpate_trace::Skin;

use super::World;
use super::course::Stretch;
use crate::scene::SceneError;

/// The world after an event, and the way there from the one before.
#[derive(Clone)]
pub struct Change {
    time: f64,
    world: World,
    /// Where the memory of viscous tissue lies in the body before.
    memory: CarriedMemory,
    /// Whether elements are gone, and with them skin.
    cuts: bool,
    /// For each node whether it is part of the skin.
    skin: Vec<bool>,
    /// The skin as traces draw it.
    triangles: Skin,
    text: String,
}

impl Change {
    /// When it happens (s): in the first step that begins then or later.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// The world from then on, which has the nodes of the scene's mesh and the elements that are left.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// What happens, in words.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Whether elements are removed.
    pub fn cuts(&self) -> bool {
        self.cuts
    }

    pub(crate) fn memory(&self) -> &CarriedMemory {
        &self.memory
    }

    pub(crate) fn triangles(&self) -> &Skin {
        &self.triangles
    }

    /// The number of a surface feature after the event, where it has one: edges and triangles are numbered anew.
    pub(crate) fn feature(&self, feature: u64) -> Option<u64> {
        let on_skin = || self.skin.get((feature & u64::from(u32::MAX)) as usize).is_some_and(|skin| *skin);
        let stays = !self.cuts || feature_kind(feature) == Some(FeatureKind::Vertex) && on_skin();
        stays.then_some(feature)
    }
}

/// The body after an event.
pub(super) struct Later {
    stretch: Stretch,
    mesh: TetMesh,
    model: FemModel,
}

/// The bodies after each of the events. `config` is that of `whole`, whose fixed nodes no event releases.
pub(super) fn bodies(whole: &World, config: &FemConfig, course: Vec<Stretch>) -> Result<Vec<Later>, SceneError> {
    course.into_iter().map(|stretch| body_after(whole, config, stretch)).collect()
}

/// The body after one change.
pub(super) fn body_after(whole: &World, config: &FemConfig, stretch: Stretch) -> Result<Later, SceneError> {
    let mesh = part(&whole.mesh, &stretch.left);
    let free = whole.model.node_of_free();
    let held = free.iter().copied().filter(|&node| stretch.held[node as usize]).collect();
    let model = whole.model.changed(&mesh, &FemConfig { held, ..config.clone() });
    let model = model.map_err(|e| refused(whole, &stretch, e.to_string()))?;
    Ok(Later { stretch, mesh, model })
}

/// The worlds after each of the events.
pub(super) fn changes(whole: &World, bodies: Vec<Later>) -> Result<Vec<Change>, SceneError> {
    let mut changes: Vec<Change> = Vec::with_capacity(bodies.len());
    for later in bodies {
        let change = change_to(whole, changes.last(), later)?;
        changes.push(change);
    }
    Ok(changes)
}

/// The way from the body after `before`, or from the whole one, to a later one.
pub(super) fn change_to(whole: &World, before: Option<&Change>, later: Later) -> Result<Change, SceneError> {
    let Later { stretch, mesh, model } = later;
    let all: Vec<u32>;
    let (model_before, left_before) = match before.map(|change| (&change.world.model, &change.world.left)) {
        Some((model, Some(left))) => (model, left),
        _ => {
            all = (0..whole.mesh.tetrahedra.len() as u32).collect();
            (&whole.model, &all)
        }
    };
    let place = |t: &u32| left_before.binary_search(t).map_or(u32::MAX, |place| place as u32);
    let memory = CarriedMemory::new(model_before, &model, &stretch.left.iter().map(place).collect::<Vec<_>>());
    let cuts = stretch.left.len() < left_before.len();
    let surface = mesh.surface();
    let geometry = SurfaceGeometry::new(surface.triangles.clone(), &mesh.nodes)
        .map_err(|e| refused(whole, &stretch, e.to_string()))?;
    let mut skin = vec![false; mesh.nodes.len()];
    surface.triangles.iter().flatten().for_each(|&node| skin[node as usize] = true);
    let triangles = surface.triangles.as_slice().into();
    let Stretch { time, left, text, .. } = stretch;
    let world = World {
        mesh,
        surface,
        model,
        geometry,
        changes: Vec::new(),
        basis: None,
        start: Arc::default(),
        left: Some(left),
        ..whole.clone()
    };
    Ok(Change { time, world, memory, cuts, skin, triangles, text })
}

fn refused(whole: &World, stretch: &Stretch, message: String) -> SceneError {
    whole.scene().at(&format!("event.{}", stretch.event), message, "change the selections of the event")
}

/// The mesh with only some of its tetrahedra.
fn part(mesh: &TetMesh, left: &[u32]) -> TetMesh {
    fn of<T: Copy>(all: &[T], left: &[u32]) -> Vec<T> {
        left.iter().filter_map(|&t| all.get(t as usize).copied()).collect()
    }
    TetMesh {
        tetrahedra: of(&mesh.tetrahedra, left),
        mid_nodes: of(&mesh.mid_nodes, left),
        regions: of(&mesh.regions, left),
        ..mesh.clone()
    }
}

/// The most nodes whose rows differ between the matrices of two of the bodies, the whole one among them.
pub(super) fn most_touched(whole: &FemModel, bodies: &[Later]) -> usize {
    let models: Vec<&FemModel> = std::iter::once(whole).chain(bodies.iter().map(|body| &body.model)).collect();
    let pairs = (0..models.len()).flat_map(|b| (0..b).map(move |a| (a, b)));
    pairs.map(|(a, b)| touched(models[a], models[b])).max().unwrap_or(0)
}

/// The nodes whose rows differ between the matrices of two bodies: those of elements that are gone, those that are held or
/// released, and of the latter the neighbours.
fn touched(before: &FemModel, after: &FemModel) -> usize {
    let mut touched: Vec<bool> = before.held().iter().zip(after.held()).map(|(a, b)| a != b).collect();
    for i in 0..touched.len() {
        if before.held()[i] && !after.held()[i] {
            let pattern = before.pattern();
            pattern.row(i).for_each(|p| touched[pattern.columns()[p] as usize] = true);
        }
    }
    // Elements are told by their nodes, which the bodies number alike.
    let elements = |model: &FemModel| {
        let quadratic = model.quadratic_elements().iter().map(|e| e.nodes.to_vec());
        let all = model.elements().iter().map(|e| e.nodes.to_vec());
        let mut nodes: Vec<Vec<u32>> = if quadratic.len() > 0 { quadratic.collect() } else { all.collect() };
        nodes.sort_unstable();
        nodes
    };
    let left = elements(after);
    let gone = elements(before).into_iter().filter(|e| left.binary_search(e).is_err());
    let free = before.node_of_free();
    for node in gone.flatten() {
        if let Ok(free) = free.binary_search(&node) {
            touched[free] = true;
        }
    }
    touched.iter().filter(|&&t| t).count()
}
