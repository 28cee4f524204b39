//! Damaged files give errors, never a panic, and never records that were not written.

use std::io::Cursor;
use std::sync::LazyLock;

use palpate_trace::{InlineTrace, Trace, TraceError, TraceReader};

mod sample;

/// A small whole trace: two steps.
static WHOLE: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let (mut trace, mut ticks, mut steps, mut factors) =
        InlineTrace::with_sink(Cursor::new(Vec::new()), &sample::config()).unwrap();
    for k in 0..2 {
        sample::push_step(k, &mut ticks, &mut steps, &mut factors);
    }
    trace.drain();
    trace.finish_into_sink().0.unwrap().into_inner()
});

fn read(bytes: &[u8]) -> (Trace, Option<TraceError>) {
    Trace::collect(TraceReader::new(Cursor::new(bytes), bytes.len() as u64, "memory"))
}

#[test]
fn every_truncation_is_an_error() {
    let (whole, damage) = read(&WHOLE);
    assert!(damage.is_none() && whole.ticks.len() == 66);
    for length in 0..WHOLE.len() {
        let (read, damage) = read(&WHOLE[..length]);
        let told = match damage {
            Some(TraceError::Foreign { empty: true, .. }) => length == 0,
            damage => length > 0 && matches!(damage, Some(TraceError::Damaged { .. })),
        };
        assert!(told, "cut to {length} bytes");
        assert!(read.ticks.len() <= 66);
    }
}

#[test]
fn every_flipped_byte_is_an_error() {
    let (whole, _) = read(&WHOLE);
    let mut bytes = WHOLE.clone();
    for place in 0..bytes.len() {
        // Lowest bit, highest bit and all bits, in turn.
        let mask = [0x01, 0x80, 0xff][place % 3];
        bytes[place] ^= mask;
        let (damaged, damage) = read(&bytes);
        // All is under some checksum or has only one legal value.
        assert!(damage.is_some(), "byte {place} ^ {mask:#x} passed unnoticed");
        assert!(damaged.ticks.len() <= whole.ticks.len());
        // Chunks are checked before they are read, so no sample is ever wrong.
        for (read, written) in damaged.ticks.iter().zip(&whole.ticks) {
            assert_eq!(read.force.map(f64::to_bits), written.force.map(f64::to_bits));
        }
        bytes[place] ^= mask;
    }
}

#[test]
fn noise_is_an_error() {
    // xorshift64* noise, also behind a valid beginning.
    let mut state = 0x1234_5678_9abc_def1_u64;
    let mut byte = || {
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        (state.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 56) as u8
    };
    for round in 0..2000 {
        let kept = if round % 2 == 0 { 0 } else { round * 7 % WHOLE.len() };
        let noise: Vec<u8> = WHOLE[..kept].iter().copied().chain((0..200).map(|_| byte())).collect();
        assert!(read(&noise).1.is_some());
    }
}

#[test]
fn bytes_after_the_end_are_an_error() {
    let mut bytes = WHOLE.clone();
    bytes.push(0);
    assert!(read(&bytes).1.is_some());
}

#[test]
fn what_is_no_trace_is_said_to_be_none() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("missing.mcap");
    assert!(matches!(Trace::load(&missing), Err(TraceError::Read { .. })));
    let text = folder.path().join("scene.toml");
    std::fs::write(&text, "[world]\nstep = 0.033\n").unwrap();
    let error = Trace::load(&text).unwrap_err().to_string();
    assert!(error.contains("scene.toml: not a trace"), "{error}");
}
