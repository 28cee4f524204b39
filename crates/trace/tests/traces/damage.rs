//! Damaged files give errors, never a panic, and never records that were not written.

use crate::sample;
use std::io::Cursor;
use std::sync::LazyLock;

use palpate_trace::{InlineTrace, TickRecord, Trace, TraceError, TraceReader};

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
        // Chunks are checked before they are read, so no sample is ever wrong; what lies behind a damaged one is read.
        for read in &damaged.ticks {
            let written = &whole.ticks[read.tick as usize];
            assert_eq!(read.force.map(f64::to_bits), written.force.map(f64::to_bits));
        }
        bytes[place] ^= mask;
    }
}

/// What is lost is the chunk with the damage, and it is told by its place and times.
#[test]
fn a_damaged_chunk_is_told_by_its_times_and_the_others_are_read() {
    let (mut trace, mut ticks, mut steps, mut factors) =
        InlineTrace::with_sink(Cursor::new(Vec::new()), &sample::config()).unwrap();
    // A chunk a second at most.
    for k in 0..150 {
        sample::push_step(k, &mut ticks, &mut steps, &mut factors);
        trace.drain();
    }
    let mut bytes = trace.finish_into_sink().0.unwrap().into_inner();
    let (whole, damage) = read(&bytes);
    assert!(damage.is_none());
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x10;
    let (left, damage) = read(&bytes);
    let told = damage.as_ref().unwrap().to_string();
    println!("{told}");
    let Some(TraceError::Parts { parts, end: None, .. }) = damage else { panic!("{told}") };
    let [part] = parts.as_slice() else { panic!("{told}") };
    let place = middle as u64;
    assert!(part.offset <= place && place < part.offset + part.length, "{part:?}: byte {place}");
    let [from, to] = part.time_ns.unwrap();
    let (lost, kept): (Vec<&TickRecord>, Vec<&TickRecord>) =
        whole.ticks.iter().partition(|tick| left.ticks.iter().all(|left| left.tick != tick.tick));
    println!("lost {:?} to {:?}, {} kept", lost.first().map(|t| t.time_ns), lost.last().map(|t| t.time_ns), kept.len());
    assert!(lost.len() > 100 && kept.len() > 1000, "{} lost, {} kept", lost.len(), kept.len());
    assert!(lost.iter().all(|tick| (from..=to).contains(&tick.time_ns)), "{told}");
    assert!(kept.iter().any(|tick| tick.time_ns > to) && kept.iter().any(|tick| tick.time_ns < from));
    assert_eq!(kept.len(), left.ticks.len());

    // Several parts are one error; what is cut off behind them is told too.
    let third = bytes.len() / 3;
    bytes[third] ^= 0x10;
    let (fewer, damage) = read(&bytes[..bytes.len() * 4 / 5]);
    let told = damage.as_ref().unwrap().to_string();
    let Some(TraceError::Parts { parts, end: Some(_), .. }) = damage else { panic!("{told}") };
    assert!(parts.len() == 2 && fewer.ticks.len() < left.ticks.len(), "{told}");
}

/// Where the data of the first chunk begins, and its length: behind the magic each record has its kind and its length.
fn first_chunk(bytes: &[u8]) -> (usize, usize) {
    const CHUNK: u8 = 0x06;
    let mut place = 8;
    loop {
        let length = u64::from_le_bytes(bytes[place + 1..place + 9].try_into().unwrap()) as usize;
        if bytes[place] == CHUNK {
            return (place + 9, length);
        }
        place += 9 + length;
    }
}

/// The first chunk alone tells what the channels hold, but for the end of the file.
#[test]
fn a_trace_whose_first_chunk_is_lost_is_read_by_what_its_end_tells() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("first.mcap");
    let (mut trace, mut ticks, mut steps, mut factors) =
        InlineTrace::with_sink(Cursor::new(Vec::new()), &sample::config()).unwrap();
    for k in 0..90 {
        sample::push_step(k, &mut ticks, &mut steps, &mut factors);
        trace.drain();
    }
    let mut bytes = trace.finish_into_sink().0.unwrap().into_inner();
    let (whole, _) = read(&bytes);
    let (place, length) = first_chunk(&bytes);
    bytes[place + length / 2] ^= 0x10;
    std::fs::write(&path, &bytes).unwrap();
    let (left, damage) = Trace::recover(&path).unwrap();
    let told = damage.as_ref().unwrap().to_string();
    let Some(TraceError::Parts { parts, end: None, .. }) = damage else { panic!("{told}") };
    assert_eq!(parts.len(), 1, "{told}");
    let lost = whole.ticks.len() - left.ticks.len();
    assert!(left.ticks.len() > 1000, "{lost} lost, {} left", left.ticks.len());
    let samples =
        |ticks: &[TickRecord]| -> Vec<_> { ticks.iter().map(|t| (t.tick, t.force.map(f64::to_bits))).collect() };
    assert!(samples(&left.ticks) == samples(&whole.ticks[lost..]), "what is left is what was written");
    let numbers = |trace: &Trace| -> Vec<u64> { trace.steps.iter().map(|step| step.step).collect() };
    assert!(!left.steps.is_empty() && numbers(&whole).ends_with(&numbers(&left)));
    // The bytes alone, read once from start to end, do not tell it in time.
    let (blind, damage) = read(&bytes);
    assert!(damage.unwrap().to_string().contains("no whole end") && blind.ticks.is_empty());

    // Of a run that was killed there is no end to tell it.
    std::fs::write(&path, &bytes[..bytes.len() * 9 / 10]).unwrap();
    let (left, damage) = Trace::recover(&path).unwrap();
    let told = damage.as_ref().unwrap().to_string();
    let Some(TraceError::Parts { end: Some(end), .. }) = damage else { panic!("{told}") };
    assert!(matches!(*end, TraceError::Undescribed { .. }) && told.contains("no whole end"), "{told}");
    assert!(left.ticks.is_empty());
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
