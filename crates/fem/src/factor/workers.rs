//! Two pieces of work, side by side where the caller has workers to spare.

/// Runs both. On a worker of a pool with several threads they may run side by side; on any other thread, as a factor
/// thread that is to keep off the cores of the step, one after the other. Nothing may depend on which it was.
pub(super) fn join<A: Send, B: Send>(first: impl FnOnce() -> A + Send, second: impl FnOnce() -> B + Send) -> (A, B) {
    if are_many() { rayon::join(first, second) } else { (first(), second()) }
}

/// Whether the caller has workers to spare.
pub(super) fn are_many() -> bool {
    rayon::current_thread_index().is_some() && rayon::current_num_threads() > 1
}
