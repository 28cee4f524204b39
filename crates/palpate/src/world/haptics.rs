//! What a scene means for the 1 kHz side: what the tick solves, and whether its coupling is one that theory grants.

use palpate_haptics::coupling::{BoundGrounds, CouplingConfig, LIGHT_GRIP, MARGIN, StiffnessBound, stiffness_bound};

use super::World;
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
}

impl CouplingChoice {
    /// For a scene whose device has been checked. Hardware that tells what it is may be another than the file says.
    pub(crate) fn new(scene: &SceneDescription) -> Option<Self> {
        let spec = devices::spec(&scene.device, None).ok()?;
        let config = devices::coupling(scene, &spec);
        let bound = stiffness_bound(&spec, config.translation.damping, scene.rates.tick);
        Some(Self { config, of_scene: scene.coupling.is_some(), bound })
    }

    /// Whether the stiffness is above the bound.
    pub fn exceeds(&self) -> bool {
        self.config.translation.stiffness > self.bound.stiffness
    }

    /// What to say of a coupling that the bound does not grant.
    pub(crate) fn warning(&self) -> Option<String> {
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
        )
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

/// What to say of a hand-over that the scene states and its steps are too short for.
pub(super) fn late_hand_over(scene: &SceneDescription) -> Option<String> {
    let (stated, step) = (scene.tick.hand_over, 1.0 / scene.rates.step);
    let by_default = stated == TickDescription::default().hand_over || scene.tick.method != TickMethod::Local;
    (!by_default && stated > step).then(|| {
        format!(
            "[tick] hand_over = {} ms is longer than a step of {:.1} ms: the next shape would come before the last is there, \
             so it is cut to {:.1} ms; use at most a third of a step",
            stated * 1e3,
            step * 1e3,
            step * HAND_OVER * 1e3,
        )
    })
}

impl World {
    /// Time (s) over which a tick goes over from one step's shape to the next's: what the scene states, and at most a third of
    /// its step.
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
                let milliseconds = (self.hand_over() * 1e6).round() / 1e3;
                format!("local ({} nodes at most, hand-over {milliseconds} ms)", tick.patch_nodes)
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
