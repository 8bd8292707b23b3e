//! What is kept of a run with derivatives: rows at given times, or its summaries and its end.

use crate::driver::sensitivities::COMPONENTS;
use crate::formulation::equations::{Evaluation, States};
use crate::formulation::run_dual::{RunDual, RunDualSystem};
use crate::formulation::system::System;
use crate::model::contact_modes::Contacts;
use crate::model::energy::BILATERAL_WORKS;
use crate::model::motion::Motion;
use crate::model::source::DIRECTIONS;
use crate::number::lanes::{LaneTask, Lanes};
use crate::number::real::Real;
use crate::stepping::summary::{Summaries, Summary, SummaryInstant, Wanted};

/// The place of the derivatives of some directions among those of all.
pub(super) struct Rows<'a> {
    pub(super) times: &'a [f64],
    /// The components of all rows, each with one number for every direction.
    pub(super) numbers: &'a mut [f64],
    /// The first of the directions, and the number of all directions.
    pub(super) first: usize,
    pub(super) width: usize,
    pub(super) taken: usize,
}

/// The summaries of a run and its last state, with their derivatives.
pub(super) struct Ends<R> {
    summaries: Summaries<RunDual<R>>,
    until: f64,
    last: Option<Motion<RunDual<R>>>,
}

/// What takes the instants of a run with derivatives.
pub(super) enum Sink<'a, R> {
    Rows(Rows<'a>),
    Ends(Ends<R>),
}

impl<R: Lanes> Sink<'_, R> {
    /// Whether it needs no further instant.
    pub(super) fn is_full(&self) -> bool {
        match self {
            Self::Rows(rows) => rows.taken == rows.times.len(),
            Self::Ends(ends) => ends.last.is_some(),
        }
    }

    /// Whether it wants the instant at this end of a step.
    #[inline(always)]
    pub(super) fn wants(&self, time: f64) -> bool {
        match self {
            Self::Rows(rows) => rows.times.get(rows.taken) == Some(&time),
            Self::Ends(ends) => ends.last.is_none(),
        }
    }

    /// The next instant that it wants inside a step that ends at `end`.
    pub(super) fn next_before(&self, end: f64) -> Option<f64> {
        match self {
            Self::Rows(rows) => rows.times.get(rows.taken).copied().filter(|&time| time < end),
            Self::Ends(_) => None,
        }
    }

    /// Writes NaN for the rows that are missing, because the run cannot be followed to them.
    pub(super) fn give_up(&mut self) {
        if let Self::Rows(rows) = self {
            let Rows { times, numbers, first, width, taken } = rows;
            let columns = *first..(*width).min(*first + DIRECTIONS);
            for component in *taken * COMPONENTS..times.len() * COMPONENTS {
                numbers[component * *width..][columns.clone()].fill(f64::NAN);
            }
        }
    }
}

/// Gives an instant to a sink.
pub(super) struct Take<'a, 's, R> {
    pub(super) sink: &'a mut Sink<'s, R>,
    pub(super) system: &'a RunDualSystem<R>,
    pub(super) time: f64,
    pub(super) now: &'a Evaluation<RunDual<R>>,
    pub(super) y: &'a States<RunDual<R>>,
}

impl<R: Lanes> LaneTask<R> for Take<'_, '_, R> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { sink, system, time, now, y } = self;
        match sink {
            Sink::Rows(rows) => rows.take(system, now, y),
            Sink::Ends(ends) => ends.take(time, now),
        }
    }
}

impl Rows<'_> {
    #[inline(always)]
    fn take<R: Lanes>(
        &mut self,
        system: &RunDualSystem<R>,
        now: &Evaluation<RunDual<R>>,
        y: &States<RunDual<R>>,
    ) {
        let mut energy = [RunDual::zero(); 3 + BILATERAL_WORKS];
        let size = system.size();
        if size.works > 0 {
            let energies = system.energies(&Contacts::sticking(), &now.motion);
            energy[..3].copy_from_slice(&[energies.kinetic, energies.elastic, energies.gravity]);
            energy[3..].copy_from_slice(&y[size.states..size.all()]);
        }
        let Motion { q, p, memory } = now.motion;
        let motion = q.row().into_iter().chain(p.row()).chain(memory);
        let row = motion.chain(now.multipliers).chain(now.torque).chain(energy);
        let Self { first, width, .. } = *self;
        for (component, number) in row.enumerate() {
            let from = (self.taken * COMPONENTS + component) * width;
            for k in first..width.min(first + DIRECTIONS) {
                self.numbers[from + k] = number.direction(k - first);
            }
        }
        self.taken += 1;
    }
}

impl<R: Lanes> Ends<R> {
    /// Takes the summaries of a run until the time of its last instant.
    pub(super) fn new(wanted: &Wanted, until: f64) -> Self {
        Self { summaries: Summaries::new(wanted), until, last: None }
    }

    #[inline(always)]
    fn take(&mut self, time: f64, now: &Evaluation<RunDual<R>>) {
        let zero = RunDual::zero();
        let t = RunDual::constant(time);
        let instant = SummaryInstant { t, now, slip_speed: zero, closure: zero, half_width: zero };
        self.summaries.watch(&instant, R::ALL);
        if time >= self.until {
            self.last = Some(now.motion);
        }
    }

    /// The derivatives of the last state; NaN if the run did not get so far.
    pub(super) fn state(&self, direction: usize) -> [f64; 18] {
        let Some(Motion { q, p, .. }) = self.last else { return [f64::NAN; 18] };
        let (q, p) = (q.row(), p.row());
        std::array::from_fn(|n| if n < 9 { q[n] } else { p[n - 9] }.direction(direction))
    }

    /// The derivative of a summary; NaN if it has none, or has seen no instant.
    pub(super) fn slope(&self, summary: Summary, direction: usize) -> f64 {
        let memory = self.summaries.memory(summary);
        let values = memory.map(|number| number.lane(0));
        if self.last.is_none() || !values[0].is_finite() {
            return f64::NAN;
        }
        summary.slope(values, memory.map(|number| number.direction(direction))).unwrap_or(f64::NAN)
    }
}
