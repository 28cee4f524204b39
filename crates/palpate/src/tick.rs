//! The tick stage (1 kHz): device, latest snapshot, local contact problem, wrench; and the tool's pose for the step.

use palpate_collision::ToolPose;
use palpate_haptics::SetupError;
use palpate_haptics::device::{DeviceSpec, HapticDevice, TickTime};
use palpate_haptics::exchange::{Reader, Writer};
use palpate_haptics::run::run_tick;
use palpate_haptics::snapshot::HapticSnapshot;
use palpate_haptics::tick::{PatchTickConfig, Tick, TickConfig, TickState, TickWorkspace};
use palpate_haptics::wrench::Wrench;

pub use palpate_haptics::record::{TickFlags, TickRecord};

use crate::devices;
use crate::record::TickLine;
use crate::run::RunError;
use crate::world::World;

/// A tick with the times that only the real clock knows.
#[derive(Clone, Copy, Debug)]
pub struct TickReport {
    /// What the tick did.
    pub record: TickRecord,
    /// How late it woke up (s); 0 in lockstep.
    pub latency: f64,
    /// Its work (s); 0 in lockstep.
    pub work: f64,
    /// Periods missed since the last tick.
    pub overruns: u32,
}

/// The tick with everything that it reads and writes, but for the device.
pub(crate) struct TickStage {
    tick: Tick,
    state: TickState,
    ws: TickWorkspace,
    snapshots: Reader<HapticSnapshot>,
    poses: Writer<ToolPose>,
    line: TickLine,
    index: u64,
    /// Whether the device has told a sound pose.
    placed: bool,
}

impl TickStage {
    /// The tick of a world on a device of this record, by `config`.
    pub(crate) fn new(
        world: &World,
        config: &TickConfig,
        spec: &DeviceSpec,
        snapshots: Reader<HapticSnapshot>,
        poses: Writer<ToolPose>,
        line: TickLine,
    ) -> Result<Self, RunError> {
        let refused = |e: SetupError| RunError::Device(e.to_string());
        let mut tick = Tick::new(config, spec).map_err(refused)?;
        if world.patch_nodes() > 0 {
            let on_patches = PatchTickConfig {
                tool: world.tool().clone(),
                detection: *world.detection(),
                max_nodes: world.patch_nodes(),
                max_bodies: world.body_contacts(),
                hand_over: world.hand_over(),
            };
            tick = tick.on_patches(on_patches).map_err(refused)?;
        }
        if let Some(hinge) = world.tool().hinge() {
            let grip = world.description().tools[0].grip.unwrap_or_default();
            tick = tick.with_gripper(&grip, *hinge).map_err(refused)?;
        }
        let contacts = world.tool_capacity();
        let (state, ws) = (tick.state(contacts), tick.workspace(contacts));
        Ok(Self { tick, state, ws, snapshots, poses, line, index: 0, placed: false })
    }

    /// What the scene says about its tick, on a device of this record.
    pub(crate) fn config(world: &World, spec: &DeviceSpec) -> TickConfig {
        let scene = world.description();
        TickConfig {
            period: 1.0 / scene.rates.tick,
            sweeps: scene.solver.tick_sweeps,
            tolerance: scene.solver.tick_tolerance,
            coupling: devices::coupling(scene, spec),
            passivity: scene.passivity,
            limits: scene.limits,
        }
    }

    /// Forgets all ticks so far; the next is number 0.
    pub(crate) fn restart(&mut self) {
        self.state.reset();
        (self.index, self.placed) = (0, false);
    }

    /// Nominal time between ticks (s).
    pub(crate) fn period(&self) -> f64 {
        self.tick.period()
    }

    /// Time since the tick before (s); a period for the first.
    pub(crate) fn since(&self, before: Option<f64>, time: f64) -> f64 {
        before.map_or(self.period(), |before| time - before)
    }

    /// One tick at `time` (s), `dt` seconds after the last, on `device`. `host_lead` is what this machine's clock says beyond
    /// `dt` (s), where that is by the device's.
    pub(crate) fn tick(
        &mut self,
        device: &mut dyn HapticDevice,
        time: f64,
        dt: f64,
        host_lead: Option<f64>,
    ) -> TickRecord {
        let moment = TickTime { index: self.index, time, dt, host_lead };
        self.index += 1;
        let record = run_tick(&self.tick, &mut self.state, &mut self.ws, &mut self.snapshots, device, moment);
        // Before the first sound pose there is none to tell the step.
        self.placed |= !record.flags.contains(TickFlags::BAD_POSE) && record.device_error.is_none();
        if self.placed {
            self.poses.send(record.tool());
        }
        record
    }

    /// Hands the report to the trace.
    pub(crate) fn trace(&mut self, report: &TickReport) {
        self.line.push(report);
    }
}

/// The tick stage with the device that it serves.
pub struct Ticker {
    stage: TickStage,
    device: Box<dyn HapticDevice>,
}

impl Ticker {
    /// Opens the device of the scene, for programs that bring their own loop: `snapshots` come from the step, `poses`
    /// go to it. Nothing is traced.
    ///
    /// # Errors
    /// A device that cannot be opened.
    pub fn open(world: &World, snapshots: Reader<HapticSnapshot>, poses: Writer<ToolPose>) -> Result<Self, RunError> {
        let device = devices::device(world.scene())?;
        Self::new(world, device, snapshots, poses, TickLine::none())
    }

    /// The same on a device of the caller's, with changes to what the scene says about its tick: for programs that try
    /// many couplings, devices or rates on one world.
    ///
    /// # Errors
    /// A change that cannot be.
    pub fn on_device(
        world: &World,
        device: Box<dyn HapticDevice>,
        change: impl FnOnce(&mut TickConfig),
        snapshots: Reader<HapticSnapshot>,
        poses: Writer<ToolPose>,
    ) -> Result<Self, RunError> {
        Self::changed(world, device, change, snapshots, poses, TickLine::none())
    }

    pub(crate) fn new(
        world: &World,
        device: Box<dyn HapticDevice>,
        snapshots: Reader<HapticSnapshot>,
        poses: Writer<ToolPose>,
        line: TickLine,
    ) -> Result<Self, RunError> {
        Self::changed(world, device, |_| {}, snapshots, poses, line)
    }

    fn changed(
        world: &World,
        device: Box<dyn HapticDevice>,
        change: impl FnOnce(&mut TickConfig),
        snapshots: Reader<HapticSnapshot>,
        poses: Writer<ToolPose>,
        line: TickLine,
    ) -> Result<Self, RunError> {
        // The limits that the scene states, before those that the device states of itself.
        let spec = devices::spec(&world.description().device, Some(device.spec()));
        let spec = spec.map_err(|e| RunError::Device(e.to_string()))?;
        let mut config = TickStage::config(world, &spec);
        change(&mut config);
        Ok(Self { stage: TickStage::new(world, &config, &spec, snapshots, poses, line)?, device })
    }

    /// Nominal time between ticks (s).
    pub fn period(&self) -> f64 {
        self.stage.period()
    }

    /// Time since the tick before (s); a period for the first.
    pub(crate) fn since(&self, before: Option<f64>, time: f64) -> f64 {
        self.stage.since(before, time)
    }

    /// One tick at `time` (s), `dt` seconds after the last: allocates nothing, takes no lock, has no panic path.
    pub fn tick(&mut self, time: f64, dt: f64) -> TickRecord {
        self.stage.tick(self.device.as_mut(), time, dt, None)
    }

    /// The same where `dt` is by the device's clock, and this machine's said `host_lead` more (s).
    pub(crate) fn tick_by(&mut self, time: f64, dt: f64, host_lead: Option<f64>) -> TickRecord {
        self.stage.tick(self.device.as_mut(), time, dt, host_lead)
    }

    /// Hands the report to the trace.
    pub(crate) fn trace(&mut self, report: &TickReport) {
        self.stage.trace(report);
    }

    /// Takes the force off and lets the device go.
    pub fn rest(&mut self) {
        // A device that is gone already needs no zero force.
        let _ = self.device.write(Wrench::zero());
        self.device.close();
    }
}

#[cfg(test)]
mod tests {
    use palpate_haptics::exchange::latest;

    use super::*;
    use crate::scene::Scene;

    const BLOCK: &str = r#"
        name = "block"
        [[body]]
        name = "block"
        block = { min = [0, 0, 0], max = [0.04, 0.04, 0.04], cells = [2, 2, 2] }
        material = { law = "neo_hookean", young = 5e3, poisson = 0.4 }
        fixed = [{ below = { axis = "z", at = 0.0 } }]
        [[tool]]
        name = "ball"
        shape = { kind = "sphere", radius = 0.005 }
        [device]
        preset = "touch"
        [hand]
        path = [{ time = 0.0, position = [0.02, 0.02, 0.06] }]
    "#;

    #[test]
    fn a_preset_of_the_device_limits_the_force() {
        let world = Scene::from_toml(BLOCK, std::path::Path::new("")).unwrap().build().unwrap();
        let (_, snapshots) = latest(&HapticSnapshot::new(1));
        let (poses, _) = latest(&world.first_tool());
        let device = devices::device(world.scene()).unwrap();
        let ticker = Ticker::new(&world, device, snapshots, poses, TickLine::none()).unwrap();
        assert_eq!(ticker.stage.tick.limits().max_force(), 3.3, "what CHAI3D states for the Touch (N)");
    }
}
