//! Many runs: threads that take one run after the other, each into the lane that has become free.
//!
//! Every run gives the bits that it gives alone, whoever computes it beside which others.

use std::borrow::Cow;
use std::marker::PhantomData;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use crate::control::Fingers;
use crate::energy::LedgerRow;
use crate::error::Error;
use crate::formulation::{Choice, Chosen, System};
use crate::grid::Grid;
use crate::integrator::dop853::InDop853;
use crate::integrator::rk4::InRk4;
use crate::integrator::rosenbrock::InRosenbrock;
use crate::integrator::{AdaptiveInLanes, InLanes, Method, Runs};
use crate::lanes::Lanes;
use crate::monitor::VIOLATIONS;
use crate::record::{Instant, reserved};
use crate::simd::{Instructions, LaneKernel, dispatch_lanes};
use crate::simulate::{Options, Run, Scene, Status, Steps, require_sound, simulate};
use crate::stepping::adaptive::AdaptiveSteps;
use crate::stepping::batch::{Equip, Finished, LaneParameters, RunQueue, Watched};
use crate::stepping::equal::EqualSteps;
use crate::summary::COUNT;

/// How often the caller is told how far the runs are, and asked whether to stop.
const WATCH: Duration = Duration::from_millis(50);

/// What is left of one run.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Its number.
    pub run: usize,
    /// How it ended.
    pub status: Status,
    /// The same in words; empty where it reached its end, which needs no words of its own.
    pub message: String,
    /// Its last instant, s.
    pub t: f64,
    /// Coordinates there.
    pub q: [f64; 9],
    /// Velocities there.
    pub p: [f64; 9],
    /// When each of [`VIOLATIONS`] was first seen, s; NaN for never.
    pub violations: [f64; VIOLATIONS.len()],
    /// Steps taken.
    pub steps: u64,
    /// The summaries, in the order of [`SUMMARIES`](crate::summary::SUMMARIES).
    pub summaries: [f64; COUNT],
}

impl Row {
    /// Of a run that was simulated alone.
    fn of(number: usize, run: Run) -> Self {
        let mut violations = [f64::NAN; VIOLATIONS.len()];
        for (time, (name, _)) in violations.iter_mut().zip(VIOLATIONS) {
            let found = run.violations.iter().find(|(seen, _)| *seen == name);
            *time = found.map_or(f64::NAN, |(_, first)| *first);
        }
        Self {
            run: number,
            status: run.status,
            message: if run.status == Status::Completed { String::new() } else { run.message },
            t: run.last.t,
            q: run.last.q,
            p: run.last.p,
            violations,
            steps: run.stats.steps,
            summaries: run.summaries,
        }
    }
}

/// Gives the scene of each run.
pub type Scenes<'a> = dyn Fn(usize) -> Result<Scene, Error> + Sync + 'a;

/// What the threads share.
pub struct Shared<'a> {
    scenes: &'a Scenes<'a>,
    /// How each run is simulated.
    pub options: &'a Options,
    runs: usize,
    fingers: OnceLock<Fingers>,
    next: AtomicUsize,
    done: AtomicUsize,
    stop: AtomicBool,
}

impl<'a> Shared<'a> {
    /// Nothing done yet.
    pub fn new(scenes: &'a Scenes<'a>, runs: usize, options: &'a Options) -> Self {
        let (next, done, stop) = (AtomicUsize::new(0), AtomicUsize::new(0), AtomicBool::new(false));
        Self { scenes, options, runs, fingers: OnceLock::new(), next, done, stop }
    }

    /// The next run, unless there is none or the caller wants to stop.
    pub fn take(&self) -> Result<Option<(usize, Scene)>, Error> {
        if self.stops() {
            return Ok(None);
        }
        let run = self.next.fetch_add(1, Ordering::Relaxed);
        if run >= self.runs {
            return Ok(None);
        }
        let refused = |error| Error::Run { run, error: Box::new(error) };
        let scene = (self.scenes)(run)?;
        require_sound(&scene, self.options).map_err(refused)?;
        // The code is compiled for one kind of fingers.
        let fingers = scene.inputs.fingers();
        if *self.fingers.get_or_init(|| fingers) == fingers {
            return Ok(Some((run, scene)));
        }
        let (field, rule) = (format!("run {run}: fingers"), "must be those of all other runs");
        Err(Error::Shape { field, found: format!("{fingers:?}"), rule })
    }

    /// The scene of the first run, for lanes that have none of their own.
    pub fn peek(&self) -> Result<Option<Scene>, Error> {
        if self.runs == 0 { Ok(None) } else { (self.scenes)(0).map(Some) }
    }

    /// Whether the caller wants to stop.
    #[inline(always)]
    pub fn stops(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Counts a finished run.
    pub fn finished(&self) {
        self.done.fetch_add(1, Ordering::Relaxed);
    }
}

/// Simulates runs 0 to `runs` of `scenes` on `threads` threads of its own. `watch` hears now and then how many are done, and
/// says whether to stop; then the rows are those that were done. Of free steps only the ends are known, and nothing is recorded.
pub fn ensemble(
    scenes: &Scenes<'_>,
    runs: usize,
    options: &Options,
    threads: usize,
    watch: &mut dyn FnMut(usize) -> bool,
) -> Result<Vec<Row>, Error> {
    let shared = &Shared::new(scenes, runs, options);
    let threads = threads.min(runs.max(1));
    let (sender, results) = channel();
    let mut rows = reserved("the rows of an ensemble, in numbers,", runs)?;
    std::thread::scope(|scope| {
        for _ in 0..threads {
            let sender = sender.clone();
            let thread = std::thread::Builder::new().spawn_scoped(scope, move || {
                let worked = work(shared);
                if worked.is_err() {
                    shared.stop.store(true, Ordering::Relaxed);
                }
                // The receiver waits for all; if it is gone, nobody wants the rows.
                let _ = sender.send(worked);
            });
            if let Err(error) = thread {
                shared.stop.store(true, Ordering::Relaxed);
                return Err(Error::Threads { threads, reason: error.to_string() });
            }
        }
        drop(sender);
        loop {
            match results.recv_timeout(WATCH) {
                Ok(worked) => rows.extend(worked?),
                Err(RecvTimeoutError::Disconnected) => return Ok(()),
                Err(RecvTimeoutError::Timeout) => {
                    if watch(shared.done.load(Ordering::Relaxed)) {
                        shared.stop.store(true, Ordering::Relaxed);
                    }
                }
            }
        }
    })?;
    rows.sort_unstable_by_key(|row| row.run);
    Ok(rows)
}

/// The rows of one thread, which takes run after run.
struct Worker<'a> {
    shared: &'a Shared<'a>,
    rows: Vec<Row>,
}

impl<'a> RunQueue<'a> for Worker<'a> {
    fn take(&mut self) -> Result<Option<(usize, Cow<'a, Scene>)>, Error> {
        Ok(self.shared.take()?.map(|(run, scene)| (run, Cow::Owned(scene))))
    }

    fn stops(&mut self) -> bool {
        self.shared.stops()
    }

    fn finish(&mut self, finished: Finished, _: impl FnOnce(&Watched) -> LedgerRow) {
        let Finished { number, status, message, last, first_times, summaries, stats, .. } = finished;
        // A run that was stopped has no row.
        if status == Status::Interrupted {
            return;
        }
        let Instant { t, q, p, .. } = last.instant;
        let (violations, steps) = (first_times, stats.steps);
        self.rows.push(Row { run: number, status, message, t, q, p, violations, steps, summaries });
        self.shared.finished();
    }
}

/// Makes equations and method for the runs in lanes. `I` names the method.
struct Equipment<'a, I> {
    instructions: Instructions,
    choice: Choice,
    options: &'a Options,
    method: PhantomData<I>,
}

impl<R: Lanes, I: InLanes> Equip<Chosen<R>, I::Method<R>> for Equipment<'_, I> {
    #[inline(always)]
    fn equip(&mut self, parameters: &LaneParameters<'_>) -> (Chosen<R>, I::Method<R>) {
        let Self { instructions, choice, options, .. } = *self;
        let runs = Runs { instructions, choice, parameters, gains: &options.stabilization };
        let system = runs.system::<R>();
        let method = I::new(runs, system.size());
        (system, method)
    }

    #[inline(always)]
    fn renew(&mut self, parameters: &LaneParameters<'_>, system: &mut Chosen<R>, method: &mut I::Method<R>) {
        let Self { instructions, choice, options, .. } = *self;
        let runs = Runs { instructions, choice, parameters, gains: &options.stabilization };
        *system = runs.system();
        I::renew(method, runs);
    }
}

/// One thread's runs in equal steps, compiled once for each level of instructions. `I` names the method.
pub struct EqualLanes<'a, I> {
    shared: &'a Shared<'a>,
    choice: Choice,
    dt: f64,
    method: PhantomData<I>,
}

impl<'a, I> EqualLanes<'a, I> {
    /// Steps of at most `dt`.
    pub fn new(shared: &'a Shared<'a>, choice: Choice, dt: f64) -> Self {
        Self { shared, choice, dt, method: PhantomData }
    }
}

impl<I: InLanes> LaneKernel for EqualLanes<'_, I> {
    type Output = Result<Vec<Row>, Error>;

    #[inline(always)]
    fn run<R: Lanes>(self, instructions: Instructions) -> Self::Output {
        let Self { shared, choice, dt, .. } = self;
        let options = shared.options;
        let equip = Equipment::<I> { instructions, choice, options, method: PhantomData };
        let grid =
            |scene: &Scene| Grid::new(&scene.inputs, &scene.initial, scene.duration, dt, options.refine);
        let queue = Worker { shared, rows: Vec::new() };
        let steps = EqualSteps { instructions, options, queue, grid, equip };
        steps.run::<R, _, _>().map(|worker| worker.rows)
    }
}

/// One thread's runs in adaptive steps, compiled once for each level of instructions. `I` names the method.
pub struct AdaptiveLanes<'a, I> {
    shared: &'a Shared<'a>,
    choice: Choice,
    tolerance: f64,
    method: PhantomData<I>,
}

impl<'a, I> AdaptiveLanes<'a, I> {
    /// Steps whose errors are below `tolerance`.
    pub fn new(shared: &'a Shared<'a>, choice: Choice, tolerance: f64) -> Self {
        Self { shared, choice, tolerance, method: PhantomData }
    }
}

impl<I: AdaptiveInLanes> LaneKernel for AdaptiveLanes<'_, I> {
    type Output = Result<Vec<Row>, Error>;

    #[inline(always)]
    fn run<R: Lanes>(self, instructions: Instructions) -> Self::Output {
        let Self { shared, choice, tolerance, .. } = self;
        let options = shared.options;
        let equip = Equipment::<I> { instructions, choice, options, method: PhantomData };
        let queue = Worker { shared, rows: Vec::new() };
        let steps = AdaptiveSteps { instructions, options, tolerance, queue, equip };
        steps.run::<R, _, _>().map(|worker| worker.rows)
    }
}

/// What one thread does.
fn work(shared: &Shared<'_>) -> Result<Vec<Row>, Error> {
    let Some(first) = shared.peek()? else { return Ok(Vec::new()) };
    let options = shared.options;
    let (choice, level) = (options.choice(first.inputs.fingers()), options.simd);
    match (&options.steps, options.method) {
        (Steps::Fixed(dt), Method::Rk4) => {
            dispatch_lanes(level, EqualLanes::<InRk4>::new(shared, choice, *dt))?
        }
        (Steps::Fixed(dt), Method::Dop853) => {
            dispatch_lanes(level, EqualLanes::<InDop853>::new(shared, choice, *dt))?
        }
        (Steps::Fixed(dt), Method::Rosenbrock) => {
            dispatch_lanes(level, EqualLanes::<InRosenbrock>::new(shared, choice, *dt))?
        }
        (Steps::Free { tolerance, .. }, Method::Dop853) => {
            dispatch_lanes(level, AdaptiveLanes::<InDop853>::new(shared, choice, *tolerance))?
        }
        (Steps::Free { tolerance, .. }, Method::Rosenbrock) => {
            dispatch_lanes(level, AdaptiveLanes::<InRosenbrock>::new(shared, choice, *tolerance))?
        }
        _ => one_by_one(shared),
    }
}

/// Methods whose steps have no lanes.
fn one_by_one(shared: &Shared<'_>) -> Result<Vec<Row>, Error> {
    let mut rows = Vec::new();
    while let Some((number, scene)) = shared.take()? {
        let (run, _) = simulate(&scene, shared.options, &|| shared.stops())?;
        if run.status == Status::Interrupted {
            break;
        }
        rows.push(Row::of(number, run));
        shared.finished();
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::FINGERS;
    use crate::formulation::{FORMULATIONS, Formulation};
    use crate::inputs::{Impulse, Inputs, PiecewisePolynomial, Sinusoid};
    use crate::lanes::Row4;
    use crate::parameters::Parameters;
    use crate::simd::Level;
    use crate::start::{State, contact, driven};
    use crate::trigonometry::EXACT;

    /// The default parameters with masses, impulses and ends that differ: lanes are at different places.
    fn scene(run: usize) -> Result<Scene, Error> {
        let k = run as f64;
        let (finger, pid) = ([0.0762, 0.049, 0.0045, 0.1, 5.8e-4], [100.0, 1.0, 1000.0]);
        let tip = [0.02, 3e5, 100.0, 100.0, 1.0, 0.1, 0.1];
        let (object, surroundings) = ([0.049, 0.08 + 0.01 * k, 4e-5, 0.0], [9.81, f64::INFINITY]);
        let values = [&finger[..], &finger, &tip, &tip, &object, &pid, &pid, &surroundings].concat();
        let parameters = Parameters::from_array(&values.try_into().expect("as many as there are"))?;
        let sine =
            Sinusoid { start: 0.002, end: 0.006, omega: 300.0 + k, phase: 0.1, amplitude: [1.0, 2.0, 0.0] };
        let impulse = Impulse { time: 0.003 + 1e-4 * k, impulse: [0.01, -0.02, 1e-5] };
        let schedule = PiecewisePolynomial::constant([0.1, 0.08]).into();
        Ok(Scene {
            inputs: Inputs::new(schedule, Vec::new(), vec![sine], vec![impulse], Vec::new())?,
            initial: State::at_rest(contact(&parameters)?),
            check: true,
            duration: 0.004 + 5e-4 * k,
            parameters,
        })
    }

    /// The same with fingers of either kind.
    fn scene_with(fingers: Fingers, run: usize) -> Result<Scene, Error> {
        let mut scene = scene(run)?;
        if fingers == Fingers::Driven {
            let schedule = PiecewisePolynomial::constant([0.1, 0.08]).into();
            scene.inputs = Inputs::new(schedule, Vec::new(), Vec::new(), Vec::new(), Vec::new())?;
            scene.inputs = scene.inputs.with_fingers(fingers);
            scene.initial = driven(&scene.parameters, &scene.inputs, 0.0)?;
        }
        Ok(scene)
    }

    /// One lane without a run would send the sines of all lanes the slow way, if it computed with numbers that overflow.
    #[test]
    fn lanes_without_a_run_never_need_the_slow_sine() {
        let fixed = |method| (method, Steps::Fixed(1e-4));
        let free = |method| (method, Steps::Free { tolerance: 1e-6, times: None });
        for (method, steps) in [
            fixed(Method::Rk4),
            fixed(Method::Dop853),
            fixed(Method::Rosenbrock),
            free(Method::Dop853),
            free(Method::Rosenbrock),
        ] {
            for ((_, fingers), (name, formulation)) in
                FINGERS.into_iter().flat_map(|fingers| FORMULATIONS.map(|formulation| (fingers, formulation)))
            {
                // Fewer runs than lanes, and more, of which the last ones leave lanes empty.
                for runs in [1, 11] {
                    let options = Options { steps: steps.clone(), method, formulation, ..Options::default() };
                    let scenes = |run| scene_with(fingers, run);
                    let shared = Shared::new(&scenes, runs, &options);
                    EXACT.set(0);
                    let rows = work(&shared).expect("sound scenes");
                    assert!(rows.len() == runs && rows.iter().all(|row| row.status == Status::Completed));
                    let exact = EXACT.get();
                    assert_eq!(exact, 0, "{method:?}, {steps:?}, {name}, {fingers:?}, {runs} runs");
                }
            }
        }
    }

    /// Compares rows of four lanes, which runs leave and enter, with those of lone runs: every number, as text that has all of it.
    fn require_alone(options: &Options, rows: impl Fn(&Shared<'_>) -> Result<Vec<Row>, Error>) {
        let shared = Shared::new(&scene, 11, options);
        let mut rows = rows(&shared).expect("sound scenes");
        rows.sort_unstable_by_key(|row| row.run);
        assert_eq!(rows.len(), 11);
        for (number, row) in rows.iter().enumerate() {
            let (run, _) = simulate(&scene(number).expect("sound"), options, &|| false).expect("sound");
            assert_eq!(format!("{row:?}"), format!("{:?}", Row::of(number, run)));
        }
    }

    #[test]
    fn lanes_for_any_processor_give_the_bits_of_lone_runs() {
        let instructions = Level::detect().require().unwrap();
        let dt = 2e-4;
        let options = Options { steps: Steps::Fixed(dt), ..Options::default() };
        require_alone(&options, |shared| {
            EqualLanes::<InRk4>::new(shared, options.choice(Fingers::Pid), dt).run::<Row4>(instructions)
        });
        let tolerance = 1e-6;
        let options = Options {
            steps: Steps::Free { tolerance, times: None },
            method: Method::Dop853,
            formulation: Formulation::Nullspace,
            ..Options::default()
        };
        require_alone(&options, |shared| {
            AdaptiveLanes::<InDop853>::new(shared, options.choice(Fingers::Pid), tolerance)
                .run::<Row4>(instructions)
        });
    }

    /// Only the stabilisation leads back to the constraints, so with the other formulations a start off them is refused, of a
    /// lone run and of one of many, whatever its lane.
    #[test]
    fn a_start_that_a_lone_run_refuses_is_refused_among_many() {
        let off = |run: usize| {
            let mut scene = scene(run)?;
            scene.check = false;
            scene.initial.q[0] += if run == 6 { 1e-3 } else { 0.0 };
            Ok(scene)
        };
        let fixed = || Steps::Fixed(2e-4);
        let free = || Steps::Free { tolerance: 1e-4, times: None };
        let radau = Method::Radau5;
        for (method, steps) in
            [(Method::Rk4, fixed()), (radau, fixed()), (Method::Dop853, free()), (radau, free())]
        {
            let of =
                |formulation| Options { method, formulation, steps: steps.clone(), ..Options::default() };
            let many = |options: &Options| ensemble(&off, 11, options, 1, &mut |_| false);
            for formulation in [Formulation::Nullspace, Formulation::Projected] {
                let options = of(formulation);
                let alone = simulate(&off(6).expect("a scene"), &options, &|| false).expect_err("off");
                let expected = Error::Run { run: 6, error: Box::new(alone) };
                assert_eq!(many(&options), Err(expected), "{method:?} {steps:?}");
            }
            assert_eq!(many(&of(Formulation::Csm)).map(|rows| rows.len()), Ok(11), "{method:?} {steps:?}");
        }
    }
}
