//! The equations of a scene after the choice of formulation, fingers and ledger. Step loops and methods call
//! them without knowing this choice.
//!
//! They are written once for all numbers: lanes, dual numbers of lanes for Jacobians, and the dual numbers of a run
//! with derivatives. Each call goes to code that is compiled once for each kind of numbers. In lanes a call costs
//! little (measured: docs/what-a-scene-pays.md), so step loops and methods are compiled once, not once for each
//! formulation.

use crate::formulation::equations::size_of;
use crate::formulation::nullspace::Nullspace;
use crate::formulation::projected;
use crate::formulation::{
    ApplyJump, Carried, ContactEquations, ContactJump, Csm, Equations, Evaluation, Formulation,
    MAX_COMPONENTS, Size, StageState, States, System, Unilateral, for_fingers,
};
use crate::model::{
    Applied, ContactModel, Contacts, Energies, Fingers, FrameLoads, Input, Motion, Others, Parts, Plant,
    SegmentDrive, SegmentFrame, Source, Stabilization,
};
use crate::number::{LaneTask, Lanes, Lift, Real, task};

#[derive(Debug, Clone, Copy)]
pub(crate) enum EquationKind<R> {
    Csm(Csm<R>),
    Nullspace(Nullspace<R>),
    Unilateral(Unilateral<R>),
    AnyParts(Unilateral<R, Others>),
}

/// Evaluates one expression with the equations of any kind. No code is compiled for unilateral contact, or for parts that
/// are not the paper's, if the constants in brackets are false; then no equations are of these kinds.
macro_rules! with {
    ($kind:expr, $equations:ident [$unilateral:expr, $any_parts:expr] => $body:expr) => {
        match &$kind {
            EquationKind::Csm($equations) => $body,
            EquationKind::Nullspace($equations) => $body,
            EquationKind::Unilateral($equations) if const { $unilateral } => $body,
            EquationKind::Unilateral(Unilateral { csm: $equations, .. }) => $body,
            EquationKind::AnyParts($equations) if const { $any_parts } => $body,
            EquationKind::AnyParts(Unilateral { csm: $equations, .. }) => $body,
        }
    };
}
pub(crate) use with;

/// The choice of equations, and what their state carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Choice {
    pub formulation: Formulation,
    pub contact: ContactModel,
    pub fingers: Fingers,
    pub moves: bool,
    pub carried: Carried,
}

/// The equations of a scene, or of one scene for each lane, after the choice.
#[derive(Debug, Clone, Copy)]
pub struct SceneEquations<R> {
    pub(crate) carried: Carried,
    /// Whether the formulation puts the state back on the constraints at the end of a step.
    pub(crate) corrects: bool,
    pub(crate) kind: EquationKind<R>,
}

task! {
    /// Builds equations. Lanes need this whenever one of their runs changes. The code is called, not inlined.
    ['a, R: Lanes, S: Source<R>]
    Build<'a, S>(choice: Choice, source: &'a S, gains: &'a Stabilization) for R => EquationKind<R> = {
        let Choice { formulation, contact, fingers, moves, .. } = choice;
        let csm = Csm::new(Plant::called(source, fingers, moves), &formulation.gains(gains));
        let opens = contact == ContactModel::Unilateral;
        let drifts = opens || formulation != Formulation::Nullspace;
        let papers = !R::ANY_PARTS || source.kinds().has_the_papers_geometry();
        match (papers, opens) {
            (true, false) if drifts => EquationKind::Csm(csm),
            (true, false) => EquationKind::Nullspace(Nullspace { plant: csm.plant }),
            (true, true) => EquationKind::Unilateral(Unilateral::new(source, csm, drifts, opens)),
            (false, _) => EquationKind::AnyParts(Unilateral::new(source, csm, drifts, opens)),
        }
    }
}

impl<R: Lanes> SceneEquations<R> {
    /// Builds the equations of a scene, or of one scene for each lane.
    pub fn new(choice: Choice, source: &impl Source<R>, gains: &Stabilization) -> Self {
        Self {
            carried: choice.carried,
            corrects: choice.formulation == Formulation::Projected,
            kind: R::outlined(Build { choice, source, gains }),
        }
    }

    /// Lets a part of an event of unilateral contact happen to a state at time `tau` of a segment, with an impulse.
    pub(crate) fn apply(
        &self,
        at: (&SegmentDrive<R>, R),
        y: &mut States<R>,
        jump: ContactJump,
        impulse: &[R; 3],
    ) {
        let input = &R::outlined(InputAt { drive: at.0, tau: at.1 });
        match &self.kind {
            EquationKind::Unilateral(equations) => {
                R::outlined(ApplyJump { equations, input, y, jump, impulse });
            }
            EquationKind::AnyParts(equations) if const { R::ANY_PARTS } => {
                R::outlined(ApplyJump { equations, input, y, jump, impulse });
            }
            _ => {}
        }
    }
}

#[inline(always)]
fn copy_computed<R: Real, E: Equations<R>>(
    equations: &E,
    (driven, carried): (bool, Carried),
    rate: &mut States<R>,
    found: &States<R>,
) {
    for_fingers!(driven, driven => {
        let states = equations.states(driven);
        rate[..states].copy_from_slice(&found[..states]);
        let opens = equations.opens();
        if carried.ledger || opens && carried.slips {
            // The power of the hand's motion and the speed of slips are zero if there are none.
            let end = (states + equations.works() + 1 + usize::from(opens)).min(MAX_COMPONENTS);
            rate[states..end].copy_from_slice(&found[states..end]);
        }
    });
}

/// Evaluates the equations. A caller that knows how the fingers move has the code for these alone.
#[inline(always)]
pub(super) fn evaluate_into<R: Lanes, E: Equations<R>>(
    equations: &E,
    (driven, carried): (bool, Carried),
    (applied, contacts): (Applied<'_, R>, &Contacts<R>),
    y: &States<R>,
    now: &mut Evaluation<R>,
) {
    let found = equations.evaluate(driven, applied, contacts, y, carried);
    copy_computed(equations, (driven, carried), &mut now.rate, &found.rate);
    // The paper's tips have no branches.
    let before = now.motion.relaxation;
    now.motion = found.motion;
    if E::Parts::PAPERS {
        now.motion.relaxation = before;
    }
    now.multipliers = found.multipliers;
    now.residuals = found.residuals;
    now.tilt = found.tilt;
    now.sin_tilt = found.sin_tilt;
    now.contact_heights = found.contact_heights;
    now.torque = found.torque;
    if equations.opens() {
        now.share = found.share;
    }
}

/// Evaluates only the rates, likewise.
#[inline(always)]
pub(super) fn rates_into<R: Lanes, E: Equations<R>>(
    equations: &E,
    (driven, carried): (bool, Carried),
    (applied, contacts): (Applied<'_, R>, &Contacts<R>),
    at: StageState<'_, R>,
    rate: &mut States<R>,
) {
    let StageState { from, by, along } = at;
    let mut y = [R::zero(); MAX_COMPONENTS];
    for_fingers!(driven, driven => {
        for n in 0..equations.states(driven) {
            y[n] = along[n].mul_add(by, from[n]);
        }
    });
    let found = equations.evaluate(driven, applied, contacts, &y, carried);
    copy_computed(equations, (driven, carried), rate, &found.rate);
}

/// Evaluates an expression for the fingers of the equations. If the constant in brackets is true, the code is compiled
/// for each kind of fingers alone; this is done where it was measured to pay (docs/what-a-scene-pays.md).
macro_rules! for_fingers_of {
    ($equations:expr, $driven:ident [$alone:expr] => $body:expr) => {{
        let driven = $equations.plant().driven;
        if const { $alone } {
            for_fingers!(driven, $driven => $body)
        } else {
            let $driven = driven;
            $body
        }
    }};
}

pub(super) use for_fingers_of;

task! {
    ['a, R: Lanes, E: Equations<R>]
    Evaluate<'a, R, E>(equations: &'a E, drive: &'a SegmentDrive<R>, tau: R, moving: Option<&'a FrameLoads<R>>,
        y: &'a States<R>, now: &'a mut Evaluation<R>, carried: Carried)
    for R => () = for_fingers_of!(equations, driven [R::ORDER == 0 && E::Parts::PAPERS] => {
        evaluate_into(equations, (driven, carried), ((&drive.at(tau), moving), &drive.contacts), y, now);
    })
}
task! {
    ['a, R: Lanes, E: Equations<R>]
    Rates<'a, R, E>(equations: &'a E, input: &'a Input<R>, moving: Option<&'a FrameLoads<R>>,
        contacts: &'a Contacts<R>, from: &'a States<R>, by: R, along: &'a States<R>, rate: &'a mut States<R>,
        carried: Carried)
    for R => () = for_fingers_of!(equations, driven [R::ORDER < 2 && !E::CALLED] => {
        rates_into(equations, (driven, carried), ((input, moving), contacts), StageState { from, by, along }, rate);
    })
}

task! {
    pub(crate) ['a, R: Lanes] InputAt<'a, R>(drive: &'a SegmentDrive<R>, tau: R) for R => Input<R> = drive.at(tau)
}

task! {
    /// Computes the forces of the hand's motion at a stage, whose rates come `degrees` after the coordinates. It consists
    /// of pointers: vectors among them would be stored in parts and copied as a whole, which waits for these stores.
    pub(super) ['a, R: Lanes, T: Lift<R>]
    Load<'a, R, T>(frame: &'a SegmentFrame<R>, plant: &'a Plant<T>, tau: &'a T, force: &'a [T; 3],
        from: &'a [T], by: &'a T, along: &'a [T], degrees: usize)
    for T => FrameLoads<T> = {
        let (mut q, mut p) = ([T::zero(); 3], [T::zero(); 3]);
        if frame.turns {
            for n in 0..3 {
                q[n] = along[n].mul_add(*by, from[n]);
                p[n] = along[degrees + n].mul_add(*by, from[degrees + n]);
            }
        }
        plant.loads(&frame.motion(*tau), force, q, p)
    }
}

task! {
    ['a, R: Lanes, E: Equations<R>]
    Jump<'a, R, E>(equations: &'a E, input: &'a Input<R>, y: &'a mut States<R>, impulse: &'a [R; 3], carried: Carried)
    for R => () = equations.jump(input, y, impulse, carried)
}
task! {
    ['a, R: Lanes, E: Equations<R>]
    Correct<'a, R, E>(equations: &'a E, drive: &'a SegmentDrive<R>, tau: R, y: &'a mut States<R>, carried: Carried)
    for R => () = if equations.drifts() {
        let driven = equations.plant().driven;
        projected::correct(equations, (driven, carried), &drive.at(tau), &drive.contacts, y);
    }
}

impl<R: Lanes> SceneEquations<R> {
    /// The state of a motion, with works of zero.
    pub fn begin(&self, motion: &Motion<R>) -> States<R> {
        with!(self.kind, equations [R::ORDER < 2, R::ANY_PARTS] => equations.begin(equations.plant().driven, motion))
    }

    /// Adds the velocity jump that an impulse makes ([`Equations::jump`]).
    pub fn jump(&self, input: &Input<R>, y: &mut States<R>, impulse: &[R; 3]) {
        let carried = self.carried;
        with!(self.kind, equations [R::ORDER == 0, R::ANY_PARTS] => {
            R::outlined(Jump { equations, input, y, impulse, carried });
        });
    }

    /// The energies of a motion in the modes of the contacts, for the ledger.
    pub fn energies(&self, contacts: &Contacts<R>, motion: &Motion<R>) -> Energies<R> {
        with!(self.kind, equations [R::ORDER == 0, R::ANY_PARTS] => equations.energies(contacts, motion))
    }

    /// Puts the state at the end of a step back on the constraints, if the formulation does that.
    #[inline(always)]
    pub fn correct(&self, drive: &SegmentDrive<R>, tau: R, y: &mut States<R>) {
        if !self.corrects {
            return;
        }
        let carried = self.carried;
        with!(self.kind, equations [R::ORDER < 2, R::ANY_PARTS] => {
            R::outlined(Correct { equations, drive, tau, y, carried });
        });
    }

    /// The forces of the hand's motion at a stage. They are called, so that equations of a hand at rest have little code
    /// for them.
    #[cold]
    #[inline(never)]
    fn loads(
        &self,
        frame: &SegmentFrame<R>,
        input: &Input<R>,
        (from, by, along): (&States<R>, &R, &States<R>),
    ) -> FrameLoads<R> {
        let (plant, degrees) = with!(self.kind, equations [R::ORDER < 2, R::ANY_PARTS] => {
            (equations.plant(), equations.degrees(equations.plant().driven))
        });
        R::outlined(Load { frame, plant, tau: &input.tau, force: &input.force, from, by, along, degrees })
    }
}

/// Of numbers with second derivatives only rates are wanted, so no other code of unilateral contact is compiled for them.
impl<R: Lanes> System<R> for SceneEquations<R> {
    #[inline(always)]
    fn size(&self) -> Size {
        with!(self.kind, equations [R::ORDER < 2, R::ANY_PARTS] => {
            size_of(equations, equations.plant().driven, self.carried)
        })
    }

    #[inline(always)]
    fn evaluate_into(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>, now: &mut Evaluation<R>) {
        let (carried, mut moving) = (self.carried, None);
        let loads;
        if let Some(frame) = &drive.frame {
            loads = self.loads(frame, &R::outlined(InputAt { drive, tau }), (y, &R::zero(), y));
            moving = Some(&loads);
        }
        with!(self.kind, equations [R::ORDER < 2, R::ANY_PARTS] => {
            R::outlined(Evaluate { equations, drive, tau, moving, y, now, carried });
        });
    }

    #[inline(always)]
    fn rates(&self, input: &Input<R>, drive: &SegmentDrive<R>, at: StageState<'_, R>, rate: &mut States<R>) {
        // In one piece the stage would be copied, as vectors that wait for the stores of its parts.
        let StageState { from, by, along } = at;
        let (contacts, carried, mut moving) = (&drive.contacts, self.carried, None);
        let loads;
        if let Some(frame) = &drive.frame {
            loads = self.loads(frame, input, (from, &by, along));
            moving = Some(&loads);
        }
        with!(self.kind, equations [true, R::ANY_PARTS] => {
            R::outlined(Rates { equations, input, moving, contacts, from, by, along, rate, carried });
        });
    }
}

impl SceneEquations<f64> {
    /// The equations of unilateral contact; `None` if these are others.
    pub(crate) fn contact(&self, drive: &SegmentDrive) -> Option<ContactEquations<'_>> {
        match &self.kind {
            EquationKind::Unilateral(Unilateral { csm, friction, .. })
            | EquationKind::AnyParts(Unilateral { csm, friction, opens: true, .. }) => {
                Some(ContactEquations::new(csm, *friction, drive.frame.as_deref().copied()))
            }
            _ => None,
        }
    }
}
