//! The device, hand and coupling that a scene describes.

use palpate_collision::ToolPose;
use palpate_devices::place::{Place, PlaceConfig, Placed};
use palpate_devices::{DRIVERS, DriverConfig, driver};
use palpate_haptics::SetupError;
use palpate_haptics::coupling::CouplingConfig;
use palpate_haptics::device::{DEVICES, DeviceSetup, DeviceSpec, HapticDevice, TickTime, open};
use palpate_haptics::hand::{HAND_PRESETS, Hand};
use palpate_haptics::script::HandScript;

use crate::run::RunError;
use crate::scene::{DeviceDescription, Scene, SceneDescription};
use crate::world::World;

/// Kind of the device whose driver calls the tick itself, through a [`Port`](crate::session::Port).
pub const PORT: &str = "port";

/// Register names of all devices.
pub(crate) fn device_names() -> impl Iterator<Item = &'static str> {
    DEVICES.iter().map(|d| d.name).chain(DRIVERS.iter().map(|d| d.name)).chain([PORT])
}

/// Whether a device of this kind exists in arithmetic only and follows the scene's path.
pub(crate) fn follows_path(kind: &str) -> bool {
    DEVICES.iter().any(|d| d.name == kind)
}

/// Whether a device of this kind has a virtual time: hardware has none.
pub(crate) fn has_virtual_time(kind: &str) -> bool {
    driver(kind).is_none_or(|driver| !driver.real_time)
}

/// Keys of the scene's device that its kind does not read.
pub(crate) fn keys_without_effect(device: &DeviceDescription) -> impl Iterator<Item = &'static str> {
    let driver = driver(&device.kind);
    let given = [
        ("library", device.library.is_some()),
        ("url", device.url.is_some()),
        ("trace", device.trace.is_some()),
        ("gripper_range", device.gripper_range.is_some()),
    ];
    let reads = move |key: &str| driver.is_some_and(|driver| driver.keys.contains(&key));
    let placed = device.kind == PORT || driver.is_some_and(|driver| driver.own_frame);
    let default = PlaceConfig::default();
    let place = [("origin", device.origin != default.origin), ("axes", device.axes != default.axes)];
    let keys = given.into_iter().filter(move |(key, given)| *given && !reads(key));
    keys.chain(place.into_iter().filter(move |(_, moved)| *moved && !placed)).map(|(key, _)| key)
}

/// Names of all hands.
pub(crate) fn hand_names() -> impl Iterator<Item = &'static str> {
    HAND_PRESETS.iter().map(|h| h.name)
}

/// What the scene says that its device can do, or what the device says itself.
pub(crate) fn spec(description: &DeviceDescription, own: Option<&DeviceSpec>) -> Result<DeviceSpec, SetupError> {
    match (&description.record, &description.preset, own) {
        (Some(record), _, _) => record.validate().map(|()| record.clone()),
        (None, Some(name), _) => DeviceSpec::preset(name),
        (None, None, Some(own)) => Ok(own.clone()),
        (None, None, None) => Ok(DeviceSpec::of_mechanics(&description.mechanics)),
    }
}

/// The coupling that the scene names, or the one that suits its device.
pub(crate) fn coupling(scene: &SceneDescription, spec: &DeviceSpec) -> CouplingConfig {
    scene.coupling.unwrap_or_else(|| CouplingConfig::at_rate(spec, scene.rates.tick))
}

/// Opens the scene's device.
pub(crate) fn device(scene: &Scene) -> Result<Box<dyn HapticDevice>, RunError> {
    let description = scene.description();
    let refused = |e: SetupError| RunError::Device(e.to_string());
    if description.device.kind == PORT {
        return Err(RunError::Device(
            "`port` is a device whose own program ticks through the library; to run the scene by itself, set \
             device.kind = \"virtual\" and give the hand a path"
                .into(),
        ));
    }
    if let Some(driver) = driver(&description.device.kind) {
        let device = (driver.open)(&driver_config(scene)).map_err(|e| RunError::Device(e.to_string()))?;
        let place = Place::new(&description.device.place()).map_err(refused)?;
        return Ok(if driver.own_frame { Box::new(Placed::new(device, place)) } else { device });
    }
    let setup = DeviceSetup {
        script: HandScript::new(description.hand.path.clone()).map_err(refused)?,
        hand: Hand::preset(&description.hand.preset).map_err(refused)?,
        mechanics: description.device.mechanics,
    };
    open(&description.device.kind, &setup).map_err(refused)
}

/// Where the tool is before the first step. A path knows; hardware is asked, for it may be anywhere.
pub(crate) fn first_pose(world: &World, device: &mut dyn HapticDevice) -> ToolPose {
    let told = world.first_tool();
    if follows_path(&world.description().device.kind) {
        return told;
    }
    let moment = TickTime::regular(0, 1.0 / world.description().rates.tick);
    let opening = |gripper: f64| world.tool().hinge().map_or(0.0, |hinge| hinge.opening(gripper));
    let asked = device.read(moment).map(|sample| ToolPose { frame: sample.pose, opening: opening(sample.gripper) });
    asked.ok().filter(ToolPose::is_finite).unwrap_or(told)
}

/// What the scene says to its driver, with paths that are found from anywhere.
fn driver_config(scene: &Scene) -> DriverConfig {
    let DeviceDescription { library, url, trace, gripper_range, .. } = &scene.description().device;
    // A bare name is for the system's loader to find.
    let library = library.as_ref().map(|name| match name.contains(['/', '\\']) {
        true => scene.folder().join(name),
        false => name.into(),
    });
    let trace = trace.as_ref().map(|name| scene.folder().join(name));
    DriverConfig { library, url: url.clone(), trace, gripper_range: *gripper_range }
}
