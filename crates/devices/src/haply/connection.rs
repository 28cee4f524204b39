//! The WebSocket to the service. Every wait ends at its deadline, however many bytes arrive until then.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use tungstenite::client::client_with_config;
use tungstenite::handshake::HandshakeError;
use tungstenite::http::Uri;
use tungstenite::protocol::WebSocketConfig;
use tungstenite::{Message as Frame, Utf8Bytes, WebSocket};

/// Longest message of a service (bytes): its inventory has a kilobyte for each device.
const LONGEST_MESSAGE: usize = 1 << 20;

/// Most that waits for a service that does not read (bytes): a thousand commands.
const MOST_UNREAD: usize = 1 << 18;

/// A stream whose reads and writes end at one deadline together.
struct Timed {
    stream: TcpStream,
    until: Instant,
}

impl Timed {
    fn wait(&mut self, patience: Duration) {
        self.until = Instant::now() + patience;
    }

    fn is_over(&self) -> bool {
        Instant::now() >= self.until
    }

    /// Does `work`, which may wait for the time that is left.
    fn within<T>(&mut self, mut work: impl FnMut(&mut TcpStream, Duration) -> io::Result<T>) -> io::Result<T> {
        loop {
            let left = self.until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(ErrorKind::WouldBlock.into());
            }
            match work(&mut self.stream, left) {
                // A signal that the program got.
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::TimedOut => return Err(ErrorKind::WouldBlock.into()),
                answer => return answer,
            }
        }
    }
}

impl Read for Timed {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.within(|stream, left| stream.set_read_timeout(Some(left)).and_then(|()| stream.read(buffer)))
    }
}

impl Write for Timed {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.within(|stream, left| stream.set_write_timeout(Some(left)).and_then(|()| stream.write(bytes)))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}

/// What a wait for a message came to.
pub(super) enum Outcome {
    Text(Utf8Bytes),
    /// A message that is none of the service's.
    Binary,
    /// Nothing until the deadline, or pings and parts of a message only.
    Late,
    /// The connection has ended.
    Gone,
}

/// A connection that has shaken hands.
pub(super) struct Connection {
    socket: WebSocket<Timed>,
}

impl Connection {
    /// Connects and waits for the inventory, all within `patience`, but for the look-up of the host's name, which takes as
    /// long as the system lets it.
    pub(super) fn open(url: &str, patience: Duration) -> Result<(Self, Utf8Bytes), String> {
        let stream = reach(url, patience)?;
        let config = WebSocketConfig::default()
            .max_message_size(Some(LONGEST_MESSAGE))
            .max_frame_size(Some(LONGEST_MESSAGE))
            .write_buffer_size(0)
            .max_write_buffer_size(MOST_UNREAD);
        let (socket, _) = client_with_config(url, stream, Some(config)).map_err(|error| match error {
            HandshakeError::Interrupted(_) => "it accepts connections, but does not answer in time".into(),
            HandshakeError::Failure(error) => format!("it is no WebSocket service: {error}"),
        })?;
        let mut connection = Self { socket };
        match connection.message(&AtomicBool::new(false)) {
            Ok(Outcome::Text(text)) => Ok((connection, text)),
            Ok(Outcome::Binary) => Err("it sends no inventory, but bytes".into()),
            Ok(Outcome::Late) => Err("it sends no inventory in time".into()),
            Ok(Outcome::Gone) => Err("it hangs up before its inventory".into()),
            Err(error) => Err(error.to_string()),
        }
    }

    /// Sends a text; false where the connection is gone. What cannot be written within `patience` is written with the
    /// next text.
    pub(super) fn say(&mut self, text: String, patience: Duration) -> bool {
        self.socket.get_mut().wait(patience);
        self.socket.send(Frame::text(text)).map_or_else(|error| is_slow(&error), |()| true)
    }

    /// The next text. Looks after every frame whether it is to `end`.
    pub(super) fn hear(&mut self, patience: Duration, end: &AtomicBool) -> Outcome {
        self.socket.get_mut().wait(patience);
        self.message(end).unwrap_or(Outcome::Gone)
    }

    /// Throws away what has arrived already, for `patience` at most; false where the connection is gone.
    pub(super) fn skip(&mut self, patience: Duration, end: &AtomicBool) -> bool {
        self.socket.get_mut().wait(patience);
        if self.socket.get_ref().stream.set_nonblocking(true).is_err() {
            return false;
        }
        let last = loop {
            match self.message(end) {
                Ok(Outcome::Text(_) | Outcome::Binary) => {}
                Ok(last) => break last,
                Err(_) => break Outcome::Gone,
            }
        };
        self.socket.get_ref().stream.set_nonblocking(false).is_ok() && !matches!(last, Outcome::Gone)
    }

    /// Says farewell; whether it is heard does not matter.
    pub(super) fn close(&mut self, patience: Duration) {
        self.socket.get_mut().wait(patience);
        let _ = self.socket.close(None);
        let _ = self.socket.flush();
    }

    /// The next message until the deadline that is set.
    fn message(&mut self, end: &AtomicBool) -> Result<Outcome, tungstenite::Error> {
        loop {
            match self.socket.read() {
                Ok(Frame::Text(text)) => return Ok(Outcome::Text(text)),
                Ok(Frame::Binary(_)) => return Ok(Outcome::Binary),
                Ok(Frame::Close(_)) => return Ok(Outcome::Gone),
                // Pings that are in memory already are read without a look at the clock.
                Ok(_) if self.socket.get_ref().is_over() || end.load(Ordering::Acquire) => return Ok(Outcome::Late),
                Ok(_) => {}
                Err(error) if is_slow(&error) => return Ok(Outcome::Late),
                Err(error) => return Err(error),
            }
        }
    }
}

/// A connection to the address of `url`.
fn reach(url: &str, patience: Duration) -> Result<Timed, String> {
    let uri: Uri = url.parse().map_err(|e| format!("not an address: {e}"))?;
    let host = uri.host().ok_or("not an address: no host")?;
    if uri.scheme_str() != Some("ws") {
        return Err("not an address of the service: it begins with ws://".into());
    }
    let addresses = (host, uri.port_u16().unwrap_or(80)).to_socket_addrs().map_err(|e| e.to_string())?;
    let until = Instant::now() + patience;
    let mut refused = "the host has no address".to_owned();
    for address in addresses {
        let left = until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            break;
        }
        match TcpStream::connect_timeout(&address, left) {
            // Small messages that are not to wait for one another.
            Ok(stream) => {
                return stream.set_nodelay(true).map(|()| Timed { stream, until }).map_err(|e| e.to_string());
            }
            Err(error) => refused = error.to_string(),
        }
    }
    Err(refused)
}

/// Whether the network has only taken longer than it was waited for.
fn is_slow(error: &tungstenite::Error) -> bool {
    matches!(error, tungstenite::Error::Io(e) if e.kind() == ErrorKind::WouldBlock)
}
