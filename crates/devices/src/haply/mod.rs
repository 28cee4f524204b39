//! Haply's Inverse3, through the WebSocket of its local service.
//!
//! The service answers one state for each command that it gets, and so a thread of this driver sends the newest force
//! and waits for the answer, once a millisecond; the tick exchanges whole values with that thread and never waits for
//! the network. Where the tick has not written for [`LARGEST_SILENCE`], the thread sends no force. The service has filters
//! and a gate for forces of its own, which are not touched.

mod message;

use std::io::ErrorKind;
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use nalgebra::Vector3;
use palpate_haptics::device::{DeviceError, DeviceSample, DeviceSpec, Freedoms, HapticDevice, TickTime};
use palpate_haptics::exchange::{Reader, Writer, latest};
use palpate_haptics::wrench::Wrench;
use tungstenite::handshake::HandshakeError;
use tungstenite::http::Uri;
use tungstenite::{Message as Frame, WebSocket};

use crate::error::DriverError;
use crate::{Driver, DriverConfig, Opened};
use message::{Address, Message, command};

/// Line in the register of drivers.
pub const DRIVER: Driver = Driver {
    name: "haply",
    summary: "Inverse3 with or without VerseGrip, through Haply's local service",
    real_time: true,
    own_frame: true,
    keys: &["url"],
    open,
    probe,
};

/// Where the service listens unless it is configured otherwise.
pub const URL: &str = "ws://localhost:10001";

/// Time without a new force from the tick after which none is sent (s).
pub const LARGEST_SILENCE: f64 = 0.05;

/// Age of the newest state beyond which the device counts as silent (s).
const OLDEST_STATE: f64 = 0.1;

/// Time between two commands, unless the service takes longer to answer.
const PERIOD: Duration = Duration::from_millis(1);

/// Longest wait for the network before the thread looks whether it is to end.
const PATIENCE: Duration = Duration::from_millis(50);

/// Longest wait for the connection and for the inventory.
const OPENING: Duration = Duration::from_secs(1);

const VENDOR: &str = "Haply";

type Socket = WebSocket<TcpStream>;

/// What the thread heard last.
#[derive(Clone, Copy)]
struct Heard {
    state: Result<DeviceSample, DeviceError>,
    at: Instant,
}

/// What the tick wants, with its number.
#[derive(Clone, Copy, Default)]
struct Wanted {
    force: Vector3<f64>,
    number: u64,
}

/// An open device.
struct Haply {
    spec: DeviceSpec,
    heard: Reader<Heard>,
    wanted: Writer<Wanted>,
    written: u64,
    end: Arc<AtomicBool>,
    /// `None` once closed.
    thread: Option<JoinHandle<()>>,
}

fn open(config: &DriverConfig) -> Opened {
    let (socket, address, first) = connect(config)?;
    let (writer, heard) = latest(&Heard { state: first, at: Instant::now() });
    let (wanted, reader) = latest(&Wanted::default());
    let end = Arc::new(AtomicBool::new(false));
    let spec = spec(&address);
    let mut conversation = Conversation {
        socket,
        address,
        heard: writer,
        wanted: reader,
        end: Arc::clone(&end),
        number: 0,
        written_at: Instant::now(),
    };
    let thread = std::thread::Builder::new()
        .name("palpate-haply".into())
        .spawn(move || conversation.run())
        .map_err(DriverError::Thread)?;
    Ok(Box::new(Haply { spec, heard, wanted, written: 0, end, thread: Some(thread) }))
}

fn probe(config: &DriverConfig) -> Result<String, DriverError> {
    let (mut socket, address, _) = connect(config)?;
    // It has told what was asked; whether it hears the farewell does not matter.
    let _ = socket.close(None);
    Ok(format!("Inverse3 {}, {}", address.device_id, if address.has_grip { "with a grip" } else { "without a grip" }))
}

/// The record of the Inverse3. Haply's documentation of the service names no limits: these are those of its older
/// pantograph in CHAI3D's table, which a scene's own `record` replaces.
fn spec(address: &Address) -> DeviceSpec {
    // The name is in the table.
    let known = DeviceSpec::preset("haply-pantograph").unwrap_or_else(|_| DeviceSpec::virtual_device(0.0));
    let freedoms = Freedoms { senses_rotation: address.has_grip, ..known.freedoms };
    DeviceSpec { name: format!("inverse3 {}", address.device_id), freedoms, ..known }
}

/// Connects, and waits for the inventory: the socket, the first arm, and its first state.
fn connect(config: &DriverConfig) -> Result<(Socket, Address, Result<DeviceSample, DeviceError>), DriverError> {
    let url = config.url.as_deref().unwrap_or(URL);
    let failed = |reason: String| DriverError::Service { url: url.into(), reason };
    let stream = reach(url).map_err(failed)?;
    let (mut socket, _) = tungstenite::client(url, stream).map_err(|error| {
        failed(match error {
            HandshakeError::Interrupted(_) => "it accepts connections, but does not answer in time".into(),
            HandshakeError::Failure(error) => format!("it is no WebSocket service: {error}"),
        })
    })?;
    let text = loop {
        match socket.read() {
            Ok(Frame::Text(text)) => break text,
            Ok(_) => {}
            Err(error) if is_slow(&error) => return Err(failed("it sends no inventory".into())),
            Err(error) => return Err(failed(error.to_string())),
        }
    };
    let message = Message::parse(&text).map_err(|e| failed(format!("its inventory cannot be understood: {e}")))?;
    let address = message
        .address()
        .ok_or_else(|| DriverError::NoDevice { vendor: VENDOR, reason: "the service knows no Inverse3".into() })?;
    socket.get_ref().set_read_timeout(Some(PATIENCE)).map_err(|e| failed(e.to_string()))?;
    let first = message.sample(&address.device_id);
    Ok((socket, address, first))
}

/// A connection to the address of `url`.
fn reach(url: &str) -> Result<TcpStream, String> {
    let uri: Uri = url.parse().map_err(|e| format!("not an address: {e}"))?;
    let host = uri.host().ok_or("not an address: no host")?;
    if uri.scheme_str() != Some("ws") {
        return Err("not an address of the service: it begins with ws://".into());
    }
    let addresses = (host, uri.port_u16().unwrap_or(80)).to_socket_addrs().map_err(|e| e.to_string())?;
    let mut refused = "the host has no address".to_owned();
    for address in addresses {
        match TcpStream::connect_timeout(&address, OPENING) {
            Ok(stream) => {
                // Small messages that are not to wait for one another, and waits that end.
                let set = stream
                    .set_nodelay(true)
                    .and_then(|()| stream.set_read_timeout(Some(OPENING)))
                    .and_then(|()| stream.set_write_timeout(Some(PATIENCE)));
                return set.map(|()| stream).map_err(|e| e.to_string());
            }
            Err(error) => refused = error.to_string(),
        }
    }
    Err(refused)
}

/// Whether the network has only taken longer than the thread waits.
fn is_slow(error: &tungstenite::Error) -> bool {
    matches!(error, tungstenite::Error::Io(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut))
}

/// The thread's side: one command, one answer.
struct Conversation {
    socket: Socket,
    address: Address,
    heard: Writer<Heard>,
    wanted: Reader<Wanted>,
    end: Arc<AtomicBool>,
    number: u64,
    written_at: Instant,
}

impl Conversation {
    fn run(&mut self) {
        let mut first = true;
        let mut next = Instant::now();
        while !self.end.load(Ordering::Acquire) {
            let force = self.force();
            if !self.say(&force, first) || !self.listen() {
                self.tell(Err(DeviceError::Disconnected));
                return;
            }
            first = false;
            next = (next + PERIOD).max(Instant::now());
            std::thread::sleep(next.saturating_duration_since(Instant::now()));
        }
        // The last word takes the force off, and the service's own time-out would.
        let _ = self.say(&Vector3::zeros(), false);
        let _ = self.socket.close(None);
        let _ = self.socket.flush();
    }

    /// The newest force, or none where the tick is silent.
    fn force(&mut self) -> Vector3<f64> {
        let wanted = *self.wanted.latest();
        if wanted.number != self.number {
            (self.number, self.written_at) = (wanted.number, Instant::now());
        }
        let silent = self.written_at.elapsed().as_secs_f64() > LARGEST_SILENCE;
        if silent || !wanted.force.iter().all(|f| f.is_finite()) { Vector3::zeros() } else { wanted.force }
    }

    /// Sends a force; false where the connection is gone.
    fn say(&mut self, force: &Vector3<f64>, first: bool) -> bool {
        match self.socket.send(Frame::text(command(&self.address, force, first))) {
            Ok(()) => true,
            // What could not be written now is written with the next message.
            Err(error) => is_slow(&error),
        }
    }

    /// Waits for the answer; false where the connection is gone. A service that hangs is told, and waited for.
    fn listen(&mut self) -> bool {
        loop {
            match self.socket.read() {
                Ok(Frame::Text(text)) => {
                    let message = Message::parse(&text).map_err(|_| DeviceError::Malformed);
                    self.tell(message.and_then(|message| message.sample(&self.address.device_id)));
                    return true;
                }
                Ok(Frame::Close(_)) => return false,
                Ok(Frame::Binary(_)) => {
                    self.tell(Err(DeviceError::Malformed));
                    return true;
                }
                Ok(_) => {}
                Err(error) if is_slow(&error) => {
                    self.tell(Err(DeviceError::Timeout));
                    if self.end.load(Ordering::Acquire) {
                        return true;
                    }
                }
                Err(_) => return false,
            }
        }
    }

    fn tell(&mut self, state: Result<DeviceSample, DeviceError>) {
        self.heard.send(Heard { state, at: Instant::now() });
    }
}

impl HapticDevice for Haply {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }

    fn read(&mut self, tick: TickTime) -> Result<DeviceSample, DeviceError> {
        if self.thread.is_none() {
            return Err(DeviceError::Closed);
        }
        let heard = *self.heard.latest();
        match heard.state {
            Ok(_) if heard.at.elapsed().as_secs_f64() > OLDEST_STATE => Err(DeviceError::Timeout),
            Ok(sample) => Ok(DeviceSample { time: tick.time, ..sample }),
            Err(error) => Err(error),
        }
    }

    /// The Inverse3 has no motors for torque.
    fn write(&mut self, wrench: Wrench) -> Result<(), DeviceError> {
        if self.thread.is_none() {
            return Err(DeviceError::Closed);
        }
        self.written += 1;
        self.wanted.send(Wanted { force: wrench.force, number: self.written });
        Ok(())
    }

    fn close(&mut self) {
        if let Some(thread) = self.thread.take() {
            self.end.store(true, Ordering::Release);
            // A thread that has panicked has dropped its socket, which the service takes for the end.
            let _ = thread.join();
        }
    }
}

impl Drop for Haply {
    fn drop(&mut self) {
        self.close();
    }
}
