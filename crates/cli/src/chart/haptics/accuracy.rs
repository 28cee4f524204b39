//! Error of the force against the same scene computed offline at 1 kHz, along its path.
//!
//! A device that follows the path exactly moves the tool by a coupling of 1 MN/m, so that all methods and the reference have
//! the same tool to a few micrometres. The force is that of contact, before the limits. Means over 5 ms stand beside single
//! ticks, for a lumped node that is hit at 1 kHz spreads its impulse over a millisecond, which is an artefact of the mesh.

use miette::{Result, miette};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use palpate::constraints::compliance::ComplianceMethod;
use palpate::haptics::coupling::{CouplingConfig, Spring};
use palpate::haptics::device::ScriptedDevice;
use palpate::haptics::script::HandScript;
use palpate::prelude::*;
use palpate::step::StepStatus;

use super::cases::in_parallel;
use super::palpation::{Method, Palpation};
use super::scenes::{Case, Use};
use crate::chart::plot::{Axis, Mark, Panel, Series};
use crate::chart::table::{Table, Value};
use crate::chart::{NamedTable, Settings, Work};

/// Stiffness that makes the tool follow the device (N/m).
const STIFF: f64 = 1e6;

/// Rate of the reference (Hz).
pub(super) const OFFLINE: f64 = 1000.0;

/// Ticks of a mean.
const WINDOW: usize = 5;

/// Ticks of the first touch.
const TOUCH: usize = 100;

/// What came out along a path: a force (N) for each millisecond.
type Forces = Vec<Vector3<f64>>;

/// A case with its reference, a method and a rate of the tissue (Hz).
type Trial<'r> = (Case, &'r Forces, Method, f64);

/// What it is off by, and its forces.
type Outcome<'r> = (Trial<'r>, (Errors, Forces));

/// Rate of the tissue (Hz) whose first touch is drawn.
const DRAWN: f64 = 30.0;

/// What a method is off by.
#[derive(Clone, Copy, Debug)]
struct Errors {
    /// Root mean square over the contact, of that of the reference.
    rms: f64,
    /// Largest of means over 5 ms, of the reference's largest.
    largest: f64,
    /// The same within 100 ms of the first touch, of the reference's largest there.
    touch: f64,
    /// Largest change of the force at a step (N).
    jump: f64,
    /// Largest force of the reference (N).
    force: f64,
}

/// Measures all; the table, and panels of the error over the rate.
pub(crate) fn measure(settings: &Settings, work: &Work) -> Result<(NamedTable, Vec<Panel>)> {
    let quick = settings.quick;
    let case = |scene, purpose| Case { scene, purpose, quick };
    let mut cases =
        vec![case("block", Use::NormalTouch), case("block", Use::ObliqueTouch), case("block", Use::Palpation)];
    if !quick {
        cases.extend([case("cut", Use::Palpation), case("liver", Use::Palpation)]);
        cases.extend([case("liver", Use::Touch), case("liver", Use::FineTouch)]);
    }
    let rates: &[f64] = if quick { &[10.0, 30.0] } else { &[10.0, 30.0, 100.0] };
    let methods = [Method::Local, Method::LocalAtOnce, Method::Frozen, Method::Held];
    work.expect(cases.len());
    let offline = in_parallel(&cases, work, |case| format!("offline, {}", case.name()), |case| reference(case, work))?;
    let mut trials = Vec::new();
    for (case, offline) in cases.iter().zip(&offline) {
        let Some(offline) = offline else { continue };
        for &rate in rates {
            trials.extend(methods.map(|method| (*case, offline, method, rate)));
        }
    }
    work.expect(trials.len());
    let name = |trial: &Trial<'_>| format!("force, {}, {}", trial.0.name(), trial.2.name());
    let errors =
        in_parallel(&trials, work, name, |&(case, offline, method, rate)| errors(&case, offline, method, rate, work))?;

    let title = "Force against the same scene computed offline at 1 kHz with exact compliance, on the same path".into();
    let outcomes: Vec<Outcome<'_>> =
        trials.into_iter().zip(errors).filter_map(|(trial, errors)| Some((trial, errors?))).collect();
    Ok((NamedTable { file: "haptics_force", title, table: table(&outcomes) }, panels(&outcomes)))
}

fn table(outcomes: &[Outcome<'_>]) -> Table {
    let mut table = Table::new(&[
        "scene",
        "tissue [Hz]",
        "method",
        "rms error [%]",
        "largest error of 5 ms [%]",
        "first 100 ms [%]",
        "jump at a step [mN]",
        "largest force [N]",
    ]);
    for ((case, _, method, rate), (errors, _)) in outcomes {
        table.push(vec![
            case.name().into(),
            Value::Number(*rate, 0),
            method.name().into(),
            Value::Number(100.0 * errors.rms, 2),
            Value::Number(100.0 * errors.largest, 2),
            Value::Number(100.0 * errors.touch, 2),
            Value::Number(1e3 * errors.jump, 1),
            Value::Number(errors.force, 3),
        ]);
    }
    table
}

/// The first touches over time, then the errors over the rate of the tissue.
fn panels(outcomes: &[Outcome<'_>]) -> Vec<Panel> {
    let (mut touches, mut panels): (Vec<Panel>, Vec<Panel>) = (Vec::new(), Vec::new());
    for ((case, offline, method, rate), (errors, felt)) in outcomes {
        let touch = case.purpose.is_touch();
        if touch && *rate == DRAWN && *method != Method::LocalAtOnce {
            draw(case, offline, *method, felt, &mut touches);
        }
        let (what, error) = if touch { ("first 100 ms", errors.touch) } else { ("rms", errors.rms) };
        let title = format!("Error of the force, {what}: {}", case.name());
        let (x, y) = (Axis::linear("rate of the tissue [Hz]"), Axis::log("error of the force [%]"));
        let found = panels.iter().position(|panel| panel.title == title).unwrap_or(panels.len());
        if found == panels.len() {
            panels.push(Panel { title, x, y, series: Vec::new() });
        }
        let point = (*rate, 100.0 * error);
        let series = &mut panels[found].series;
        match series.iter_mut().find(|s| s.name == method.name()) {
            Some(series) => series.points.push(point),
            None => series.push(Series { name: method.name().into(), mark: Mark::Joined, points: vec![point] }),
        }
    }
    touches.extend(panels);
    touches
}

/// The path of a case's world, and its length in milliseconds.
pub(super) fn path(case: &Case, world: &World) -> Result<(HandScript, usize)> {
    let script = HandScript::new(world.description().hand.path.clone()).map_err(|e| miette!("{e}"))?;
    let milliseconds = (case.duration(script.duration()) * OFFLINE) as usize;
    Ok((script, milliseconds))
}

/// The coupling by which the tool follows the device.
pub(super) fn exact_coupling() -> CouplingConfig {
    CouplingConfig { translation: Spring { stiffness: STIFF, damping: 0.0 }, rotation: None }
}

/// Forces of the scene stepped offline at 1 kHz.
fn reference(case: &Case, work: &Work) -> Result<Forces> {
    let exact = |scene: &mut SceneDescription| scene.bodies[0].compliance = ComplianceMethod::Exact;
    let world = case.world(Method::Frozen, OFFLINE, exact)?;
    let (script, milliseconds) = path(case, &world)?;
    let mut simulation = Simulation::new(&world).map_err(|e| miette!("{e}"))?;
    let mut forces = Vec::with_capacity(milliseconds);
    for k in (0..milliseconds).take_while(|_| !work.stopped()) {
        let place = Translation3::from(script.intent(k as f64 / OFFLINE).position);
        let report = simulation.step(&Isometry3::from_parts(place, UnitQuaternion::identity()));
        if report.status != StepStatus::Advanced {
            return Err(miette!("{}: the tissue fails at {k} ms offline", case.name()));
        }
        forces.push(report.force);
    }
    Ok(forces)
}

/// Forces of the scene as the hand would feel them, and the milliseconds at which a step came.
fn felt(case: &Case, method: Method, rate: f64, work: &Work) -> Result<(Forces, Vec<usize>)> {
    let world = case.world(method, rate, |_| {})?;
    let (script, milliseconds) = path(case, &world)?;
    let mut palpation = Palpation::new(&world, Box::new(ScriptedDevice::new(script)), |config| {
        method.configure(rate, config);
        config.coupling = exact_coupling();
    })?;
    let held = method.period(rate) * OFFLINE;
    let (mut forces, mut steps): (Forces, _) = (Vec::with_capacity(milliseconds), Vec::new());
    let mut ticks = 0_u64;
    let mut force = Vector3::zeros();
    for k in (0..milliseconds).take_while(|_| !work.stopped()) {
        // The tick that is due in this millisecond; the others find the force of the last one.
        if k as f64 >= ticks as f64 * held - 1e-6 {
            let (record, stepped) = palpation.tick();
            ticks += 1;
            force = record.contact_wrench.force;
            if stepped {
                steps.push(k);
            }
        }
        if palpation.has_failed() {
            return Err(miette!("{}: the tissue fails at {k} ms, {}, {rate} Hz", case.name(), method.name()));
        }
        forces.push(force);
    }
    Ok((forces, steps))
}

/// What a method is off by, and its forces.
fn errors(case: &Case, offline: &Forces, method: Method, rate: f64, work: &Work) -> Result<(Errors, Forces)> {
    let (felt, steps) = felt(case, method, rate, work)?;
    Ok((compare(&felt, offline, &steps), felt))
}

/// The millisecond of the first force.
fn first_touch(forces: &[Vector3<f64>]) -> usize {
    forces.iter().position(|force| force.norm() > 0.0).unwrap_or(0)
}

/// Adds the force of a method in the first 100 ms to the panel of its touch, which begins with the reference.
fn draw(case: &Case, offline: &[Vector3<f64>], method: Method, felt: &[Vector3<f64>], panels: &mut Vec<Panel>) {
    let title = format!("Force of the first touch, tissue at {DRAWN} Hz: {}", case.name());
    let first = first_touch(offline);
    let points = |forces: &[Vector3<f64>]| -> Vec<(f64, f64)> {
        let touch = forces.iter().enumerate().skip(first.saturating_sub(TOUCH / 10)).take(TOUCH + TOUCH / 10);
        touch.map(|(k, force)| (k as f64 - first as f64, force.norm())).collect()
    };
    let series = Series { name: method.name().into(), mark: Mark::Line, points: points(felt) };
    if let Some(panel) = panels.iter_mut().find(|panel| panel.title == title) {
        panel.series.push(series);
        return;
    }
    let reference = Series { name: "offline at 1 kHz".into(), mark: Mark::Dashed, points: points(offline) };
    let (x, y) = (Axis::linear("time since the touch [ms]"), Axis::linear("force [N]"));
    panels.push(Panel { title, x, y, series: vec![reference, series] });
}

/// Means over [`WINDOW`] ticks, the last of which is that of the index.
fn means(forces: &[Vector3<f64>]) -> Forces {
    let mean = |k: usize| {
        let window = &forces[(k + 1).saturating_sub(WINDOW)..=k];
        window.iter().sum::<Vector3<f64>>() / window.len() as f64
    };
    (0..forces.len()).map(mean).collect()
}

fn compare(felt: &[Vector3<f64>], offline: &[Vector3<f64>], steps: &[usize]) -> Errors {
    let (mut off, mut all) = (0.0, 0.0);
    for (a, b) in felt.iter().zip(offline) {
        off += (a - b).norm_squared();
        all += b.norm_squared();
    }
    let (felt_means, offline_means) = (means(felt), means(offline));
    let largest = |range: std::ops::Range<usize>| {
        let pairs = felt_means.iter().zip(&offline_means).skip(range.start).take(range.len());
        pairs.fold((0.0_f64, 0.0_f64), |(error, force), (a, b)| (error.max((a - b).norm()), force.max(b.norm())))
    };
    let (error, force) = largest(0..offline.len());
    let first = first_touch(offline);
    let (touch_error, touch_force) = largest(first..(first + TOUCH).min(offline.len()));
    let change = |&k: &usize| Some((felt.get(k)? - felt.get(k.checked_sub(1)?)?).norm());
    Errors {
        rms: f64::sqrt(off / all),
        largest: error / force,
        touch: touch_error / touch_force,
        jump: steps.iter().filter_map(change).fold(0.0, f64::max),
        force,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_those_of_a_force_that_is_late_by_a_known_time() {
        // A ramp of 1 N/s from 10 ms on, and the same held for 20 ms from its begin on.
        let ramp = |k: usize| Vector3::z() * ((k as f64 - 10.0).max(0.0) * 1e-3);
        let offline: Forces = (0..210).map(ramp).collect();
        let felt: Forces = (0..210).map(|k| ramp(k / 20 * 20)).collect();
        let steps: Vec<usize> = (0..210).step_by(20).collect();
        let errors = compare(&felt, &offline, &steps);
        // 0 to 19 mN late, uniformly, of a ramp to 199 mN whose square has a mean of a third.
        let rms = f64::sqrt((0..20).map(|k| f64::from(k * k)).sum::<f64>() / 20.0) / (199.0 / f64::sqrt(3.0));
        assert!((errors.rms / rms - 1.0).abs() < 0.05, "{} {rms}", errors.rms);
        // Means of 5 ticks: 15 to 19 mN late at most, and 197 mN at the end; 97 mN after 100 ms of force.
        assert!((errors.largest - 17.0 / 197.0).abs() < 1e-9, "{errors:?}");
        assert!((errors.touch - 17.0 / 98.0).abs() < 1e-9, "{errors:?}");
        assert!((errors.jump - 0.020).abs() < 1e-12 && (errors.force - 0.197).abs() < 1e-12, "{errors:?}");
    }
}
