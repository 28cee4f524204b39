//! Many cases on all cores, each on one thread with a pool of one worker: a case is the same wherever it runs.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use miette::{IntoDiagnostic, Result};

use crate::chart::Work;

/// The answers to `cases`, in their order; `None` for those that had not ended when somebody ended the work.
///
/// # Errors
/// The first that a case returns.
pub(crate) fn in_parallel<C: Sync, T: Send>(
    cases: &[C],
    work: &Work,
    name: impl Fn(&C) -> String + Sync,
    answer: impl Fn(&C) -> Result<T> + Sync,
) -> Result<Vec<Option<T>>> {
    let workers = std::thread::available_parallelism().map_or(1, usize::from).min(cases.len());
    let pool = |_| rayon::ThreadPoolBuilder::new().num_threads(1).build().into_diagnostic();
    let pools = (0..workers).map(pool).collect::<Result<Vec<_>>>()?;
    let begun = AtomicUsize::new(0);
    let answers: Mutex<Vec<Option<Result<T>>>> = Mutex::new(cases.iter().map(|_| None).collect());
    let attend = || {
        loop {
            let index = begun.fetch_add(1, Ordering::Relaxed);
            let Some(case) = cases.get(index) else { break };
            if !work.next(&name(case)) {
                break;
            }
            let answer = answer(case);
            // What is ended early answers something else.
            if work.stopped() {
                break;
            }
            if let Some(place) = answers.lock().unwrap_or_else(PoisonError::into_inner).get_mut(index) {
                *place = Some(answer);
            }
        }
    };
    std::thread::scope(|scope| {
        for pool in &pools {
            scope.spawn(|| pool.install(attend));
        }
    });
    let answers = answers.into_inner().unwrap_or_else(PoisonError::into_inner);
    answers.into_iter().map(Option::transpose).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::AtomicBool;

    use miette::miette;

    use super::*;

    #[test]
    fn answers_keep_their_order_errors_are_told_and_a_stop_leaves_the_rest_out() {
        let stop = Arc::new(AtomicBool::new(false));
        let work = Work::new(Arc::clone(&stop), true);
        let cases: Vec<usize> = (0..20).collect();
        let squares = in_parallel(&cases, &work, usize::to_string, |k| Ok(k * k)).unwrap();
        assert_eq!(squares, cases.iter().map(|k| Some(k * k)).collect::<Vec<_>>());
        let fails = |k: &usize| if *k == 7 { Err(miette!("seven")) } else { Ok(*k) };
        assert_eq!(in_parallel(&cases, &work, usize::to_string, fails).unwrap_err().to_string(), "seven");
        let stops = |k: &usize| {
            stop.store(*k >= 5, Ordering::Relaxed);
            Ok(*k)
        };
        let answers = in_parallel(&cases, &work, usize::to_string, stops).unwrap();
        assert!(answers.len() == 20 && answers[10..].iter().all(Option::is_none), "{answers:?}");
    }
}
