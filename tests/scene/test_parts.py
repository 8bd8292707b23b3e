"""Jaws and parallelograms, faces and arcs, laws of the tip: through the public names."""

import pickle
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import softpinch as sp
from other_hands import (
    BOTTLE,
    EVERYTHING,
    FACTS,
    MEASURED,
    POWER,
    SCENES,
    STIFF,
    jaws,
    linked,
    scene_of,
)
from softpinch import _core, strategies
from softpinch.scene.outline import (
    closing,
    contact_point,
    contacts,
    finger_outline,
    object_outline,
)
from softpinch.scene.parts import half_lengths, stiffness, width
from softpinch.scene.parts import jaws as which_are_jaws
from transforms import MIRROR_MULTIPLIERS, Units, mirrored, mirrored_coordinates, require_scaled

formulations = st.sampled_from(_core.FORMULATIONS)
exponents = st.integers(-8, 8)
each_scene = pytest.mark.parametrize("name", SCENES)


@pytest.mark.parametrize("name", FACTS)
def test_the_scenes_of_an_independent_program_end_where_it_says(name: str) -> None:
    fact = FACTS[name]
    run = sp.simulate(
        scene_of(name), method="dop853", tolerance=1e-12, formulation="nullspace", record=EVERYTHING
    )
    assert run.status == "completed"
    state = run.state(-1)
    assert np.abs(state.q - np.array(fact["q"], float)).max() < 1e-9
    assert np.abs(state.p - np.array(fact["p"], float)).max() < 1e-9
    assert np.abs(np.array(state.integral) - np.array(fact["integral"], float)).max() < 1e-9
    assert np.abs(run.multipliers[-1] - np.array(fact["multipliers"], float)).max() < 1e-7
    assert run.energy.controller_work[-1] == pytest.approx(fact["work"]["torque"], abs=1e-9)
    assert np.abs(contacts(run.scene, state.q).tilts - fact["theta_p"]).max() < 1e-9


@each_scene
@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
def test_runs_keep_every_invariant(name: str, formulation: str) -> None:
    for contact in ("bilateral", "unilateral"):
        if contact == "unilateral" and formulation == "nullspace":
            continue
        scene = replace(SCENES[name], contact=contact, friction=0.8)
        pushes = [sp.Pulse(time=0.03, duration=0.02, force=(20.0, 8.0))]
        run = sp.simulate(
            replace(scene, disturbances=pushes), dt=5e-5, formulation=formulation, record=EVERYTHING
        )
        assert run.status == "completed"
        run.check()


@given(strategies.other_hands(0.05, contact="unilateral"), st.floats(0.1, 1.0), st.booleans())
@settings(max_examples=30)
def test_what_slips_and_opens_keeps_every_invariant(
    scene: sp.Scene, friction: float, projected: bool
) -> None:
    blow = sp.Impulse(time=0.02, impulse=(0.5, 0.2), angular_impulse=5e-3)
    own = replace(scene.hand.tips[0], normal_mass=0.02, tangential_mass=0.02)
    scene = replace(
        scene, friction=friction, disturbances=[blow], hand=replace(scene.hand, tip=own)
    )
    formulation: Any = "projected" if projected else "csm"
    run = sp.simulate(scene, dt=2e-5, formulation=formulation, record=EVERYTHING)
    assert run.status in ("completed", "lost", "crushed", "folded")
    run.check(residual=1e-4)


@given(
    strategies.other_hands(0.05, contact="unilateral"),
    strategies.motions(0.05, acceleration=50.0),
    st.floats(0.05, 1.0),
    st.sampled_from([("projected", "rk4"), ("csm", "dop853"), ("projected", "radau5")]),
)
@settings(max_examples=30)
def test_hands_that_are_carried_slip_and_open_keep_every_invariant(
    scene: sp.Scene, motion: sp.HandMotion, friction: float, pair: tuple[Any, Any]
) -> None:
    tips = [replace(tip, normal_mass=0.02, tangential_mass=0.02) for tip in scene.hand.tips]
    blow = sp.Impulse(time=0.02, impulse=(0.1, -0.2), angular_impulse=1e-3)
    scene = replace(
        scene,
        motion=motion,
        friction=friction,
        disturbances=[*scene.disturbances, blow],
        hand=replace(scene.hand, tip=(tips[0], tips[1])),
    )
    formulation, method = pair
    run = sp.simulate(scene, dt=2e-5, formulation=formulation, method=method, record=EVERYTHING)
    assert run.status in ("completed", "lost", "crushed", "folded")
    run.check(residual=1e-4)


@given(strategies.other_hands(), formulations)
@settings(max_examples=25)
def test_mirror_images_mirror_to_round_off(scene: sp.Scene, formulation: str) -> None:
    options: Any = {"dt": 5e-4, "formulation": formulation, "record": EVERYTHING}
    run, image = sp.simulate(scene, **options), sp.simulate(mirrored(scene), **options)
    assert image.status == run.status
    assert image.t.shape == run.t.shape
    difference = np.abs(run.q - mirrored_coordinates(image.q)).max(axis=0)
    assert (difference <= 1e-9 * (0.01 + np.abs(run.q).max())).all()
    forces = run.multipliers - image.multipliers[:, MIRROR_MULTIPLIERS]
    assert np.abs(forces).max() <= 1e-9 * np.abs(run.multipliers).max()


@given(strategies.other_hands(laws=False), formulations, exponents, exponents, exponents)
@settings(max_examples=25)
def test_powers_of_two_of_length_mass_and_time_scale_a_run_to_the_bit(
    scene: sp.Scene, formulation: str, length: int, mass: int, time: int
) -> None:
    scene = replace(scene, initial=scene.start())
    units = Units(length, mass, time)
    options: Any = {"formulation": formulation, "record": EVERYTHING}
    run = sp.simulate(scene, dt=2.0**-11, **options)
    other = sp.simulate(
        units.scene(scene), dt=2.0**-11 * units.time, **options,
        stabilization=sp.Stabilization(alpha=1e3 / units.time, beta=1e3 / units.time),
    )  # fmt: skip
    require_scaled(run, other, units, which_are_jaws(scene))


def test_a_curve_is_read_from_a_file_and_one_that_saturates_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "tip.csv"
    curve = zip(MEASURED.compression.tolist(), MEASURED.force.tolist(), strict=True)
    rows = "\n".join(f"{d},{f}" for d, f in curve)
    for headings in ("", "d [m],F [N]\n", "# pressed on glass\nd,F\n#, 20 C\n0,0\n"):
        path.write_text(headings + rows)
        assert sp.MeasuredLaw.from_csv(path) == MEASURED
    # What spreadsheets write: a mark of the encoding, quoted numbers.
    for text in ("\ufeff" + rows, rows.replace("0.001", '"0.001"')):
        path.write_text(text, encoding="utf-8")
        assert sp.MeasuredLaw.from_csv(path) == MEASURED
    for wrong in (b"1,2\nx,y\n", "größe,F\n".encode("latin-1") + rows.encode(), b"1;2\n2;8\n"):
        path.write_bytes(wrong)
        with pytest.raises(ValueError, match=r"tip\.csv: must have two columns of numbers"):
            sp.MeasuredLaw.from_csv(path)
    d = np.linspace(1e-3, 0.02, 20)
    place = r"^MeasuredLaw\.force = 0\.993262 N at 0\.02 m: "
    with pytest.raises(ValueError, match=rf"{place}.*misses it by \d+% of .* convex, without sat"):
        sp.MeasuredLaw(d, 1.0 - np.exp(-d / 4e-3))
    # Its stiffness at zero is not zero.
    for k in (0.0, 1e3):
        with pytest.raises(ValueError, match=r"N at 0\.02 m: .* flat-ended tip; F'\(0\) must be 0"):
            sp.MeasuredLaw(d, 1e3 * d + k * d**2)


def test_measured_forces_may_begin_at_zero_and_scatter() -> None:
    d = np.array([0.0, 1e-3, 2e-3, 3e-3, 4e-3])
    force = np.array([0.0, 1.1, 4.3, 4.2, 15.0])
    law = sp.MeasuredLaw(d, force)
    assert law == sp.MeasuredLaw(d[1:], force[1:])
    assert sp.fit_law(d, force, "measured").law == law
    assert eval(repr(law), vars(sp).copy()) == law
    assert str(law) == f"{law!r}, misfit {law.misfit:.2%}"
    scene = linked(hand=sp.Hand(tip=sp.Fingertip(law=law)))
    assert f"MeasuredLaw; the measured forces are met within {law.misfit:.2%}" in str(
        sp.explain(scene, measure=False)
    )
    for wrong in ([0.5, 1.0, 4.0, 9.0, 15.0], [0.0, -0.1, 4.0, 9.0, 15.0]):
        with pytest.raises(ValueError, match="must be at least 3 numbers above zero, after a "):
            sp.MeasuredLaw(d, wrong)


def test_runs_beyond_what_was_measured_are_a_warning() -> None:
    short = sp.MeasuredLaw(MEASURED.compression[:4], MEASURED.force[:4])
    tips = (sp.Fingertip(law=MEASURED), sp.Fingertip(law=short))
    scene = jaws(hand=replace(jaws().hand, tip=tips), schedule=sp.Schedule.steps([0], [[7e-3] * 2]))
    for record in ("state", ()):
        with pytest.warns(sp.SuspiciousValueWarning, match=r"^hand\.tip\.left\.law: ") as caught:
            run = sp.simulate(scene, record=record)
        (text,) = [str(each.message) for each in caught]
        deepest = 1e3 * (run.q[:, 6].max() if record else run.state(-1).q[6])
        assert f"up to 6 mm, and the run compresses the tip by {deepest:.4g} mm" in text
    with warnings.catch_warnings(action="error"):
        sp.simulate(jaws(hand=replace(jaws().hand, tip=tips)))


@pytest.mark.parametrize("beyond", [-1e-3, 9e-3, np.nan])
def test_a_measured_curve_predicts_no_force_beyond_its_range(beyond: float) -> None:
    with pytest.raises(ValueError, match=r"compression = .*: must be .* from 0 to 0\.008 m"):
        MEASURED.predicted(np.array([1e-3, beyond]))


@each_scene
def test_scenes_are_written_read_compared_and_pickled(name: str) -> None:
    scene = SCENES[name]
    assert sp.Scene.from_toml(scene.to_toml()) == scene
    assert pickle.loads(pickle.dumps(scene)) == scene
    assert hash(replace(scene)) == hash(scene)
    assert eval(repr(scene), vars(sp)) == scene
    assert scene._repr_html_().count("<svg") == 1


# Paths of other parts, in the scene of this name, and draws about their values.
VARIED = {
    "jaws and a bottle": {
        "hand.right.root_offset": sp.Normal(0.049, 1e-4),
        "hand.left.direction": sp.Normal(0.0, 0.02),
        "grasped.right.radius": sp.Normal(0.025, 1e-4),
        "grasped.left.center.1": sp.Normal(0.0, 1e-3),
    },
    "links and a wedge": {
        "grasped.right.tilt": sp.Normal(0.05, 0.01),
        "grasped.left.height": sp.Normal(0.06, 1e-3),
        "grasped.width": sp.Normal(0.05, 1e-4),
    },
    "parallelograms": {"hand.right.angle": sp.Normal(0.0, 0.02), "hand.left.length": [0.076] * 20},
    "power law": {"hand.tip.law.exponent": sp.Normal(1.67, 0.02), "hand.tip.law.foot": [1e-4] * 20},
    "measured law": {"hand.tip.left.law.shear_factor": sp.Uniform(0.5, 1.0)},
    "a link and a jaw": {"hand.left.mass": sp.Normal(0.1, 0.01), "control.left.kp": [2e4] * 20},
}


@pytest.mark.parametrize("name", VARIED)
@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
def test_lanes_have_the_bits_of_lone_runs(name: str, contact: str) -> None:
    scene = replace(SCENES[name], contact=contact, friction=0.8)
    many = sp.monte_carlo(scene, 20, seed=3, vary=VARIED[name], progress=False)
    assert (many["status"] == "completed").all()
    for k in (0, 7, 19):
        values = {path: float(many[path][k]) for path in VARIED[name]}
        last = sp.simulate(scene.with_(values)).state(-1)
        np.testing.assert_array_equal(many["final_state"][k], [*last.q, *last.p])
    if name != "measured law":
        return
    spread = np.ptp(many["final_state"][:, 8])
    assert spread > 0.0


UNITS = {
    "jaws and a box": {
        "control.kp": "N/m",
        "control.right.ki": "N/(m s)",
        "schedule.angles.0": "m",
        "hand.right.direction": "rad",
    },
    "a link and a jaw": {
        "control.right.kd": "N m s/rad",
        "control.left.kd": "N s/m",
        "schedule.angles.0": ("rad", "m"),
        "schedule.angles.0.1": "m",
        "grasped.left.center.0": "m",
    },
}


@pytest.mark.parametrize("name", UNITS)
def test_the_numbers_of_jaws_are_lengths_and_forces(name: str, tmp_path: Path) -> None:
    scene = SCENES[name]
    paths = scene.vary_paths()
    assert {path: paths[path][1] for path in UNITS[name]} == UNITS[name]
    right = "m" if name.startswith("jaws") else "rad"
    run = sp.simulate(scene, record=EVERYTHING)
    header = run.save(tmp_path / "run.csv").read_text().splitlines()[0].split(",")
    for own in (f"theta_1 [{right}]", "theta_2 [m]", "rate of theta_2 [m/s]", "theta [rad]"):
        assert own in header
    assert f"torque_1 [{'N' if right == 'm' else 'N m'}]" in header
    model = sp.linearize(scene, inputs="targets")
    assert model.input_units == (right, "m")
    assert dict(zip(model.states, model.state_units, strict=True))["integral_2"] == "m s"
    many = sp.monte_carlo(scene, vary={"grasped.mass": [0.1]}, summaries="peak_torque")
    assert many._spec.schema.entries["peak_torque"].unit == ("N" if right == "m" else "N m or N")


def test_jaws_have_no_degrees() -> None:
    degrees = sp.Schedule.in_degrees("steps", [0.0], [[6.0, 6.0]])
    with pytest.raises(ValueError, match=r"Scene\.schedule: is in degrees, but .* of a Jaw"):
        jaws(schedule=degrees)
    text = jaws().to_toml().replace("angles", "angles_deg")
    with pytest.raises(ValueError, match="is in degrees"):
        sp.Scene.from_toml(text)
    with pytest.warns(sp.SuspiciousValueWarning, match="default schedule, whose .* of a Jaw"):
        sp.simulate(sp.Scene(hand=jaws().hand, control=STIFF, duration=1e-3), dt=1e-4)
    with pytest.warns(sp.SuspiciousValueWarning, match=r"angles\.0\.0 = 4 m: usual is from -1 "):
        sp.simulate(jaws(schedule=sp.Schedule.steps([0.0], [[4.0, 4.0]]), duration=1e-3), dt=1e-4)
    opened = jaws(schedule=sp.Schedule.steps([0.0], [[-1e-3, -1e-3]]), duration=1e-3)
    with pytest.warns(sp.SuspiciousValueWarning, match="touching is at 0 mm, the schedule asks"):
        sp.simulate(opened)
    with pytest.raises(ValueError, match=r"gap 2 mm at the start\. It touches at 2 mm"):
        jaws(grasped=sp.GraspedObject(width=0.045), initial=None).start()


REFUSED: dict[str, Any] = {
    "a reference solution": lambda s: sp.reference.solve(s, [0.0, 0.01]),
    "consistent_states": lambda s: sp.strategies.consistent_states(s).example(),
    'the axis "tilt"': lambda s: sp.stability_map(s, "tilt", [10.0], progress=False),
}


@pytest.mark.parametrize("what", REFUSED)
@pytest.mark.filterwarnings("ignore")
def test_what_does_not_take_other_parts_says_so(what: str) -> None:
    with pytest.raises(ValueError, match=rf"scene: {what} does not take a Jaw yet;"):
        REFUSED[what](jaws())


def test_numbers_without_effect_are_refused() -> None:
    cases = {
        "hand.tip.youngs_modulus": ("power law", "law of its own"),
        "hand.tip.law.force.1": ("measured law", "share a measured curve"),
        "grasped.right.center": ("jaws and a bottle", r"center\.0 and .* can differ"),
        "grasped.width": ("jaws and a bottle", "both sides of the object are arcs"),
        "grasped.height": ("jaws and a wedge", "both sides of the object have ends"),
    }
    for path, (name, reason) in cases.items():
        assert path not in SCENES[name].vary_paths()
        with pytest.raises(ValueError, match=f"{path}.*{reason}"):
            sp.monte_carlo(SCENES[name], vary={path: [0.1]}, progress=False)

    with pytest.raises(ValueError, match=r"with_: 'grasped\.width': both sides .* are arcs"):
        SCENES["jaws and a bottle"].with_({"grasped.width": 0.06})
    both = {"hand.right.creep_rate": 0.1, "hand.right.joint_friction": 0.05}
    assert sp.Scene().with_(both).hand.right.creep_rate == 0.1
    stiffer = sp.Scene().with_({"hand.tip.law": sp.ParallelSprings(5e5)})
    assert stiffer.hand.tip == sp.Fingertip(youngs_modulus=5e5)


@pytest.mark.parametrize("law", [POWER, MEASURED, sp.ParallelSprings(2e5)])
def test_a_modulus_beside_a_law_is_refused(law: Any) -> None:
    says = rf"Fingertip\.youngs_modulus = 500000\.0: give .* or law = {type(law).__name__}"
    with pytest.raises(ValueError, match=says):
        sp.Fingertip(law=law, youngs_modulus=5e5)
    if law is POWER:
        scene = SCENES["power law"]
        with pytest.raises(ValueError, match=says):
            scene.with_({"hand.tip.youngs_modulus": 5e5})
        with pytest.raises(
            ValueError, match=r"^youngs_modulus = 1000: Fingertip\.youngs_modulus = "
        ):
            sp.stability_map(scene, "youngs_modulus", [1e3, 1e9], progress=False)


@pytest.mark.parametrize("name", ["joint_friction", "creep_rate"])
def test_a_joint_s_number_that_is_none_needs_a_value_first(name: str) -> None:
    path = f"hand.right.{name}"
    with pytest.raises(ValueError, match=rf"vary: '{path}': is None; give it a value in the scene"):
        sp.monte_carlo(jaws(), vary={path: [0.1]}, progress=False)


@each_scene
def test_grip_finds_the_targets_of_a_force(name: str) -> None:
    held = sp.grip(SCENES[name], force=5.0)
    assert held.force == pytest.approx(5.0, rel=1e-6)
    still = replace(held.scene, initial=held.equilibrium.state, duration=0.02)
    run = sp.simulate(still, formulation="projected")
    assert np.abs(run.q[-1] - run.q[0]).max() < 1e-8


def test_grip_crushes_no_tip_before_the_other() -> None:
    soft = sp.Fingertip(radius=0.015, youngs_modulus=2e5)
    hard = sp.Fingertip(radius=0.010, youngs_modulus=8e5)
    hand = sp.Hand(right=sp.Jaw(), left=sp.Jaw(), tip=(soft, hard))
    for force in (50.0, 100.0, 138.0):
        found = sp.grip(jaws(hand=hand), force=force).equilibrium.state
        assert found is not None
        # Upright tips: F = pi E d_n^2. Of both, 12.5 mm on average would be crushed.
        expected = [(force / (np.pi * tip.youngs_modulus)) ** 0.5 for tip in (soft, hard)]
        np.testing.assert_allclose(found.q[5:7], expected, rtol=1e-3)
    with pytest.raises(
        ValueError, match=r"no grip at rest has it; at [\d.]+ and [\d.]+ mm it is 1"
    ):
        sp.grip(jaws(hand=hand), force=200.0)


def test_fingers_that_reach_too_little_grip_as_far_as_they_reach() -> None:
    short = sp.Parallelogram(length=0.03, root_offset=0.075)
    scene = linked(hand=sp.Hand(right=short, left=short))
    held = sp.grip(scene, force=5.0).equilibrium.state
    assert held is not None
    # F = pi E d_n^2, where d_n = L sin(theta) + d_f - W_f + a + W/2.
    inward = (5.0 / (np.pi * 3e5)) ** 0.5 + 0.075 - 0.0045 - 0.02 - 0.0245
    assert held.q[3] == pytest.approx(np.arcsin(inward / 0.03), abs=2e-3)
    # Level links compress the tips by 4 mm: 15 N.
    with pytest.raises(ValueError, match=r"no grip at rest has it; at (8\d|90).* degrees it is 15"):
        sp.grip(scene, force=20.0)


def test_a_grip_that_would_be_too_loose_is_named_once() -> None:
    with pytest.raises(ValueError, match="so little force; the least is") as refused:
        sp.grip(jaws(grasped=sp.GraspedObject.disc(0.07, 0.3)), force=0.5)
    assert str(refused.value).count(" it is ") == 1


@each_scene
def test_the_drawn_contacts_are_on_the_drawn_object(name: str) -> None:
    run = sp.simulate(SCENES[name])
    q = run.q[-1]
    outline = object_outline(run.scene, q)
    closed = np.concatenate([outline, outline[:1]])
    for side in (0, 1):
        point = contact_point(run.scene, q, side)
        start, way = closed[:-1], np.diff(closed, axis=0)
        share = ((point - start) * way).sum(axis=1) / np.maximum((way**2).sum(axis=1), 1e-300)
        nearest = start + np.clip(share, 0.0, 1.0)[:, None] * way
        # The arc's chords of the drawing are 0.05 mm from the arc.
        assert np.hypot(*(nearest - point).T).min() < 6e-5
    if name == "jaws and a bottle":
        np.testing.assert_allclose(np.hypot(*(outline - q[:2]).T), 0.025, rtol=1e-12)


def test_fit_law_recovers_a_law_and_its_intervals_hold_it() -> None:
    d = np.linspace(1e-3, 8e-3, 12)
    force = 1.6e5 * d**1.67
    exact = sp.fit_law(d, force)
    assert isinstance(exact.law, sp.PowerLaw)
    assert exact.law.exponent == pytest.approx(1.67, abs=1e-9)
    assert sp.fit_law(d, np.pi * 3e5 * d**2, "springs").values[0] == pytest.approx(3e5)
    assert sp.fit_law(d, force, "measured").misfit < 0.01
    with_foot = sp.fit_law(d, 1e5 * ((d + 1e-4) ** 2 - 1e-8 - 2e-4 * d), foot=1e-4)
    assert with_foot.values[1] == pytest.approx(2.0)
    random = np.random.default_rng(2)
    inside = 0
    for _ in range(300):
        low, high = sp.fit_law(d, np.sort(force + 0.2 * random.normal(size=12))).intervals[1]
        inside += low <= 1.67 <= high
    # 285 of 300 are expected, with a standard deviation of 3.8.
    assert 270 <= inside <= 297


@pytest.mark.parametrize("kind", ["springs", "power", "measured"])
@pytest.mark.parametrize("foot", [None, 1e-3])
def test_the_drawn_law_bends_between_the_measurements(kind: str, foot: float | None) -> None:
    d = np.array([1e-3, 4e-3, 8e-3])
    foot = foot if kind == "power" else None
    measured, drawn = sp.plot.law(sp.fit_law(d, 1e6 * d**2, kind, foot=foot)).axes[0].lines
    np.testing.assert_allclose(measured.get_ydata(), 1e6 * d**2)
    depth = np.asarray(drawn.get_xdata(), float) / 1e3
    assert (depth[0], depth[-1]) == (0.0, 8e-3)
    assert np.diff(depth).max() < 1e-4
    # The parallel springs are the power 2 with any foot.
    np.testing.assert_allclose(drawn.get_ydata(), 1e6 * depth**2, atol=0.2)


def test_no_power_law_saturates() -> None:
    d = np.linspace(1e-3, 8e-3, 8)
    for force in (1.0 - np.exp(-d / 4e-3), 1e3 * d):
        with pytest.raises(ValueError, match=r"force: best as a power of 1: must be convex"):
            sp.fit_law(d, force)
    assert sp.fit_law(d, 1e3 * d**1.01).law.exponent == pytest.approx(1.01)


def test_jaws_that_pass_each_other_do_not_open() -> None:
    for target, way in ((0.2, "closes the fingers past the object"), (-0.05, "opens the fingers")):
        scene = jaws(
            grasped=sp.GraspedObject.disc(0.004, 0.01),
            schedule=sp.Schedule.steps([0.0], [[target, target]]),
            duration=1e-3,
        )
        with pytest.warns(sp.SuspiciousValueWarning, match=f"at the start: it {way}"):
            sp.simulate(scene)


def test_a_foot_is_of_a_power_law_only() -> None:
    d = np.array([1e-3, 2e-3, 4e-3])
    for kind in ("springs", "measured"):
        with pytest.raises(ValueError, match=r'foot = 0\.001: is of kind = "power" only'):
            sp.fit_law(d, 1e6 * d**2, kind, foot=1e-3)


def test_jaws_do_not_turn() -> None:
    assert "moves the fingers" in str(sp.explain(jaws()))
    assert "turns the fingers" in str(sp.explain(linked()))


def test_a_power_law_without_a_foot_keeps_its_force() -> None:
    scene = linked(hand=sp.Hand(tip=sp.Fingertip(law=replace(POWER, foot=None))))
    state = sp.State.consistent(scene, fingers=(0.08, 0.08))
    terms = sp.evaluate(replace(scene, initial=state), 0.0, state.q, state.p)
    tilt = contacts(scene, state.q).tilts
    expected = -POWER.coefficient * state.q[5:7] ** 1.67 / np.cos(tilt) ** 2
    np.testing.assert_allclose(terms.forces.elastic[5:7], expected, rtol=1e-12)


LAWS = {"springs": None, "power": POWER, "no foot": replace(POWER, foot=None), "measured": MEASURED}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("counterface", ["flat", "cylinder", "sphere"])
def test_the_stiffness_is_the_slope_of_the_core_s_force(law: str, counterface: str) -> None:
    """Also beyond the last measured compression, 8 mm."""
    arc = sp.Arc(0.025, counterface=counterface)
    tip = sp.Fingertip(law=LAWS[law], tilt_coupling=0.0)
    hand = sp.Hand(right=sp.Jaw(), left=sp.Jaw(), tip=tip)
    scene = jaws(hand=hand, grasped=replace(BOTTLE, right=arc, left=arc))
    touching = scene.start().q[3]

    def force(depth: float) -> float:
        state = sp.State.consistent(scene, fingers=(touching + depth, touching + depth))
        assert state.q[5] == pytest.approx(depth, rel=1e-12)
        return -float(sp.evaluate(scene, 0.0, state.q, state.p).forces.elastic[5])

    for depth in (2e-3, 5e-3, 7.9e-3, 9e-3):
        slope = (force(depth + 1e-6) - force(depth - 1e-6)) / 2e-6
        found = float(stiffness(scene, 0, np.array([depth]))[0])
        assert found == pytest.approx(slope, rel=1e-6)


@pytest.mark.parametrize(
    "side", [None, sp.Face(tilt=0.05), sp.Face(height=0.01), sp.Arc(0.025, span=0.5)]
)
def test_contacts_are_off_their_sides_where_these_end(side: Any) -> None:
    grasped = sp.GraspedObject(width=0.05, height=0.02, right=side, left=side)
    scene = jaws(grasped=grasped, duration=1e-4, friction=0.5)
    half = half_lengths(scene)[0]
    for share in (0.95, 1.05):
        # Higher up the object its contact is lower down the side.
        shift = 0.025 * np.sin(share * half / 0.025) if isinstance(side, sp.Arc) else share * half
        y = scene.start().q[1] + shift * (45 / 25 if isinstance(side, sp.Arc) else 1.0)
        state = sp.State.consistent(scene, y=y, fingers=scene.start().q[3:5])
        place = np.abs(contacts(scene, state.q).places).max()
        run = sp.simulate(replace(scene, initial=state), stop_on=())
        assert ("off_face" in run.violations) == (place > half)
        if not isinstance(side, sp.Face) or not side.tilt:
            assert (place > half) == (share > 1.0)


UNEVEN = linked(
    grasped=sp.GraspedObject(
        com_offset=3e-3, right=sp.Face(tilt=0.05), left=sp.Arc(0.03, (0.004, 0.0))
    )
)


def test_the_middles_of_sides_are_where_the_object_says() -> None:
    scene = replace(UNEVEN, friction=0.8)
    # W/2 - w to the right, R - K_x to the left.
    assert width(scene) == pytest.approx((0.0245 - 0.003) + (0.03 - 0.004))
    assert sp.wrench_limits(scene, [[1.0, 0.0, 0.0]]).length == pytest.approx(0.5 * width(scene))
    q = sp.simulate(scene).q[-1]
    outline = object_outline(scene, q)
    start, way = outline[1:3]
    share = (contact_point(scene, q, 0) - start) @ (way - start) / ((way - start) @ (way - start))
    assert 0.0 < share < 1.0
    away = contact_point(scene, q, 0) - start - share * (way - start)
    assert np.abs(away).max() < 1e-9


@each_scene
def test_fingers_close_until_both_tips_are_compressed_so_far(name: str) -> None:
    scene = replace(SCENES[name], initial="touching")
    x, y = scene.start().q[:2]
    for depth in (0.0, 2e-3, 5e-3):
        fingers = closing(scene, depth)
        assert fingers is not None
        state = sp.State.consistent(scene, x=x, y=y, fingers=fingers)
        # The heights of links change a little, and with them those of places on slopes.
        assert np.mean(state.q[5:7]) == pytest.approx(depth, abs=2e-4)
        if "jaws" in name:
            np.testing.assert_allclose(state.q[5:7], depth, atol=1e-12)


def test_the_drawn_tip_lies_on_the_arc() -> None:
    scene = jaws(grasped=BOTTLE)
    q = sp.simulate(scene).q[-1]
    for side in (0, 1):
        tip = finger_outline(scene, q, side).tip
        away = np.hypot(*(tip - q[:2]).T) - 0.025
        # The shear is drawn along the tangent.
        assert (np.abs(away) < 1e-4).sum() > 10
        assert away.min() > -1e-4
