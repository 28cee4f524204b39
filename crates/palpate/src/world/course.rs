//! What the events of a scene leave of the body, and what they hold, in the order of their times.

use palpate_fem::mesh::TetMesh;

use super::selection::{elements_in, nodes_in};
use crate::counted::counted;
use crate::scene::{EventDescription, NodeSelection, Scene, SceneError};

/// The body between two events.
#[derive(Clone, Debug)]
pub(super) struct Stretch {
    /// Place of the event in the scene, and its time (s).
    pub(super) event: usize,
    pub(super) time: f64,
    /// Whether each node stays where it is.
    pub(super) held: Vec<bool>,
    /// Tetrahedra of the whole body that are left, ascending.
    pub(super) left: Vec<u32>,
    /// What the event did, in words.
    pub(super) text: String,
}

/// What an event or a request selects.
pub(super) struct Selections<'a> {
    pub(super) release: &'a Option<NodeSelection>,
    pub(super) hold: &'a Option<NodeSelection>,
    pub(super) remove: &'a Option<NodeSelection>,
}

impl Selections<'_> {
    pub(super) fn is_empty(&self) -> bool {
        self.release.is_none() && self.hold.is_none() && self.remove.is_none()
    }
}

/// What the events do, in the order of their times, to a body whose `fixed` nodes are held at first.
pub(super) fn course(scene: &Scene, mesh: &TetMesh, fixed: &[bool]) -> Result<Vec<Stretch>, SceneError> {
    let events = &scene.description().events;
    let mut order: Vec<usize> = (0..events.len()).collect();
    order.sort_by(|&a, &b| events[a].time.total_cmp(&events[b].time));
    let mut held = fixed.to_vec();
    let mut gone = vec![false; mesh.tetrahedra.len()];
    let mut stretches = Vec::with_capacity(order.len());
    for event in order {
        let EventDescription { time, release, hold, remove } = &events[event];
        let parts = Selections { release, hold, remove };
        let stretch = advance(scene, mesh, &format!("event.{event}"), &parts, &mut held, &mut gone)?;
        stretches.push(Stretch { event, time: *time, ..stretch });
    }
    Ok(stretches)
}

/// What one change, which stands at `place`, does to a body whose nodes are `held` and elements `gone`; event and time are
/// left to the caller.
pub(super) fn advance(
    scene: &Scene,
    mesh: &TetMesh,
    place: &str,
    parts: &Selections<'_>,
    held: &mut [bool],
    gone: &mut [bool],
) -> Result<Stretch, SceneError> {
    let mut done = Vec::new();
    for (key, selection, hold) in [("release", parts.release, false), ("hold", parts.hold, true)] {
        let Some(selection) = selection else { continue };
        let place = format!("{place}.{key}");
        let count = set(held, &nodes_in(scene, &place, selection, mesh)?, hold);
        let (message, remedy) = if hold {
            ("every node of this selection is held already", "hold others, or release them before")
        } else {
            ("no node of this selection is held at that time", "release nodes that are fixed or held")
        };
        if count == 0 {
            return Err(scene.at(&place, message, remedy));
        }
        done.push(format!("{} {}", counted(count, "node", "nodes"), if hold { "held" } else { "released" }));
    }
    if let Some(selection) = parts.remove {
        let place = format!("{place}.remove");
        let elements = elements_in(scene, &place, selection, mesh)?;
        let count = set(gone, &elements, true);
        if count == 0 {
            let message = "all elements of this selection are gone by then";
            return Err(scene.at(&place, message, "remove others, or leave this out"));
        }
        if gone.iter().all(|&gone| gone) {
            return Err(scene.at(&place, "this removes the last element of the body", "leave some"));
        }
        done.push(format!("{} removed", counted(count, "element", "elements")));
    }
    let left: Vec<u32> = (0..gone.len()).filter(|&t| !gone[t]).map(|t| t as u32).collect();
    let moves = |t: &u32| mesh.tetrahedra[*t as usize].iter().any(|&n| !held[n as usize]);
    if !left.iter().any(moves) {
        let message = "every node is held from then on: nothing can move";
        return Err(scene.at(place, message, "hold fewer nodes"));
    }
    Ok(Stretch { event: 0, time: 0.0, held: held.to_vec(), left, text: done.join(", ") })
}

/// Sets the items to `value`; how many were not so before.
fn set(all: &mut [bool], items: &[u32], value: bool) -> usize {
    items.iter().filter(|&&item| std::mem::replace(&mut all[item as usize], value) != value).count()
}
