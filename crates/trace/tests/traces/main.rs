//! Traces: rings, files, damage and sinks that fail.

#[path = "../sample/mod.rs"]
mod sample;

mod damage;
mod failing_sinks;
mod rings;
mod round_trip;
