//! The device, hand and coupling that a scene describes.

use palpate_haptics::SetupError;
use palpate_haptics::coupling::CouplingConfig;
use palpate_haptics::device::{DEVICES, DeviceSetup, DeviceSpec, HapticDevice, open};
use palpate_haptics::hand::{HAND_PRESETS, Hand};
use palpate_haptics::script::HandScript;

use crate::run::RunError;
use crate::scene::{DeviceDescription, SceneDescription};

/// Kind of the device whose driver calls the tick itself, through a [`Port`](crate::session::Port).
pub const PORT: &str = "port";

/// Register names of all devices.
pub(crate) fn device_names() -> impl Iterator<Item = &'static str> {
    DEVICES.iter().map(|d| d.name).chain([PORT])
}

/// Whether a device of this kind exists in arithmetic only and follows the scene's path.
pub(crate) fn follows_path(kind: &str) -> bool {
    DEVICES.iter().any(|d| d.name == kind)
}

/// Names of all hands.
pub(crate) fn hand_names() -> impl Iterator<Item = &'static str> {
    HAND_PRESETS.iter().map(|h| h.name)
}

/// What the scene says that its device can do.
pub(crate) fn spec(description: &DeviceDescription) -> Result<DeviceSpec, SetupError> {
    match (&description.record, &description.preset) {
        (Some(record), _) => record.validate().map(|()| record.clone()),
        (None, Some(name)) => DeviceSpec::preset(name),
        (None, None) => Ok(DeviceSpec::virtual_device(description.mechanics.encoder_step)),
    }
}

/// The coupling that the scene names, or the one that suits its device.
pub(crate) fn coupling(scene: &SceneDescription, spec: &DeviceSpec) -> CouplingConfig {
    scene.coupling.unwrap_or_else(|| CouplingConfig::for_device(spec))
}

/// Opens the scene's device.
pub(crate) fn device(scene: &SceneDescription) -> Result<Box<dyn HapticDevice>, RunError> {
    if scene.device.kind == PORT {
        return Err(RunError::Device(
            "`port` is a device whose own program ticks through the library; to run the scene by itself, set \
             device.kind = \"virtual\" with a path for the hand"
                .into(),
        ));
    }
    let refused = |e: SetupError| RunError::Device(e.to_string());
    let setup = DeviceSetup {
        script: HandScript::new(scene.hand.path.clone()).map_err(refused)?,
        hand: Hand::preset(&scene.hand.preset).map_err(refused)?,
        mechanics: scene.device.mechanics,
    };
    open(&scene.device.kind, &setup).map_err(refused)
}
