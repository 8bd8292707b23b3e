//! Threads that share one work while the caller watches.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use crate::error::Error;

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

/// Does `work` on each of `threads` threads, and returns their results in any order. The work takes what is left to do
/// from a common source until there is nothing, or until `stop` is set: by an error or a panic of another thread, or
/// because `watch`, which is called from time to time on the caller's own thread, says so.
///
/// Stepped runs do not come here: their periods take microseconds, so that their threads wait for work (`period.rs`).
pub(super) fn share<T: Send>(
    threads: usize,
    stop: &AtomicBool,
    work: impl Fn() -> Result<T, Error> + Sync,
    watch: &mut dyn FnMut() -> bool,
) -> Result<Vec<T>, Error> {
    let work = &work;
    let (sender, results) = channel();
    std::thread::scope(|scope| {
        for _ in 0..threads {
            let sender = sender.clone();
            let thread = std::thread::Builder::new().spawn_scoped(scope, move || {
                let _guard = StopOnPanic(stop);
                let worked = work();
                if worked.is_err() {
                    stop.store(true, Ordering::Relaxed);
                }
                // The receiver waits for all threads. If it is gone, nobody needs the results.
                let _ = sender.send(worked);
            });
            if let Err(error) = thread {
                stop.store(true, Ordering::Relaxed);
                return Err(Error::Threads { threads, reason: error.to_string() });
            }
        }
        drop(sender);
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
    })
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
        let shared = std::panic::AssertUnwindSafe(|| share(2, &stop, work, &mut || false));
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
        assert_eq!(share(3, &stop, until_stopped, &mut || true), Ok(vec![1; 3]));
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
        assert_eq!(share(2, &stop, work, &mut || false), Err(refused.clone()));
    }
}
