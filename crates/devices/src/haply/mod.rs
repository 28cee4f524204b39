//! Haply's Inverse3, through the WebSocket of its local service.
//!
//! The service answers one state for each command that it gets, and so a thread of this driver sends the newest force
//! and waits for the answer, once a millisecond; the tick exchanges whole values with that thread and never waits for
//! the network. Where the tick has not written for [`LARGEST_SILENCE`], or the service has not answered in time, whatever
//! else it sends, the thread sends no force. The service has filters and a gate for forces of its own, which are not
//! touched.

mod connection;
mod conversation;
mod message;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use palpate_haptics::device::{DeviceError, DeviceSample, DeviceSpec, Freedoms, HapticDevice, TickTime};
use palpate_haptics::exchange::{Reader, Writer, latest};
use palpate_haptics::wrench::Wrench;

use crate::error::DriverError;
use crate::{Driver, DriverConfig, Opened};
use connection::Connection;
use conversation::{Conversation, Heard, Wanted};
use message::{Address, Message};

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

/// Longest wait for the connection, the handshake and the inventory together, and for the farewell of a probe.
const OPENING: Duration = Duration::from_secs(1);

const VENDOR: &str = "Haply";

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
    let (connection, address, first) = connect(config)?;
    let (writer, heard) = latest(&Heard { state: first, at: Instant::now() });
    let (wanted, reader) = latest(&Wanted::default());
    let end = Arc::new(AtomicBool::new(false));
    let spec = spec(&address);
    let mut conversation = Conversation::new(connection, address, writer, reader, Arc::clone(&end));
    let thread = std::thread::Builder::new()
        .name("palpate-haply".into())
        .spawn(move || conversation.run())
        .map_err(DriverError::Thread)?;
    Ok(Box::new(Haply { spec, heard, wanted, written: 0, end, thread: Some(thread) }))
}

fn probe(config: &DriverConfig) -> Result<String, DriverError> {
    let (mut connection, address, _) = connect(config)?;
    connection.close(OPENING);
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

/// Connects, and waits for the inventory: the connection, the first arm, and its first state.
fn connect(config: &DriverConfig) -> Result<(Connection, Address, Result<DeviceSample, DeviceError>), DriverError> {
    let url = config.url.as_deref().unwrap_or(URL);
    let failed = |reason: String| DriverError::Service { url: url.into(), reason };
    let (connection, text) = Connection::open(url, OPENING).map_err(failed)?;
    let message = Message::parse(&text).map_err(|e| failed(format!("its inventory cannot be understood: {e}")))?;
    let address = message
        .address()
        .ok_or_else(|| DriverError::NoDevice { vendor: VENDOR, reason: "the service knows no Inverse3".into() })?;
    let first = message.sample(&address.device_id);
    Ok((connection, address, first))
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
