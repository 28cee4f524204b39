//! A scene on Haply's service, from its inventory to the last command.

use std::io::{Read, Write};
use std::net::TcpListener;
use std::time::{Duration, Instant};

use super::service::{Manner, Service, inventory};
use super::{Place, assert_felt, assert_lost_in_contact, completed, refused, scene};
use serde_json::json;

/// A folder with the scene on the service at this address.
fn place_at(url: &str) -> Place {
    Place::with(&scene(&format!("kind = \"haply\"\nurl = \"{url}\"")))
}

/// A service whose hand is 10 mm below the arm's origin.
fn service() -> Service {
    let service = Service::start(inventory());
    service.desk.arm.lock().unwrap().hand = [0.0, 0.0, -0.01];
    service
}

/// The service reads what is on the way at its own pace.
fn assert_left_without_force(service: &Service) {
    let begin = Instant::now();
    while service.force() != [0.0; 3] {
        assert!(begin.elapsed() < Duration::from_secs(10), "the last word takes the force off: {:?}", service.force());
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_scene_feels_the_body_and_leaves_the_arm_without_force() {
    let service = service();
    let (_, trace) = completed(&place_at(service.url()), &[]);
    // That of the record which stands for an Inverse3.
    let record = palpate::haptics::device::DeviceSpec::preset("haply-pantograph").unwrap();
    assert_felt(&trace, record.max_force);
    assert!(service.commands_with_force() > 0);
    assert_left_without_force(&service);
}

#[test]
fn an_arm_that_is_lost_in_mid_run_gets_no_force_and_the_run_ends_in_order() {
    for (manner, said) in [
        (Manner::Unplugged, "is not connected"),
        (Manner::Gibberish, "cannot be understood"),
        (Manner::NoPosition, "cannot be understood"),
        (Manner::Binary, "cannot be understood"),
        (Manner::Ping, "did not answer in time"),
        (Manner::Trickle, "did not answer in time"),
    ] {
        let service = service();
        service.becomes(50, manner);
        let (notes, trace) = completed(&place_at(service.url()), &[]);
        assert!(notes.contains("no force in") && notes.contains(said), "{said}: {notes}");
        assert_lost_in_contact(&trace);
        assert_left_without_force(&service);
    }
}

/// What such a service was told last is its own affair: it reads nothing more.
#[test]
fn a_service_that_hangs_or_hangs_up_in_mid_run_is_a_device_that_is_gone() {
    for (manner, said) in [(Manner::Hang, "did not answer in time"), (Manner::HangUp, "is not connected")] {
        let service = service();
        service.becomes(50, manner);
        let (notes, trace) = completed(&place_at(service.url()), &[]);
        assert!(notes.contains("no force in") && notes.contains(said), "{said}: {notes}");
        assert_lost_in_contact(&trace);
    }
}

#[test]
fn no_service_another_one_and_no_arm_are_mistakes_with_their_remedies() {
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let told = refused(&place_at(&format!("ws://{free}")), &[]);
    assert!(told.contains("refused") && told.contains("is the service running"), "{told}");

    let mute = TcpListener::bind("127.0.0.1:0").unwrap();
    let told = refused(&place_at(&format!("ws://{}", mute.local_addr().unwrap())), &[]);
    assert!(told.contains("does not answer in time"), "{told}");

    let web = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("ws://{}", web.local_addr().unwrap());
    let page = std::thread::spawn(move || {
        let (mut stream, _) = web.accept().unwrap();
        let _ = stream.read(&mut [0; 4096]);
        let _ = stream.write_all(b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\nhi");
    });
    let told = refused(&place_at(&url), &[]);
    page.join().unwrap();
    assert!(told.contains("it is no WebSocket service"), "{told}");

    for (inventory, said) in [
        (json!("nonsense"), "its inventory cannot be understood"),
        (json!({ "session_id": 1, "inverse3": [] }), "no Inverse3"),
    ] {
        let service = Service::start(inventory);
        let told = refused(&place_at(service.url()), &[]);
        assert!(told.contains(said), "{told}");
    }
}
