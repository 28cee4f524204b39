//! The bundled scenes as the charts use them: their own bodies, tools and contacts, on paths that end in time.

use miette::{Result, miette};
use palpate::prelude::*;
use palpate::scene::SceneDescription;

use super::palpation::Method;

/// Cells of the liver where it has to step a thousand times a second (m): 0.0155 in the bundled scene.
const COARSE_LIVER: f64 = 0.025;

/// What a scene is used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Use {
    /// The way to the first press and a rest there, in a hand.
    Press,
    /// The whole path, exactly.
    Palpation,
    /// Straight down onto the skin of the block, exactly.
    NormalTouch,
    /// Onto it at 45 degrees, exactly.
    ObliqueTouch,
}

/// Time (s) from the begin of a press to its rest.
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

    fn describe(&self, scene: &mut SceneDescription) {
        if self.quick
            && let Some(block) = &mut scene.bodies[0].block
        {
            block.cells = [4, 4, 3];
        }
        let path = &mut scene.hand.path;
        match self.purpose {
            Use::Press => {
                let Some(first) = path.first().copied() else { return };
                let Some(mut pressed) = path.iter().find(|key| key.position != first.position).copied() else { return };
                pressed.time = PRESS;
                *path = vec![first, pressed];
            }
            Use::Palpation if self.scene == "liver" => {
                scene.bodies[0].cell = Some(COARSE_LIVER);
                // Without the second that it waits at the begin, and twice as fast.
                path.remove(0);
                let begin = path.first().map_or(0.0, |key| key.time);
                path.iter_mut().for_each(|key| key.time = 0.5 * (key.time - begin));
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
