//! Whether a tick can believe a snapshot: every number that it reads is one.
//!
//! A number that is none would else pass by where it has no part in the force of the moment, be remembered, and be handed
//! over to the next snapshot. The compliances are not looked at here, where they would be most of the work: W is when the
//! tick makes its own of it, and so is what a tick uses of C.

use nalgebra::Vector3;
use palpate_constraints::law::Law;

use super::{Tick, is_pose};
use crate::body_contact::BodyContact;
use crate::patch::HapticPatch;
use crate::snapshot::HapticSnapshot;
use crate::wrench::all_finite;

impl Tick {
    /// Whether the snapshot's numbers are finite, its laws ones, and the tool's pose one: of its patch where this tick works
    /// on it, else of its rows. Once a snapshot; its work goes by nodes and rows.
    pub(super) fn believes(&self, snapshot: &HapticSnapshot) -> bool {
        let of_tool = is_pose(&snapshot.tool_pose) && snapshot.opening.is_finite();
        let on_patch = self.patch.is_some() && snapshot.patch.valid;
        of_tool && if on_patch { snapshot.dt.is_finite() && is_patch(&snapshot.patch) } else { has_rows(snapshot) }
    }
}

fn is_law(law: &Law) -> bool {
    law.validate().is_ok()
}

fn has_rows(snapshot: &HapticSnapshot) -> bool {
    let finite = |numbers: &[f64]| numbers.iter().all(|x| x.is_finite());
    [snapshot.gripper_rows(), snapshot.delta_free(), snapshot.lambda()].into_iter().all(finite)
        && finite(snapshot.tool_rows().as_flattened())
        && snapshot.blocks().iter().all(|block| is_law(&block.law))
}

fn is_patch(patch: &HapticPatch) -> bool {
    let finite = |vectors: &[Vector3<f64>]| vectors.iter().all(all_finite);
    [patch.q_free(), patch.q_end(), patch.drift(), patch.flow(), patch.force()].into_iter().all(finite)
        && patch.viscosity.is_finite()
        && is_law(&patch.law)
        && patch.bodies.all().iter().all(is_body)
}

fn is_body(contact: &BodyContact) -> bool {
    let BodyContact { feature: _, law, frame, tool, gap, free, drift, flow, force } = contact;
    gap.is_finite()
        && frame.iter().all(|x| x.is_finite())
        && [free, drift, flow, force].into_iter().all(all_finite)
        && tool.as_ref().is_none_or(|part| all_finite(&part.lever) && all_finite(&part.opens))
        && is_law(law)
}
