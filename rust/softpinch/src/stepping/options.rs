//! The options of a simulation.

use crate::formulation::{Carried, Choice, Formulation, MAX_COMPONENTS, System};
use crate::method::{Method, Runs};
use crate::model::{ContactModel, Inputs, Scene, Stabilization, fastest_rate};
use crate::number::{Level, MOST};
use crate::stepping::{Recordable, STOP_ON, Selection, Summary, ViolationSet, Wanted};

/// The length of the steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Steps {
    /// Equal steps between breakpoints, at most this long, s.
    Fixed(f64),
    /// Steps that are as long as the error allows.
    Free {
        /// Largest error of a step, as a share of each state's magnitude.
        tolerance: f64,
    },
}

/// Default limit to the attempted steps of a run with free steps, which take seconds. A run that needs more
/// has a stiff scene and an explicit method.
pub const MAX_STEPS: u64 = 10_000_000;

/// The options of a simulation.
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs)] // of fields that their types explain
pub struct Options {
    pub steps: Steps,
    pub method: Method,
    pub formulation: Formulation,
    pub contact: ContactModel,
    /// Gains of (19) and (20).
    pub stabilization: Stabilization,
    pub record: Selection,
    /// Number of steps between rows. The last instant is always recorded.
    pub every: u64,
    /// Instants to record instead, s; `None` to record the ends of steps.
    pub times: Option<Vec<f64>>,
    pub stop_on: ViolationSet,
    pub summaries: Wanted,
    /// Largest number of attempted steps in a run with free steps.
    pub max_steps: u64,
    /// Number of equal parts into which each step of a fixed grid is divided.
    pub refine: u32,
    /// Whether runs whose steps [may be unstable](Options::may_be_unstable) end where their energy ledger shows that
    /// they are. This carries the ledger.
    pub guard: bool,
    /// Whether every scene of an ensemble has passed [`check`](crate::driver::check) with these options. They are not
    /// checked again, which would take a tenth of a short run.
    pub checked: bool,
    pub simd: Level,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            steps: Steps::Fixed(1e-4),
            method: Method::Rk4,
            formulation: Formulation::Csm,
            contact: ContactModel::Bilateral,
            stabilization: Stabilization::default(),
            record: [Recordable::State].into_iter().collect(),
            every: 1,
            times: None,
            stop_on: STOP_ON.iter().map(|&(_, violation)| violation).collect(),
            summaries: Wanted::default(),
            max_steps: MAX_STEPS,
            refine: 1,
            guard: false,
            checked: false,
            simd: Level::detect(),
        }
    }
}

impl Options {
    /// Whether the steps of a run may be beyond the stability limit of its method, by a bound on the rates of the
    /// motion.
    pub fn may_be_unstable(&self, scene: &Scene) -> bool {
        self.step_to_stable_one(scene) > 1.0
    }

    /// Whether a run is guarded by its ledger: its steps may be unstable, and the state has place for the works.
    pub fn guards(&self, scene: &Scene) -> bool {
        self.may_be_unstable(scene) && Self { guard: true, ..self.clone() }.fits(scene)
    }

    /// Whether all that the states of a run carry fits into them.
    pub(crate) fn fits(&self, scene: &Scene) -> bool {
        scene.parameters.branches() == 0 || self.runs(scene).system::<f64>().size().all() <= MAX_COMPONENTS
    }

    /// The steps of a run by the longest one that is stable by that bound. It is zero for methods with error control, and
    /// for those that are stable for every step.
    pub fn step_to_stable_one(&self, scene: &Scene) -> f64 {
        let Steps::Fixed(dt) = self.steps else { return 0.0 };
        dt.min(scene.duration) / f64::from(self.refine) / self.surely_stable_step(scene)
    }

    /// The longest step that is stable by the bound on the rates, s; infinite if every step is stable.
    pub fn surely_stable_step(&self, scene: &Scene) -> f64 {
        let Some(limit) = self.method.entry().real_stability_limit else { return f64::INFINITY };
        let rate = fastest_rate(&scene.parameters, scene.inputs.fingers);
        let Stabilization { alpha, beta } = self.stabilization;
        limit / if self.formulation == Formulation::Csm { rate.max(alpha).max(beta) } else { rate }
    }

    pub(crate) fn runs<'a>(&'a self, scene: &'a Scene) -> Runs<'a> {
        let (choice, parameters) = (self.choice(&scene.inputs), [&scene.parameters; MOST]);
        Runs { choice, parameters, gains: &self.stabilization }
    }

    pub(crate) fn choice(&self, inputs: &Inputs) -> Choice {
        let Self { formulation, contact, .. } = *self;
        let (fingers, moves) = (inputs.fingers, inputs.moves());
        let ledger = self.guard
            || self.record.contains(Recordable::Energy)
            || self.summaries.set.contains(Summary::EnergyClosure);
        let slips = contact == ContactModel::Unilateral && self.summaries.set.contains(Summary::SlipDistance);
        Choice { formulation, contact, fingers, moves, carried: Carried { ledger, slips } }
    }
}
