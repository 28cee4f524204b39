//! A service as Haply's: a thread with a WebSocket on this machine that answers one state for each command.
#![allow(dead_code)] // each test uses its part

use std::io::Write;
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use serde_json::{Value, json};
use tungstenite::{Message, WebSocket};

/// What the service does with a command.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Manner {
    Sound,
    Hang,
    Gibberish,
    Unplugged,
    NoPosition,
    Binary,
    /// Takes the force, but answers by pings alone.
    Ping,
    /// Takes the force, but answers by an endless message, byte after byte.
    Trickle,
    HangUp,
}

/// The device behind the service: a mass on a spring to a hand, moved by a millisecond a command.
#[derive(Default)]
pub(crate) struct Arm {
    position: [f64; 3],
    velocity: [f64; 3],
    pub(crate) hand: [f64; 3],
    force: [f64; 3],
}

pub(crate) struct Desk {
    manner: Mutex<Manner>,
    /// The manner from so many commands with a force on.
    turn: Mutex<Option<(u64, Manner)>>,
    commands_with_force: AtomicU64,
    pub(crate) arm: Mutex<Arm>,
    pub(crate) commands: AtomicU64,
    pub(crate) sessions: AtomicUsize,
    end: AtomicBool,
}

pub(crate) struct Service {
    pub(crate) desk: Arc<Desk>,
    url: String,
    thread: Option<JoinHandle<()>>,
}

impl Service {
    /// A service whose inventory is made of `inventory`.
    pub(crate) fn start(inventory: Value) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("ws://{}", listener.local_addr().unwrap());
        listener.set_nonblocking(true).unwrap();
        let desk = Arc::new(Desk {
            manner: Mutex::new(Manner::Sound),
            turn: Mutex::default(),
            commands_with_force: AtomicU64::new(0),
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

    pub(crate) fn url(&self) -> &str {
        &self.url
    }

    pub(crate) fn is(&self, manner: Manner) {
        *self.desk.manner.lock().unwrap() = manner;
    }

    /// Lets it be so after this many commands with a force.
    pub(crate) fn becomes(&self, after: u64, manner: Manner) {
        *self.desk.turn.lock().unwrap() = Some((after, manner));
    }

    pub(crate) fn commands_with_force(&self) -> u64 {
        self.desk.commands_with_force.load(Ordering::Relaxed)
    }

    pub(crate) fn force(&self) -> [f64; 3] {
        self.desk.arm.lock().unwrap().force
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        self.desk.end.store(true, Ordering::Release);
        self.thread.take().unwrap().join().unwrap();
    }
}

impl Desk {
    fn manner(&self) -> Manner {
        let mut manner = self.manner.lock().unwrap();
        let turn = self.turn.lock().unwrap();
        if let Some((after, then)) = *turn
            && self.commands_with_force.load(Ordering::Relaxed) >= after
        {
            *manner = then;
        }
        *manner
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
    let mut trickle = Trickle::default();
    while !desk.end.load(Ordering::Acquire) {
        // One manner for all of a turn: an answer in the midst of a trickled message would spoil both.
        let manner = desk.manner();
        match manner {
            Manner::Ping => _ = socket.send(Message::Ping(vec![7].into())),
            Manner::Trickle => trickle.drip(socket.get_mut()),
            _ => trickle.finish(socket.get_mut()),
        }
        match socket.read() {
            Ok(Message::Text(text)) => {
                if !answer(desk, manner, &mut socket, &text) {
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

/// A text of blanks, of which a byte is sent at a time.
#[derive(Default)]
struct Trickle {
    left: u16,
}

impl Trickle {
    fn drip(&mut self, stream: &mut TcpStream) {
        if self.left == 0 {
            self.left = 10_000;
            let [high, low] = self.left.to_be_bytes();
            let _ = stream.write_all(&[0x81, 126, high, low]);
        }
        let _ = stream.write_all(b" ");
        self.left -= 1;
    }

    fn finish(&mut self, stream: &mut TcpStream) {
        let _ = stream.write_all(&vec![b' '; usize::from(std::mem::take(&mut self.left))]);
    }
}

/// False where the service hangs up.
fn answer(desk: &Desk, manner: Manner, socket: &mut WebSocket<TcpStream>, text: &str) -> bool {
    let command: Value = serde_json::from_str(text).unwrap();
    let first = desk.commands.fetch_add(1, Ordering::Relaxed) == 0;
    assert_eq!(command.get("session").is_some(), first, "the session is configured once, at first: {text}");
    assert_eq!(command["inverse3"][0]["device_id"], "049D");
    let force = &command["inverse3"][0]["commands"]["set_cursor_force"]["vector"];
    let force = ["x", "y", "z"].map(|axis| force[axis].as_f64().unwrap());
    desk.commands_with_force.fetch_add(u64::from(force != [0.0; 3]), Ordering::Relaxed);
    let state = move_arm(&mut desk.arm.lock().unwrap(), force);
    let reply = match manner {
        Manner::Sound => Message::text(json!({ "inverse3": [{ "device_id": "049D", "state": state }] }).to_string()),
        Manner::Gibberish => Message::text("{ \"inverse3\": [ { \"device"),
        Manner::Unplugged => Message::text(json!({ "inverse3": [] }).to_string()),
        Manner::NoPosition => Message::text(json!({ "inverse3": [{ "device_id": "049D", "state": {} }] }).to_string()),
        Manner::Binary => Message::binary(vec![1_u8, 2, 3]),
        Manner::Ping | Manner::Trickle => return true,
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

pub(crate) fn inventory() -> Value {
    let zero = json!({ "x": 0.0, "y": 0.0, "z": 0.0 });
    let state = json!({ "cursor_position": zero, "cursor_velocity": zero });
    let config = json!({ "type": "inverse3", "handedness": "right" });
    json!({ "session_id": 7, "inverse3": [{ "device_id": "049D", "config": config, "state": state }] })
}
