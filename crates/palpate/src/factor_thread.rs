//! The factor stage on a thread of its own in real time, and what becomes of a run in which that thread dies.
//!
//! The step never waits for it: without the thread the last factor that it handed over stays, older by the step, and where
//! it preconditions no more the step factors its own matrix. So a hand keeps its force, and the run says at its end what
//! happened.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

use palpate_haptics::exchange::Sender;

use crate::pace::{NAP, Pacer};
use crate::record::FactorLine;
use crate::refresh::{Refresh, RefreshReport};

/// The end of a factor thread before that of its run.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct FactorThreadDeath {
    /// When (s).
    pub(crate) time: f64,
    /// What the panic said.
    pub(crate) reason: String,
}

impl FactorThreadDeath {
    /// What there is to say of it at the end of a run.
    pub(crate) fn note(&self) -> String {
        format!(
            "the factor thread died at {:.3} s ({}): the run went on with the last factor that it had made, and with factors of \
             the steps' own where that did not do; please report it",
            self.time, self.reason
        )
    }
}

/// Refreshes the factor until `end`, or until a refresh panics, which it tells in `death`.
pub(crate) fn refresh_until(
    end: &AtomicBool,
    refresh: &mut Refresh,
    trace: &mut FactorLine,
    pacer: Pacer,
    reports: Sender<RefreshReport>,
    death: &OnceLock<FactorThreadDeath>,
) {
    let clock = pacer.clone();
    // What a panic leaves half done is never read: a factor is handed over whole.
    let all = AssertUnwindSafe(|| refresh_loop(refresh, trace, pacer, reports, end));
    if let Err(panic) = catch_unwind(all) {
        let _ = death.set(FactorThreadDeath { time: clock.time(), reason: reason(panic.as_ref()) });
    }
}

fn refresh_loop(
    refresh: &mut Refresh,
    trace: &mut FactorLine,
    mut pacer: Pacer,
    mut reports: Sender<RefreshReport>,
    end: &AtomicBool,
) {
    refresh.wake_here();
    while pacer.wait_or_called(end, || refresh.is_urged()).is_some() {
        refresh.want();
        let report = loop {
            if end.load(Ordering::Acquire) {
                return;
            }
            match refresh.refresh(|| pacer.time()) {
                Some(report) => break report,
                // The step that has a matrix wakes it.
                None => std::thread::park_timeout(NAP),
            }
        };
        trace.push(&report, true);
        reports.send(report);
    }
}

/// The words of a panic.
fn reason(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("a panic without words").to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::{Engine, workers};
    use crate::replay::replay;
    use crate::run::{Length, Observer, RunOptions};
    use crate::slide::slide;
    use crate::step::StepReport;
    use crate::summary::RunEnd;
    use crate::tick::TickReport;

    #[derive(Default)]
    struct Seen(Vec<StepReport>, Vec<TickReport>);

    impl Observer for Seen {
        fn step(&mut self, report: &StepReport) {
            self.0.push(*report);
        }

        fn tick(&mut self, report: &TickReport) {
            self.1.push(*report);
        }
    }

    #[test]
    fn a_run_whose_factor_thread_dies_goes_on_to_its_end_with_force_and_says_so() {
        const LAST: u64 = 2;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("death.mcap");
        let world = slide(1.0);
        let options = RunOptions { length: Length::Seconds(1.2), trace: Some(path.clone()), ..RunOptions::default() };
        let pool = workers(Some(1)).unwrap();
        let mut engine = pool.install(|| Engine::new(&world, &options)).unwrap();
        engine.refresh.as_mut().unwrap().die_after(LAST);
        let mut seen = Seen::default();
        let outcome = crate::realtime::run(engine, &pool, &options, &AtomicBool::new(false), &mut seen).unwrap();

        let summary = outcome.summary;
        assert_eq!((summary.end, summary.factors), (RunEnd::Completed, LAST));
        let died = summary.factor_thread_died.expect("it died");
        assert!(died < 1.2, "{died}");
        assert!(summary.notes.iter().any(|note| note.contains("the factor thread died at")), "{:?}", summary.notes);
        // Every step went on with what there was.
        let Seen(steps, ticks) = seen;
        let after: Vec<_> = steps.iter().filter(|step| step.time > died).collect();
        assert!(after.len() > 5 && after.iter().all(|step| step.factor_epoch == LAST));
        let ages: Vec<_> = after.iter().map(|step| step.factor_age).collect();
        assert!(ages.windows(2).all(|pair| pair[0] < pair[1]), "the factor ages: {ages:?}");
        assert!(after.iter().any(|step| step.active > 0 && step.force.norm() > 0.05), "it presses on");
        assert!(ticks.iter().all(|tick| tick.record.wrench.force.iter().all(|f| f.is_finite())));
        assert!(ticks.iter().any(|tick| tick.record.time > died && tick.record.wrench.force.norm() > 0.05));
        assert!(replay(&path).unwrap().is_identical());
    }

    #[test]
    fn a_matrix_that_arrives_wakes_the_thread_that_waits_for_it() {
        let world = slide(1.0);
        let Engine { mut stage, refresh, .. } = Engine::new(&world, &RunOptions::default()).unwrap();
        let mut refresh = refresh.unwrap();
        std::thread::scope(|scope| {
            let waiting = scope.spawn(move || {
                refresh.wake_here();
                refresh.want();
                std::iter::repeat_with(|| {
                    refresh.refresh(|| 0.0).or_else(|| {
                        std::thread::park();
                        None
                    })
                })
                .flatten()
                .next()
            });
            // The first step after it has asked has the matrix; some seconds of them, where it never wakes.
            let woken = (0..5000).any(|step| {
                stage.advance(f64::from(step) / 30.0);
                waiting.is_finished()
            });
            waiting.thread().unpark();
            assert!(woken && waiting.join().unwrap().is_some_and(|report| report.epoch == 1));
        });
    }
}
