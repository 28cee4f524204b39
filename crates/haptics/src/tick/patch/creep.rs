//! How a place of the patch creeps to where a force holds it.
//!
//! Tissue with the damping D = βK has, where its mass is not felt, the equation K (w + β w') = f for the way w that it
//! has gone under a force f, inside as at its skin. A step of backward Euler of length h knows it as `C f`, C = (1 +
//! β/h)⁻¹ K⁻¹.
//!
//! A damper alone would answer a tool that comes by steps, as an encoder has it, with forces without bound. So a part σ
//! of K⁻¹ yields at once (three elements: Zener), such that a held touch relaxes in a time τ:
//! ```text
//! x = q_end + d t/h + w
//! w + β' w' = g + σ β' g'
//! g = (1 + β/h) (q_free - q_end + e + C f) + o s(t)                                 m
//! β' = β + τ (1 + β/h),   σ = τ/β'
//! ```
//! and a tick of length T takes it by backward Euler too: `w = ϑ w₋ + (1 - ϑ) g + ϑ σ (g - g₋)`, ϑ = β'/(β' + T). Its
//! compliance is `(1 - ϑ + ϑ σ)(1 + β/h) C`: C itself for a tick as long as the step, and less for a shorter one, in
//! which D holds more against, down to C/(1 + 1/(τ/β + τ/h)). Two springs and a damper give nothing out that they did
//! not take in. Without viscosity, β = 0, x = q_free + d t/h + C f + o s.
//!
//! Tissue that has been touched for a while moves with the tool already, and d + e knows of it. So only a share a of β
//! counts, which falls to 0 as the touch grows older: `a β` stands for β then, `d + (1 - a) e` for d, and `a e` for e.
//!
//! d and e are the patch's drift and its flow, o s(t) is what is handed over from the snapshot before.

use nalgebra::Vector3;

use crate::patch::HapticPatch;

const ZERO: Vector3<f64> = Vector3::new(0.0, 0.0, 0.0);

/// Where a patch has a place \[m\], in any three coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    /// At the end of the step.
    pub(super) end: Vector3<f64>,
    /// The same without the forces of the step.
    pub(super) free: Vector3<f64>,
    pub(super) drift: Vector3<f64>,
    pub(super) flow: Vector3<f64>,
}

impl Place {
    /// The nodes of a patch.
    pub(super) fn nodes(patch: &HapticPatch) -> impl Iterator<Item = Self> {
        let shapes = patch.q_end().iter().zip(patch.q_free());
        let ways = patch.drift().iter().zip(patch.flow());
        shapes.zip(ways).map(|((end, free), (drift, flow))| Self { end: *end, free: *free, drift: *drift, flow: *flow })
    }
}

/// Relaxation time of a force on a place that is held \[s\]: a device knows its place by steps, of which a damper alone
/// would make forces without bound.
const RELAXES: f64 = 3e-3;

/// Age of a touch up to which the tissue creeps, and the time that it takes to cease \[s\].
const CREEPS: f64 = 0.06;
const CEASES: f64 = 0.06;

/// How long the tool has touched \[s\], as far as that matters; a tool that touches no more becomes new as slowly.
#[derive(Clone, Copy, Debug)]
pub(super) struct TouchAge(f64);

impl TouchAge {
    pub(super) const NEW: Self = Self(0.0);

    /// Lets time pass, in touch or not.
    pub(super) fn pass(&mut self, dt: f64, touches: bool) {
        self.0 = (self.0 + if touches { dt } else { -dt }).clamp(0.0, CREEPS + CEASES);
    }

    /// a.
    pub(super) fn share(self) -> f64 {
        ((CREEPS + CEASES - self.0) / CEASES).clamp(0.0, 1.0)
    }
}

/// When a tick is.
#[derive(Clone, Copy, Debug)]
pub(in crate::tick) struct Moment {
    /// s.
    pub(super) fade: f64,
    /// What s has fallen by since the tick before.
    pub(super) faded: f64,
    /// t/h, and 1/h while the drift goes on \[1/s\].
    pub(super) drifted: f64,
    pub(super) drifts: f64,
    pub(super) law: CreepLaw,
}

/// How places creep in a tick.
#[derive(Clone, Copy, Debug)]
pub(super) struct CreepLaw {
    /// a.
    share: f64,
    /// ϑ, ϑσ, 1 + β/h.
    kept: f64,
    at_once: f64,
    slow: f64,
    /// β' + T \[s\]; 0 without creep.
    lag: f64,
}

impl CreepLaw {
    /// Of tissue whose damping is `viscosity` (s) times its stiffness, for the share a, steps of h and a tick of T \[s\].
    pub(super) fn new(viscosity: f64, share: f64, step: f64, tick: f64) -> Self {
        let beta = viscosity * share;
        if !(beta > 0.0 && step > 0.0) {
            return Self { share: 0.0, kept: 0.0, at_once: 0.0, slow: 1.0, lag: 0.0 };
        }
        let slow = 1.0 + beta / step;
        let time = beta + RELAXES * slow;
        let kept = time / (time + tick);
        Self { share, kept, at_once: kept * RELAXES / time, slow, lag: time + tick }
    }

    /// Whether places need time.
    pub(super) fn is_slow(&self) -> bool {
        self.lag > 0.0
    }

    /// What the compliance of the patch is multiplied by in the tick.
    pub(super) fn yields(&self) -> f64 {
        (1.0 - self.kept + self.at_once) * self.slow
    }

    /// w towards a goal.
    fn follow(&self, creep: &Creep, goal: &Vector3<f64>) -> Vector3<f64> {
        creep.way * self.kept + goal * (1.0 - self.kept) + (goal - creep.goal) * self.at_once
    }
}

impl Moment {
    /// d of a place with what of e goes evenly.
    fn drift(&self, place: &Place) -> Vector3<f64> {
        place.drift + place.flow * (1.0 - self.law.share)
    }

    /// g of a place without forces and without what is handed over.
    fn goal(&self, place: &Place) -> Vector3<f64> {
        (place.free - place.end + place.flow * self.law.share) * self.law.slow
    }
}

/// State of a place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Creep {
    /// w at the end of the tick before \[m\].
    way: Vector3<f64>,
    /// o \[m\].
    pub(super) offset: Vector3<f64>,
    /// g at the end of the tick before \[m\].
    goal: Vector3<f64>,
    /// Velocity under the forces of then \[m/s\].
    rate: Vector3<f64>,
}

impl Creep {
    pub(super) const REST: Self = Self { way: ZERO, offset: ZERO, goal: ZERO, rate: ZERO };

    /// x in this tick without forces.
    pub(super) fn unforced(&self, place: &Place, now: &Moment) -> Vector3<f64> {
        if !now.law.is_slow() {
            return place.free + now.drift(place) * now.drifted + self.offset * now.fade;
        }
        let goal = now.goal(place) + self.offset * now.fade;
        place.end + now.drift(place) * now.drifted + now.law.follow(self, &goal)
    }

    /// Ends a tick whose forces move the place by `moved` = C f; x.
    pub(super) fn keep(&mut self, place: &Place, now: &Moment, moved: &Vector3<f64>) -> Vector3<f64> {
        self.rate = now.drift(place) * now.drifts;
        if !now.law.is_slow() {
            // Its way and goal are known from x when the next snapshot comes, and not looked at before.
            return self.unforced(place, now) + moved;
        }
        let goal = now.goal(place) + self.offset * now.fade + moved * now.law.slow;
        self.way = now.law.follow(self, &goal);
        self.goal = goal;
        self.rate += (self.goal - self.way) / now.law.lag;
        place.end + now.drift(place) * now.drifted + self.way
    }

    /// Begins on a new snapshot at `shape`, and where it creeps as fast as it has been, under the forces of the tick
    /// before: these move the place by `moved` = C f.
    pub(super) fn take_over(&mut self, place: &Place, now: &Moment, shape: &Vector3<f64>, moved: &Vector3<f64>) {
        self.way = shape - place.end;
        self.goal = self.way + (self.rate - now.drift(place) * now.drifts) * now.law.lag;
        self.offset = match now.law.is_slow() {
            true => self.goal - now.goal(place) - moved * now.law.slow,
            false => shape - moved - place.free,
        };
    }

    /// Begins where the forces of the tick before hold the place, with nothing to be handed over; x.
    pub(super) fn begin(&mut self, place: &Place, now: &Moment, moved: &Vector3<f64>) -> Vector3<f64> {
        let shape = place.free + moved;
        *self = Self { way: shape - place.end, goal: now.goal(place) + moved * now.law.slow, ..Self::REST };
        shape
    }

    /// Whether its numbers are finite.
    pub(super) fn is_finite(&self) -> bool {
        crate::wrench::all_finite(&(self.way + self.offset + self.goal + self.rate))
    }
}
