//! The device, hand and coupling that a scene describes.

use palpate_haptics::SetupError;
use palpate_haptics::coupling::CouplingConfig;
use palpate_haptics::device::{DEVICES, DeviceSetup, DeviceSpec, HapticDevice, open};
use palpate_haptics::hand::{HAND_PRESETS, Hand};
use palpate_haptics::script::HandScript;

use crate::scene::{DeviceDescription, SceneDescription};

/// Register names of all devices.
pub(crate) fn device_names() -> impl Iterator<Item = &'static str> {
    DEVICES.iter().map(|d| d.name)
}

/// Names of all hands.
pub(crate) fn hand_names() -> impl Iterator<Item = &'static str> {
    HAND_PRESETS.iter().map(|h| h.name)
}

/// What the scene's device can do.
pub(crate) fn spec(description: &DeviceDescription) -> Result<DeviceSpec, SetupError> {
    match &description.preset {
        Some(name) => DeviceSpec::preset(name),
        None => Ok(DeviceSpec::virtual_device(description.mechanics.encoder_step)),
    }
}

/// The coupling that the scene names, or the one that suits its device.
pub(crate) fn coupling(scene: &SceneDescription, spec: &DeviceSpec) -> CouplingConfig {
    scene.coupling.unwrap_or_else(|| CouplingConfig::for_device(spec))
}

/// Opens the scene's device.
pub(crate) fn device(scene: &SceneDescription) -> Result<Box<dyn HapticDevice>, SetupError> {
    let setup = DeviceSetup {
        script: HandScript::new(scene.hand.path.clone())?,
        hand: Hand::preset(&scene.hand.preset)?,
        mechanics: scene.device.mechanics,
    };
    open(&scene.device.kind, &setup)
}
