//! Does the driver speak the service's protocol, and survive everything that a service may do?
//!
//! The service here is a thread with a WebSocket on this machine that answers one state for each command.

use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use nalgebra::Vector3;
use palpate_devices::{DriverConfig, DriverError, driver};
use palpate_haptics::device::{DeviceError, DeviceSample, HapticDevice, TickTime};
use palpate_haptics::wrench::Wrench;
use serde_json::{Value, json};
use tungstenite::{Message, WebSocket};

/// What the service does with a command.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Manner {
    Sound,
    Hang,
    Gibberish,
    Unplugged,
    NoPosition,
    Binary,
    HangUp,
}

/// The device behind the service: a mass on a spring to a hand, moved by a millisecond a command.
#[derive(Default)]
struct Arm {
    position: [f64; 3],
    velocity: [f64; 3],
    hand: [f64; 3],
    force: [f64; 3],
}

struct Desk {
    manner: Mutex<Manner>,
    arm: Mutex<Arm>,
    commands: AtomicU64,
    sessions: AtomicUsize,
    end: AtomicBool,
}

struct Service {
    desk: Arc<Desk>,
    url: String,
    thread: Option<JoinHandle<()>>,
}

impl Service {
    /// A service whose inventory is made of `inventory`.
    fn start(inventory: Value) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("ws://{}", listener.local_addr().unwrap());
        listener.set_nonblocking(true).unwrap();
        let desk = Arc::new(Desk {
            manner: Mutex::new(Manner::Sound),
            arm: Mutex::default(),
            commands: AtomicU64::new(0),
            sessions: AtomicUsize::new(0),
            end: AtomicBool::new(false),
        });
        let served = Arc::clone(&desk);
        let thread = std::thread::spawn(move || {
            while !served.end.load(Ordering::Acquire) {
                match listener.accept() {
                    Ok((stream, _)) => serve(&served, stream, &inventory),
                    Err(_) => std::thread::sleep(Duration::from_millis(2)),
                }
            }
        });
        Self { desk, url, thread: Some(thread) }
    }

    fn config(&self) -> DriverConfig {
        DriverConfig { url: Some(self.url.clone()), ..DriverConfig::default() }
    }

    fn open(&self) -> Box<dyn HapticDevice> {
        open(&self.config()).unwrap_or_else(|e| panic!("{e}"))
    }

    fn is(&self, manner: Manner) {
        *self.desk.manner.lock().unwrap() = manner;
    }

    fn force(&self) -> [f64; 3] {
        self.desk.arm.lock().unwrap().force
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        self.desk.end.store(true, Ordering::Release);
        self.thread.take().unwrap().join().unwrap();
    }
}

/// One connection, from the inventory to its end.
fn serve(desk: &Desk, stream: TcpStream, inventory: &Value) {
    stream.set_nonblocking(false).unwrap();
    stream.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
    stream.set_nodelay(true).unwrap();
    let Ok(mut socket) = tungstenite::accept(stream) else { return };
    desk.sessions.fetch_add(1, Ordering::Relaxed);
    let _ = socket.send(Message::text(inventory.to_string()));
    while !desk.end.load(Ordering::Acquire) {
        match socket.read() {
            Ok(Message::Text(text)) => {
                if !answer(desk, &mut socket, &text) {
                    return;
                }
            }
            Ok(Message::Close(_)) => return,
            Err(tungstenite::Error::Io(e)) if e.kind() == std::io::ErrorKind::WouldBlock => {}
            Err(_) => return,
            Ok(_) => {}
        }
    }
}

/// False where the service hangs up.
fn answer(desk: &Desk, socket: &mut WebSocket<TcpStream>, text: &str) -> bool {
    let command: Value = serde_json::from_str(text).unwrap();
    let first = desk.commands.fetch_add(1, Ordering::Relaxed) == 0;
    assert_eq!(command.get("session").is_some(), first, "the session is configured once, at first: {text}");
    assert_eq!(command["inverse3"][0]["device_id"], "049D");
    let force = &command["inverse3"][0]["commands"]["set_cursor_force"]["vector"];
    let force = ["x", "y", "z"].map(|axis| force[axis].as_f64().unwrap());
    let state = move_arm(&mut desk.arm.lock().unwrap(), force);
    let manner = *desk.manner.lock().unwrap();
    let reply = match manner {
        Manner::Sound => Message::text(json!({ "inverse3": [{ "device_id": "049D", "state": state }] }).to_string()),
        Manner::Gibberish => Message::text("{ \"inverse3\": [ { \"device"),
        Manner::Unplugged => Message::text(json!({ "inverse3": [] }).to_string()),
        Manner::NoPosition => Message::text(json!({ "inverse3": [{ "device_id": "049D", "state": {} }] }).to_string()),
        Manner::Binary => Message::binary(vec![1_u8, 2, 3]),
        Manner::HangUp => return false,
        Manner::Hang => {
            while *desk.manner.lock().unwrap() == Manner::Hang && !desk.end.load(Ordering::Acquire) {
                std::thread::sleep(Duration::from_millis(2));
            }
            Message::text(json!({ "inverse3": [{ "device_id": "049D", "state": state }] }).to_string())
        }
    };
    socket.send(reply).is_ok()
}

/// The arm a millisecond later, as the service tells it.
fn move_arm(arm: &mut Arm, force: [f64; 3]) -> Value {
    arm.force = force;
    for i in 0..3 {
        let f = force[i] + 350.0 * (arm.hand[i] - arm.position[i]) - 6.0 * arm.velocity[i];
        arm.velocity[i] += 1e-3 * f / 0.1;
        arm.position[i] += 1e-3 * arm.velocity[i];
    }
    let xyz = |v: [f64; 3]| json!({ "x": v[0], "y": v[1], "z": v[2] });
    json!({ "cursor_position": xyz(arm.position), "cursor_velocity": xyz(arm.velocity) })
}

fn inventory() -> Value {
    let zero = json!({ "x": 0.0, "y": 0.0, "z": 0.0 });
    let state = json!({ "cursor_position": zero, "cursor_velocity": zero });
    let config = json!({ "type": "inverse3", "handedness": "right" });
    json!({ "session_id": 7, "inverse3": [{ "device_id": "049D", "config": config, "state": state }] })
}

fn open(config: &DriverConfig) -> Result<Box<dyn HapticDevice>, DriverError> {
    (driver("haply").unwrap().open)(config)
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
    let mut device = service.open();
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
    let mut device = service.open();
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
    let mut device = service.open();
    let faults = [
        (Manner::Hang, DeviceError::Timeout),
        (Manner::Gibberish, DeviceError::Malformed),
        (Manner::Unplugged, DeviceError::Disconnected),
        (Manner::NoPosition, DeviceError::Malformed),
        (Manner::Binary, DeviceError::Malformed),
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
    let mut device = service.open();
    service.is(Manner::Hang);
    until(device.as_mut(), "the time-out", |_, answer| answer == Err(DeviceError::Timeout));
    let begin = Instant::now();
    device.close();
    // Patience is 50 ms; ten seconds are a hang on any machine.
    assert!(begin.elapsed() < Duration::from_secs(10));
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
    let error = open(&service.config()).err().unwrap();
    assert!(matches!(error, DriverError::NoDevice { .. }) && error.to_string().contains("no Inverse3"), "{error}");
    let service = Service::start(json!("nonsense"));
    let error = open(&service.config()).err().unwrap();
    assert!(error.to_string().contains("cannot be understood"), "{error}");
    let service = Service::start(inventory());
    let found = (driver("haply").unwrap().probe)(&service.config()).unwrap();
    assert_eq!(found, "Inverse3 049D, without a grip");
}
