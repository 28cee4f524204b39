//! What a grasper's jaws and its shaft feel, against the same jaws moved on the scene stepped offline at 1 kHz.
//!
//! The jaws have a spring of their own, so that two methods open and close them differently: each has its own reference, which
//! has at every millisecond the tool and the opening that its tick had. A force that is held for a step is left out, for its
//! jaws leap from step to step.

use miette::{Result, miette};
use palpate::collision::ToolPose;
use palpate::constraints::compliance::ComplianceMethod;
use palpate::haptics::device::ScriptedDevice;
use palpate::prelude::*;
use palpate::step::StepStatus;

use super::accuracy::{OFFLINE, exact_coupling, path};
use super::cases::in_parallel;
use super::palpation::{Method, Palpation};
use super::scenes::{Case, Use};
use crate::chart::plot::{Axis, Mark, Panel, Series};
use crate::chart::table::{Table, Value};
use crate::chart::{NamedTable, Settings, Work};

/// The case.
const CASE: Case = Case { scene: "grasp", purpose: Use::Palpation, quick: false };

/// Length of the path until the block has been carried in the air for 0.3 s (s).
const LENGTH: f64 = 1.9;

/// Closing, lifting and held in the air (s): from the first touch of the pads, within the lift, and after it has settled.
const PHASES: [[f64; 2]; 3] = [[0.8, 1.0], [1.0, 1.6], [1.7, 1.9]];

/// Rate of the tissue (Hz) that is drawn.
const DRAWN: f64 = 30.0;

/// What a grasp feels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Felt {
    /// Torque of contact on the opening (N m): the squeeze of the jaws.
    squeeze: f64,
    /// Force of contact on the tool, downwards (N).
    weight: f64,
}

/// At each millisecond: of the ticks, and of the steps offline.
type Course = Vec<[Felt; 2]>;

/// Measures all; the table, and a panel of the squeeze over time.
pub(crate) fn measure(settings: &Settings, work: &Work) -> Result<(NamedTable, Vec<Panel>)> {
    let rates: &[f64] = if settings.quick { &[] } else { &[10.0, 30.0, 100.0] };
    let methods = [Method::Local, Method::LocalAtOnce, Method::Frozen];
    let trials: Vec<_> = rates.iter().flat_map(|&rate| methods.map(|method| (method, rate))).collect();
    work.expect(trials.len());
    let name = |&(method, rate): &(Method, f64)| format!("grasp, {}, {rate} Hz", method.name());
    let courses = in_parallel(&trials, work, name, |&(method, rate)| course(method, rate, work))?;

    let mut table = Table::new(&[
        "tissue [Hz]",
        "method",
        "squeeze, rms error [%]",
        "closing [mN m]",
        "closing, offline [mN m]",
        "lifting [mN m]",
        "lifting, offline [mN m]",
        "held [mN m]",
        "held, offline [mN m]",
        "weight held [mN]",
        "weight, offline [mN]",
    ]);
    let mut panels = Vec::new();
    for (&(method, rate), course) in trials.iter().zip(&courses) {
        let Some(course) = course else { continue };
        let mut row = vec![Value::Number(rate, 0), method.name().into(), Value::Number(100.0 * rms(course), 1)];
        let phases = PHASES.map(|phase| mean(course, phase));
        row.extend(phases.iter().flatten().map(|felt| Value::Number(1e3 * felt.squeeze, 1)));
        row.extend(phases[2].iter().map(|felt| Value::Number(1e3 * felt.weight, 1)));
        table.push(row);
        if rate == DRAWN {
            draw(method, course, &mut panels);
        }
    }
    let title =
        "Squeeze and weight of the grasp, means, against the same jaws offline at 1 kHz with exact compliance".into();
    Ok((NamedTable { file: "haptics_grasp", title, table }, panels))
}

/// The grasp as the jaws feel it, and offline.
fn course(method: Method, rate: f64, work: &Work) -> Result<Course> {
    let world = CASE.world(method, rate, |_| {})?;
    let (script, _) = path(&CASE, &world)?;
    let mut palpation = Palpation::new(&world, Box::new(ScriptedDevice::new(script)), |config| {
        method.configure(rate, config);
        config.coupling = exact_coupling();
    })?;
    let exact = |scene: &mut SceneDescription| scene.bodies[0].compliance = ComplianceMethod::Exact;
    let offline = CASE.world(Method::Frozen, OFFLINE, exact)?;
    let mut simulation = Simulation::new(&offline).map_err(|e| miette!("{e}"))?;
    let milliseconds = (LENGTH * OFFLINE) as usize;
    let mut course = Course::with_capacity(milliseconds);
    for k in (0..milliseconds).take_while(|_| !work.stopped()) {
        let (record, _) = palpation.tick();
        let tool = ToolPose { frame: record.tool_pose, opening: record.gripper.opening };
        let report = simulation.step(&tool);
        if palpation.has_failed() || report.status != StepStatus::Advanced {
            return Err(miette!("grasp: the tissue fails at {k} ms, {}, {rate} Hz", method.name()));
        }
        let snapshot = simulation.snapshot();
        let squeeze = snapshot.gripper_rows().iter().zip(snapshot.lambda()).map(|(row, lambda)| row * lambda).sum();
        course.push([
            Felt { squeeze: record.gripper.contact_torque, weight: -record.contact_wrench.force.z },
            Felt { squeeze, weight: -report.force.z },
        ]);
    }
    Ok(course)
}

/// Means over a phase (s).
fn mean(course: &[[Felt; 2]], [from, to]: [f64; 2]) -> [Felt; 2] {
    let index = |time: f64| ((time * OFFLINE).round() as usize).min(course.len());
    let within = &course[index(from)..index(to)];
    let n = within.len().max(1) as f64;
    [0, 1].map(|of| Felt {
        squeeze: within.iter().map(|felt| felt[of].squeeze).sum::<f64>() / n,
        weight: within.iter().map(|felt| felt[of].weight).sum::<f64>() / n,
    })
}

/// Root mean square of the squeeze's error, of that of the reference.
fn rms(course: &[[Felt; 2]]) -> f64 {
    let square = |of: &dyn Fn(&[Felt; 2]) -> f64| course.iter().map(|felt| of(felt).powi(2)).sum::<f64>();
    f64::sqrt(square(&|[felt, offline]| felt.squeeze - offline.squeeze) / square(&|[_, offline]| offline.squeeze))
}

/// Adds a method to the panel; the reference of the local patch stands for all.
fn draw(method: Method, course: &[[Felt; 2]], panels: &mut Vec<Panel>) {
    let points = |of: usize| -> Vec<(f64, f64)> {
        let squeezes = course.iter().enumerate().map(|(k, felt)| (k as f64 / OFFLINE, 1e3 * felt[of].squeeze));
        squeezes.filter(|&(time, _)| time >= PHASES[0][0] - 0.1).collect()
    };
    let series = |name: &str, mark, of| Series { name: name.into(), mark, points: points(of) };
    match panels.last_mut() {
        Some(panel) if method == Method::Frozen => panel.series.push(series(method.name(), Mark::Line, 0)),
        None if method == Method::Local => panels.push(Panel {
            title: format!("Squeeze of the grasper's jaws, tissue at {DRAWN} Hz"),
            x: Axis::linear("time [s]"),
            y: Axis::linear("torque of contact on the opening [mN m]"),
            series: vec![series("offline at 1 kHz", Mark::Dashed, 1), series(method.name(), Mark::Line, 0)],
        }),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_and_the_error_are_those_of_a_squeeze_that_is_known() {
        // Closing from 0.8 s on with 1 mN m a millisecond; the tick lacks a tenth of it.
        let squeeze = |k: u32| 1e-3 * f64::from(k.saturating_sub(800));
        let course: Course =
            (0..1900).map(|k| [0.9, 1.0].map(|share| Felt { squeeze: share * squeeze(k), weight: share })).collect();
        assert!((rms(&course) - 0.1).abs() < 1e-12);
        let [felt, offline] = mean(&course, PHASES[0]);
        assert!((offline.squeeze - 1e-3 * 99.5).abs() < 1e-12 && (felt.squeeze / offline.squeeze - 0.9).abs() < 1e-12);
        assert!((felt.weight - 0.9).abs() < 1e-12 && mean(&course, [5.0, 6.0]) == [Felt::default(); 2]);
    }
}
