//! What a scene means for the 1 kHz side: what the tick solves, and whether its coupling is one that theory grants.

use palpate_haptics::coupling::{BoundGrounds, CouplingConfig, LIGHT_GRIP, MARGIN, StiffnessBound, stiffness_bound};

use super::World;
use crate::counted::counted;
use crate::devices;
use crate::scene::{SceneDescription, TickDescription, TickMethod};

/// The virtual coupling of a scene on the device that its file names.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CouplingChoice {
    /// Stiffness and damping.
    pub config: CouplingConfig,
    /// Whether the scene names them; otherwise they are tuned from the device.
    pub of_scene: bool,
    /// The largest stiffness that theory grants with this damping.
    pub bound: StiffnessBound,
    /// Whether torques are sent while the orientation is coupled rigidly: no spring bounds their stiffness then.
    pub rigid_torque: bool,
}

impl CouplingChoice {
    /// For a scene whose device has been checked. Hardware that tells what it is may be another than the file says.
    pub(crate) fn new(scene: &SceneDescription) -> Option<Self> {
        let spec = devices::spec(&scene.device, None).ok()?;
        let config = devices::coupling(scene, &spec);
        let bound = stiffness_bound(&spec, config.translation.damping, scene.rates.tick);
        let torque = scene.limits.max_torque.map_or(spec.max_torque, |torque| torque.min(spec.max_torque));
        let rigid_torque = torque > 0.0 && config.rotation.is_none();
        Some(Self { config, of_scene: scene.coupling.is_some(), bound, rigid_torque })
    }

    /// Whether the stiffness is above the bound.
    pub fn exceeds(&self) -> bool {
        self.config.translation.stiffness > self.bound.stiffness
    }

    /// What to say of a coupling that theory does not grant.
    pub(crate) fn warnings(&self) -> impl Iterator<Item = String> {
        let rigid = self.rigid_torque.then(|| {
            "the device has motors for torque, and the orientation is coupled to the tool rigidly: the tuning of a spring \
             needs the device's rotational inertia and damping, which its record does not hold, so that nothing but \
             limits.max_torque and limits.torque_slew keeps its torque calm; give [coupling] a `rotation` with the \
             stiffness (N m/rad) and damping (N m s/rad) that the device bears, or set limits.max_torque = 0"
                .into()
        });
        self.warning().into_iter().chain(rigid)
    }

    fn warning(&self) -> Option<String> {
        let spring = self.config.translation;
        self.exceeds().then(|| {
            format!(
                "[coupling] translation.stiffness = {} N/m is above the {:.0} N/m that are stable against any wall with \
                 {} N s/m ({}): use at most {:.0} N/m, or leave the coupling out to have it tuned from the device",
                spring.stiffness,
                self.bound.stiffness,
                spring.damping,
                grounds(self.bound.grounds),
                self.bound.stiffness / MARGIN,
            )
        })
    }
}

impl std::fmt::Display for CouplingChoice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let spring = self.config.translation;
        write!(
            f,
            "{:.0} N/m and {} N s/m, {}; stable against any wall up to {:.0} N/m ({})",
            spring.stiffness,
            spring.damping,
            if self.of_scene { "by the scene" } else { "tuned from the device" },
            self.bound.stiffness,
            grounds(self.bound.grounds),
        )?;
        match self.config.rotation {
            Some(spring) => write!(f, "; rotation {} N m/rad and {} N m s/rad", spring.stiffness, spring.damping),
            None if self.rigid_torque => write!(f, "; rotation rigid, with motors for torque"),
            None => Ok(()),
        }
    }
}

fn grounds(grounds: BoundGrounds) -> String {
    match grounds {
        BoundGrounds::Device => "by the damping of the device, with nobody holding it".into(),
        BoundGrounds::LightGrip => {
            format!("the device's damping is unknown: by {LIGHT_GRIP} N s/m of a hand that holds it lightly")
        }
        BoundGrounds::Encoder => "by the device's friction against its encoder step".into(),
    }
}

/// Share of a step that a hand-over takes at most: what lasts longer is felt as lag before the next comes.
const HAND_OVER: f64 = 1.0 / 3.0;

/// What to say of a hand-over that the scene states and that is cut to what its steps have time for.
pub(super) fn late_hand_over(scene: &SceneDescription) -> Option<String> {
    let (stated, step) = (scene.tick.hand_over, 1.0 / scene.rates.step);
    let by_default = stated == TickDescription::default().hand_over || scene.tick.method != TickMethod::Local;
    let longest = step * HAND_OVER;
    // A third of a step as people write it is not too long by its last digit.
    (!by_default && stated > longest * 1.01).then(|| {
        format!(
            "[tick] hand_over = {} ms is longer than a third of a step of {:.1} ms, and a shape that lags longer is felt: it is cut \
             to {:.1} ms; use at most that, or leave it out",
            stated * 1e3,
            step * 1e3,
            longest * 1e3,
        )
    })
}

impl World {
    /// Time (s) over which a tick goes over from one step's shape to the next's: what the scene states, and at most a
    /// third of its step. A time that is over within a tick is none.
    pub fn hand_over(&self) -> f64 {
        self.description().tick.hand_over.min(self.dt() * HAND_OVER)
    }

    /// Nodes of the tissue around the tool that a snapshot carries; 0 where the tick has frozen rows.
    pub fn patch_nodes(&self) -> usize {
        let tick = &self.description().tick;
        if tick.method == TickMethod::Local { tick.patch_nodes } else { 0 }
    }

    /// What contact problem the tick solves, with the parameters of the method.
    pub fn tick_method(&self) -> String {
        let tick = &self.description().tick;
        match tick.method {
            TickMethod::Local => {
                let (time, period) = (self.hand_over(), 1.0 / self.description().rates.tick);
                let milliseconds = (time * 1e6).round() / 1e3;
                let hand_over = match time > period {
                    true => format!("hand-over {milliseconds} ms"),
                    false => "each step's shape at once".into(),
                };
                format!("local ({} at most, {hand_over})", counted(tick.patch_nodes, "node", "nodes"))
            }
            TickMethod::Frozen => "frozen rows".into(),
        }
    }

    /// The virtual coupling between device and tool. `None` where the device of the scene is not described well.
    pub fn coupling(&self) -> Option<CouplingChoice> {
        CouplingChoice::new(self.description())
    }

    /// What stands between the contact force and the hand, as text for people.
    pub(super) fn force_path(&self) -> String {
        let scene = self.description();
        let coupling = self.coupling().map(|choice| choice.to_string()).unwrap_or_default();
        let (p, l) = (&scene.passivity, &scene.limits);
        let passivity = match p.control {
            true => format!("on, allowance {} J", p.allowance),
            false => "observed only".into(),
        };
        let of = |value: Option<f64>, unit: &str| value.map_or("the device's".into(), |v| format!("{v} {unit}"));
        format!(
            "coupling: {coupling}\npassivity: {passivity}; limits: force {}, torque {}, power {}, slew {} N/s",
            of(l.max_force, "N"),
            of(l.max_torque, "N m"),
            of(l.max_power, "W"),
            l.force_slew,
        )
    }
}
