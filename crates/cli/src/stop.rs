//! Signals that ask for an end: Ctrl-C (INT), TERM, and HUP where the terminal goes away.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use miette::{IntoDiagnostic, Result, WrapErr};

use crate::exit;

/// Whether somebody wants the work to end, and by which signal.
pub(crate) struct Stop {
    asked: Arc<AtomicBool>,
    signal: Arc<AtomicUsize>,
}

impl Stop {
    /// Watches for the signals from now on. The first asks for an end in order; a second one ends the program at once.
    pub(crate) fn watch() -> Result<Self> {
        let stop = Self { asked: Arc::default(), signal: Arc::default() };
        stop.register().into_diagnostic().wrap_err("Ctrl-C cannot be watched")?;
        Ok(stop)
    }

    #[cfg(unix)]
    fn register(&self) -> std::io::Result<()> {
        use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
        use signal_hook::flag;

        for (signal, code) in [(SIGHUP, exit::HUNG_UP), (SIGINT, exit::INTERRUPTED), (SIGTERM, exit::TERMINATED)] {
            if signal == SIGHUP && is_ignored(signal) {
                continue;
            }
            // In this order: the first signal finds the flag down.
            flag::register_conditional_shutdown(signal, code.into(), Arc::clone(&self.asked))?;
            flag::register_usize(signal, Arc::clone(&self.signal), signal as usize)?;
            flag::register(signal, Arc::clone(&self.asked))?;
        }
        Ok(())
    }

    #[cfg(not(unix))]
    fn register(&self) -> std::result::Result<(), ctrlc::Error> {
        let asked = Arc::clone(&self.asked);
        ctrlc::set_handler(move || {
            if asked.swap(true, Ordering::SeqCst) {
                std::process::exit(exit::INTERRUPTED.into());
            }
        })
    }

    /// Goes up with the first signal.
    pub(crate) fn flag(&self) -> &Arc<AtomicBool> {
        &self.asked
    }

    /// Whether a signal has come.
    pub(crate) fn is_asked(&self) -> bool {
        self.asked.load(Ordering::SeqCst)
    }

    /// Exit code of work that the signal ended.
    pub(crate) fn code(&self) -> u8 {
        match u8::try_from(self.signal.load(Ordering::SeqCst)) {
            Ok(signal @ 1..=64) => exit::SIGNALLED + signal,
            _ => exit::INTERRUPTED,
        }
    }
}

/// Whether whoever started the program has it ignore this signal, as `nohup` does for HUP. Known on Linux.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    mask >> (signal - 1) & 1 == 1
}
