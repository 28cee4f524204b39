//! A scene's loop on a clock of its own: the step, the hand-over and the tick that `palpate run --lockstep` has, on one thread,
//! with any device, coupling and rate of the tick.

use miette::{Result, miette};
use palpate::collision::ToolPose;
use palpate::haptics::device::HapticDevice;
use palpate::haptics::exchange::{Reader, Writer, latest};
use palpate::haptics::snapshot::HapticSnapshot;
use palpate::haptics::tick::TickConfig;
use palpate::prelude::*;
use palpate::scene::{TickDescription, TickMethod};
use palpate::step::StepStatus;
use palpate::tick::{TickRecord, Ticker};

/// What the tick does between two steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Method {
    /// Contacts found anew on the tissue around the tool.
    Local,
    /// The same, with the shape of the tissue taken over at once from each new step.
    LocalAtOnce,
    /// The rows of the step.
    Frozen,
    /// Nothing: the loop runs at the rate of the tissue, and its force is held for a whole step.
    Held,
}

impl Method {
    /// Name in tables and pictures.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Local => "local patch",
            Self::LocalAtOnce => "local patch, no hand-over",
            Self::Frozen => "frozen rows",
            Self::Held => "force held for a step",
        }
    }

    /// Sets up the tick of a scene whose tissue steps at `rate` (Hz).
    pub(crate) fn describe(self, rate: f64, scene: &mut SceneDescription) {
        scene.rates.step = rate;
        scene.tick.method = TickMethod::Local;
        if matches!(self, Self::Frozen | Self::Held) {
            // What a scene says of its patch has no effect on frozen rows, and would be refused.
            scene.tick = TickDescription { method: TickMethod::Frozen, ..TickDescription::default() };
        }
        if self == Self::LocalAtOnce {
            scene.tick.hand_over = 0.0;
        }
    }

    /// Time between two ticks (s), for tissue that steps at `rate` (Hz).
    pub(crate) fn period(self, rate: f64) -> f64 {
        if self == Self::Held { 1.0 / rate } else { 1e-3 }
    }

    /// Lets the tick have that period, and take it for no gap.
    pub(crate) fn configure(self, rate: f64, config: &mut TickConfig) {
        config.period = self.period(rate);
        // A hand moves far between two ticks that are far apart.
        config.limits.jump_distance = config.limits.jump_distance.max(config.limits.jump_speed * config.period);
        config.limits.gap = config.limits.gap.max(3.0 * config.period);
        // As many steps as the default allows at 30 Hz.
        config.limits.stale_after = config.limits.stale_after.max(6.0 / rate);
        config.limits.stale_zero = config.limits.stale_zero.max(15.0 / rate);
    }
}

/// A scene in motion.
pub(crate) struct Palpation<'w> {
    simulation: Simulation<'w>,
    ticker: Ticker,
    snapshots: Writer<HapticSnapshot>,
    poses: Reader<ToolPose>,
    rate: f64,
    ticks: u64,
    steps: u64,
    failed: bool,
}

/// Share of a period that passes for none.
const ROUNDING: f64 = 1e-6;

impl<'w> Palpation<'w> {
    /// Before its first step, on this device, with changes to what the scene says about its tick.
    pub(crate) fn new(
        world: &'w World,
        device: Box<dyn HapticDevice>,
        change: impl FnOnce(&mut TickConfig),
    ) -> Result<Self> {
        let rates = world.description().rates;
        let (snapshots, taken) = latest(&world.empty_snapshot());
        let (told, poses) = latest(&world.first_tool());
        let ticker = Ticker::on_device(world, device, change, taken, told).map_err(|e| miette!("{e}"))?;
        let every = (rates.step / rates.factor).round().max(1.0) as u64;
        let simulation = Simulation::new(world).map_err(|e| miette!("{e}"))?.refresh_every(every);
        Ok(Self { simulation, ticker, snapshots, poses, rate: rates.step, ticks: 0, steps: 0, failed: false })
    }

    /// The step that is due, and the next tick; whether there was a step.
    pub(crate) fn tick(&mut self) -> (TickRecord, bool) {
        let period = self.ticker.period();
        // Divided by the rate, as a run does it: the last bit of a product would be another.
        let time = self.ticks as f64 / (1.0 / period);
        let due = time * self.rate >= self.steps as f64 - ROUNDING;
        if due {
            let report = self.simulation.step(self.poses.latest());
            self.steps += 1;
            self.failed |= report.status == StepStatus::RolledBack;
            self.snapshots.value_mut().clone_from(self.simulation.snapshot());
            self.snapshots.publish();
        }
        self.ticks += 1;
        (self.ticker.tick(time, period), due)
    }

    /// Whether the tissue failed in a step.
    pub(crate) fn has_failed(&self) -> bool {
        self.failed
    }
}

#[cfg(test)]
mod tests {
    use palpate::constraints::compliance::ComplianceMethod;
    use palpate::haptics::device::VirtualDevice;
    use palpate::haptics::hand::Hand;
    use palpate::haptics::script::HandScript;
    use palpate::tick::TickReport;

    use super::*;

    #[test]
    fn the_loop_of_the_chart_is_that_of_a_lockstep_run_to_the_bit() {
        struct Kept(Vec<TickRecord>);
        impl Observer for Kept {
            fn tick(&mut self, report: &TickReport) {
                self.0.push(report.record);
            }
        }
        let mut scene = Scene::bundled("block").unwrap();
        // Factored in every step: the thread of factors has a clock of its own.
        let change = |scene: &mut SceneDescription| {
            scene.bodies[0].compliance = ComplianceMethod::Exact;
            scene.bodies[0].block.as_mut().unwrap().cells = [4, 4, 3];
        };
        scene.edit(change).unwrap();
        let world = scene.build().unwrap();
        let mut kept = Kept(Vec::new());
        let length = Length::Seconds(1.2);
        let options = RunOptions { length, lockstep: true, threads: Some(1), ..RunOptions::default() };
        run(&world, &options, &AtomicBool::new(false), &mut kept).unwrap();

        let (hand, device) = (&world.description().hand, &world.description().device);
        let script = HandScript::new(hand.path.clone()).unwrap();
        let device = VirtualDevice::new(device.mechanics, Hand::preset(&hand.preset).unwrap(), script).unwrap();
        let mut palpation = Palpation::new(&world, Box::new(device), |_| {}).unwrap();
        assert!(kept.0.len() == 1200 && kept.0.iter().any(|record| record.active > 0));
        for record in &kept.0 {
            assert_eq!(format!("{:?}", palpation.tick().0), format!("{record:?}"));
        }
    }
}
