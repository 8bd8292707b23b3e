//! How a run ends, in words: each message says the cause, with the numbers, and then what may help.

use crate::error::Error;
use crate::method::traits::Unsolved;
use crate::stepping::monitor::{STOPPABLE, VIOLATIONS};
use crate::stepping::status::Status;

/// How a run ended, and the same in words.
pub type End = (Status, String);

/// What the last attempt of an adaptive step came to.
#[derive(Debug, Clone, Copy)]
pub enum Attempt {
    /// There has been none.
    None,
    /// Its error, in allowed errors; at most one where the step was accepted.
    Error(f64),
    /// Its equations were not solved.
    Unsolved(Unsolved),
}

/// The message of a run that reached its end.
#[must_use]
pub fn arrival(t: f64) -> String {
    format!("reached the end at t = {t} s")
}

/// A run that the caller stopped.
#[cold]
pub fn interruption(t: f64) -> End {
    (Status::Interrupted, format!("stopped from outside at t = {t} s; run.state(-1) goes on from there"))
}

/// A run whose recording found no more memory.
#[cold]
pub fn full(t: f64, error: &Error) -> End {
    (Status::Interrupted, format!("stopped at t = {t} s: {error}; run.state(-1) goes on from there"))
}

/// A number overflowed in the step from `from`.
#[cold]
pub fn overflow(from: f64) -> End {
    let message = format!(
        "a number overflowed in the step from t = {from} s; the last row is the last finite instant. Shorter steps (a \
         smaller dt or tolerance) or a less extreme scene may help"
    );
    (Status::NotFinite, message)
}

/// The result of an iteration, in words.
fn failure(Unsolved { iterations, correction }: Unsolved) -> String {
    if correction.is_finite() {
        format!(
            "its correction was still {correction:.1e} of the states' sizes after {iterations} iterations"
        )
    } else {
        format!("a number overflowed in iteration {iterations}")
    }
}

/// The equations of a step of equal length were not solved.
#[cold]
pub fn unsolved(t: f64, h: f64, unsolved: Unsolved) -> End {
    let message = format!(
        "Newton's iteration did not converge in the step of {h:.3e} s from t = {t} s: {}. A smaller dt may help, or tolerance= \
         with a method that has it",
        failure(unsolved)
    );
    (Status::NewtonFailed, message)
}

/// An adaptive step became shorter than the clock resolves.
#[cold]
pub fn too_small(t: f64, h: f64, last: Attempt) -> End {
    let reason = match last {
        Attempt::None => {
            "the clock does not resolve a first step there; a start nearer to zero does".to_owned()
        }
        Attempt::Error(error) if !error.is_finite() => "a number overflowed in the last attempt".to_owned(),
        Attempt::Error(error) if error > 1.0 => {
            format!("the last attempt's error was still {error:.1e} times what tolerance allows")
        }
        Attempt::Error(_) => "the error asks for ever shorter ones".to_owned(),
        Attempt::Unsolved(unsolved) => {
            format!("in the last attempt Newton's iteration did not converge, {}", failure(unsolved))
        }
    };
    let message = format!(
        "no step was short enough at t = {t} s, down to {h:.3e} s: {reason}. The motion may run away there; else a larger \
         tolerance or another method may help"
    );
    (Status::StepTooSmall, message)
}

/// A run used up the steps that it may take.
#[cold]
pub fn too_many(t: f64, h: f64, most: u64) -> End {
    let message = format!(
        "{most} steps, rejected ones too, were not enough: it came to t = {t} s, where a step has {h:.3e} s. With an explicit method \
         the scene is stiff: \"radau5\" takes longer steps; else a larger tolerance or max_steps"
    );
    (Status::TooManySteps, message)
}

/// The end of a run that had gone on after a violation and then failed: no other step helps, but to end it at the violation. The
/// advice behind the message's cause is replaced.
pub fn after_violation(end: End, first_times: &[f64; VIOLATIONS.len()]) -> End {
    use Status::{NewtonFailed, NotFinite, StepTooSmall, TooManySteps};
    let (status, message) = end;
    let first = STOPPABLE
        .iter()
        .map(|&(name, violation)| (name, first_times[violation as usize]))
        .filter(|(_, t)| !t.is_nan())
        .min_by(|(_, a), (_, b)| a.total_cmp(b));
    let (true, Some((name, t))) =
        (matches!(status, NotFinite | NewtonFailed | StepTooSmall | TooManySteps), first)
    else {
        return (status, message);
    };
    let cause = message.split_once(". ").map_or(message.as_str(), |(cause, _)| cause);
    let message = format!(
        "{cause}. The run had gone on from t = {t} s, where it was {name} and the model stopped holding: with stop_on = {name:?} it \
         ends there"
    );
    (status, message)
}
