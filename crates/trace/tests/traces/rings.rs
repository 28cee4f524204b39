//! Rings drop and count when full; the thread writes what was pushed before it is told to finish.

use crate::sample;
use std::io::Cursor;

use palpate_trace::{Dropped, InlineTrace, LogLevel, LogRecord, Offer, Trace, TraceConfig, TraceReader, TraceThread};

#[test]
fn a_full_ring_drops_the_newest_and_counts() {
    let config = TraceConfig {
        tick_capacity: 10,
        step_capacity: 3,
        factor_capacity: 2,
        log_capacity: 4,
        geometry_buffers: 2,
        geometry_stride: 1,
        solids: sample::solids(),
        ..sample::config()
    };
    let (mut trace, mut ticks, mut steps, mut factors) =
        InlineTrace::with_sink(Cursor::new(Vec::new()), &config).unwrap();
    // Nobody drains: the first fit, the rest do not.
    let taken = (0..25).filter(|&k| ticks.push(sample::tick(k))).count();
    assert_eq!(taken, 10);
    assert_eq!((0..7).filter(|&k| steps.push(sample::step(k))).count(), 3);
    assert_eq!((1..6).filter(|&k| factors.push(sample::factor(k))).count(), 2);
    let bodies = (0..8).filter(|&k| steps.push_rigid(sample::rigid(k))).count();
    assert_eq!(bodies, 3, "one body moves: as many records as steps");
    let line = LogRecord::new(0, LogLevel::Info, "step", "line");
    assert_eq!((0..9).filter(|_| steps.log(line)).count(), 4);
    assert_eq!((0..6).filter(|_| trace.log(line)).count(), 4);
    let mut filled = 0;
    for k in 0..5 {
        steps.push_positions(k, None, |out| {
            out.copy_from_slice(&sample::positions(k));
            filled += 1;
        });
    }
    assert_eq!(filled, 2, "without a free buffer nothing is filled");
    let dropped = Dropped { ticks: 15, steps: 4, rigid: 5, factors: 3, log: 5 + 2, geometry: 3 };
    assert_eq!(trace.status().dropped, dropped);

    // Room again after a drain, buffers included.
    trace.drain();
    assert!(ticks.push(sample::tick(25)));
    assert_eq!(steps.push_positions(5, None, |out| out.fill(0.0)), Offer::Taken);

    let (sink, summary) = trace.finish_into_sink();
    assert_eq!(summary.dropped, dropped);
    let bytes = sink.unwrap().into_inner();
    let length = bytes.len() as u64;
    let (read, damage) = Trace::collect(TraceReader::new(Cursor::new(bytes), length, "memory"));
    assert!(damage.is_none());
    let expected: Vec<u64> = (0..10).chain([25]).collect();
    assert_eq!(read.ticks.iter().map(|tick| tick.tick).collect::<Vec<_>>(), expected);
    assert_eq!(read.metadata["dropped"]["ticks"], "15");
    assert_eq!(read.metadata["dropped"]["geometry"], "3");
    assert_eq!(read.others["/tissue/surface"], 3);
}

#[test]
fn the_thread_writes_all_that_was_pushed_before_finish() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let (mut trace, mut ticks, mut steps, mut factors) = TraceThread::spawn(&path, &sample::config()).unwrap();
    // Three producers on their own threads, as in a run.
    std::thread::scope(|scope| {
        scope.spawn(|| (0..5000).for_each(|k| assert!(ticks.push(sample::tick(k)))));
        scope.spawn(|| (0..150).for_each(|k| assert!(steps.push(sample::step(k)))));
        scope.spawn(|| (1..50).for_each(|k| assert!(factors.push(sample::factor(k)))));
    });
    assert!(trace.log(LogRecord::new(5_000_000_000, LogLevel::Info, "run", "ended by the user")));
    let summary = trace.finish();
    assert!(summary.failure.is_none(), "{summary}");
    assert_eq!(summary.dropped.total(), 0);
    assert_eq!(summary.bytes, std::fs::metadata(&path).unwrap().len());

    let read = Trace::load(&path).unwrap();
    assert!(read.ticks.iter().map(|tick| tick.tick).eq(0..5000));
    assert!(read.steps.iter().map(|step| step.step).eq(0..150));
    assert!(read.factors.iter().map(|factor| factor.epoch).eq(1..50));
    assert_eq!(read.log[0].message(), "ended by the user");

    // Whoever still pushes afterwards gets no panic: the ring fills, then drops.
    for k in 0..10_000 {
        ticks.push(sample::tick(k));
    }
}

#[test]
fn a_dropped_trace_is_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    {
        let (_trace, mut ticks, _steps, _factors) = TraceThread::spawn(&path, &sample::config()).unwrap();
        assert!(ticks.push(sample::tick(400)));
    }
    assert_eq!(Trace::load(&path).unwrap().ticks, [sample::tick(400)]);
}

#[test]
fn a_killed_run_keeps_what_was_flushed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let (mut trace, mut ticks, mut steps, mut factors) = InlineTrace::create(&path, &sample::config()).unwrap();
    for k in 0..100 {
        assert!(sample::push_step(k, &mut ticks, &mut steps, &mut factors));
        trace.drain();
    }
    // The file as a kill would leave it: nothing written at the end.
    let copy = folder.path().join("killed.mcap");
    std::fs::copy(&path, &copy).unwrap();
    let (read, damage) = Trace::recover(&copy).unwrap();
    assert!(damage.is_some(), "a file without its end must not pass for whole");
    assert!(Trace::load(&copy).is_err());
    // 3.3 s of ticks, of which the last flush period of 1 s may be missing.
    let (pushed, kept) = (100 * sample::TICKS_PER_STEP, read.ticks.len() as u64);
    assert!(kept + 1000 + sample::TICKS_PER_STEP >= pushed, "{kept} of {pushed} ticks");
    assert!(read.ticks.iter().map(|tick| tick.tick).eq(0..kept));
    assert_eq!(trace.finish().messages.len(), 9);
}
