//! The bundled scenes as the charts use them: their own bodies, tools and contacts, on paths that end in time.

use miette::{Result, miette};
use palpate::haptics::script::ScriptKey;
use palpate::prelude::*;
use palpate::scene::SceneDescription;

use super::palpation::Method;

/// Cells of the liver where it has to step a thousand times a second (m): 0.0155 in the bundled scene.
const COARSE_LIVER: f64 = 0.025;

/// Cells of the liver (m) whose first touch tells what of its error is the mesh's.
const FINE_LIVER: f64 = 0.012;

/// What a scene is used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Use {
    /// The way to the first press and a rest there, in a hand; a grasper closes where it will lift, lifts, and rests there.
    Press,
    /// The whole path, exactly.
    Palpation,
    /// Straight down onto the skin of the block, exactly.
    NormalTouch,
    /// Onto it at 45 degrees, exactly.
    ObliqueTouch,
    /// The begin of the liver's path, exactly, on its own cells.
    Touch,
    /// The same on finer ones.
    FineTouch,
}

impl Use {
    /// Whether it is a first touch, and no more.
    pub(crate) fn is_touch(self) -> bool {
        !matches!(self, Self::Press | Self::Palpation)
    }
}

/// Length (s) of the begin of the liver's path: 100 ms beyond its first touch.
const TOUCH: f64 = 0.49;

/// Time (s) from the begin of a press to its rest, and of each of a grasper's two motions.
pub(crate) const PRESS: f64 = 0.4;

/// A bundled scene and its use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Case {
    pub(crate) scene: &'static str,
    pub(crate) purpose: Use,
    /// On few elements, for a quick look.
    pub(crate) quick: bool,
}

impl Case {
    /// Name in tables.
    pub(crate) fn name(&self) -> String {
        match self.purpose {
            Use::Press | Use::Palpation => self.scene.into(),
            Use::NormalTouch => format!("{}, touched straight on", self.scene),
            Use::ObliqueTouch => format!("{}, touched at 45 degrees", self.scene),
            Use::Touch => format!("{}, touched", self.scene),
            Use::FineTouch => format!("{}, cells of {:.0} mm, touched", self.scene, FINE_LIVER * 1e3),
        }
    }

    /// The scene whose tissue steps at `rate` (Hz), with the tick of `method`, and a further change.
    pub(crate) fn world(&self, method: Method, rate: f64, change: impl FnOnce(&mut SceneDescription)) -> Result<World> {
        let mut scene = Scene::bundled(self.scene).map_err(|e| miette!("{e}"))?;
        let edit = |scene: &mut SceneDescription| {
            method.describe(rate, scene);
            self.describe(scene);
            change(scene);
        };
        scene.edit(edit).map_err(|e| miette!("{e}"))?;
        scene.build().map_err(|e| miette!("{e}"))
    }

    /// How long a path of this length (s) is followed (s).
    pub(crate) fn duration(&self, path: f64) -> f64 {
        if matches!(self.purpose, Use::Touch | Use::FineTouch) { path.min(TOUCH) } else { path }
    }

    fn describe(&self, scene: &mut SceneDescription) {
        if self.quick
            && let Some(block) = &mut scene.bodies[0].block
        {
            block.cells = [4, 4, 3];
        }
        let path = &mut scene.hand.path;
        match self.purpose {
            Use::Press if path.iter().any(|key| key.gripper == Some(0.0)) => lift(path),
            Use::Press => {
                let Some(first) = path.first().copied() else { return };
                let Some(mut pressed) = path.iter().find(|key| key.position != first.position).copied() else { return };
                pressed.time = PRESS;
                *path = vec![first, pressed];
            }
            Use::Touch => hasten(path),
            Use::FineTouch => {
                scene.bodies[0].cell = Some(FINE_LIVER);
                hasten(path);
            }
            Use::Palpation if self.scene == "liver" => {
                scene.bodies[0].cell = Some(COARSE_LIVER);
                hasten(path);
            }
            Use::Palpation if self.quick => path.truncate(3),
            Use::Palpation => {}
            Use::NormalTouch | Use::ObliqueTouch => {
                // The ball of 12 mm touches the skin at z = 42 mm and comes to 8 mm below that in half a second.
                let aside = if self.purpose == Use::ObliqueTouch { 0.012 } else { 0.0 };
                path.truncate(2);
                let places = [[-0.008 - aside, 0.0, 0.046], [-0.008, 0.0, 0.034]];
                for (k, (key, place)) in path.iter_mut().zip(places).enumerate() {
                    (key.time, key.position) = (0.5 * k as f64, place);
                }
            }
        }
    }
}

/// Keeps of a grasper's path that it closes and lifts.
fn lift(path: &mut Vec<ScriptKey>) {
    let Some(closes) = path.iter().position(|key| key.gripper == Some(0.0)) else { return };
    let closed = path[closes];
    let Some(&raised) = path[closes..].iter().find(|key| key.position != closed.position) else { return };
    *path = vec![
        ScriptKey { time: 0.0, gripper: Some(1.0), ..closed },
        ScriptKey { time: PRESS, ..closed },
        ScriptKey { time: 2.0 * PRESS, ..raised },
    ];
}

/// Without the second that it waits at the begin, and twice as fast.
fn hasten(path: &mut Vec<ScriptKey>) {
    path.remove(0);
    let begin = path.first().map_or(0.0, |key| key.time);
    path.iter_mut().for_each(|key| key.time = 0.5 * (key.time - begin));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_press_ends_in_a_rest_and_a_grasper_s_closed_and_raised() {
        let path = |scene| {
            let case = Case { scene, purpose: Use::Press, quick: false };
            let worlds =
                [Method::Local, Method::Frozen, Method::Held].map(|method| case.world(method, 30.0, |_| {}).unwrap());
            worlds[0].description().hand.path.clone()
        };
        let pressed = path("block");
        assert_eq!((pressed.len(), pressed[1].time), (2, PRESS));
        let lifted = path("grasp");
        assert_eq!(lifted.iter().map(|key| key.gripper).collect::<Vec<_>>(), [Some(1.0), Some(0.0), None]);
        assert_eq!(lifted[0].position, lifted[1].position, "it closes where it is");
        assert!(lifted[2].position[2] > lifted[1].position[2] + 0.01 && lifted[2].time == 2.0 * PRESS);
    }
}
