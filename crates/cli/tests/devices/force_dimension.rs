//! A scene on Force Dimension's DHD, on recorded traces, and the list of devices.

use palpate::trace::{TickFlags, Trace};
use serde_json::Value;

use super::{Place, SCENE, completed, folder, norm, run, scene};

const HARDWARE: &str = "kind = \"force_dimension\"\nlibrary = \"./libdhd.so\"";

fn place() -> Option<Place> {
    super::place("dhd", HARDWARE, &[])
}

#[test]
fn a_scene_on_hardware_feels_the_body_and_its_trace_replays_to_the_bit_and_as_a_device() {
    let Some(place) = place() else { return };
    let output = run(&folder(&place), "run scene.toml --json --threads 1", &[]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&summary["end"], &summary["mode"]), (&"completed".into(), &"real time".into()));
    let trace = Trace::load(place.path("small.mcap")).unwrap();
    let last = trace.ticks.last().unwrap();
    // In the world the device's origin lies at 44 mm, and the ball touches at 40.
    assert!(last.device_position[2] < 0.040 && last.device_position[2] > 0.033, "{:?}", last.device_position);
    assert!(last.force[2] > 0.05 && norm(last.force) < 12.0, "{:?}", last.force);
    // The stand-in is turned by a right angle about z.
    let turned = last.device_orientation.map(f64::abs);
    let half = std::f64::consts::FRAC_1_SQRT_2;
    assert!(norm([turned[0], turned[1], turned[2] - half]) < 1e-9, "{turned:?}");

    let output = run(&folder(&place), "replay small.mcap", &[]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));

    std::fs::write(place.path("again.toml"), scene("kind = \"replay\"\ntrace = \"small.mcap\"").replace("origin", "#"))
        .unwrap();
    let output = run(&folder(&place), "run again.toml --lockstep --trace again.mcap --threads 1", &[]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let again = Trace::load(place.path("again.mcap")).unwrap();
    let end = again.ticks.last().unwrap();
    let gap: [f64; 3] = std::array::from_fn(|i| end.device_position[i] - last.device_position[i]);
    // The ends of both runs lie less than a late tick apart, in which the hand is nearly at rest.
    assert!(norm(gap) < 1e-3 && end.force[2] > 0.05, "{gap:?} {:?}", end.force);
}

/// What is lost is told, and the device is not there meanwhile.
#[test]
fn a_damaged_trace_is_a_device_with_a_gap() {
    let place = Place::with(&SCENE.replace("time = 1.0", "time = 4.0"));
    let output = run(&folder(&place), "run scene.toml --seconds 4 --lockstep --quiet", &[]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut bytes = place.read("small.mcap");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x10;
    std::fs::write(place.path("torn.mcap"), &bytes).unwrap();
    let (left, damage) = Trace::recover(place.path("torn.mcap")).unwrap();
    assert!(damage.is_some() && left.ticks.len() < 4000, "{} ticks left", left.ticks.len());
    let scene = place.text("scene.toml") + "\n[device]\nkind = \"replay\"\ntrace = \"torn.mcap\"\n";
    std::fs::write(place.path("again.toml"), scene).unwrap();
    let output = run(&folder(&place), "run again.toml --seconds 4 --lockstep --trace again.mcap --json", &[]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
    let notes = summary["notes"].to_string();
    assert!(["torn.mcap", "damaged", "does not answer"].iter().all(|words| notes.contains(words)), "{notes}");
    let again = Trace::load(place.path("again.mcap")).unwrap();
    let lost = |tick: u64| left.ticks.iter().all(|left| left.tick != tick);
    for tick in &again.ticks {
        assert_eq!(tick.flags.contains(TickFlags::DEVICE_MISSING), lost(tick.tick), "tick {}", tick.tick);
    }
}

#[test]
fn hardware_that_is_unplugged_in_mid_run_gets_no_force_and_the_run_ends_in_order() {
    let Some(place) = place() else { return };
    let output = run(&folder(&place), "run scene.toml --json --threads 1", &[("STAND_IN_UNPLUG", "200")]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(summary["end"], "completed");
    assert!(summary["notes"].to_string().contains("the device is not connected"), "{}", summary["notes"]);
    let trace = Trace::load(place.path("small.mcap")).unwrap();
    let first = trace.ticks.iter().position(|tick| tick.flags.contains(TickFlags::DEVICE_MISSING)).unwrap();
    // One of the 200 poses told where the tool is before the first step.
    assert_eq!(first, 199);
    assert!(trace.ticks[first..].iter().all(|tick| tick.force == [0.0; 3] && tick.torque == [0.0; 3]));
}

/// A limit of the device's own is in the trace, and the run replays all the same.
#[test]
fn a_motor_that_is_saturated_is_told_in_the_trace() {
    let Some(place) = place() else { return };
    let (_, trace) = completed(&place, &[("STAND_IN_SATURATED", "0.02")]);
    let mut limited = 0;
    for tick in &trace.ticks {
        // The device's axes are the world's.
        let saturates = tick.force.iter().any(|f| f.abs() > 0.02);
        assert_eq!(tick.flags.contains(TickFlags::FORCE_LIMITED), saturates, "tick {}: {:?}", tick.tick, tick.force);
        limited += usize::from(saturates);
    }
    assert!(limited > 0 && limited < trace.ticks.len(), "{limited}");
}

#[test]
fn hardware_that_is_not_there_is_a_mistake_with_its_remedy() {
    let place = Place::with(&scene("kind = \"force_dimension\"\nlibrary = \"./nowhere.so\""));
    let output = run(&folder(&place), "run scene.toml --no-trace", &[]);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && message.contains("nowhere.so"), "{message}");
    assert!(message.contains("device.library"), "{message}");
    let output = run(&folder(&place), "run scene.toml --no-trace --lockstep", &[]);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && message.contains("no virtual time"), "{message}");
    for (device, word) in [
        ("kind = \"haply\"\nlibrary = \"./libdhd.so\"", "no effect"),
        ("kind = \"force-dimension\"", "did you mean `force_dimension`?"),
        ("kind = \"haply\"\naxes = [\"y\", \"x\", \"z\"]", "cross product"),
        ("kind = \"virtual\"", "no effect"),
        ("kind = \"haply\"\npreset = \"touch\"\nrecord = { name = \"x\" }", "record"),
    ] {
        std::fs::write(place.path("scene.toml"), scene(device)).unwrap();
        let output = run(&folder(&place), "check scene.toml", &[]);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && message.contains(word), "{device}: {message}");
    }
    std::fs::write(place.path("scene.toml"), scene("kind = \"port\"")).unwrap();
    let output = run(&folder(&place), "run scene.toml --no-trace", &[]);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && message.contains("ticks through the library"), "{message}");
}

#[test]
fn devices_are_listed_with_why_not_for_those_that_are_not_found() {
    let Some(place) = place() else { return };
    let output = run(&folder(&place), "devices --dhd ./libdhd.so --hd ./nowhere.so --haply ws://127.0.0.1:1", &[]);
    assert!(output.status.success());
    let text = String::from_utf8(output.stdout).unwrap();
    let line =
        |name: &str| text.lines().find(|line| line.starts_with(name)).unwrap_or_else(|| panic!("{name}: {text}"));
    assert!(line("virtual").contains("built in") && line("scripted").contains("built in"));
    assert!(line("port").contains("C library") && line("replay").contains("trace"));
    assert!(line("force_dimension").contains(" found ") && line("force_dimension").contains("1 connected"));
    assert!(line("openhaptics").contains("not found") && line("openhaptics").contains("there is no file ./nowhere.so"));
    assert!(line("haply").contains("not found") && line("haply").contains("refused"));
    // A name without a folder is that of the file in this one.
    let output = run(&folder(&place), "devices --dhd libdhd.so --hd nowhere.so --haply ws://127.0.0.1:1", &[]);
    let text = String::from_utf8(output.stdout).unwrap();
    let found = text.lines().find(|line| line.starts_with("force_dimension"));
    assert!(found.is_some_and(|line| line.contains(" found ") && line.contains("1 connected")), "{text}");
}
