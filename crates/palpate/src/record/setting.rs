//! What a trace says before anything happens: scene, device, rates, and the shapes that viewers draw.

use std::collections::BTreeMap;

use palpate_haptics::device::DeviceSpec;
use palpate_trace::{Attachment, BodyGeometry, TraceConfig};

use super::{DEVICE_RECORD, LOCKSTEP, SCENE};
use crate::drawn::{solids, tool_shape};
use crate::run::RunOptions;
use crate::world::World;

pub(super) fn config(world: &World, options: &RunOptions, device: &DeviceSpec) -> TraceConfig {
    let scene = world.description();
    let base = if options.lockstep { TraceConfig::default() } else { TraceConfig::real_time() };
    let length = options.length.seconds(world.dt());
    let engine = BTreeMap::from([
        ("version".to_string(), env!("CARGO_PKG_VERSION").to_string()),
        ("scene".into(), scene.name.clone()),
        ("embedded".into(), world.scene().is_embedded().to_string()),
        ("folder".into(), world.scene().folder().display().to_string()),
        ("mode".into(), if options.lockstep { LOCKSTEP } else { "real time" }.into()),
        ("seconds".into(), format!("{length:?}")),
        ("step_rate_hz".into(), format!("{:?}", scene.rates.step)),
        ("factor_rate_hz".into(), format!("{:?}", scene.rates.factor)),
        ("tick_rate_hz".into(), format!("{:?}", scene.rates.tick)),
        // What hardware says of itself is not in the scene. Numbers and names can be written as TOML.
        (DEVICE_RECORD.into(), toml::to_string(device).unwrap_or_default()),
    ]);
    let scene_file =
        Attachment { name: SCENE.into(), media_type: "application/toml".into(), data: world.scene().text().into() };
    let rest = world.mesh().nodes.iter().map(|x| [x.x, x.y, x.z]).collect();
    TraceConfig {
        engine,
        attachments: vec![scene_file],
        bodies: vec![BodyGeometry::new(scene.bodies[0].name.clone(), rest, world.surface().triangles.clone())],
        solids: solids(world),
        tool: tool_shape(world.tool()),
        ..base
    }
}
