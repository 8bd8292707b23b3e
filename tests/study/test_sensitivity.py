"""Which parameter matters, against models whose answer is known exactly."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import softpinch as sp
from ensembles import calm, pushed
from softpinch.study.effects import Effects, effects


def draws(n: int, names: str, seed: int = 1) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    return {name: rng.uniform(-np.pi, np.pi, n) for name in names}


@pytest.mark.parametrize("kind", ["uniform", "normal", "three values"])
@pytest.mark.parametrize(
    ("n", "within"),
    [(1000, 0.09), (5000, 0.04), pytest.param(20_000, 0.02, marks=pytest.mark.slow)],
)
def test_an_additive_linear_model(kind: str, n: int, within: float) -> None:
    rng = np.random.default_rng(2)
    draw = {
        "uniform": lambda: rng.uniform(-(3**0.5), 3**0.5, n),
        "normal": lambda: rng.normal(size=n),
        "three values": lambda: rng.choice([-(1.5**0.5), 0.0, 1.5**0.5], n),
    }[kind]
    x = {name: draw() for name in "abcd"}
    # All have variance 1, so the shares are 9, 4, 1 and 0 of 14.
    found = effects(x, 5.0 - 3.0 * x["a"] + 2.0 * x["b"] + x["c"])
    for name, exact in {"a": 9 / 14, "b": 4 / 14, "c": 1 / 14, "d": 0.0}.items():
        assert found[name].share == pytest.approx(exact, abs=within), name
        assert found[name].runs == n
    assert found["a"].rank_correlation < -0.7 < 0.4 < found["b"].rank_correlation
    assert found["c"].share > found["c"].noise
    assert abs(found["d"].share) < 3.0 * found["d"].noise < within


@pytest.mark.parametrize(
    ("n", "within"),
    [
        (2000, 0.05),
        pytest.param(20_000, 0.02, marks=pytest.mark.slow),
        pytest.param(100_000, 0.01, marks=pytest.mark.slow),
    ],
)
def test_the_ishigami_function(n: int, within: float) -> None:
    x = draws(n, "abc")
    found = effects(x, np.sin(x["a"]) + 7.0 * np.sin(x["b"]) ** 2
                    + 0.1 * x["c"] ** 4 * np.sin(x["a"]))  # fmt: skip
    # Ishigami and Homma (1990): variances of a, of b, and of a and c together only.
    alone = 0.5 * (1.0 + 0.1 * np.pi**4 / 5.0) ** 2
    both = 0.01 * np.pi**8 * (1 / 18 - 1 / 50)
    total = alone + 49.0 / 8.0 + both
    assert found["a"].share == pytest.approx(alone / total, abs=within)
    assert found["b"].share == pytest.approx(49.0 / 8.0 / total, abs=within)
    assert abs(found["c"].share) < within
    # b goes up and down: no rank correlation sees it.
    assert abs(found["b"].rank_correlation) < within


def test_shares_of_pure_noise_have_mean_zero_and_pass_the_level_one_time_in_twenty() -> None:
    rng = np.random.default_rng(3)
    shares, passed = [], 0
    for _ in range(300):
        x = {name: rng.random(120) for name in "ab"}
        for effect in effects(x, rng.standard_t(3, 120)).values():
            shares.append(effect.share)
            passed += effect.share > effect.noise
    error = np.std(shares) / np.sqrt(len(shares))
    assert abs(np.mean(shares)) < 4.0 * error
    assert 0.02 < passed / len(shares) < 0.09


@given(
    n=st.integers(1, 60),
    seed=st.integers(0, 2**32),
    scale=st.sampled_from([1e-300, 1e-6, 1.0, 1e100, 1.5e308]),
    rounded=st.booleans(),
)
def test_any_numbers_give_finite_shares_and_units_do_not_matter(
    n: int, seed: int, scale: float, rounded: bool
) -> None:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-1, 1, n), rng.uniform(-1, 1, n)
    if rounded:
        x, y = np.round(x), np.round(y)
    y[rng.random(n) < 0.1] = np.inf
    found = effects({"x": x, "scaled": x * scale, "same": np.full(n, scale)}, y)
    finite = y[np.isfinite(y)]
    assert found["x"].runs == len(finite)
    if len(finite) < 3 or np.ptp(finite) == 0.0:
        assert np.isnan(found["x"].share)
        return
    assert -1e3 < found["x"].share <= 1.0
    assert -1.0 - 1e-9 <= found["x"].rank_correlation <= 1.0 + 1e-9
    if scale in (1e-6, 1.0, 1e100):
        assert found["scaled"].share == pytest.approx(found["x"].share, abs=1e-6)
    assert found["same"] == (0.0, 0.0, 0.0, len(finite))
    large = effects({"x": x}, np.where(np.isfinite(y), y * 1e200, np.nan))
    assert large["x"].share == pytest.approx(found["x"].share, abs=1e-9)


def test_bad_input_is_refused() -> None:
    with pytest.raises(ValueError, match="a has 2 rows: must have one for each of result, 3"):
        effects({"a": [1.0, 2.0]}, [1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match=r"a\[1\] = nan: must be finite"):
        effects({"a": [1.0, np.nan]}, [1.0, 2.0])
    scene = sp.Scene(duration=0.01)
    with pytest.raises(ValueError, match="nothing was varied"):
        sp.sensitivity(sp.monte_carlo(scene, 3, dt=1e-3, progress=False))
    with pytest.raises(ValueError, match='did you mean "completed"'):
        sp.sensitivity(pushed(), "complete")


def test_an_ensemble_says_which_of_its_parameters_matter() -> None:
    ensemble = pushed()
    found = sp.sensitivity(ensemble)
    assert set(found) == {"grasped.mass", "disturbances.0.force.0", "disturbances.0.force.1",
                          "schedule.angles.0.0", "schedule.angles.0.1"}  # fmt: skip
    shares = [effect.share for effect in found.values()]
    assert shares == sorted(shares, reverse=True)
    assert next(iter(found)).startswith("disturbances.0.force")
    # The same again: what sets the noise level is not random.
    assert sp.sensitivity(ensemble) == found
    force = ensemble["disturbances.0.force"]
    bare = effects({"x": force[:, 0]}, (ensemble.status == "completed").astype(float))
    assert bare["x"].share == found["disturbances.0.force.0"].share
    assert sp.sensitivity(ensemble, "final_state.theta")["grasped.mass"].runs == ensemble.runs
    settled = np.isfinite(ensemble["settling_time"]).sum()
    assert next(iter(sp.sensitivity(ensemble, "settling_time").values())).runs == settled
    still = calm()
    same = sp.sensitivity(still)
    assert np.isnan(same["grasped.mass"].share)
    said = f"The result is the same in all {still.runs} runs: no share is known."
    assert repr(same).startswith(f"{said}\nvaried") and said in same._repr_html_()  # type: ignore[attr-defined]
    assert repr(found).startswith("varied")
    few = Effects(effects({"x": [1.0, 2.0, 3.0]}, [1.0, 2.0, np.nan]))
    assert repr(few).startswith("The result is finite in only 2 runs")
