//! The threads of ensembles, sensitivities and stepped runs.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::{Error, Result};

/// Interval at which the caller is asked whether to stop.
const WATCH: Duration = Duration::from_millis(50);

/// Stops the other threads if its own panics.
struct StopOnPanic<'a>(&'a AtomicBool);

impl Drop for StopOnPanic<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.store(true, Ordering::Relaxed);
        }
    }
}

/// Does `work` for each of `parts` on a thread of the pool, and meanwhile `own` on the caller's thread, which gets the
/// results in any order. An error or a panic sets `stop`, at which work is expected to end.
pub fn share<P: Send, T: Send, O>(
    pool: &ThreadPool,
    parts: impl Iterator<Item = P>,
    stop: &AtomicBool,
    work: impl Fn(P) -> Result<T> + Sync,
    own: impl FnOnce(&Receiver<Result<T>>) -> O,
) -> O {
    let work = &work;
    let (sender, results) = channel();
    pool.in_place_scope(|scope| {
        for part in parts {
            let sender = sender.clone();
            scope.spawn(move |_| {
                let _guard = StopOnPanic(stop);
                let worked = work(part);
                if worked.is_err() {
                    stop.store(true, Ordering::Relaxed);
                }
                // If the receiver is gone, nobody needs the results.
                let _ = sender.send(worked);
            });
        }
        drop(sender);
        own(&results)
    })
}

/// Does `work` on each of `threads` new threads, and returns their results in any order. The work takes what is left to
/// do from a common source until there is nothing, or until `stop` is set: by an error or a panic of another thread, or
/// because `watch`, which is called from time to time on the caller's own thread, says so.
pub fn share_watched<T: Send>(
    threads: usize,
    stop: &AtomicBool,
    work: impl Fn() -> Result<T> + Sync,
    watch: &mut dyn FnMut() -> bool,
) -> Result<Vec<T>> {
    let mut watched = |results: &Receiver<Result<T>>| {
        let mut all = Vec::with_capacity(threads);
        loop {
            match results.recv_timeout(WATCH) {
                Ok(worked) => all.push(worked?),
                Err(RecvTimeoutError::Disconnected) => return Ok(all),
                Err(RecvTimeoutError::Timeout) => {
                    if watch() {
                        stop.store(true, Ordering::Relaxed);
                    }
                }
            }
        }
    };
    // The threads have ended when this returns.
    let shared = ThreadPoolBuilder::new()
        .num_threads(threads)
        .build_scoped(|thread| thread.run(), |pool| share(pool, 0..threads, stop, |_| work(), &mut watched));
    shared.unwrap_or_else(|error| Err(Error::Threads { threads, reason: error.to_string() }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_other_threads_stop_after_a_panic() {
        let (stop, first) = (AtomicBool::new(false), AtomicBool::new(true));
        let work = || {
            assert!(!first.swap(false, Ordering::Relaxed), "the first thread panics");
            while !stop.load(Ordering::Relaxed) {
                std::thread::yield_now();
            }
            Ok(())
        };
        let shared = std::panic::AssertUnwindSafe(|| share_watched(2, &stop, work, &mut || false));
        assert!(std::panic::catch_unwind(shared).is_err());
    }

    #[test]
    fn the_work_stops_where_the_caller_says_so_and_after_an_error() {
        let stop = AtomicBool::new(false);
        let until_stopped = || {
            while !stop.load(Ordering::Relaxed) {
                std::thread::yield_now();
            }
            Ok(1)
        };
        assert_eq!(share_watched(3, &stop, until_stopped, &mut || true), Ok(vec![1; 3]));
        let (stop, first) = (AtomicBool::new(false), AtomicBool::new(true));
        let refused = Error::Field { field: "dt".to_owned(), value: 0.0, rule: "must be positive" };
        let work = || {
            if first.swap(false, Ordering::Relaxed) {
                return Err(refused.clone());
            }
            while !stop.load(Ordering::Relaxed) {
                std::thread::yield_now();
            }
            Ok(1)
        };
        assert_eq!(share_watched(2, &stop, work, &mut || false), Err(refused.clone()));
    }
}
