//! Why a device cannot be opened, with what was tried and the remedy.

use std::path::PathBuf;

use palpate_haptics::SetupError;
use thiserror::Error;

/// A device that cannot be opened.
#[derive(Debug, Error)]
pub enum DriverError {
    /// No library could be loaded.
    #[error(
        "the library of {vendor} cannot be loaded: {tried}; install the vendor's SDK, or name the file by {remedy}"
    )]
    Library {
        /// Whose it is.
        vendor: &'static str,
        /// The files that were tried: where they were looked for, or what the system said of one that is there.
        tried: String,
        /// Where to name the file.
        remedy: &'static str,
    },
    /// The library lacks a function: it is another one, or too old.
    #[error("{path}: not a library of {vendor} that can be used: it has no function `{symbol}` ({reason})", path = path.display())]
    Symbol {
        /// The library.
        path: PathBuf,
        /// Whose it should be.
        vendor: &'static str,
        /// The function.
        symbol: &'static str,
        /// What the system said.
        reason: String,
    },
    /// The library works, but there is no device.
    #[error("{vendor}: no device can be opened: {reason}; check power, cable and the permission to use its port")]
    NoDevice {
        /// Whose.
        vendor: &'static str,
        /// What its library said.
        reason: String,
    },
    /// The service cannot be reached, or does not speak its language.
    #[error("{url}: {reason}; is the service running, and is this its address?")]
    Service {
        /// Its address.
        url: String,
        /// What happened.
        reason: String,
    },
    /// The device's answer at its opening cannot be used.
    #[error("{0}")]
    Setup(#[from] SetupError),
    /// No trace was named.
    #[error("there is no trace to replay: name one by `trace`")]
    NoTrace,
    /// The trace cannot be read.
    #[error("{0}")]
    Trace(#[from] palpate_trace::TraceError),
    /// The trace holds no pose.
    #[error("{path}: the trace holds no tick whose device answered", path = path.display())]
    EmptyTrace {
        /// The trace.
        path: PathBuf,
    },
    /// The system refuses a thread.
    #[error("the device's thread cannot be started: {0}")]
    Thread(std::io::Error),
}
