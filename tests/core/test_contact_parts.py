"""Unilateral contact of other parts against the oracle's: events, modes, states, the ledger."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise
from math import cos, sin
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad, simpson

import softpinch as sp
from contact_scenes import sequence, settled
from core.test_contact_agreement import METHODS, calm, compare, simulated
from oracle import UnilateralReference, unilateral
from oracle.contact_parts import PartsContact, PartsMechanics
from oracle.contact_terms import Mechanics, Terms
from oracle.evaluate import parameters
from other_hands import MEASURED, POWER
from scenes import uneven
from softpinch import ContactMode
from softpinch.scene.parts import jaws as which_are_jaws
from transforms import MIRROR_MULTIPLIERS, Units, mirrored, mirrored_coordinates, require_scaled
from unilateral_parts import BOTTLE, BY_HAND, KINDS, grasp, jawed, started

# Seeds of grasps in which tips slip, open and meet the side again. Two have the part twice and the
# paper's parts beside it, the third has any parts.
SEEDS = {
    "jaw": (14, 20, 15),
    "parallelogram": (44, 20, 51),
    "tilted face": (10, 58, 31),
    "arc": (46, 40, 49),
    "power law": (24, 32, 11),
    "measured law": (38, 48, 31),
    "mixed": (28, 17),
}
RANDOM = [(kind, seed) for kind, seeds in SEEDS.items() for seed in seeds]
FIRST = [(kind, next(iter(seeds))) for kind, seeds in SEEDS.items()]
# The oracle and these runs are as close as this share of what `compare` allows: 1e-11 s and m.
CLOSE = 1e-3
FREE, GRAZE = int(ContactMode.FREE), int(ContactMode.GRAZE)


@cache
def expected(kind: str, seed: int) -> UnilateralReference:
    return unilateral(grasp(kind, seed))


def modes(run: sp.Run) -> set[tuple[ContactMode, ContactMode]]:
    return {(change.before, change.after) for change in run.contact_changes}


def test_there_are_scenes_of_every_kind() -> None:
    assert tuple(SEEDS) == KINDS


@pytest.mark.parametrize(("kind", "seed"), RANDOM)
def test_tips_slip_open_and_meet_again_as_in_the_oracle(kind: str, seed: int) -> None:
    scene, ours = grasp(kind, seed), expected(kind, seed)
    for options in METHODS:
        run = simulated(scene, **options)
        compare(run, ours, CLOSE)
        run.check(residual=1e-9, closure=1e-9)
    found = modes(run)
    assert any(after == ContactMode.SLIP for _, after in found)
    assert any(after == ContactMode.FREE for _, after in found)
    assert any(before == ContactMode.FREE != after for before, after in found)
    assert run.energy.impact_loss[-1] > 0.0


STATUSES = {
    "a bottle falls past the ends of its arcs": "lost",
    "a tip meets the end of an arc": "lost",
    "a wedge slips out of its jaws": "lost",
}


@pytest.mark.parametrize("name", BY_HAND)
def test_a_scene_made_by_hand_runs_as_in_the_oracle(name: str) -> None:
    scene = BY_HAND[name]
    ours, run = unilateral(scene), simulated(scene, **METHODS[1])
    compare(run, ours, CLOSE)
    assert run.status == STATUSES.get(name, "completed")
    run.check(residual=1e-9, closure=1e-9)
    if "graze" in name:
        # On an arc, long enough for the couple's rows on x and y to count.
        assert grazes(run)[0] > (5e-4 if "parallelogram" in name else 1e-4)


def grazes(run: sp.Run) -> list[float]:
    """How long tips graze, s, the longest first."""
    found = []
    for finger in ("right", "left"):
        own = settled(run, finger)
        found += [b[0] - a[0] for a, b in pairwise(own) if a[2] == GRAZE]
    return sorted(found, reverse=True)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_many_grasps_run_as_in_the_oracle(kind: str) -> None:
    compared = 0
    for seed in range(1000, 1060):
        scene = grasp(kind, seed, duration=0.03, scale=1.5)
        run, other = (simulated(scene, **options) for options in METHODS[1:])
        # A tip may meet its side less than a step before it passes the end (docs/unilateral.md).
        alike = sequence(run) == sequence(other) and abs(run.q[-1] - other.q[-1]).max() < 1e-8
        # Tips that open each other in turn settle in the core below 1e-11 m, in the oracle sooner.
        if alike and shortest_flight(run) > 1e-7 and calm(scene, run):
            compare(run, unilateral(scene))
            compared += 1
    assert compared > 50


def shortest_flight(run: sp.Run) -> float:
    """The shortest time for which a tip is free, s."""
    found = [np.inf]
    for finger in ("right", "left"):
        found += [b[0] - a[0] for a, b in pairwise(settled(run, finger)) if a[2] == FREE]
    return min(found)


def test_a_link_on_a_parallel_face_has_the_terms_of_the_paper_s_hand() -> None:
    """Two derivations: of any parts here, of the paper's hand in `lagrangian`."""
    scene = uneven()
    parts, papers = PartsMechanics(scene), Mechanics(parameters(scene))
    rng, middle = np.random.default_rng(3), np.array(scene.start().q)
    middle[5:] = 4e-3, 5e-3, 1e-3, -1e-3
    for _ in range(20):
        q, p = middle + 0.3 * rng.uniform(-1, 1, 9) * np.abs(middle), rng.uniform(-3, 3, 9)
        q[2] = rng.uniform(-0.5, 0.5)
        state = [*q.tolist(), *p.tolist(), *rng.uniform(-0.1, 0.1, 2).tolist()]
        asked, tilts = rng.uniform(-5, 5, 5).tolist(), rng.uniform(-0.5, 0.5, 2).tolist()
        ours, theirs = parts.terms(state, asked, tilts), papers.terms(state, asked, tilts)
        for name in Terms._fields:
            # The place of a contact is counted upwards, the height of the centre downwards.
            sign = -1.0 if name == "heights" else 1.0
            own, other = np.array(getattr(ours, name)), np.array(getattr(theirs, name))
            np.testing.assert_allclose(own, sign * other, rtol=1e-12, atol=1e-12, err_msg=name)
        np.testing.assert_allclose(parts.tilts(state), papers.tilts(state), atol=1e-15)
        own, other = parts.energies(state, tilts), papers.energies(state, tilts)[:3]
        np.testing.assert_allclose(own, other, rtol=1e-13)


@pytest.mark.parametrize("law", [None, POWER, replace(POWER, exponent=2.3, foot=None), MEASURED])
@pytest.mark.parametrize("coupling", [1.0, -1.0])
def test_the_oracle_s_energy_is_the_sum_of_the_springs(law: Any, coupling: float) -> None:
    """(4): springs of the density F'' at the depth z, sheared along the side and across it."""
    tip = sp.Fingertip(law=law, tilt_coupling=coupling)
    contact = PartsContact(sp.Scene(hand=sp.Hand(tip=tip)), 0)

    def density(z: float) -> float:
        """F'', N/m^2."""
        if law is None:
            return 2.0 * np.pi * tip.youngs_modulus
        if isinstance(law, sp.PowerLaw):
            n = law.exponent
            return law.coefficient * n * (n - 1.0) * (z + (law.foot or 0.0)) ** (n - 2.0)
        x = min(z / law.compression[-1], 1.0)
        powers = np.arange(10)
        choose = np.array([1, 9, 36, 84, 126, 126, 84, 36, 9, 1])
        return float(law.weights @ (choose * x**powers * (1.0 - x) ** (9 - powers)))

    for depth, shear, tilt in ((3e-3, 1e-3, 0.2), (7e-3, -2e-3, -0.5), (9e-3, 5e-4, 0.0)):

        def stored(z: float, depth: float = depth, s: float = shear, tilt: float = tilt) -> float:
            along = (depth - z) / cos(tilt) + coupling * s * sin(tilt)
            return density(z) * (along**2 + (s * cos(tilt)) ** 2) / 2.0

        total = quad(stored, 0.0, depth, points=[min(8e-3, depth)], epsabs=0.0, epsrel=1e-10)[0]
        state = [0.0] * 20
        state[5], state[7] = depth, shear
        assert contact.energy(state, tilt)[0] == pytest.approx(total, rel=1e-8)
        force = quad(lambda z, d=depth: density(z) * (d - z), 0.0, depth, points=[min(8e-3, depth)])
        state[7] = 0.0
        assert contact.energy(state, 0.0)[1] == pytest.approx(force[0], rel=1e-8)


@pytest.mark.parametrize(("depth", "share"), [(1e-3, 3e-3), (4e-3, 1e-2), (8e-3, 2.1e-2)])
@pytest.mark.parametrize("radius", [0.5, 0.1, 0.0245])
@pytest.mark.parametrize("tilt", [0.0, 0.35])
def test_an_arc_softens_shear_and_tilt_as_it_softens_the_force(
    depth: float, share: float, radius: float, tilt: float
) -> None:
    """The springs of a hemisphere in three dimensions against a cylinder, by those on a plane.

    Their number and the sums of compressions and of squares are the factors of d_t^2 / 2, of
    kappa d_t and of the energy without shear.
    """
    a, n = 0.02, 500
    middles = (np.arange(n) + 0.5) / n
    height, around = np.meshgrid(a * middles, np.pi * middles)
    across = np.sqrt(a**2 - height**2) * np.cos(around)
    plane = (a - depth - across * sin(tilt)) / cos(tilt)
    centre = (a - depth + radius) * np.array([sin(tilt), cos(tilt)])
    beside = radius**2 - (across - centre[0]) ** 2
    curved = np.where(beside > 0.0, centre[1] - np.sqrt(np.abs(beside)), np.inf)
    sums = []
    for side in (curved, plane):
        pressed = np.maximum(height - side, 0.0)
        sums.append([np.sign(pressed).mean(), pressed.mean(), (pressed**2).mean()])
    softer = (1.0 + a / radius) ** -0.5
    np.testing.assert_allclose(np.divide(*sums) / softer, 1.0, atol=share + 1e-3)


def _changed(**changes: Callable[[Any], Any]) -> Callable[[pytest.MonkeyPatch], None]:
    """Makes the oracle wrong: changes its terms."""
    right = PartsMechanics.terms

    def wrong(self: PartsMechanics, *arguments: Any) -> Terms:
        terms = right(self, *arguments)
        return terms._replace(**{name: f(getattr(terms, name)) for name, f in changes.items()})

    return lambda patch: patch.setattr(PartsMechanics, "terms", wrong)


def _with_factors(k: int, value: float) -> Callable[[pytest.MonkeyPatch], None]:
    """Makes the oracle wrong: chi, kappa or eta is another."""
    right = PartsContact.__init__

    def wrong(self: PartsContact, *arguments: Any) -> None:
        right(self, *arguments)
        factors = list(self._factors)
        factors[k] = value
        self._factors = tuple(factors)

    return lambda patch: patch.setattr(PartsContact, "__init__", wrong)


TURN_ONLY = np.array([0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0])
WRONG: dict[str, tuple[str, int, Callable[[pytest.MonkeyPatch], None]]] = {
    "couples do not act on x and y": ("arc", 40, _changed(turning=lambda t: t * TURN_ONLY)),
    "no bias": ("parallelogram", 20, _changed(b=lambda b: 0.999 * b)),
    "arcs do not soften": ("arc", 46, _with_factors(0, 1.0)),
    "shear is as stiff as pressure": ("power law", 32, _with_factors(2, 1.0)),
}


@pytest.mark.parametrize("what", WRONG)
def test_an_oracle_that_is_wrong_is_found_out(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    kind, seed, make_wrong = WRONG[what]
    make_wrong(monkeypatch)
    scene = grasp(kind, seed)
    with pytest.raises(AssertionError):
        compare(simulated(scene, **METHODS[1]), unilateral(scene))


def tilted(right: float, left: float) -> sp.Hand:
    return sp.Hand(right=sp.Jaw(angle=right), left=sp.Jaw(angle=left))


def test_tips_without_friction_do_not_turn_a_disc() -> None:
    """Pressure on a disc acts through its middle, whatever the couples of tilted tips are.

    So friction bounds lambda^N and not lambda^N - k tau: the couple's part along the arc is part
    of the pressure.
    """
    scene = jawed(
        BOTTLE,
        hand=tilted(0.4, 0.3),
        friction=0.0,
        disturbances=[sp.Impulse(time=0.02, impulse=(0.4, 0.1))],
        duration=0.05,
        gravity=0.0,
    )
    run = simulated(started(scene, {}, {2: 15.0}), **METHODS[1])
    assert (ContactMode.FREE, ContactMode.SLIP) in modes(run)
    np.testing.assert_allclose(run.p[:, 2], 15.0, rtol=1e-12)
    # The couples push the disc along its sides all the same.
    assert np.abs(run.p[run.t < 0.02, 1]).max() > 0.01


def test_a_disc_turns_by_friction_alone() -> None:
    """I theta'' = R (lambda_N1 - lambda_N2), through slips, sticking and grazes."""
    push = sp.Pulse(time=0.005, duration=0.01, force=(20.0, 30.0))
    scene = jawed(BOTTLE, hand=tilted(0.4, -0.2), friction=0.15, disturbances=[push], duration=0.02)
    dt = 2.0**-17
    run = sp.simulate(started(scene, {}, {2: 30.0}), dt=dt, record=("state", "multipliers"))
    friction = run.multipliers[:, 2] - run.multipliers[:, 3]
    moment = simpson(0.025 * friction, x=run.t)
    turned = scene.grasped.inertia * (run.p[-1, 2] - run.p[0, 2])
    assert abs(turned) > 1e-3
    assert turned == pytest.approx(moment, rel=1e-3)


@pytest.mark.parametrize("formulation", ["csm", "projected"])
@pytest.mark.parametrize(("kind", "seed"), [("arc", 40), ("mixed", 28), ("measured law", 38)])
def test_rk4_keeps_order_four_through_events_of_other_parts(
    kind: str, seed: int, formulation: Any
) -> None:
    scene, ours = grasp(kind, seed), expected(kind, seed)
    steps = 8.06e-5 / 2.0 ** np.arange(4)
    ends = [sp.simulate(scene, dt=h, formulation=formulation, every=10**9).q[-1] for h in steps]
    errors = [np.abs(end - ours.end.q).max() for end in ends]
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert abs(order - 4.0) < 0.25, (order, errors)
    assert len(ours.changes) >= 7


@pytest.mark.parametrize(("kind", "seed"), FIRST)
def test_the_mirror_image_slips_and_opens_like_the_image_in_a_mirror(kind: str, seed: int) -> None:
    scene = grasp(kind, seed)
    options: dict[str, Any] = {"dt": 5e-5, "method": "dop853"}
    run, image = (simulated(each, **options) for each in (scene, mirrored(scene)))
    assert (image.status, image.holds) == (run.status, run.holds)
    assert sequence(image)[::-1] == sequence(run)
    times, others = (
        [change[0] for finger in sides for change in settled(each, finger)]
        for each, sides in ((run, ("right", "left")), (image, ("left", "right")))
    )
    np.testing.assert_allclose(others, times, rtol=0, atol=1e-10)
    np.testing.assert_allclose(mirrored_coordinates(image.q), run.q, rtol=0, atol=1e-10)
    np.testing.assert_allclose(mirrored_coordinates(image.p), run.p, rtol=0, atol=1e-8)
    forces = image.multipliers[:, MIRROR_MULTIPLIERS]
    np.testing.assert_allclose(forces, run.multipliers, rtol=0, atol=1e-6)


@pytest.mark.parametrize("formulation", ["csm", "projected"])
@pytest.mark.parametrize(("kind", "seed"), FIRST)
def test_powers_of_two_scale_runs_that_slip_and_open_to_the_bit(
    kind: str, seed: int, formulation: Any
) -> None:
    scene = grasp(kind, seed)
    rng = np.random.default_rng(seed)
    length, mass, time = rng.integers(-8, 9, 3).tolist()
    if any(isinstance(tip.law, sp.PowerLaw) for tip in scene.hand.tips):
        length = 0  # a power of a power of two is rounded
    units = Units(length, mass, time)
    dt = 2.0**-14
    run = simulated(scene, dt=dt, formulation=formulation)
    gains = sp.Stabilization(alpha=1e3 / units.time, beta=1e3 / units.time)
    other = simulated(
        units.scene(scene), dt=dt * units.time, formulation=formulation, stabilization=gains
    )
    require_scaled(run, other, units, which_are_jaws(scene))
    np.testing.assert_array_equal(other.contact, run.contact)
    for ours, theirs in zip(run.contact_changes, other.contact_changes, strict=True):
        assert theirs[1:] == ours[1:]
        assert theirs.time == ours.time * units.time


@pytest.mark.parametrize("kind", KINDS)
def test_lanes_that_slip_and_open_have_the_bits_of_lone_runs(kind: str) -> None:
    scene, dt = grasp(kind, SEEDS[kind][-1]), 5e-5
    vary = {
        "friction.right": sp.Uniform(0.05, 1.5),
        "friction.left": sp.Uniform(0.05, 1.5),
        "grasped.mass": sp.Uniform(0.08, 0.15),
    }
    many = sp.monte_carlo(scene, 10, seed=3, vary=vary, dt=dt, progress=False)
    changes = set()
    for k in range(10):
        lone = sp.simulate(scene.with_({path: float(many[path][k]) for path in vary}), dt=dt)
        last = lone.state(-1)
        assert many.status[k] == lone.status
        np.testing.assert_array_equal(many["final_state"][k], [*last.q, *last.p])
        changes.add(len(lone.contact_changes))
    assert len(changes) > 1  # lanes do not change their modes together
