"""The layer for JAX: the bits of `simulate`, and the derivatives of it in every way JAX asks."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from unilateral_scenes import regripped

jax = pytest.importorskip("jax", reason="the extra jax is not installed")

import jax.numpy as jnp  # noqa: E402
from jax.test_util import check_grads  # noqa: E402

import softpinch.jax as layers  # noqa: E402

SCENE = sp.Scene(
    schedule=sp.Schedule.ramps([0.0, 0.02], np.deg2rad([[4.0, 4.0], [7.0, 2.0]])),
    disturbances=[sp.Pulse(time=0.01, duration=0.01, force=(20.0, -10.0))],
    duration=0.03,
)
# A number, a pair and an array.
PATHS = ("hand.tip.youngs_modulus", "disturbances.0.force", "schedule.angles")
OPTIONS: dict[str, Any] = {"dt": 1e-3, "every": 4}
RECORD = ("multipliers", "torque")
SMOOTH = ("q", "p", *RECORD)
# Sizes of the values, by which derivatives are scaled, so that none hides behind another.
SIZES = {"hand.tip.youngs_modulus": 3e5, "disturbances.0.force": 20.0, "schedule.angles": 0.1}
N = 3


@pytest.fixture(autouse=True)
def sixty_four_bits() -> Iterator[None]:
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


def values() -> dict[str, Any]:
    pulse = SCENE.disturbances[0]
    assert isinstance(pulse, sp.Pulse)
    return {
        "hand.tip.youngs_modulus": jnp.array(3.1e5),
        "disturbances.0.force": jnp.array(pulse.force),
        "schedule.angles": jnp.array(SCENE.schedule.angles),
    }


def batch() -> dict[str, Any]:
    """N runs, none like another."""
    factors = 1.0 + 0.02 * np.arange(N)
    return {path: jnp.stack([k * value for k in factors]) for path, value in values().items()}


def one(of: Any, k: int) -> Any:
    return jax.tree.map(lambda value: value[k], of)


def simulated(**more: Any) -> sp.Run:
    changed = replace(SCENE.hand, tip=sp.Fingertip(youngs_modulus=3.1e5))
    return sp.simulate(replace(SCENE, hand=changed), record=("state", *RECORD), **OPTIONS, **more)


def trajectory() -> Any:
    return layers.simulate(SCENE, PATHS, record=RECORD, **OPTIONS)


def final() -> Any:
    return layers.final_state(SCENE, PATHS, dt=1e-3)


LAYERS = {"trajectory": trajectory, "final state": final}
BOTH = pytest.mark.parametrize("make", LAYERS.values(), ids=LAYERS)


def loss(layer: Any) -> Any:
    """A curved function of scaled values: sums over coordinates and rates of different sizes."""

    def of(scaled: dict[str, Any]) -> Any:
        run = layer({path: SIZES[path] * value for path, value in scaled.items()})
        return jnp.sum((1e2 * run.q) ** 2) + jnp.sum(jnp.sin(run.p))

    return of


def scaled(given: dict[str, Any]) -> dict[str, Any]:
    return {path: value / SIZES[path] for path, value in given.items()}


def same(a: Any, b: Any) -> bool:
    """To the bit, of the same types."""
    pairs = list(zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True))
    return bool(pairs) and all(x.dtype == y.dtype and np.array_equal(x, y) for x, y in pairs)


def near(a: Any, b: Any, relative: float) -> bool:
    pairs = zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    return all(np.allclose(x, y, rtol=0.0, atol=relative * np.abs(y).max()) for x, y in pairs)


def test_the_rows_are_those_of_simulate() -> None:
    run, given = simulated(), trajectory()(values())
    assert layers.STATUSES[int(given.status)] == run.status == "completed" and given.completed
    for name in ("t", *SMOOTH):
        assert np.array_equal(getattr(given, name), getattr(run, name))
    plain = layers.simulate(SCENE, PATHS, **OPTIONS)(values())
    assert plain.multipliers is None and plain.torque is None
    last = final()(values())
    assert np.array_equal(last.q, run.q[-1]) and np.array_equal(last.p, run.p[-1])
    assert last.t == run.t[-1]


@BOTH
def test_jit_changes_no_bit(make: Any) -> None:
    layer = make()
    assert same(jax.jit(layer)(values()), layer(values()))
    slope = jax.grad(loss(layer))
    assert near(jax.jit(slope)(scaled(values())), slope(scaled(values())), 1e-12)


@pytest.mark.parametrize("path", PATHS)
def test_jvp_is_the_sensitivity_along_the_tangent(path: str) -> None:
    direction = jnp.array(np.random.default_rng(2).normal(size=values()[path].shape))
    zeros = jax.tree.map(jnp.zeros_like, values())
    run: Any = simulated(sensitivities=path)
    out, dots = jax.jvp(trajectory(), (values(),), ({**zeros, path: direction},))
    assert same(out, trajectory()(values()))
    rows = {"q": run.sensitivity[path][:, :9], "p": run.sensitivity[path][:, 9:]}
    rows |= {name: getattr(run.sensitivity, name)[path] for name in RECORD}
    for name, slope in rows.items():
        wanted = np.tensordot(slope, direction, axes=np.ndim(direction))
        assert near(getattr(dots, name), wanted, 1e-12) and np.abs(wanted).max() > 0.0
    assert not np.any(dots.t)


@BOTH
def test_jax_finds_the_derivatives_right_forwards_and_backwards(make: Any) -> None:
    check: Any = check_grads
    check(loss(make()), (scaled(values()),), order=1, modes=("fwd", "rev"), eps=1e-4,
                rtol=1e-5)  # fmt: skip


@BOTH
def test_a_batch_is_a_loop(make: Any) -> None:
    layer = make()
    together = jax.jit(jax.vmap(layer))(batch())
    slopes = jax.vmap(jax.grad(loss(layer)))(scaled(batch()))
    for k in range(N):
        assert same(one(together, k), layer(one(batch(), k)))
        assert near(one(slopes, k), jax.grad(loss(layer))(one(scaled(batch()), k)), 1e-12)


@BOTH
def test_batches_of_batches_and_of_some_values_only(make: Any) -> None:
    layer, given = make(), batch()
    moduli = given.pop("hand.tip.youngs_modulus")

    def of(modulus: Any, rest: Any) -> Any:
        return layer({"hand.tip.youngs_modulus": modulus, **rest})

    table = jax.vmap(jax.vmap(of, (None, 0)), (0, None))(moduli, given)
    for i in range(N):
        for j in range(N):
            assert same(one(one(table, i), j), of(moduli[i], one(given, j)))
    shared = jax.vmap(of, (0, None))(moduli, one(given, 0))
    assert same(shared, one(jax.tree.map(lambda value: jnp.swapaxes(value, 0, 1), table), 0))


def test_only_what_moves_is_derived(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    inner = sp.simulate

    def watched(*given: Any, sensitivities: Any, **how: Any) -> sp.Run:
        asked.append(tuple(sensitivities))
        return inner(*given, sensitivities=sensitivities, **how)

    monkeypatch.setattr("softpinch.jax.layers.run_of", watched)
    layer, rest = trajectory(), values()
    modulus = rest.pop(PATHS[0])
    jax.grad(lambda e: layer({PATHS[0]: e, **rest}).q[-1, 1])(modulus)
    assert asked == [(PATHS[0],)]
    asked.clear()
    jacobian = jax.jacfwd(lambda angles: layer({**values(), PATHS[2]: angles}).q)(
        values()[PATHS[2]]
    )
    assert asked == [(PATHS[2],)] and jacobian.shape == (9, 9, 2, 2)  # one call, not one a column


@pytest.mark.parametrize("last", [True, False])
def test_derivatives_go_on_through_the_events_of_contacts(last: bool) -> None:
    scene, paths = regripped(), ("friction", "hand.tip.right.youngs_modulus")
    how: dict[str, Any] = {"dt": 2e-4}
    layer = (
        layers.final_state(scene, paths, **how) if last else layers.simulate(scene, paths, **how)
    )

    def of(given: Any) -> Any:
        run = layer({paths[0]: given[0], paths[1]: 3e5 * given[1]})
        return jnp.sum((1e2 * run.q) ** 2) + jnp.sum(jnp.sin(run.p))

    run = sp.simulate(scene, **how)
    assert {change.after.name for change in run.contact_changes} >= {"FREE", "SLIP", "STICK"}
    check: Any = check_grads
    check(of, (jnp.array([0.5, 1.1]),), order=1, modes=("fwd", "rev"), eps=1e-6, rtol=1e-5)
    slopes = jax.vmap(jax.grad(of))(jnp.array([[0.5, 1.1], [0.52, 0.9]]))
    assert near(slopes[0], jax.grad(of)(jnp.array([0.5, 1.1])), 1e-12)
    assert np.isfinite(slopes).all() and np.abs(slopes).min() > 0.0


def test_what_has_no_derivative_is_nan_with_the_reason() -> None:
    scene = sp.Scene(contact="unilateral", friction=0.01, duration=0.02)
    layer = layers.simulate(scene, "friction", dt=1e-3)
    given = {"friction": jnp.array(0.01)}
    with pytest.warns(sp.StabilityWarning, match="an event coincides with another one"):
        out, dots = jax.jvp(layer, (given,), ({"friction": jnp.array(1.0)},))
    known = np.isfinite(dots.q).all(axis=1)
    assert np.isfinite(out.q).all() and known[0] and not known[-1]
    with pytest.warns(sp.StabilityWarning, match="an event coincides with another one"):
        assert np.isnan(jax.grad(lambda mu: layer({"friction": mu}).q[-1, 1])(0.01))


def test_a_run_that_ends_early_is_filled_up() -> None:
    thrown = sp.Impulse(time=0.011, impulse=(50.0, 0.0))
    scene = replace(SCENE, disturbances=[thrown])
    layer = layers.simulate(scene, "disturbances.0.impulse", **OPTIONS)
    run = sp.simulate(scene, **OPTIONS)
    n = len(run)
    assert not run.success and 3 < n < 9

    def kept(impulse: Any) -> Any:
        given = layer({"disturbances.0.impulse": impulse})
        return jnp.sum(jnp.where(jnp.isnan(given.q), 0.0, given.q))

    given = layer({"disturbances.0.impulse": thrown.impulse})
    assert layers.STATUSES[int(given.status)] == run.status and not given.completed
    assert np.array_equal(given.q[:n], run.q) and np.array_equal(given.t[:n], run.t)
    assert all(np.isnan(value[n:]).all() for value in (given.t, given.q, given.p))
    slope = jax.grad(kept)(jnp.array(thrown.impulse))
    assert np.isfinite(slope).all() and np.any(slope)

    # The derivative of a square is NaN in the rows that are not there.
    def squares(impulse: Any) -> Any:
        return jnp.nansum(layer({"disturbances.0.impulse": impulse}).q ** 2)

    h, at = 1e-5, np.array(thrown.impulse)
    apart = [squares(at + by) - squares(at - by) for by in h * np.eye(2)]
    assert np.allclose(jax.grad(squares)(at), np.divide(apart, 2.0 * h), rtol=1e-6)
    # Beside others in a batch, which run on.
    many = jax.vmap(lambda x: layer({"disturbances.0.impulse": x}))(
        jnp.array([[0.0, 0.0], thrown.impulse])
    )
    assert many.completed.tolist() == [True, False] and np.isfinite(many.q[0]).all()


@pytest.mark.parametrize("make", [layers.simulate, layers.final_state])
def test_wrong_arguments_are_refused_by_their_names(make: Any) -> None:
    for vary, error, words in [
        ("grasped.mas", ValueError, "has no field 'mas'"),
        (("grasped.mass", "grasped.mass.0"), ValueError, "has no parts"),
        ((), ValueError, r"vary = \(\): must have"),
        (3, TypeError, "vary = 3"),
    ]:
        with pytest.raises(error, match=words):
            make(SCENE, vary)
    with pytest.raises(ValueError, match=r"dt = -1\.0"):
        make(SCENE, "grasped.mass", dt=-1.0)
    with pytest.raises(TypeError, match="scene = 1"):
        make(1, "grasped.mass")
    with pytest.raises(ValueError, match="record = 'energy'"):
        layers.simulate(SCENE, "grasped.mass", record="energy")


@BOTH
def test_wrong_values_are_refused_by_their_paths(make: Any) -> None:
    layer, right = make(), values()
    for given, error, words in [
        (3.0, TypeError, "values = 3.0: must be a table"),
        ({**right, "grasped.mass": 0.1}, ValueError, "values.grasped.mass: unknown name"),
        ({PATHS[0]: 3e5}, ValueError, f"'{PATHS[1]}' is missing"),
        ({**right, PATHS[1]: 1.0}, ValueError, r"has shape \(\), must have \(2,\)"),
        ({**right, PATHS[0]: "x"}, TypeError, "= 'x': must be numbers"),
        ({**right, PATHS[0]: np.nan}, ValueError, "^Fingertip.youngs_modulus = NaN: must be"),
    ]:
        with pytest.raises(error, match=words):
            layer(given)
    with pytest.raises(ValueError, match="must have"):
        jax.jit(layer)({**right, PATHS[1]: jnp.zeros(3)})


def test_a_value_that_moves_the_rows_is_refused() -> None:
    layer = layers.simulate(SCENE, "duration", **OPTIONS)
    assert len(layer({"duration": 0.03}).t) == 9
    with pytest.raises(Exception, match="number of rows must not depend on its values"):
        layer({"duration": 0.06})


def test_an_error_within_jit_has_its_message_and_the_number_of_its_run() -> None:
    moduli = jnp.array([3e5, -1.0])
    layer = layers.simulate(SCENE, PATHS[0], **OPTIONS)
    with pytest.raises(Exception, match=r"youngs_modulus = -1.0"):
        jax.jit(lambda e: layer({PATHS[0]: e}))(moduli[1]).q.block_until_ready()
    with pytest.raises(Exception, match=r"run 1: Fingertip.youngs_modulus = -1.0"):
        jax.vmap(jax.grad(lambda e: layer({PATHS[0]: e}).q[-1, 1]))(moduli).block_until_ready()
    with pytest.raises(Exception, match=r"run 1: Fingertip.youngs_modulus = -1.0"):
        jax.vmap(lambda e: layer({PATHS[0]: e}))(moduli).q.block_until_ready()


def test_numbers_of_32_bits_are_refused() -> None:
    layer = trajectory()
    jax.config.update("jax_enable_x64", False)
    for use in (trajectory, final, lambda: layer(values())):
        with pytest.raises(RuntimeError, match=r'jax.config.update\("jax_enable_x64", True\)'):
            use()


def test_there_are_no_second_derivatives() -> None:
    with pytest.raises(ValueError, match="do not support JVP"):
        jax.hessian(loss(final()))(scaled(values()))
