//! A scene on OpenHaptics' HDAPI, whose device has a servo thread of its own.

use super::{Place, assert_felt, assert_lost_in_contact, completed, folder, place, refused, run};

const HARDWARE: &str = "kind = \"openhaptics\"\nlibrary = \"./libhd.so\"";
const LAST_WORD: (&str, &str) = ("STAND_IN_LAST_WORD", "last_word.txt");

/// What the library was told last: whether forces are enabled, the force along each axis and the largest of all (N).
fn last_word(place: &Place) -> [f64; 5] {
    let words: Vec<f64> = place.text(LAST_WORD.1).split_whitespace().map(|word| word.parse().unwrap()).collect();
    words.try_into().unwrap()
}

fn assert_left_without_force(place: &Place) {
    let [enabled, x, y, z, largest] = last_word(place);
    assert_eq!((enabled, [x, y, z]), (0.0, [0.0; 3]), "the motors are left without force");
    assert!(largest > 0.0 && largest <= 3.3, "{largest} N");
}

#[test]
fn a_scene_feels_the_body_and_leaves_the_motors_without_force() {
    let Some(place) = place("hd", HARDWARE, &[]) else { return };
    let (_, trace) = completed(&place, &[LAST_WORD]);
    // What the device states of itself.
    assert_felt(&trace, 3.3);
    assert_left_without_force(&place);
}

#[test]
fn a_device_that_is_lost_in_mid_run_gets_no_force_and_the_run_ends_in_order() {
    for (fault, said) in [("STAND_IN_UNPLUG", "is not connected"), ("STAND_IN_STALL", "did not answer in time")] {
        let Some(place) = place("hd", HARDWARE, &[]) else { return };
        let (notes, trace) = completed(&place, &[LAST_WORD, (fault, "100")]);
        assert!(notes.contains("no force in") && notes.contains(said), "{fault}: {notes}");
        assert_lost_in_contact(&trace);
        let [enabled, x, y, z, largest] = last_word(&place);
        assert!(enabled == 0.0 && largest > 0.0, "{fault}");
        // A servo thread that has stopped tells the motors nothing more.
        assert!(fault == "STAND_IN_STALL" || [x, y, z] == [0.0; 3], "{fault}: {x} {y} {z} N");
    }
}

#[test]
fn poses_that_are_no_numbers_end_the_force() {
    let Some(place) = place("hd", HARDWARE, &[]) else { return };
    let (_, trace) = completed(&place, &[LAST_WORD, ("STAND_IN_NAN", "100")]);
    let bad = |tick: &&palpate::trace::TickRecord| tick.flags.contains(palpate::trace::TickFlags::BAD_POSE);
    assert!(trace.ticks.iter().any(|tick| tick.force[2] > 0.0) && trace.ticks.last().is_some_and(|tick| bad(&tick)));
    assert!(trace.ticks.iter().filter(bad).all(|tick| tick.force == [0.0; 3] && tick.torque == [0.0; 3]));
    assert_left_without_force(&place);
}

#[test]
fn hardware_that_is_not_there_is_a_mistake_with_its_remedy() {
    let Some(sound) = place("hd", HARDWARE, &[]) else { return };
    let told = refused(&sound, &[("STAND_IN_ABSENT", "1")]);
    assert!(told.contains("device fault") && told.contains("cable"), "{told}");
    let told = refused(&sound, &[("STAND_IN_STALL", "0")]);
    assert!(told.contains("its servo thread does not call"), "{told}");

    let old = place("hd", HARDWARE, &["-DWITHOUT_UNSCHEDULE"]).unwrap();
    let told = refused(&old, &[]);
    assert!(told.contains("hdUnschedule") && told.contains("not a library of OpenHaptics"), "{told}");

    let wrong = place("dhd", "kind = \"openhaptics\"\nlibrary = \"./libdhd.so\"", &[]).unwrap();
    let told = refused(&wrong, &[]);
    assert!(told.contains("hdInitDevice") && told.contains("libdhd.so"), "{told}");

    wrong.write("libdhd.so", "no library");
    let told = refused(&wrong, &[]);
    assert!(told.contains("cannot be loaded") && told.contains("libdhd.so"), "{told}");
    let nowhere = Place::with(&super::scene("kind = \"openhaptics\"\nlibrary = \"./nowhere.so\""));
    let told = refused(&nowhere, &[]);
    assert!(told.contains("there is no file ./nowhere.so") && told.contains("device.library"), "{told}");

    let output = run(&folder(&sound), "run scene.toml --no-trace --lockstep", &[]);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && message.contains("no virtual time"), "{message}");
}
