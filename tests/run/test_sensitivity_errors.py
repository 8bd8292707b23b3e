"""Errors of `sensitivities`."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from derivative_scenes import uneven
from softpinch.scene.disturbance import Compiled, Disturbance

SCENE = uneven(duration=0.005)
NOISY = replace(
    SCENE, disturbances=(sp.Noise(force_std=1.0, moment_std=0.1, rate_hz=500.0, duration=0.003),)
)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Real(Disturbance):
    """A step that makes its number a float."""

    push: float = 1.0

    def compile(self) -> Compiled:
        return sp.Step(time=0.001, force=(float(self.push), 0.0)).compile()


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Cast(Disturbance):
    """A step that casts its number to a float, of which NumPy only warns."""

    push: float = 1.0

    def compile(self) -> Compiled:
        load = np.asarray(self.push).astype(np.float64) * np.array([[1.0, 0.0, 0.0]])
        before = np.zeros((1, 3))
        pieces = np.concatenate([before, load])[..., None]
        return Compiled(forces=((np.array([0.001]), pieces),))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Square(Disturbance):
    """A step of the number's square, of whatever kind it is."""

    push: float = 1.0

    def compile(self) -> Compiled:
        pieces = np.zeros((2, 3, 1), dtype=np.result_type(type(self.push), np.float64))
        pieces[1, 0, 0] = self.push**2
        return Compiled(forces=((np.array([0.001]), pieces),))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Size(Disturbance):
    """A step of the number's size, which has lost the imaginary part."""

    push: float = -1.0

    def compile(self) -> Compiled:
        return sp.Step(time=0.001, force=(abs(self.push), 0.0)).compile()


def simulated(scene: sp.Scene, paths: Any, **how: Any) -> sp.Run:
    return sp.simulate(scene, dt=1e-3, sensitivities=paths, **how)


def with_load(load: Disturbance) -> sp.Scene:
    return replace(SCENE, disturbances=(load,))


SAMPLED = replace(SCENE, control=sp.SampledController.pid(1e-3, 4.0, 0.05, 20.0))
REFUSED: dict[str, tuple[sp.Scene, Any]] = {
    "control must not be a SampledController": (SAMPLED, "gravity"),
    "'grasped.height' is None": (SCENE, "grasped.height"),
    "'grasped.weight'.*no field 'weight'": (SCENE, "grasped.weight"),
    "'hand.tip.radius'.*is a pair": (SCENE, ["gravity", "hand.tip.radius"]),
    "'duration': there is no derivative by it": (SCENE, "duration"),
    "'initial.time': there is no derivative by it": (SCENE, "initial.time"),
    "set the same number": (SCENE, ["initial.q", "initial.q.0"]),
    "the rate or the times of a noise": (NOISY, "disturbances.0.rate_hz"),
    "seed is not a number": (NOISY, "disturbances.0.seed"),
    "'disturbances.0.push': Real.compile must accept": (with_load(Real()), "disturbances.0.push"),
    "'disturbances.0.push': Cast.compile must accept": (with_load(Cast()), "disturbances.0.push"),
    "'disturbances.0.push': Size.compile must accept": (with_load(Size()), "disturbances.0.push"),
}


@pytest.mark.parametrize("text", REFUSED)
def test_numbers_without_a_derivative_are_refused(text: str) -> None:
    scene, paths = REFUSED[text]
    with pytest.raises(ValueError, match=text) as caught:
        simulated(scene, paths)
    assert str(caught.value).startswith("sensitivities")
    if isinstance(paths, str):
        with pytest.raises(ValueError, match=text):
            sp.monte_carlo(scene, 2, dt=1e-3, gradients="final_state", sensitivities=paths)


def powered(exponent: float, foot: float | None) -> sp.Scene:
    law = sp.PowerLaw(1.6e5, exponent, foot)
    return sp.Scene(hand=sp.Hand(tip=sp.Fingertip(law=law)), initial="touching", duration=0.005)


FOOT = "hand.tip.law.foot"
NO_FOOT = (
    r"^sensitivities: 'hand\.tip\.law\.foot': a foot of zero .* n > 2 in all runs: give a foot"
)


@pytest.mark.parametrize("exponent", [1.67, 2.0])
@pytest.mark.parametrize("foot", [None, 0.0])
def test_a_foot_of_zero_has_a_derivative_above_a_square_only(
    exponent: float, foot: float | None
) -> None:
    """Below a square differences grow without bound as they shrink; of a square they are zero."""
    scene = powered(exponent, foot)
    with pytest.raises(ValueError, match=NO_FOOT):
        simulated(scene, FOOT)
    with pytest.raises(ValueError, match=NO_FOOT):
        sp.monte_carlo(scene, 2, dt=1e-3, gradients="final_state", sensitivities=FOOT)
    with pytest.raises(ValueError, match=NO_FOOT):
        sp.fit(scene, [1e-3, 2e-3], {"x": [0.0, 0.0]}, {FOOT: (0.0, 1e-3)}, noise=1e-6, dt=1e-3)
    assert simulated(powered(exponent, 1e-4), FOOT).success
    above = powered(2.5, foot)
    run = simulated(above, FOOT)
    moved = (sp.simulate(above.with_({FOOT: 1e-8}), dt=1e-3).q[-1] - run.q[-1]) / 1e-8
    off = run.sensitivity[FOOT][-1, :9] - moved
    assert np.abs(off).max() <= 0.01 * np.abs(moved).max()


@pytest.mark.parametrize(
    "vary", [{"hand.tip.law.exponent": [2.5, 1.67]}, {FOOT: [1e-4, 0.0]}], ids=["exponent", "foot"]
)
def test_no_run_of_a_study_has_a_gradient_by_a_foot_of_zero(vary: dict[Any, Any]) -> None:
    how: dict[str, Any] = {"dt": 1e-3, "gradients": "final_state", "sensitivities": FOOT}
    with pytest.raises(ValueError, match=NO_FOOT):
        sp.monte_carlo(powered(2.5, None), vary=vary, progress=False, **how)
    footed = powered(1.67, 1e-4)
    found = sp.monte_carlo(footed, vary={FOOT: [1e-4, 2e-4]}, progress=False, **how)
    assert np.isfinite(found.gradients["final_state"][FOOT]).all()


def test_a_number_is_no_path() -> None:
    with pytest.raises(TypeError, match=r"^sensitivities = \[3\]: must be paths"):
        simulated(SCENE, [3])


def test_a_disturbance_of_users_own_has_derivatives_if_it_takes_complex_numbers() -> None:
    scene = replace(SCENE, disturbances=(Square(push=3.0),))
    same = replace(SCENE, disturbances=(sp.Step(time=0.001, force=(9.0, 0.0)),))
    ours = simulated(scene, "disturbances.0.push").sensitivity["disturbances.0.push"]
    by_force = simulated(same, "disturbances.0.force").sensitivity["disturbances.0.force"]
    np.testing.assert_allclose(ours, 6.0 * by_force[..., 0], rtol=1e-12, atol=1e-15)
    assert ours.any()


def test_a_sensitivity_state_goes_with_its_own_scene_and_state() -> None:
    run = simulated(SCENE, "schedule.angles")
    at = run.sensitivity.at(2)
    with pytest.raises(ValueError, match="goes with the State of the same row"):
        simulated(SCENE, at)
    other = replace(SCENE, initial=run.state(2), schedule=sp.Schedule.steps([0.0], [[0.1, 0.1]]))
    with pytest.raises(ValueError, match="SensitivityState is that of another scene"):
        simulated(other, at)
    for k, error in ((len(run.t), IndexError), (-len(run.t) - 1, IndexError), (1.5, TypeError)):
        with pytest.raises(error, match=f"k = {k}"):
            run.sensitivity.at(k)  # type: ignore[arg-type]


def test_missing_derivatives_are_an_error_with_the_remedy() -> None:
    with pytest.raises(sp.NotRecordedError, match=r"pass sensitivities=\(path, ...\)"):
        _ = simulated(SCENE, ()).sensitivity
    run = simulated(SCENE, ["gravity", "grasped.mass"])
    found = run.sensitivity
    for name in ("multipliers", "torque", "energy"):
        with pytest.raises(
            sp.NotRecordedError, match=f"sensitivity.{name}: '{name}' was not recorded"
        ):
            getattr(found, name)
    with pytest.raises(KeyError, match=r'derivatives by "gravity", "grasped\.mass"'):
        _ = found["grasped.inertia"]
    assert list(found) == ["gravity", "grasped.mass"]
    assert found["gravity"].shape == (len(run.t), 18)
    with pytest.raises(ValueError, match="read-only"):
        found["gravity"][0, 0] = 1.0


def test_a_run_that_ends_early_has_derivatives_up_to_its_end() -> None:
    push = sp.Step(time=0.001, force=(400.0, 0.0))
    scene = replace(SCENE, disturbances=(push,), duration=0.05)
    run = simulated(scene, ["gravity", "disturbances.0.force"])
    assert run.status == "separated"
    assert run.t[-1] < 0.05
    long = simulated(replace(scene, duration=0.05), ["disturbances.0.force"], stop_on=())
    ours = run.sensitivity["disturbances.0.force"]
    assert len(ours) == len(run.t)
    np.testing.assert_array_equal(ours, long.sensitivity["disturbances.0.force"][: len(run.t)])


def test_derivatives_that_end_before_their_run_are_nan_with_a_warning() -> None:
    """The equations of its last steps have no solution to round-off."""
    scene = sp.Scene(disturbances=[sp.Step(time=0.0011, force=(1500.0, 0.5))], duration=0.05)
    how: Any = {"tolerance": 1e-6, "method": "radau5", "stop_on": ()}
    with pytest.warns(sp.StabilityWarning, match="derivatives from there on are NaN"):
        run = sp.simulate(scene, **how, sensitivities="grasped.mass")
    assert run.status == "step_too_small"
    followed = np.isfinite(run.sensitivity["grasped.mass"]).all(axis=1)
    assert 100 < followed.sum() < len(run)
    assert not np.diff(followed.astype(int)).max() > 0


def test_a_run_does_not_go_on_from_nan() -> None:
    run = simulated(SCENE, "gravity")
    lost = sp.SensitivityState(shapes={"gravity": ()}, derivatives=np.full((20, 1), np.nan))
    with pytest.raises(ValueError, match=r"sensitivities\.derivatives"):
        simulated(replace(SCENE, initial=run.state(2)), lost)
