//! Does the driver speak the service's protocol, and survive everything that a service may do?

mod service;

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use nalgebra::Vector3;
use palpate_devices::{DriverConfig, DriverError, driver};
use palpate_haptics::device::{DeviceError, DeviceSample, HapticDevice, TickTime};
use palpate_haptics::wrench::Wrench;
use serde_json::json;
use service::{Manner, Service, inventory};
use tungstenite::Message;

fn open(config: &DriverConfig) -> Result<Box<dyn HapticDevice>, DriverError> {
    (driver("haply").unwrap().open)(config)
}

fn config(service: &Service) -> DriverConfig {
    DriverConfig { url: Some(service.url().into()), ..DriverConfig::default() }
}

fn opened(service: &Service) -> Box<dyn HapticDevice> {
    open(&config(service)).unwrap_or_else(|e| panic!("{e}"))
}

/// Reads once a millisecond until `done`, for ten seconds at most.
fn until(
    device: &mut dyn HapticDevice,
    what: &str,
    mut done: impl FnMut(&mut dyn HapticDevice, Result<DeviceSample, DeviceError>) -> bool,
) {
    let begin = Instant::now();
    for k in 0.. {
        let answer = device.read(TickTime::regular(k, 1e-3));
        if done(device, answer) {
            return;
        }
        assert!(begin.elapsed() < Duration::from_secs(10), "never came: {what}; last {answer:?}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_wall_of_200_newtons_per_metre_holds_the_hand_where_both_springs_balance() {
    let service = Service::start(inventory());
    service.desk.arm.lock().unwrap().hand = [0.0, 0.0, -0.01];
    let mut device = opened(&service);
    assert_eq!(device.spec().name, "inverse3 049D");
    let balance = -350.0 * 0.01 / 550.0;
    let mut still = 0;
    until(device.as_mut(), "the balance", |device, answer| {
        let height = answer.unwrap_or_else(|e| panic!("{e}")).pose.translation.z;
        device.write(Wrench::from_force(Vector3::new(0.0, 0.0, (-200.0 * height).max(0.0)))).unwrap();
        still = if (height - balance).abs() < 1e-6 { still + 1 } else { 0 };
        still > 20
    });
    drop(device);
    // The service reads what is on the way at its own pace.
    let begin = Instant::now();
    while service.force() != [0.0; 3] {
        assert!(begin.elapsed() < Duration::from_secs(10), "the last word takes the force off");
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_program_that_stops_ticking_leaves_no_force_on_the_arm() {
    let service = Service::start(inventory());
    let mut device = opened(&service);
    device.write(Wrench::from_force(Vector3::new(0.5, 0.0, 0.0))).unwrap();
    until(device.as_mut(), "the force", |_, _| service.force()[0] == 0.5);
    until(device.as_mut(), "silence", |_, _| service.force()[0] == 0.0);
    device.write(Wrench::from_force(Vector3::new(f64::NAN, 1.0, 0.0))).unwrap();
    let commands = service.desk.commands.load(Ordering::Relaxed);
    until(device.as_mut(), "commands", |_, _| service.desk.commands.load(Ordering::Relaxed) > commands + 3);
    assert_eq!(service.force(), [0.0; 3], "no number that is none is sent");
}

#[test]
fn everything_that_a_service_may_do_in_mid_run_is_an_error_of_each_tick_until_it_is_over() {
    let service = Service::start(inventory());
    let mut device = opened(&service);
    let faults = [
        (Manner::Hang, DeviceError::Timeout),
        (Manner::Gibberish, DeviceError::Malformed),
        (Manner::Unplugged, DeviceError::Disconnected),
        (Manner::NoPosition, DeviceError::Malformed),
        (Manner::Binary, DeviceError::Malformed),
        (Manner::Ping, DeviceError::Timeout),
        (Manner::Trickle, DeviceError::Timeout),
    ];
    for (manner, error) in faults {
        until(device.as_mut(), "the device", |_, answer| answer.is_ok());
        service.is(manner);
        until(device.as_mut(), "the error", |device, answer| {
            // The tick is never held up by the network.
            device.write(Wrench::from_force(Vector3::x())).unwrap();
            answer == Err(error)
        });
        service.is(Manner::Sound);
    }
    until(device.as_mut(), "the device", |_, answer| answer.is_ok());
    service.is(Manner::HangUp);
    until(device.as_mut(), "the end", |_, answer| answer == Err(DeviceError::Disconnected));
    device.close();
    assert_eq!(device.read(TickTime::regular(0, 1e-3)), Err(DeviceError::Closed));
    assert_eq!(device.write(Wrench::zero()), Err(DeviceError::Closed));
    assert_eq!(service.desk.sessions.load(Ordering::Relaxed), 1);
}

#[test]
fn a_device_is_closed_while_its_service_hangs() {
    let service = Service::start(inventory());
    let mut device = opened(&service);
    service.is(Manner::Hang);
    until(device.as_mut(), "the time-out", |_, answer| answer == Err(DeviceError::Timeout));
    let begin = Instant::now();
    device.close();
    // Patience is 50 ms; ten seconds are a hang on any machine.
    assert!(begin.elapsed() < Duration::from_secs(10));
}

#[test]
fn a_service_that_answers_by_pings_or_byte_after_byte_gets_no_force_and_is_closed() {
    for manner in [Manner::Ping, Manner::Trickle] {
        let service = Service::start(inventory());
        let mut device = opened(&service);
        let push = |device: &mut dyn HapticDevice| device.write(Wrench::from_force(Vector3::x())).unwrap();
        until(device.as_mut(), "the force", |device, _| {
            push(device);
            service.force()[0] == 1.0
        });
        service.is(manner);
        until(device.as_mut(), "no force", |device, answer| {
            push(device);
            answer == Err(DeviceError::Timeout) && service.force() == [0.0; 3]
        });
        let commands = service.desk.commands.load(Ordering::Relaxed);
        until(device.as_mut(), "commands", |device, _| {
            push(device);
            service.desk.commands.load(Ordering::Relaxed) > commands + 3
        });
        assert_eq!(service.force(), [0.0; 3], "without an answer there is no force");
        let begin = Instant::now();
        device.close();
        // Patience is 50 ms; ten seconds are a hang on any machine.
        assert!(begin.elapsed() < Duration::from_secs(10));
    }
}

/// Serves one connection by `serve`, and tells how opening it went.
fn opened_at(serve: impl FnOnce(TcpStream) + Send + 'static) -> DriverError {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("ws://{}", listener.local_addr().unwrap());
    std::thread::spawn(move || serve(listener.accept().unwrap().0));
    let (answer, told) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let config = DriverConfig { url: Some(url), ..DriverConfig::default() };
        let _ = answer.send(open(&config).err().expect("it is no service"));
    });
    // A second is the deadline; ten are a hang on any machine.
    told.recv_timeout(Duration::from_secs(10)).expect("opening hangs")
}

/// Sends these bytes, one in 50 ms, until nobody listens any more.
fn drip(stream: &mut TcpStream, bytes: impl Iterator<Item = u8>) {
    for byte in bytes {
        if stream.write_all(&[byte]).is_err() {
            return;
        }
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn a_service_that_sends_without_end_before_its_inventory_is_given_up() {
    let error = opened_at(|mut stream| {
        let _ = stream.read(&mut [0; 4096]);
        drip(&mut stream, b"HTTP/1.1 101 Switching Protocols\r\n".iter().copied().cycle());
    });
    assert!(error.to_string().contains("does not answer in time"), "{error}");
    let error = opened_at(|stream| {
        let mut socket = tungstenite::accept(stream).unwrap();
        while socket.send(Message::Ping(vec![7].into())).is_ok() {
            std::thread::sleep(Duration::from_millis(50));
        }
    });
    assert!(error.to_string().contains("no inventory in time"), "{error}");
    let error = opened_at(|stream| {
        let mut socket = tungstenite::accept(stream).unwrap();
        drip(socket.get_mut(), [0x81, 126, 0xff, 0xff].into_iter().chain(std::iter::repeat(b' ')));
    });
    assert!(error.to_string().contains("no inventory in time"), "{error}");
}

#[test]
fn no_service_another_one_and_no_device_are_told_apart() {
    let at = |url: &str| DriverConfig { url: Some(url.into()), ..DriverConfig::default() };
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let error = open(&at(&format!("ws://{free}"))).err().unwrap();
    assert!(matches!(error, DriverError::Service { .. }) && error.to_string().contains("refused"), "{error}");
    for (url, word) in
        [("http://localhost", "ws://"), ("nonsense", "not an address"), ("ws://no.such.host.invalid", "")]
    {
        let error = open(&at(url)).err().unwrap();
        assert!(matches!(error, DriverError::Service { .. }) && error.to_string().contains(word), "{error}");
    }

    // Something else that listens and says nothing: the handshake does not wait for ever.
    let mute = TcpListener::bind("127.0.0.1:0").unwrap();
    let error = open(&at(&format!("ws://{}", mute.local_addr().unwrap()))).err().unwrap();
    assert!(error.to_string().contains("does not answer in time"), "{error}");

    let service = Service::start(json!({ "session_id": 1, "inverse3": [] }));
    let error = open(&config(&service)).err().unwrap();
    assert!(matches!(error, DriverError::NoDevice { .. }) && error.to_string().contains("no Inverse3"), "{error}");
    let service = Service::start(json!("nonsense"));
    let error = open(&config(&service)).err().unwrap();
    assert!(error.to_string().contains("cannot be understood"), "{error}");
    let service = Service::start(inventory());
    let found = (driver("haply").unwrap().probe)(&config(&service)).unwrap();
    assert_eq!(found, "Inverse3 049D, without a grip");
}
