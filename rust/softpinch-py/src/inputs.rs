//! Schedule and disturbances across the border to Python, for one run or for many. The first axis of every
//! array is that of the runs; it has length one if all runs share the array.

use std::sync::Arc;

use numpy::PyReadonlyArray4;
use numpy::ndarray::ArrayView1;
use pyo3::prelude::*;

use crate::convert::{GivenRow, GivenRows, collected, columns, entries, raise, require, select};
use softpinch::error::{Error, lookup};
use softpinch::model::{
    FINGERS, Fingers, GainSwitch, HandMotion, Impulse, Inputs as CoreInputs, MAX_DEGREE, MEASURES, Measure,
    Noise, PiecewisePolynomial, Place, SampledController, Sinusoid,
};

/// Breaks (runs, m) and coefficients (runs, m + 1, channels, terms).
type Piecewise<'py> = (GivenRows<'py>, PyReadonlyArray4<'py, f64>);
/// Standard deviations, rate, start and end (runs, 6); the seed; the runs' numbers (runs,); the stream.
type NoiseTuple<'py> = (GivenRows<'py>, u64, GivenRow<'py, u64>, u64);

/// Names of the measures, number of states, anti-windup and whether jitter is normal, and the numbers of each run (runs, k):
/// period, instant of the first sample, delay of measures, delay, loss, jitter, limit of the rate, rate without load, limits (4), initial torque (2), A, B, C, D,
/// initial state, noise, resolution and dead zone; of a second set of gains A, B, C, D, instant and thresholds, if its
/// measure, or an empty name, and `latched` are given.
type BlockTuple<'py> = (Vec<String>, usize, [bool; 2], GivenRows<'py>, Option<(String, bool)>);
/// The blocks of a cascade, seed and the runs' numbers (runs,).
type ControllerTuple<'py> = (Vec<BlockTuple<'py>>, u64, GivenRow<'py, u64>);

/// Accelerations of the hand's frame along fixed axes, its tilt, and the sinusoids (runs, 5) that add to them: angular
/// frequency, phase at time 0, amplitudes of both accelerations and of the tilt.
type MotionTuple<'py> = (Piecewise<'py>, Piecewise<'py>, GivenRows<'py>);

/// A part of the inputs, with an entry for each run, or one entry that all runs share.
struct Part<T>(Vec<T>);

impl<T: Clone> Part<T> {
    fn of(&self, run: usize) -> Result<T, Error> {
        let own = self.0.get(if self.0.len() == 1 { 0 } else { run });
        let (found, rule) = (format_args!("no entry for run {run}"), "must have one for each run");
        own.cloned().ok_or_else(|| Error::shape("inputs", found, rule))
    }
}

type Block = Part<Arc<SampledController>>;

/// Schedule and disturbances in the form that the core takes.
#[pyclass(frozen, module = "softpinch._core")]
pub struct Inputs {
    schedule: Part<Arc<PiecewisePolynomial<2>>>,
    forces: Vec<Part<Arc<PiecewisePolynomial<3>>>>,
    sines: Vec<Part<Sinusoid>>,
    impulses: Vec<Part<Impulse>>,
    noises: Vec<(Part<Noise>, Part<u64>)>,
    fingers: Fingers,
    controller: Option<(Vec<Block>, Part<u64>)>,
    motion: Option<Part<Arc<HandMotion>>>,
}

impl Inputs {
    /// Refuses parts that have entries for different numbers of runs.
    fn check(&self) -> PyResult<()> {
        let mut lengths = [self.schedule.0.len()]
            .into_iter()
            .chain(self.forces.iter().map(|part| part.0.len()))
            .chain(self.sines.iter().map(|part| part.0.len()))
            .chain(self.impulses.iter().map(|part| part.0.len()))
            .chain(self.noises.iter().flat_map(|(part, numbers)| [part.0.len(), numbers.0.len()]))
            .chain(self.controller.iter().map(|(_, numbers)| numbers.0.len()))
            .chain(self.controller.iter().flat_map(|(blocks, _)| blocks.iter().map(|part| part.0.len())))
            .chain(self.motion.iter().map(|part| part.0.len()))
            .filter(|&length| length != 1);
        let first = lengths.next().unwrap_or(1);
        let other = lengths.find(|&length| length != first).unwrap_or(first);
        require(other == first, || {
            format!("inputs have {first} entries and {other} entries: must have one for each run")
        })
    }

    /// The inputs of one run. The first run has the number 0. A discrete controller takes its first sample at
    /// `origin`, s.
    pub fn of(&self, run: usize, origin: f64) -> Result<CoreInputs, Error> {
        let noises = self.noises.iter().map(|(part, numbers)| {
            let noise = part.of(run)?;
            Ok(Noise { key: [noise.key[0], numbers.of(run)?], ..noise })
        });
        let inputs = CoreInputs::new(
            self.schedule.of(run)?,
            self.forces.iter().map(|part| part.of(run)).collect::<Result<_, _>>()?,
            self.sines.iter().map(|part| part.of(run)).collect::<Result<_, _>>()?,
            self.impulses.iter().map(|part| part.of(run)).collect::<Result<_, _>>()?,
            noises.collect::<Result<_, Error>>()?,
        )?;
        let motion = self.motion.as_ref().map(|part| part.of(run)).transpose()?;
        let inputs = inputs.with_hand_motion(motion);
        let Some((parts, numbers)) = &self.controller else {
            return Ok(inputs.with_fingers(self.fingers));
        };
        let blocks = parts.iter().map(|part| part.of(run)).collect::<Result<_, _>>()?;
        let controller = SampledController::cascade(blocks, numbers.of(run)?);
        let (found, rule) = ("no blocks", "must have one or more");
        let controller = controller.ok_or_else(|| Error::shape("control", found, rule))?;
        Ok(inputs.with_controller(controller, origin))
    }
}

#[pymethods]
impl Inputs {
    #[new]
    #[pyo3(signature = (schedule, forces, sines, impulses, noises, fingers, controller=None, motion=None))]
    fn new(
        schedule: Piecewise<'_>,
        forces: Vec<Piecewise<'_>>,
        sines: Vec<GivenRows<'_>>,
        impulses: Vec<GivenRows<'_>>,
        noises: Vec<NoiseTuple<'_>>,
        fingers: &str,
        controller: Option<ControllerTuple<'_>>,
        motion: Option<MotionTuple<'_>>,
    ) -> PyResult<Self> {
        let forces = forces.iter().enumerate();
        let inputs = Self {
            schedule: piecewise("schedule", &schedule)?,
            forces: forces
                .map(|(k, own)| piecewise(&format!("forces[{k}]"), own))
                .collect::<PyResult<_>>()?,
            sines: sines.iter().map(|rows| part("sines", rows, sinusoid)).collect::<PyResult<_>>()?,
            impulses: impulses.iter().map(|rows| part("impulses", rows, impulse)).collect::<PyResult<_>>()?,
            noises: noises
                .iter()
                .map(|(rows, seed, numbers, stream)| {
                    let noise = |row| noise(row, *seed, *stream);
                    Ok((part("noises", rows, noise)?, Part(entries("the runs' numbers", numbers)?)))
                })
                .collect::<PyResult<_>>()?,
            fingers: lookup("fingers", fingers, &FINGERS).map_err(raise)?,
            controller: match controller {
                None => None,
                Some((given, seed, numbers)) => {
                    let blocks = given.iter().map(|own| blocks(own, seed)).collect::<PyResult<_>>()?;
                    Some((blocks, Part(entries("the runs' numbers", &numbers)?)))
                }
            },
            motion: motion.map(hand_motion).transpose()?,
        };
        inputs.check().map(|()| inputs)
    }

    /// `State.controller` of the first run at `time`, s, at which its controller starts; empty if it has none.
    fn controller(&self, time: f64) -> PyResult<Vec<f64>> {
        Ok(self.of(0, time).map_err(raise)?.controller_row())
    }
}

fn hand_motion((accelerations, tilts, sines): MotionTuple<'_>) -> PyResult<Part<Arc<HandMotion>>> {
    let accelerations = piecewise::<2>("motion.acceleration", &accelerations)?.0;
    let (tilts, sines) = (piecewise::<1>("motion.tilt", &tilts)?.0, columns::<5>("motion.sines", &sines)?);
    let motions = accelerations.iter().zip(tilts).zip(sines).map(|((acceleration, tilt), sine)| {
        let (acceleration, tilt) = (acceleration.as_ref().clone(), tilt.as_ref().clone());
        Arc::new(HandMotion { acceleration, tilt, sine })
    });
    Ok(Part(motions.collect()))
}

fn blocks(
    (names, states, [anti_windup, normal_jitter], rows, switch): &BlockTuple<'_>,
    seed: u64,
) -> PyResult<Block> {
    let measures: Vec<Measure> = select("control.measures", names, &MEASURES)?;
    let m: usize = measures.iter().map(|measure| measure.width()).sum();
    let n = *states;
    let rows = rows.as_array();
    let second = if switch.is_some() { (n + 2) * (n + m) + 3 } else { 0 };
    let (found, width) = (rows.ncols(), 14 + (n + 2) * (n + m) + n + 3 * m + second);
    require(found == width, || format!("control: has {found} numbers, must have {width}"))?;
    let one = |row: ArrayView1<'_, f64>| {
        let mut rest = row.iter().skip(14).copied();
        let mut take = |count: usize| rest.by_ref().take(count).collect::<Vec<f64>>();
        Arc::new(SampledController {
            period: row[0],
            first_sample: row[1],
            measure_delay: row[2],
            delay: row[3],
            loss: row[4],
            jitter: row[5],
            normal_jitter: *normal_jitter,
            rate_limit: row[6],
            no_load_rate: row[7],
            limits: [[row[8], row[9]], [row[10], row[11]]],
            initial_torque: [row[12], row[13]],
            a: take(n * n),
            b: take(n * m),
            c: take(2 * n),
            d: take(2 * m),
            initial_state: take(n),
            noise: take(m),
            resolution: take(m),
            dead_zone: take(m),
            switch: switch.as_ref().map(|(name, latched)| {
                let k = names.iter().position(|own| own == name).unwrap_or(names.len());
                let first: usize = measures[..k].iter().map(|measure| measure.width()).sum();
                let entries = [first, first + measures.get(k).map_or(0, |measure| measure.width())];
                let gains = [n * n, n * m, 2 * n, 2 * m].map(&mut take);
                let [at, above, below] = [(); 3].map(|()| take(1)[0]);
                GainSwitch { at, entries, above, below, latched: *latched, gains }
            }),
            measures: measures.clone(),
            anti_windup: *anti_windup,
            key: [seed, 0],
            outer: None,
            place: Place::default(),
        })
    };
    Ok(Part(rows.rows().into_iter().map(one).collect()))
}

/// A part of the inputs from rows of exactly `N` numbers, one row for each run.
fn part<T, const N: usize>(
    name: &str,
    rows: &GivenRows<'_>,
    make: impl Fn([f64; N]) -> T,
) -> PyResult<Part<T>> {
    Ok(Part(columns(name, rows)?.into_iter().map(make).collect()))
}

fn sinusoid([start, end, omega, phase, amplitude @ ..]: [f64; 7]) -> Sinusoid {
    Sinusoid { start, end, omega, phase, amplitude }
}

fn impulse([time, impulse @ ..]: [f64; 4]) -> Impulse {
    Impulse { time, impulse }
}

fn noise([x, y, moment, rate, start, end, u, v]: [f64; 8], seed: u64, stream: u64) -> Noise {
    Noise { std: [x, y, moment], acceleration: [u, v], rate, start, end, key: [seed, 0], stream }
}

/// A piecewise polynomial of `C` channels for each run.
fn piecewise<const C: usize>(
    name: &str,
    (breaks, coefficients): &Piecewise<'_>,
) -> PyResult<Part<Arc<PiecewisePolynomial<C>>>> {
    let (breaks, coefficients) = (breaks.as_array(), coefficients.as_array());
    let (runs, rows, channels, terms) = coefficients.dim();
    let (own, most) = (breaks.nrows(), MAX_DEGREE + 1);
    require(own == runs && channels == C && (1..=most).contains(&terms), || {
        format!(
            "{name}.coefficients has shape ({runs}, {rows}, {channels}, {terms}): must be ({own}, rows, {C}, 1 to {most})"
        )
    })?;
    let one = |run: usize| {
        let number = |row: usize, channel: usize, term: usize| {
            if term < terms { coefficients[[run, row, channel, term]] } else { 0.0 }
        };
        let series = |row: usize, channel: usize| std::array::from_fn(|term| number(row, channel, term));
        let table = (0..rows).map(|row| std::array::from_fn(|channel| series(row, channel)));
        let table = collected("the coefficients, in numbers,", table)?;
        let breaks = collected("the breaks, in numbers,", breaks.row(run).iter().copied())?;
        let made = PiecewisePolynomial::new(name, breaks, table).map(Arc::new);
        made.map_err(|error| raise(if runs == 1 { error } else { error.of_run(run) }))
    };
    Ok(Part((0..runs).map(one).collect::<PyResult<_>>()?))
}
