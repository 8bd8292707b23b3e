//! Derivatives through the events of unilateral contact.
//!
//! The run without derivatives says what happens in a step: which events are due after which time, and what they do. The
//! numbers with derivatives do the same. At an event the condition of the mode that ends is zero, so the derivative of its
//! time is minus that of the condition, over the rate of the condition along the step (implicit function theorem). From there
//! on the time is a number with derivatives, until the step ends at a time that is fixed: the state jumps by the saltation
//! matrix.

use crate::driver::request::Request;
use crate::error::{Error, Result, seconds};
use crate::formulation::{ContactJump, MAX_COMPONENTS, RunDual, RunDualEquations, States, System};
use crate::method::{RunDualMethod, Runs, Step, Unsolved, values};
use crate::model::{ContactModel, Mode, SegmentDrive, Source};
use crate::number::{LaneTask, Lanes, Real, task};
use crate::stepping::{Cause, Event, EventResult, LaneContact, Limits, Moment, Passage, Segment};

/// Events closer together than this share of a step are one, whose derivative depends on their order.
const TOGETHER: f64 = 1e-9;
/// Events of the same kind of both tips are one if closer together than this share of the time since the last event.
const ALIKE: f64 = 1e-6;
/// A condition whose rate at its event is below this share of its mean rate in the step only grazes zero.
const GRAZING: f64 = 1e-6;
/// A share of a step in which round-off has a part in the mean rate.
const SHORT: f64 = 1e-3;

const COINCIDES: &str = "an event coincides with another one or with a breakpoint";

/// The method of a run with derivatives, and its contacts if they are unilateral.
pub struct Stepper<R> {
    pub method: RunDualMethod<R>,
    pub contact: Option<ContactDerivatives<R>>,
}

pub struct ContactDerivatives<R> {
    pub lane: LaneContact,
    pub passed: Passed<R>,
}

/// What a run has passed until now.
#[derive(Clone)]
pub struct Passed<R> {
    /// The time of the last event or breakpoint, and the end of the segment, since its start, s.
    between: [f64; 2],
    /// The times of the changes of modes.
    changes: Vec<RunDual<R>>,
    /// For each direction the time from which there are no derivatives, s, and the reason.
    lost: Vec<Option<(f64, &'static str)>>,
}

pub type DualStates<R> = States<RunDual<R>>;

/// The state at a time of the segment that starts at `anchor`, with its equations and what events are due at.
#[derive(Clone)]
pub struct Place<'a, R> {
    pub equations: &'a RunDualEquations<R>,
    pub limits: &'a Limits<RunDual<R>>,
    pub anchor: f64,
    pub drive: SegmentDrive<RunDual<R>>,
    pub tau: RunDual<R>,
    pub y: DualStates<R>,
}

task! {
    ['w, 'p, R: Lanes]
    Pass<'w, 'p, R>(contact: &'w mut ContactDerivatives<R>, method: &'w mut RunDualMethod<R>, place: &'w mut Place<'p, R>,
        h: f64, impulse: &'w [RunDual<R>; 3], log: &'w [Passage])
    for R => Result = contact.pass(method, place, (h, impulse), log)
}

task! {
    pub(super) ['a, D: Lanes, S: Source<D>] LimitsOf<'a, S>(source: &'a S) for D => Limits<D> = Limits::new(source)
}

impl<R: Lanes> Stepper<R> {
    /// The stepper at the start of a run with derivatives in `count` directions.
    pub fn new(runs: Runs<'_>, &Request { options, scene, .. }: &Request<'_>, count: usize) -> Result<Self> {
        let mut contact = None;
        if options.contact == ContactModel::Unilateral {
            let mut lane = LaneContact::new(options, scene);
            lane.restart(options, scene)?;
            let passed = Passed { between: [0.0; 2], changes: Vec::new(), lost: vec![None; count] };
            contact = Some(ContactDerivatives { lane, passed });
        }
        Ok(Self { method: RunDualMethod::new(runs, options.method), contact })
    }

    /// Why a direction has no derivatives from a time on, if so, and the derivatives of the times of changes of modes.
    pub fn changes(&self, direction: usize) -> (Option<String>, Vec<f64>) {
        let Some(Passed { changes, lost, .. }) = self.contact.as_ref().map(|contact| &contact.passed) else {
            return Default::default();
        };
        let (until, why) = lost[direction].unwrap_or((f64::INFINITY, ""));
        let lost = format!("sensitivities: at t = {} {why}, so there are no derivatives", seconds(until));
        let known = changes.iter().take_while(|time| time.lane(0) < until);
        ((until < f64::INFINITY).then_some(lost), known.map(|time| time.direction(direction)).collect())
    }

    /// Whether no direction has derivatives any more.
    pub fn has_lost_all(&self) -> bool {
        self.contact.as_ref().is_some_and(|contact| contact.passed.lost.iter().all(Option::is_some))
    }

    /// Chooses the modes at the start of a segment, before a step of length `h`. `moves` says in which directions the
    /// start moves.
    #[inline(always)]
    pub fn begin(
        &mut self,
        place: &mut Place<'_, R>,
        (segment, inputs, h): (&Segment, SegmentDrive, f64),
        moves: impl Fn(usize) -> bool,
    ) -> Result {
        let tau = place.tau.lane(0);
        let Some(ContactDerivatives { lane, passed, .. }) = &mut self.contact else { return Ok(()) };
        let modes = lane.run.modes();
        lane.enter(segment.anchor, inputs);
        passed.between = [tau, segment.end - segment.anchor];
        let begin = |lane: &mut LaneContact, y: &_| lane.begin(&Moment { earlier: false, tau, h, y });
        self.follow(place, (0.0, [RunDual::zero(); 3]), begin)?;
        if let Some(contact) = self.contact.as_mut().filter(|contact| contact.lane.run.modes() != modes) {
            let why = "the modes of contacts change at a breakpoint that a path moves";
            contact.passed.lose(place, |k| moves(k).then_some(why));
        }
        Ok(())
    }

    /// Lets an impulse act on the object, before a step of length `h`.
    #[inline(always)]
    pub fn strike(&mut self, place: &mut Place<'_, R>, (h, impulse): (f64, [RunDual<R>; 3])) -> Result {
        let Place { equations, drive, tau, y, .. } = place;
        if self.contact.is_none() {
            equations.system.jump(&drive.at(*tau), y, &impulse);
            return Ok(());
        }
        let plain = impulse.map(|number| number.lane(0));
        let strike = |lane: &mut LaneContact, y: &_| {
            let at = Moment { earlier: false, tau: 0.0, h, y };
            lane.change(&at, |stepper, place| stepper.strike(place, &plain))
        };
        self.follow(place, (0.0, impulse), strike).map(|_| ())
    }

    /// Takes a step of length `h`, with all events in it. `rate` is that at its start.
    #[inline(always)]
    pub fn step(&mut self, place: &mut Place<'_, R>, h: f64, rate: &DualStates<R>) -> Result {
        let (tau, by) = (place.tau, RunDual::constant(h));
        let next = place.arrive(&mut self.method, by, rate)?;
        let arrived = values(&next);
        let advance = |lane: &mut LaneContact, y: &_| {
            lane.advance(&Moment { earlier: false, tau: tau.lane(0), h, y }, &arrived)
        };
        if !self.follow(place, (h, [RunDual::zero(); 3]), advance)? {
            (place.tau, place.y) = (tau + by, next);
        }
        Ok(())
    }

    /// Lets the contacts do `work` in a step of length `h`, with an impulse on the object, and follows it to the end of the
    /// step. Returns whether anything happens.
    #[inline(always)]
    fn follow(
        &mut self,
        place: &mut Place<'_, R>,
        (h, impulse): (f64, [RunDual<R>; 3]),
        work: impl FnOnce(&mut LaneContact, &States<f64>) -> EventResult<States<f64>>,
    ) -> Result<bool> {
        let Self { method, contact: Some(contact), .. } = self else { return Ok(false) };
        let ended = work(&mut contact.lane, &values(&place.y)).is_err();
        let mut log = contact.lane.run.log.clone();
        while ended && !matches!(log.last(), None | Some(Passage::Modes(..))) {
            // The event at which the run ends happens after its last row.
            log.pop();
        }
        if log.is_empty() {
            return Ok(false);
        }
        let pass = Pass { contact, method, place, h, impulse: &impulse, log: &log };
        R::outlined(pass).map(|()| true)
    }
}

impl<R: Lanes> Passed<R> {
    /// From here on there are no derivatives in the directions for which `why` has a reason.
    fn lose(&mut self, place: &mut Place<'_, R>, why: impl Fn(usize) -> Option<&'static str>) {
        let time = place.anchor + place.tau.lane(0);
        for (k, lost) in self.lost.iter_mut().enumerate() {
            *lost = lost.or_else(|| Some((time, why(k)?)));
        }
        let slopes: Vec<_> = self.lost.iter().map(|lost| lost.map_or(0.0, |_| f64::NAN)).collect();
        let nothing = RunDual::varied(0.0, &slopes);
        place.y.iter_mut().for_each(|number| *number = *number + nothing);
    }
}

impl<R: Lanes> ContactDerivatives<R> {
    #[inline(always)]
    fn pass(
        &mut self,
        method: &mut RunDualMethod<R>,
        place: &mut Place<'_, R>,
        (h, impulse): (f64, &[RunDual<R>; 3]),
        log: &[Passage],
    ) -> Result {
        let end = place.tau + RunDual::constant(h);
        for (k, &passage) in log.iter().enumerate() {
            let Place { equations: RunDualEquations { system, .. }, drive, tau, y, .. } = place;
            match passage {
                Passage::Step(length, event) => {
                    // By round-off the same modes may be chosen again: nothing happens then.
                    let happens = !self.keeps_modes(&log[k + 1..]);
                    self.reach(method, place, (length, h), (event, happens))?;
                }
                Passage::Jump(jump) => system.apply((drive, *tau), y, jump, impulse),
                Passage::Undefined(why) => self.passed.lose(place, |_| Some(why)),
                Passage::Modes(contacts, changes) => {
                    self.passed.changes.resize(changes, RunDual::constant(place.anchor) + *tau);
                    // A tip that opens freezes its tilt.
                    let tilt = system.evaluate(drive, *tau, y).tilt;
                    let [right, left] = contacts;
                    let (kept, tilts) = (drive.contacts.frozen_tilt, [right.frozen_tilt, left.frozen_tilt]);
                    for lane in 0..R::WIDTH {
                        drive.contacts.set(lane, [right.mode, left.mode], tilts);
                    }
                    for i in 0..2 {
                        if contacts[i].mode == Mode::Free {
                            let same = kept[i].lane(0) == tilts[i];
                            drive.contacts.frozen_tilt[i].slope =
                                if same { kept[i].slope } else { tilt[i].slope };
                        }
                    }
                }
            }
        }
        if h > 0.0 {
            let now = place.equations.system.evaluate(&place.drive, place.tau, &place.y);
            method.restart();
            place.y = place.arrive(method, end - place.tau, &now.rate)?;
        }
        method.restart();
        place.tau = end;
        Ok(())
    }

    /// Whether the passages that follow an event choose the same modes again.
    fn keeps_modes(&self, then: &[Passage]) -> bool {
        let (&[Passage::Modes(_, changes), ..]
        | &[Passage::Jump(ContactJump::Absorb(_)), Passage::Modes(_, changes), ..]) = then
        else {
            return false;
        };
        changes == self.passed.changes.len()
    }

    /// Takes the step that leads to an event, with the derivative of its length.
    #[inline(always)]
    fn reach(
        &mut self,
        method: &mut RunDualMethod<R>,
        place: &mut Place<'_, R>,
        (length, h): (f64, f64),
        (event, happens): (Event, bool),
    ) -> Result {
        let (mut by, mut y, mut found) = (RunDual::constant(length), place.y, [[RunDual::<R>::zero(); 2]; 3]);
        // A tip that just touches at the start is relaxed but for round-off.
        let rests = event.cause == Cause::Relaxed && length <= TOGETHER * h;
        let Place { equations: RunDualEquations { system, .. }, limits, drive, tau, .. } = &*place;
        let mut now = system.evaluate(drive, *tau, &y);
        let rate = now.rate;
        let events = [event, Event { finger: 1 - event.finger, ..event }];
        // Derivatives are linear in that of the length, so two of them give the one at which the condition stays zero.
        for trial in 0..3 {
            method.restart();
            found[trial] = events.map(|event| limits.event_value(&now, &drive.contacts, event));
            let [_, [held, _], [moving, _]] = found;
            for k in 0..by.slope.len() {
                by.slope[k] = match trial {
                    1 => R::constant(1.0),
                    2 if !rests => -(held.slope[k] / (moving.slope[k] - held.slope[k])),
                    _ => R::zero(),
                };
            }
            y = place.arrive(method, by, &rate)?;
            now = system.evaluate(drive, *tau + by, &y);
        }
        let modes = |i: usize| [drive.contacts.free[i], drive.contacts.graze[i], drive.contacts.slip(i)];
        let alike = modes(0).map(|lanes| lanes & 1) == modes(1).map(|lanes| lanes & 1);
        (place.tau, place.y) = (place.tau + by, y);
        if !happens {
            return Ok(());
        }
        let (t, [last, end]) = (place.tau.lane(0), self.passed.between);
        self.passed.between[0] = t;
        let together = (t - last).min(end - t) <= TOGETHER * h;
        self.passed.lose(place, |k| {
            let [rate, other] = [0, 1].map(|i| found[2][i].direction(k) - found[1][i].direction(k));
            let falls = -rate * length > GRAZING * found[0][0].lane(0) || length < SHORT * h;
            // The other tip has the same event, too.
            let both = alike && found[2][1].lane(0).abs() < ALIKE * (t - last) * other.abs();
            match () {
                () if rests => None,
                () if together || both => Some(COINCIDES),
                () if !(rate < 0.0 && falls) => Some("an event only just happens"),
                () => None,
            }
        });
        Ok(())
    }
}

impl<R: Lanes> Place<'_, R> {
    /// The state after a step of the method. `rate` is that at its start.
    #[inline(always)]
    fn arrive(
        &self,
        method: &mut RunDualMethod<R>,
        h: RunDual<R>,
        rate: &DualStates<R>,
    ) -> Result<DualStates<R>> {
        let Self { equations, anchor, drive, tau, y, .. } = self;
        let (system, end) = (&equations.system, *tau + h);
        let mut next = *y;
        if h.lane(0).abs() <= f64::EPSILON * end.lane(0).abs() {
            // What round-off leaves of a step is too short to be solved. The derivative of its length counts.
            for n in 0..MAX_COMPONENTS {
                next[n] = y[n] + h * rate[n];
            }
            return Ok(next);
        }
        let step = Step { system, drive, tau: *tau, h, y, rate, allowed: None };
        // The equations were solved in the run, but not again to round-off.
        let attempt = method.step(equations, &step, &mut next);
        let time = anchor + end.lane(0);
        attempt.map_err(|Unsolved { correction, .. }| Error::NoDerivative { time, correction })?;
        system.correct(drive, end, &mut next);
        Ok(next)
    }
}
