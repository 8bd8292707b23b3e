//! The intervals of time during which the violations hold in one run.

use crate::error::Error;
use crate::model::Mode;
use crate::stepping::record::MOST_VALUES;
use crate::stepping::{Change, VIOLATIONS, ViolationSet};

/// Largest number of intervals of one violation, as far as the size of a recording is limited.
const MOST_INTERVALS: usize = (MOST_VALUES / 2.0) as usize; // a small whole number

/// The intervals of a run so far. An interval has the times of the first and of the last of consecutive
/// watched instants that show the violation.
pub struct Intervals {
    /// The violations at the last watched instant, and its time.
    found: ViolationSet,
    last: f64,
    /// For each of [`VIOLATIONS`] the intervals, s; the end of one that lasts is NaN.
    intervals: [Vec<[f64; 2]>; VIOLATIONS.len()],
    limit: usize,
    /// The error that says that there is no memory for an interval. The run has to end then.
    pub refusal: Option<Error>,
}

/// No intervals, before the first instant.
impl Default for Intervals {
    fn default() -> Self {
        let (found, intervals) = Default::default();
        Self { found, last: f64::NAN, intervals, limit: MOST_INTERVALS, refusal: None }
    }
}

impl Intervals {
    #[inline(always)]
    pub fn note(&mut self, t: f64, found: ViolationSet) {
        if found != self.found {
            self.change(t, found);
        }
        self.last = t;
    }

    #[cold]
    #[inline(never)]
    fn change(&mut self, t: f64, found: ViolationSet) {
        for (intervals, (_, violation)) in self.intervals.iter_mut().zip(VIOLATIONS) {
            match (self.found.contains(violation), found.contains(violation)) {
                (false, true) => keep(intervals, [t, f64::NAN], self.limit, &mut self.refusal),
                (true, false) => end(intervals, self.last),
                _ => {}
            }
        }
        self.found = found;
    }

    /// Adds one more change of a contact. If there is no room for it, the run has to end.
    pub fn keep_change(&mut self, changes: &mut Vec<Change>, change: Change) {
        keep(changes, change, self.limit, &mut self.refusal);
    }

    /// The intervals at the end of the run, which ends those that last.
    pub fn finish(&mut self) -> [Vec<[f64; 2]>; VIOLATIONS.len()] {
        let mut all = std::mem::take(&mut self.intervals);
        for intervals in &mut all {
            end(intervals, self.last);
        }
        all
    }
}

/// The intervals of a run that ends at `end`, during which the mode of a contact was one of those that `shows`
/// names. The modes are first those of `start`, and then the `changes` follow.
pub fn of_changes(
    start: [Mode; 2],
    changes: &[Change],
    end: f64,
    from: f64,
    shows: impl Fn(Mode) -> bool,
) -> Vec<[f64; 2]> {
    let mut modes = start;
    // What changes at the very start, such as a slip that the first impact stops, has not lasted.
    let mut lasts = [0, 1].map(|i| !changes.iter().any(|change| change.finger == i && change.time == from));
    let shown = |modes: [Mode; 2], lasts: [bool; 2]| (0..2).any(|i| lasts[i] && shows(modes[i]));
    let mut intervals = Vec::new();
    let mut since = shown(modes, lasts).then_some(from);
    for change in changes {
        (modes[change.finger], lasts[change.finger]) = (change.after, true);
        match (since, shown(modes, lasts)) {
            (None, true) => since = Some(change.time),
            (Some(begin), false) => {
                intervals.push([begin, change.time]);
                since = None;
            }
            _ => {}
        }
    }
    intervals.extend(since.map(|begin| [begin, end]));
    intervals
}

fn end(intervals: &mut [[f64; 2]], t: f64) {
    if let Some(interval) = intervals.last_mut().filter(|interval| interval[1].is_nan()) {
        interval[1] = t;
    }
}

/// Adds one more interval. If there is no room for it, the refusal says so.
fn keep<T>(intervals: &mut Vec<T>, interval: T, limit: usize, refusal: &mut Option<Error>) {
    let count = intervals.len();
    if count < limit && intervals.try_reserve(1).is_ok() {
        return intervals.push(interval);
    }
    *refusal = Some(Error::TooLarge {
        what: "the violations' intervals, in numbers,",
        needed: 2.0 * (count + 1) as f64,
        limit: 2.0 * limit as f64,
        advice: "simulate a shorter time, or stop_on= the violation that comes and goes",
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stepping::monitor::Violation::{Pulling, Rim};

    #[test]
    fn intervals_have_the_first_and_the_last_instant_that_show_a_violation() {
        let mut intervals = Intervals::default();
        for (t, found) in [
            (0.0, vec![]),
            (1.0, vec![Pulling]),
            (2.0, vec![Pulling, Rim]),
            (3.0, vec![Rim]),
            (4.0, vec![Pulling]),
            (5.0, vec![]),
            (6.0, vec![Rim]),
            (7.0, vec![Rim]),
        ] {
            intervals.note(t, found.into_iter().collect());
        }
        let all = intervals.finish();
        assert_eq!(all[Pulling as usize], [[1.0, 2.0], [4.0, 4.0]]);
        assert_eq!(all[Rim as usize], [[2.0, 3.0], [6.0, 7.0]]);
        assert_eq!(all.iter().map(Vec::len).sum::<usize>(), 4);
    }

    #[test]
    fn a_violation_that_comes_and_goes_too_often_is_refused_and_the_rest_is_kept() {
        let mut intervals = Intervals { limit: 3, ..Intervals::default() };
        let mut t = 0.0;
        while intervals.refusal.is_none() {
            intervals.note(t, [Pulling].into_iter().collect());
            intervals.note(t + 1.0, ViolationSet::default());
            t += 2.0;
        }
        assert_eq!(t, 8.0);
        let message = intervals.refusal.take().map(|error| error.to_string()).unwrap_or_default();
        assert!(message.contains("the violations' intervals"), "{message}");
        assert_eq!(intervals.finish()[Pulling as usize], [[0.0, 0.0], [2.0, 2.0], [4.0, 4.0]]);
    }
}
