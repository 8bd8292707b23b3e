//! Runs that are stepped from outside across the border to Python.

use std::sync::{Mutex, MutexGuard, TryLockError};

use numpy::PyArrayMethods;
use pyo3::exceptions::{PyIndexError, PyKeyboardInterrupt, PyRuntimeError, PyValueError};
use pyo3::prelude::*;

use crate::batch::Batch;
use crate::convert::{GivenRows, GivenState, Numbers, Row, Rows, columns, raise, require, room};
use crate::signals::detached;
use crate::simulation::Simulation;
use softpinch::driver::{Observed, Simulator as Core};
use softpinch::error::Error;
use softpinch::model::{Motion, Parameters, State};
use softpinch::stepping::Status;

/// Time, coordinates, velocities, multipliers and the code of the status.
type Observation = (f64, Numbers<9>, Numbers<9>, Numbers<4>, u8);
/// Time, coordinates, velocities, integrals with the states of Maxwell branches, grid, contacts and controller of a state.
type StateParts =
    (f64, Numbers<9>, Numbers<9>, Vec<f64>, Option<(f64, u64)>, Option<Numbers<4>>, Option<Vec<f64>>);
/// Arrays of all runs: times (n,), coordinates (n, 9), velocities (n, 9), multipliers (n, 4) and codes (n,). They
/// are borrowed once no other thread uses the simulator.
type Arrays<'py> = (Row<'py>, Rows<'py>, Rows<'py>, Rows<'py>, Row<'py, u8>);

/// Runs that are stepped from outside. The code of a status is its place in `STATUSES` plus one; 0 for a run under way.
#[pyclass(frozen, module = "softpinch._core")]
pub struct Simulator(Mutex<Runs>);

struct Runs {
    core: Core,
    targets: Vec<[f64; 2]>,
}

fn code(status: Option<Status>) -> u8 {
    status.map_or(0, |status| status as u8 + 1)
}

/// A state from which a run goes on, and whether it is refused if it is off the constraints.
fn given(parameters: &Parameters, state: GivenState) -> (State, bool) {
    let check = state.check;
    (State { linearized: None, ..state.state(parameters) }, check)
}

impl Simulator {
    /// The runs, unless another thread uses them.
    fn runs(&self) -> PyResult<MutexGuard<'_, Runs>> {
        match self.0.try_lock() {
            Ok(runs) => Ok(runs),
            Err(TryLockError::Poisoned(runs)) => Ok(runs.into_inner()),
            Err(TryLockError::WouldBlock) => Err(PyRuntimeError::new_err(
                "this simulator is in use by another thread; make one for each thread",
            )),
        }
    }

    /// The runs, if there is one of this number.
    fn with(&self, run: usize) -> PyResult<MutexGuard<'_, Runs>> {
        let all = self.runs()?;
        let runs = all.core.runs();
        if run < runs {
            Ok(all)
        } else {
            Err(PyIndexError::new_err(format!("run {run}: there are only {runs} runs")))
        }
    }
}

impl Runs {
    fn advance(&mut self, py: Python<'_>, accelerations: &[[f64; 2]]) -> PyResult<()> {
        let Self { core, targets } = self;
        let done = detached(py, |stops| core.step(targets, accelerations, stops))?;
        // An interrupted step has changed nothing, so it can be repeated.
        if done.map_err(raise)? { Ok(()) } else { Err(PyKeyboardInterrupt::new_err(())) }
    }

    /// Does some work, and writes what was last seen of all runs then. Arrays that overlap are refused before.
    fn observe_after(
        &mut self,
        (t, q, p, multipliers, status): Arrays<'_>,
        work: impl FnOnce(&mut Self) -> PyResult<()>,
    ) -> PyResult<()> {
        let (mut t, mut status) = (t.try_readwrite()?, status.try_readwrite()?);
        let (mut q, mut p, mut multipliers) =
            (q.try_readwrite()?, p.try_readwrite()?, multipliers.try_readwrite()?);
        work(self)?;
        let runs = self.core.runs();
        let refused = || PyValueError::new_err(format!("out: must be contiguous arrays of {runs} runs"));
        let t = t.as_slice_mut().map_err(|_| refused())?;
        let (q, _) = q.as_slice_mut().map_err(|_| refused())?.as_chunks_mut::<9>();
        let (p, _) = p.as_slice_mut().map_err(|_| refused())?.as_chunks_mut::<9>();
        let (multipliers, _) = multipliers.as_slice_mut().map_err(|_| refused())?.as_chunks_mut::<4>();
        let status = status.as_slice_mut().map_err(|_| refused())?;
        if [t.len(), q.len(), p.len(), multipliers.len(), status.len()] != [runs; 5] {
            return Err(refused());
        }
        for run in 0..runs {
            let seen = self.core.observed(run);
            let Motion { q: coordinates, p: rates, .. } = &seen.motion;
            (t[run], q[run], p[run]) = (seen.t, coordinates.row(), rates.row());
            (multipliers[run], status[run]) = (seen.multipliers, code(seen.status));
        }
        Ok(())
    }

    fn observation(&self, run: usize) -> Observation {
        let Observed { t, motion: Motion { q, p, .. }, multipliers, status, .. } = self.core.observed(run);
        (*t, Numbers(q.row()), Numbers(p.row()), Numbers(*multipliers), code(*status))
    }
}

#[pymethods]
impl Simulator {
    /// A single run.
    #[staticmethod]
    fn alone(simulation: &Simulation, period: f64) -> PyResult<Self> {
        let Simulation { scene, options } = simulation;
        let core = Core::new(vec![scene.clone()], options, period, 1).map_err(|error| match error {
            Error::Run { error, .. } => raise(*error),
            error => raise(error),
        })?;
        Ok(Self(Mutex::new(Runs { core, targets: vec![[0.0; 2]] })))
    }

    /// The runs of a batch.
    #[staticmethod]
    fn many(py: Python<'_>, batch: &Batch, period: f64, threads: usize) -> PyResult<Self> {
        let &Batch { runs, ref options, .. } = batch;
        let core = py.detach(|| {
            let mut scenes = room("the runs", runs)?;
            for run in 0..runs {
                scenes.push(batch.scene(run).map_err(raise)?);
            }
            Core::new(scenes, options, period, threads).map_err(raise)
        })?;
        let mut targets = room("the actions, in numbers,", runs)?;
        targets.resize(runs, [0.0; 2]);
        Ok(Self(Mutex::new(Runs { core, targets })))
    }

    /// Steps the only run by one period, in which its hand may have this acceleration along fixed axes.
    fn step(
        &self,
        py: Python<'_>,
        right: f64,
        left: f64,
        acceleration: Option<[f64; 2]>,
    ) -> PyResult<Observation> {
        let mut runs = self.runs()?;
        runs.targets.fill([right, left]);
        runs.advance(py, acceleration.as_slice())?;
        Ok(runs.observation(0))
    }

    /// Steps all runs that have not ended by one period, with these accelerations of the hands, and writes what is seen.
    fn step_all(
        &self,
        py: Python<'_>,
        actions: GivenRows<'_>,
        accelerations: Option<GivenRows<'_>>,
        arrays: Arrays<'_>,
    ) -> PyResult<()> {
        let mut all = self.runs()?;
        let (actions, runs) = (actions.as_array(), all.targets.len());
        let found = actions.dim();
        require(found == (runs, 2), || format!("actions have shape {found:?}: must be ({runs}, 2)"))?;
        // Row by row, because the array may have any layout.
        for (target, row) in all.targets.iter_mut().zip(actions.rows()) {
            *target = [row[0], row[1]];
        }
        let accelerations = accelerations.map(|rows| columns("acceleration", &rows)).transpose()?;
        all.observe_after(arrays, |all| all.advance(py, accelerations.as_deref().unwrap_or(&[])))
    }

    /// What was last seen of a run.
    fn observation(&self, run: usize) -> PyResult<Observation> {
        Ok(self.with(run)?.observation(run))
    }

    /// Writes what was last seen of all runs.
    fn observe(&self, arrays: Arrays<'_>) -> PyResult<()> {
        self.runs()?.observe_after(arrays, |_| Ok(()))
    }

    /// The status of a run in words; empty if it goes on or has reached its end.
    fn message(&self, run: usize) -> PyResult<String> {
        Ok(self.with(run)?.core.observed(run).message.clone())
    }

    /// The end of the last period of a run, s.
    fn end(&self, run: usize) -> PyResult<f64> {
        Ok(self.with(run)?.core.end(run))
    }

    /// The present state of a run.
    fn state(&self, run: usize) -> PyResult<StateParts> {
        let runs = self.with(run)?;
        let scene = runs.core.scene(run);
        let State { time, motion: Motion { q, p, memory, relaxation }, grid, contact, .. } = scene.initial;
        let controller = scene.initial.controller.clone();
        let memories = [&memory[..], &relaxation[..4 * scene.parameters.branches()]].concat();
        Ok((time, Numbers(q.row()), Numbers(p.row()), memories, grid, contact.map(Numbers), controller))
    }

    /// Puts a run back to its start, or to the start of another run.
    fn reset(&self, run: usize, state: Option<GivenState>) -> PyResult<()> {
        let mut runs = self.with(run)?;
        let parameters = runs.core.scene(run).parameters;
        let state = state.map(|state| given(&parameters, state));
        runs.core.reset(run, state.as_ref().map(|(state, check)| (state, *check))).map_err(raise)
    }

    /// Goes on from a state.
    fn set_state(&self, run: usize, state: GivenState) -> PyResult<()> {
        let mut runs = self.with(run)?;
        let (state, check) = given(&runs.core.scene(run).parameters, state);
        runs.core.set_state(run, (&state, check)).map_err(raise)
    }

    /// Sets the external force and moment of a run.
    fn set_force(&self, run: usize, force: [f64; 3]) -> PyResult<()> {
        self.with(run)?.core.set_force(run, force).map_err(raise)
    }
}
