//! The ways in which a run ends, also in words: each message gives the cause with its numbers, and then advice.

use crate::error::{Error, seconds};
use crate::formulation::States;
use crate::method::Unsolved;
use crate::model::{Coordinates, Geometry, Mode, SIDES, Scene};
use crate::names::named;
use crate::number::signed;
use crate::stepping::monitor::{explain, half_length};
use crate::stepping::{Instant, STOP_ON, VIOLATIONS, Violation};

named! {
    /// How a run ended.
    Status;
    STATUSES = {
        /// The run reached its end.
        Completed = "completed",
        /// A tip left the object.
        Separated = "separated",
        /// A tip was pressed flat.
        Crushed = "crushed",
        /// A tip was tilted by 90 degrees.
        Folded = "folded",
        /// A tip pulled, and the run was to end there.
        Pulling = "pulling",
        /// A tip needed more friction than there is, and the run was to end there.
        Slipping = "slipping",
        /// A contact reached the rim of its tip, and the run was to end there.
        Rim = "rim",
        /// A contact left its face, and the run was to end there.
        OffFace = "off_face",
        /// A tip opened, and the run was to end there.
        Opened = "opened",
        /// Unilateral contact: a contact left its face, or the object is beside neither tip.
        Lost = "lost",
        /// Unilateral contact: the modes changed too often within one step.
        Chattering = "chattering",
        /// Unilateral contact: no modes were admissible.
        NoMode = "no_mode",
        /// A number overflowed.
        NotFinite = "not_finite",
        /// The equations of an implicit step were not solved.
        NewtonFailed = "newton_failed",
        /// No step was short enough for the allowed error.
        StepTooSmall = "step_too_small",
        /// The run used up its steps.
        TooManySteps = "too_many_steps",
        /// The caller stopped the run.
        Interrupted = "interrupted",
        /// The steps were beyond the stability limit of the method.
        Unstable = "unstable",
    }
}

impl Status {
    /// The status of a run that ends because of a violation. The violations follow `Completed` in their own order.
    pub(crate) fn of(violation: Violation) -> Self {
        STATUSES[1 + violation as usize].1
    }
}

/// Largest number of events within one step of the run.
pub(crate) const MOST_EVENTS: usize = 64;

/// How the object is lost. A finger is 0 for the right one, 1 for the left one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Loss {
    /// The closed contact of this finger left its face.
    OffFace(usize),
    /// The free tip of this finger met the end of the face.
    MetEnd(usize),
    /// Both tips are free, and neither is beside its face.
    Apart,
}

/// Why a run ends at an event of its contacts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Reason {
    Lost(Loss),
    /// A violation that was to end the run, and that events locate.
    Broken(Violation),
    /// More than [`MOST_EVENTS`] events within one step.
    Chattering,
    NoMode,
    Unsolved(Unsolved),
    NotFinite,
}

/// The end of a run at an event of its contacts.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ContactEnd {
    pub reason: Reason,
    /// The time since the start of the segment, s.
    pub tau: f64,
    pub y: States<f64>,
}

pub(crate) type EventResult<T = ()> = Result<T, Box<ContactEnd>>;

/// The status with which a run ended, and its message.
pub(crate) type End = (Status, String);

/// The end of a run that has gone well, which needs no words.
pub(crate) fn completed() -> End {
    (Status::Completed, String::new())
}

/// The message of a run that reached its end.
pub fn arrival(t: f64) -> String {
    format!("reached the end at t = {}", seconds(t))
}

#[cold]
pub(crate) fn interruption(t: f64) -> End {
    let t = seconds(t);
    (Status::Interrupted, format!("stopped from outside at t = {t}; run.state(-1) goes on from there"))
}

/// The end of a run whose recording found no more memory.
#[cold]
pub(crate) fn full(t: f64, error: &Error) -> End {
    let t = seconds(t);
    (Status::Interrupted, format!("stopped at t = {t}: {error}; run.state(-1) goes on from there"))
}

/// The end of a run in which a number overflowed, in the step that started at `from`.
#[cold]
pub(crate) fn overflow(from: f64) -> End {
    let from = seconds(from);
    let message = format!(
        "a number overflowed in the step from t = {from}; the last row is the last finite instant. Shorter steps (a \
         smaller dt or tolerance) or a less extreme scene may help"
    );
    (Status::NotFinite, message)
}

/// The end of a run with steps of length `h` whose energy ledger is open by `error` at time `t`, which is more than
/// the energy `supplied` to the motion so far. Steps up to `stable` are surely stable.
#[cold]
pub(crate) fn unstable(t: f64, h: f64, (error, supplied): (f64, f64), stable: f64) -> End {
    let message = format!(
        "the energy ledger is open by {error:.3e} J at t = {}, where only {supplied:.3e} J were ever put in: steps of {h:.3e} s are \
         too long for the method to be stable, and the run is not the motion. dt <= {stable:.2e} s is surely short enough, \
         max_stable_dt finds the longest step, and \"radau5\" is stable for every step",
        seconds(t)
    );
    (Status::Unstable, message)
}

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
pub(crate) fn unsolved(t: f64, h: f64, unsolved: Unsolved) -> End {
    let message = format!(
        "Newton's iteration did not converge in the step of {h:.3e} s from t = {}: {}. A smaller dt may help, or tolerance= \
         with a method that has it",
        seconds(t),
        failure(unsolved)
    );
    (Status::NewtonFailed, message)
}

/// The end of a run whose adaptive steps became shorter than double precision resolves. The last attempt was `unsolved`, or
/// had this error in units of the allowed one; a negative error stands for no attempt.
#[cold]
pub(crate) fn too_small(t: f64, h: f64, (unsolved, error): (Option<Unsolved>, f64)) -> End {
    let reason = match unsolved {
        Some(unsolved) => {
            format!("in the last attempt Newton's iteration did not converge, {}", failure(unsolved))
        }
        None if error < 0.0 => {
            "the clock does not resolve a first step there; start at a time nearer to zero".to_owned()
        }
        None if !error.is_finite() => "a number overflowed in the last attempt".to_owned(),
        None if error > 1.0 => {
            format!("the last attempt's error was still {error:.1e} times what tolerance allows")
        }
        None => "the error control kept shortening the steps".to_owned(),
    };
    let t = seconds(t);
    let message = format!(
        "no step was short enough at t = {t}, down to {h:.3e} s: {reason}. The motion may diverge there; otherwise a larger \
         tolerance or another method may help"
    );
    (Status::StepTooSmall, message)
}

#[cold]
pub(crate) fn too_many(t: f64, h: f64, most: u64) -> End {
    let t = seconds(t);
    let message = format!(
        "{most} steps, rejected ones too, were not enough: the run reached t = {t} with a step length of {h:.3e} s. If the method is \
         explicit, the scene is stiff: \"radau5\" takes longer steps. Otherwise raise tolerance or max_steps"
    );
    (Status::TooManySteps, message)
}

/// The end of a run at an event of its contacts, which have these modes at the `last` instant.
#[cold]
pub(crate) fn contact(scene: &Scene, last: &Instant, reason: Reason, modes: [Mode; 2], h: f64) -> End {
    let t = seconds(last.t);
    let words = format!("the right tip {}, the left tip {}", modes[0].word(), modes[1].word());
    match reason {
        Reason::Lost(loss) => (
            Status::Lost,
            format!(
                "the object was lost at t = {t}: {}; more friction, targets that close the fingers further, gentler disturbances and \
                 moves, or higher faces would keep it",
                lost(scene, last, loss, modes)
            ),
        ),
        Reason::Broken(violation) => {
            (Status::of(violation), explain(&scene.parameters, violation, false, last))
        }
        Reason::Chattering => (
            Status::Chattering,
            format!(
                "the modes of the contacts changed more than {MOST_EVENTS} times within one step at t = {t} ({words}): as a rule two \
                 contacts open each other in turn, ever faster. Another dt, method or formulation seldom helps; tips of another \
                 normal_mass (half of it, say), or less friction, may avoid it"
            ),
        ),
        Reason::NoMode => (
            Status::NoMode,
            format!(
                "no modes of the contacts were admissible at t = {t} (so far {words}). Friction is beyond the critical coefficient there; \
                 less friction or less mass of the tips would avoid it"
            ),
        ),
        Reason::Unsolved(cause) => unsolved(last.t, h, cause),
        Reason::NotFinite => overflow(last.t),
    }
}

/// Describes how the object was lost: which tip, how far from the middle of its face, and how far the face has slipped.
fn lost(scene: &Scene, last: &Instant, loss: Loss, modes: [Mode; 2]) -> String {
    let (initial, last) = (&scene.initial.motion, &last.motion);
    let [start, now] =
        [initial, last].map(|motion| Geometry::of_scene(&scene.parameters, &motion.q, &motion.p).contacts);
    let halves = [0, 1].map(|i| half_length::<f64>(&scene.parameters, i));
    let of = |i: usize| {
        // The integral of C^N (12), in which a - d_n in front of theta_p-dot is taken by the trapezoidal rule.
        let along = |place: f64, q: &Coordinates| signed(i, place) + q.shear[i];
        let compressions = initial.q.compression[i] + last.q.compression[i];
        let thickness = scene.parameters.tips[i].radius - 0.5 * compressions;
        let slipped = along(now[i].place, &last.q) - along(start[i].place, &initial.q)
            + thickness * (now[i].tilt - start[i].tilt);
        let (place, begun, slipped) = (now[i].place.abs(), start[i].place.abs(), slipped.abs());
        format!(
            "{place:.3e} m from the middle of the face, {begun:.3e} m at the start; the face slipped {slipped:.3e} m over it; half the height \
             is {:.3e} m",
            halves[i]
        )
    };
    match loss {
        Loss::OffFace(i) => {
            let (side, word) = (SIDES[i], modes[i].word());
            format!("the contact of the {side} tip, which {word}, left its face ({})", of(i))
        }
        Loss::MetEnd(i) => {
            format!("the {} tip, which is free, met the end of the face ({})", SIDES[i], of(i))
        }
        Loss::Apart => format!(
            "both tips are free, and neither is beside its face any longer (the right one is {:.3e} m, the left one {:.3e} m from the \
             middle of the face; half the height is {:.3e} m)",
            now[0].place.abs(),
            now[1].place.abs(),
            halves[0]
        ),
    }
}

/// The end, at time `last`, of a run that first went on after a violation and then failed. No other step helps then,
/// only a stop at the violation. The message keeps its cause, but this advice replaces its own.
pub(crate) fn after_violation(end: End, last: f64, first_times: &[f64; VIOLATIONS.len()]) -> End {
    use Status::{NewtonFailed, NotFinite, StepTooSmall, TooManySteps, Unstable};
    let (status, message) = end;
    let first = STOP_ON
        .iter()
        .map(|&(name, violation)| (name, first_times[violation as usize]))
        .filter(|&(_, t)| t < last || t == last && status != Unstable)
        .min_by(|(_, a), (_, b)| a.total_cmp(b));
    let (true, Some((name, t))) =
        (matches!(status, NotFinite | Unstable | NewtonFailed | StepTooSmall | TooManySteps), first)
    else {
        return (status, message);
    };
    let cause = message.split_once(". ").map_or(message.as_str(), |(cause, _)| cause);
    let message = format!(
        "{cause}. The run had gone on from t = {}, where it was {name} and the model stopped holding: with stop_on = {name:?} it \
         ends there",
        seconds(t)
    );
    (status, message)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stepping::monitor::VIOLATIONS;

    #[test]
    fn a_run_that_a_violation_ends_has_its_name() {
        for (name, violation) in VIOLATIONS {
            assert_eq!(Status::of(violation).name(), name);
        }
    }
}
