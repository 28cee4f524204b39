//! The producers allocate and free nothing. One test, so that no other thread of this program disturbs the count.

use assert_no_alloc::{AllocDisabler, assert_no_alloc, violation_count};
use palpate_trace::{LogLevel, LogRecord, Offer, Skin, TraceConfig, TraceThread};

mod sample;

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

#[test]
fn producers_allocate_nothing() {
    // The count works at all: one allocation and its release.
    assert_no_alloc(|| drop(std::hint::black_box(Box::new(7_u64))));
    let seen = violation_count();
    assert!(seen >= 1, "the allocator does not count");

    // Small rings, so that both ends of each are met: room, and full.
    let config = TraceConfig {
        tick_capacity: 256,
        step_capacity: 16,
        factor_capacity: 4,
        log_capacity: 4,
        geometry_buffers: 2,
        geometry_stride: 1,
        ..sample::config()
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let (trace, mut ticks, mut steps, mut factors) = TraceThread::spawn(&path, &config).unwrap();
    let mut taken = [0_u32; 5];
    // The skin of a body that is cut in every step: handed over and let go of without memory.
    let skin: Skin = vec![[0, 1, 2]].into();
    for k in 0..2000 {
        assert_no_alloc(|| {
            for n in 0..sample::TICKS_PER_STEP {
                taken[0] += u32::from(ticks.push(sample::tick(k * sample::TICKS_PER_STEP + n)));
            }
            taken[1] += u32::from(steps.push(sample::step(k)));
            taken[2] += u32::from(factors.push(sample::factor(k + 1)));
            let line = LogRecord::new(k, LogLevel::Info, "step", "a line of the log");
            taken[3] += u32::from(steps.log(line));
            taken[4] += u32::from(
                steps.push_positions(k, Some(&skin), |out| out.copy_from_slice(&sample::positions(k)))
                    != Offer::Dropped,
            );
        });
        if k % 10 == 0 {
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
    }
    assert_eq!(violation_count(), seen, "a producer allocated or freed");

    let summary = trace.finish();
    let dropped = summary.dropped;
    assert!(summary.failure.is_none());
    assert!(dropped.ticks > 0 && dropped.geometry > 0, "the rings were never full: {dropped:?}");
    let offered = [2000 * sample::TICKS_PER_STEP, 2000, 2000, 2000, 2000];
    let lost = [dropped.ticks, dropped.steps, dropped.factors, dropped.log, dropped.geometry];
    for k in 0..5 {
        assert_eq!(u64::from(taken[k]) + lost[k], offered[k], "each record is taken or counted");
        assert!(taken[k] > 0);
    }
}
