//! The ends of runs in words. Each message gives the cause with its numbers, and then advice.

use crate::error::Error;
use crate::method::traits::Unsolved;
use crate::model::contact_modes::Mode;
use crate::stepping::contact_events::Reason;
use crate::stepping::event_stepper::MOST_EVENTS;
use crate::stepping::monitor::{STOP_ON, VIOLATIONS};
use crate::stepping::status::Status;

/// The status with which a run ended, and its message.
pub type End = (Status, String);

/// The result of the last attempt of an adaptive step.
#[derive(Debug, Clone, Copy)]
pub enum Attempt {
    /// There has been no attempt.
    None,
    /// The error, in units of the allowed error; at most one if the step was accepted.
    Error(f64),
    /// The equations of the step were not solved.
    Unsolved(Unsolved),
}

/// The message of a run that reached its end.
#[must_use]
pub fn arrival(t: f64) -> String {
    format!("reached the end at t = {t} s")
}

/// The end of a run that the caller stopped.
#[cold]
pub fn interruption(t: f64) -> End {
    (Status::Interrupted, format!("stopped from outside at t = {t} s; run.state(-1) goes on from there"))
}

/// The end of a run whose recording found no more memory.
#[cold]
pub fn full(t: f64, error: &Error) -> End {
    (Status::Interrupted, format!("stopped at t = {t} s: {error}; run.state(-1) goes on from there"))
}

/// The end of a run in which a number overflowed, in the step that started at `from`.
#[cold]
pub fn overflow(from: f64) -> End {
    let message = format!(
        "a number overflowed in the step from t = {from} s; the last row is the last finite instant. Shorter steps (a \
         smaller dt or tolerance) or a less extreme scene may help"
    );
    (Status::NotFinite, message)
}

/// Describes an iteration that did not converge.
fn failure(Unsolved { iterations, correction }: Unsolved) -> String {
    if correction.is_finite() {
        format!(
            "its correction was still {correction:.1e} of the states' sizes after {iterations} iterations"
        )
    } else {
        format!("a number overflowed in iteration {iterations}")
    }
}

/// The end of a run in which the equations of a step of fixed length were not solved.
#[cold]
pub fn unsolved(t: f64, h: f64, unsolved: Unsolved) -> End {
    let message = format!(
        "Newton's iteration did not converge in the step of {h:.3e} s from t = {t} s: {}. A smaller dt may help, or tolerance= \
         with a method that has it",
        failure(unsolved)
    );
    (Status::NewtonFailed, message)
}

/// The end of a run whose adaptive steps became shorter than double precision resolves.
#[cold]
pub fn too_small(t: f64, h: f64, last: Attempt) -> End {
    let reason = match last {
        Attempt::None => {
            "the clock does not resolve a first step there; start at a time nearer to zero".to_owned()
        }
        Attempt::Error(error) if !error.is_finite() => "a number overflowed in the last attempt".to_owned(),
        Attempt::Error(error) if error > 1.0 => {
            format!("the last attempt's error was still {error:.1e} times what tolerance allows")
        }
        Attempt::Error(_) => "the error control kept shortening the steps".to_owned(),
        Attempt::Unsolved(unsolved) => {
            format!("in the last attempt Newton's iteration did not converge, {}", failure(unsolved))
        }
    };
    let message = format!(
        "no step was short enough at t = {t} s, down to {h:.3e} s: {reason}. The motion may diverge there; otherwise a larger \
         tolerance or another method may help"
    );
    (Status::StepTooSmall, message)
}

/// The end of a run that used up its steps.
#[cold]
pub fn too_many(t: f64, h: f64, most: u64) -> End {
    let message = format!(
        "{most} steps, rejected ones too, were not enough: the run reached t = {t} s with a step length of {h:.3e} s. If the method is \
         explicit, the scene is stiff: \"radau5\" takes longer steps. Otherwise raise tolerance or max_steps"
    );
    (Status::TooManySteps, message)
}

/// The end of a run at an event of its contacts, which have these modes at time `t`.
#[cold]
pub fn contact(t: f64, reason: Reason, [right, left]: [Mode; 2], h: f64) -> End {
    let modes = format!("the right tip {}, the left tip {}", right.word(), left.word());
    match reason {
        Reason::Lost => (
            Status::Lost,
            format!(
                "the object was lost at t = {t} s ({modes}): a contact left its face, or a free tip met the end of the face, or neither \
                 tip is beside its face"
            ),
        ),
        Reason::Chattering => (
            Status::Chattering,
            format!(
                "the modes of the contacts changed more than {MOST_EVENTS} times within one step at t = {t} s ({modes}). A tip with more mass \
                 or less friction may help"
            ),
        ),
        Reason::NoMode => (
            Status::NoMode,
            format!(
                "no modes of the contacts were admissible at t = {t} s (so far {modes}). Friction is beyond the critical coefficient there; \
                 less friction or less mass of the tips would avoid it"
            ),
        ),
        Reason::Unsolved(cause) => unsolved(t, h, cause),
        Reason::NotFinite => overflow(t),
    }
}

/// The end of a run that first went on after a violation and then failed. No other step helps then, only a
/// stop at the violation. The message keeps its cause, but this advice replaces its own.
pub fn after_violation(end: End, first_times: &[f64; VIOLATIONS.len()]) -> End {
    use Status::{NewtonFailed, NotFinite, StepTooSmall, TooManySteps};
    let (status, message) = end;
    let first = STOP_ON
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
