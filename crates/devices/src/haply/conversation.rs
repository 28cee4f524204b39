//! The thread's side of the exchange: one command, one answer.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use nalgebra::Vector3;
use palpate_haptics::device::{DeviceError, DeviceSample};
use palpate_haptics::exchange::{Reader, Writer};

use super::LARGEST_SILENCE;
use super::connection::{Connection, Outcome};
use super::message::{Address, Message, command};

/// Time between two commands, unless the service takes longer to answer.
const PERIOD: Duration = Duration::from_millis(1);

/// Longest wait for an answer and for room to write.
const PATIENCE: Duration = Duration::from_millis(50);

/// What the thread heard last.
#[derive(Clone, Copy)]
pub(super) struct Heard {
    pub(super) state: Result<DeviceSample, DeviceError>,
    pub(super) at: Instant,
}

/// What the tick wants, with its number.
#[derive(Clone, Copy, Default)]
pub(super) struct Wanted {
    pub(super) force: Vector3<f64>,
    pub(super) number: u64,
}

/// The thread's side: one command, one answer.
pub(super) struct Conversation {
    connection: Connection,
    address: Address,
    heard: Writer<Heard>,
    wanted: Reader<Wanted>,
    end: Arc<AtomicBool>,
    number: u64,
    written_at: Instant,
    /// The last command has no answer yet.
    unanswered: bool,
}

impl Conversation {
    pub(super) fn new(
        connection: Connection,
        address: Address,
        heard: Writer<Heard>,
        wanted: Reader<Wanted>,
        end: Arc<AtomicBool>,
    ) -> Self {
        Self { connection, address, heard, wanted, end, number: 0, written_at: Instant::now(), unanswered: false }
    }

    pub(super) fn run(&mut self) {
        let mut first = true;
        let mut next = Instant::now();
        while !self.end.load(Ordering::Acquire) {
            let force = self.force();
            // An answer that came late is not the one to the command that follows.
            if !self.connection.skip(PERIOD, &self.end) || !self.say(&force, first) || !self.listen() {
                self.tell(Err(DeviceError::Disconnected));
                return;
            }
            first = false;
            next = (next + PERIOD).max(Instant::now());
            std::thread::sleep(next.saturating_duration_since(Instant::now()));
        }
        // The last word takes the force off, and the service's own time-out would.
        let _ = self.say(&Vector3::zeros(), false);
        self.connection.close(PATIENCE);
    }

    /// The newest force, or none where the tick is silent or the service does not answer.
    fn force(&mut self) -> Vector3<f64> {
        let wanted = *self.wanted.latest();
        if wanted.number != self.number {
            (self.number, self.written_at) = (wanted.number, Instant::now());
        }
        let silent = self.written_at.elapsed().as_secs_f64() > LARGEST_SILENCE;
        let sound = !silent && !self.unanswered && wanted.force.iter().all(|f| f.is_finite());
        if sound { wanted.force } else { Vector3::zeros() }
    }

    /// Sends a force; false where the connection is gone.
    fn say(&mut self, force: &Vector3<f64>, first: bool) -> bool {
        self.connection.say(command(&self.address, force, first), PATIENCE)
    }

    /// Waits for the answer; false where the connection is gone. A service that gives none in time is told, and the next
    /// command takes the force off.
    fn listen(&mut self) -> bool {
        let outcome = self.connection.hear(PATIENCE, &self.end);
        self.unanswered = matches!(outcome, Outcome::Late);
        match outcome {
            Outcome::Text(text) => {
                let message = Message::parse(&text).map_err(|_| DeviceError::Malformed);
                self.tell(message.and_then(|message| message.sample(&self.address.device_id)));
            }
            Outcome::Binary => self.tell(Err(DeviceError::Malformed)),
            Outcome::Late => self.tell(Err(DeviceError::Timeout)),
            Outcome::Gone => return false,
        }
        true
    }

    fn tell(&mut self, state: Result<DeviceSample, DeviceError>) {
        self.heard.send(Heard { state, at: Instant::now() });
    }
}
