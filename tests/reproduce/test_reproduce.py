"""`softpinch reproduce`: measures that can fail, numbers that are known, files that are there."""

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from paper_operations import LEAST_FORCE, SETTLED
from softpinch import paper
from softpinch.reproduce import FORMATS, Reproduction, find, reproduce, simulate_all
from softpinch.reproduce import verdict as v
from softpinch.run import measures as m
from softpinch.run.options import Options
from softpinch.run.run import LEDGER

pytest.importorskip("matplotlib")

# Two operations, the second to 10 and -10 degrees, and a push in the middle of the first.
SCENE = sp.Scene(
    schedule=sp.Schedule.steps([0.0, 1.0], np.deg2rad([[0, 0], [10, -10]])), duration=2.0
)
PUSHED = replace(
    SCENE,
    schedule=sp.Schedule.steps([0.0], [[0.0, 0.0]]),
    disturbances=(sp.Pulse(time=1.0, duration=0.01, force=(1.0, 0.0)),),
)
T = np.linspace(0.0, 2.0, 2001)


def made(scene: sp.Scene = SCENE, status: str = "completed", **columns: Any) -> sp.Run:
    """A run with what a test puts into it: q, multipliers, residuals as functions of time."""
    t = T if status == "completed" else T[:1500]
    sizes = {"q": 9, "p": 9, "integral": 2, "multipliers": 4, "residuals": 4, "energy": len(LEDGER)}
    arrays = {name: np.zeros((len(t), size)) for name, size in sizes.items()}
    arrays["q"][:, 3:5] = scene.schedule.target(t - 1e-9)
    for name, change in columns.items():
        array, column = name.rsplit("_", 1)
        arrays[array][:, int(column)] = change(t)
    options = Options(dt=1e-3, method="rk4", formulation="csm", stabilization=sp.Stabilization(),
                      record=("state", "multipliers", "residuals", "energy"), every=1,
                      stop_on=())  # fmt: skip
    outcome = {
        "t": t.copy(),
        "status": status,
        "message": "as made",
        "violations": {},
        "violation_intervals": {},
        "holds": False,
        "stats": {},
    }
    return sp.Run(scene, options, {**arrays, **outcome, "final": {}})


def since(start: float, shape: Callable[[np.ndarray], np.ndarray]) -> Callable[..., np.ndarray]:
    """`shape` of the time since `start`, zero before."""
    return lambda t: np.where(t > start, shape(np.maximum(t - start, 0.0)), 0.0)


def ring(size: float, last: float = 0.05) -> Callable[..., np.ndarray]:
    return since(1.0, lambda t: size * np.exp(-t / last) * np.sin(40.0 * t))


def spike(time: float, size: float) -> Callable[..., np.ndarray]:
    return lambda t: np.where(np.abs(t - time) < 5e-4, size, 1e-12)


def verdicts(check: Callable[[sp.Run], v.Finding], **columns: Any) -> str:
    return check(made(**columns)).verdict


def test_converging_holds_only_where_the_end_of_every_operation_is_calm() -> None:
    settle = since(1.0, lambda t: 0.02 * (1.0 - np.exp(-t / 0.05)))
    assert verdicts(v._converges, q_0=settle) == "holds"
    creep = since(1.0, lambda t: 0.02 * (1.0 - np.exp(-t)))
    assert verdicts(v._converges, q_0=creep) == "does not hold"
    for column in (0, 1, 2):
        shake = {f"q_{column}": lambda t: 1e-3 * np.sin(50.0 * t)}
        assert verdicts(v._converges, **shake) == "does not hold"
    first_only = {"q_1": lambda t: np.where(t < 1.0, 1e-3 * np.sin(50.0 * t), 0.0)}
    assert verdicts(v._converges, **first_only) == "does not hold"
    assert verdicts(v._converges, q_0=settle, status="separated") == "does not hold"


def test_settling_time_is_that_of_an_exponential() -> None:
    run = made(q_0=since(1.0, lambda t: 0.02 * (1.0 - np.exp(-t / 0.05))))
    times = m.settling_times(run, 1e-4, 1.0)
    np.testing.assert_allclose(times, [0.0, 0.05 * np.log(0.02 / 1e-4)], atol=1e-3)
    assert np.isnan(m.settling_times(made(status="crushed"), 1e-4, 1.0)[1])


def test_the_fingers_arrive_or_not() -> None:
    assert verdicts(v._fingers_arrive) == "holds"
    late = {"q_3": lambda t: np.where(t > 1.0, np.deg2rad(9.0), 0.0)}
    assert verdicts(v._fingers_arrive, **late) == "does not hold"
    np.testing.assert_allclose(
        np.rad2deg(m.finger_errors(made(**late))), [[0, 0], [1, 0]], atol=1e-6
    )


def test_residuals_hold_up_to_their_order_and_rise_at_switches_only() -> None:
    assert verdicts(v._holonomic_order, residuals_0=spike(1.0, 9e-9)) == "holds"
    assert verdicts(v._holonomic_order, residuals_1=spike(1.0, -2e-8)) == "does not hold"
    # C^N may rise around a switch, not elsewhere.
    assert verdicts(v._nonholonomic_order, residuals_2=spike(1.01, 1e-3)) == "holds"
    assert verdicts(v._nonholonomic_order, residuals_3=spike(1.2, -2e-6)) == "does not hold"
    assert verdicts(v._rises_at_switches, residuals_2=spike(1.01, 1e-7)) == "holds"
    assert verdicts(v._rises_at_switches, residuals_2=spike(0.5, 1e-7)) == "does not hold"


def test_residuals_of_an_operation_and_of_its_last_quarter() -> None:
    run = made(residuals_1=spike(1.1, -3e-9), residuals_2=spike(0.9, 5e-9))
    np.testing.assert_allclose(m.peak_residuals(run), [[1e-12, 5e-9], [3e-9, 1e-12]])
    np.testing.assert_allclose(m.peak_residuals(run, 1.0 - m.LAST), [[1e-12, 5e-9], [1e-12, 1e-12]])


def test_a_disturbance_is_survived_or_not() -> None:
    def verdict(**columns: Any) -> str:
        return v._survives("ii", made(PUSHED, **columns)).verdict

    assert verdict(q_2=ring(0.1)) == "holds"
    assert verdict(q_2=ring(0.1, last=10.0)) == "does not hold"
    assert verdict(q_0=since(1.0, lambda t: 1e-3 * t)) == "does not hold"
    assert verdict(q_4=since(1.0, lambda t: np.full_like(t, 0.01))) == "does not hold"
    lost = v._survives("ii", made(PUSHED, status="separated"))
    assert lost.verdict == "does not hold"
    assert "separated" in lost.evidence
    pulls = made(PUSHED, multipliers_0=lambda t: np.where((t > 1.1) & (t < 1.2), -2.0, 1.0))
    assert "a tip has to pull, -2.0 N" in v._survives("ii", pulls).evidence


def test_a_light_grasp_swings_more_or_not() -> None:
    def verdict(light: float, strong: float, light_y: float, strong_y: float) -> str:
        held = made(PUSHED)
        runs = [made(PUSHED, q_0=ring(x), q_1=ring(y))
                for x, y in ((light, light_y), (strong, strong_y))]  # fmt: skip
        return v._light_swings_more((runs[0], held), (runs[1], held)).verdict

    assert verdict(2e-3, 1e-3, 2e-6, 1e-6) == "holds"
    assert verdict(1e-3, 2e-3, 2e-6, 1e-6) == "does not hold"
    assert verdict(2e-3, 1e-3, 1e-6, 2e-6) == "does not hold"
    assert verdict(1e-3, 1e-3, 1e-6, 1e-6) == "does not hold"


def test_a_response_is_the_change_to_the_undisturbed() -> None:
    creep = {"q_1": lambda t: 1e-3 * t}
    both = {"q_1": lambda t: 1e-3 * t + ring(1e-4)(t)}
    t, change = m.response(made(PUSHED, **both), made(PUSHED, **creep))
    assert t[0] == 0.0 and len(t) == 1001
    np.testing.assert_allclose(change[:, 1], ring(1e-4)(T[1000:]), atol=1e-15)
    assert m.swing(made(PUSHED, **both))[1] == pytest.approx(1e-3, rel=0.1)
    assert m.onset(made(PUSHED)) == 1.0
    assert not m.lasting(made(PUSHED))
    assert m.lasting(made(replace(PUSHED, disturbances=(sp.Step(time=1.0, moment=1.0),))))
    assert m.lasting(made(replace(PUSHED, disturbances=(sp.Sine(frequency_hz=1.0),))))
    impulse = sp.Impulse(time=0.5, impulse=(1.0, 0.0))
    assert m.onset(made(replace(PUSHED, disturbances=(*PUSHED.disturbances, impulse)))) == 0.5


def test_swing_back_is_the_overshoot_of_the_peak() -> None:
    def wave(t: np.ndarray) -> np.ndarray:
        turn = np.sin(10.0 * np.pi * t)
        return np.select([t < 0.1, t < 0.2], [turn, 0.25 * turn], 0.0)

    back = m.swing_back(made(PUSHED, q_0=since(1.0, wave)))
    np.testing.assert_allclose(back, [0.25, 0.0, 0.0], atol=1e-3)


def test_pulling_is_measured_between_rows_but_not_across_a_switch() -> None:
    # Through zero at 0.3005 s and back at 0.4005 s; and from a jump at the switch to 1.0505 s.
    def force(t: np.ndarray) -> np.ndarray:
        dip = np.where(t < 0.9, 100.0 * (np.abs(t - 0.3505) - 0.05), 50.0)
        return np.where(t >= 1.0, 100.0 * (t - 1.0505), dip)

    run = made(multipliers_0=force, multipliers_1=lambda t: np.where(t > 1.7, -1.0, 1.0))
    np.testing.assert_allclose(m.pulling_intervals(run, 0), [(0.3005, 0.4005), (1.0, 1.0505)])
    np.testing.assert_allclose(m.pulling_intervals(run, 1), [(1.7005, 2.0)])
    assert m.longest_pull(run, 0.0, 1.0) == pytest.approx(0.1)
    assert m.longest_pull(run, 1.0, 2.0) == pytest.approx(0.2995)
    assert m.longest_pull(run, 0.5, 1.0) == 0.0
    np.testing.assert_allclose(m.least_pressing(run), [-4.95, -5.05])


# ---- the runs themselves -----------------------------------------------------------------------


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Reproduction:
    """With the step of the two simulations that the expected numbers come from."""
    told: list[tuple[str, float]] = []
    out = tmp_path_factory.mktemp("reproduce") / "made" / "here"
    found = reproduce(out, dt=2e-4, progress=lambda what, share: told.append((what, share)))
    shares = [share for _, share in told]
    assert shares == sorted(shares) and shares[0] == 0.0 and shares[-1] == 1.0
    return found


def column(result: Reproduction, table: str, name: str) -> list[Any]:
    found = result.tables[table]
    return [row[found.columns.index(name)] for row in found.rows]


def test_every_operation_settles_where_the_oracle_does(result: Reproduction) -> None:
    names = ("x [mm]", "y [mm]", "theta [deg]", "d_n1 [mm]", "d_n2 [mm]")
    for name, expected in zip(names, np.transpose(SETTLED), strict=True):
        np.testing.assert_allclose(
            column(result, "operations", name), expected, rtol=0, atol=5.1e-4, err_msg=name
        )
    least = column(result, "operations", "least lambda^H [N]")
    assert {k: round(least[k - 1]) for k in LEAST_FORCE} == LEAST_FORCE
    pulls = column(result, "operations", "pulls for [ms]")
    assert [pull > 0 for pull in pulls] == [force < 0 for force in least]


def test_the_other_sign_of_the_shear_loses_the_step(result: Reproduction) -> None:
    assert column(result, "tilt_coupling", "status, kappa = +1") == ["completed"] * 12
    lost = ["completed"] * 12
    lost[8] = "separated"
    assert column(result, "tilt_coupling", "status, kappa = -1") == lost


def test_the_verdict_on_every_claim(result: Reproduction) -> None:
    claims = [finding for finding in result.findings if finding.source]
    assert [claim.verdict for claim in claims] == ["holds"] * 11
    beyond = [finding for finding in result.findings if not finding.source]
    assert {finding.verdict for finding in beyond} == {"not in the paper"}
    assert beyond[-1].evidence == paper.PARAMETER_NOTE
    (lmee,) = [claim for claim in claims if "LMEE" in claim.claim]
    assert "it holds with the energy of gravity, and while no tip slips" in lmee.evidence
    (reading,) = [f for f in beyond if "delta(t)" in f.claim]
    assert reading.value == 0.0 and "separated" in reading.evidence
    (order,) = [f for f in beyond if "how long the step is" in f.claim]
    assert order.value == pytest.approx(16.0, rel=0.5)


def test_at_a_coarse_step_the_claim_about_residuals_fails() -> None:
    findings = {finding.claim: finding for finding in find(simulate_all(5e-4))}
    failed = [claim for claim, finding in findings.items() if finding.verdict == "does not hold"]
    assert failed == ["the holonomic residual C^H is at most of order 1e-8"]
    assert findings[failed[0]].value > 1e-8


def test_the_files_are_there_and_hold_the_tables(result: Reproduction) -> None:
    names = {file.name for file in result.files}
    figures = ("4", "5", "6", "7", "_forces", "_tilt_coupling", "_energy_minimum",
               "_contact_operations", "_contact_disturbances")  # fmt: skip
    assert names == {f"figure{figure}.png" for figure in figures} | {
        f"{table}.csv" for table in result.tables
    }
    for file in result.files:
        assert file.stat().st_size > 500
    folder = result.files[0].parent
    shapes = {"operations": (8, 15), "disturbances": (4, 17), "tilt_coupling": (12, 9),
              "energy_minimum": (8, 11)}  # fmt: skip
    for name, (rows, columns) in shapes.items():
        with (folder / f"{name}.csv").open(newline="", encoding="utf-8") as file:
            header, *body = list(csv.reader(file))
        assert (len(body), len(header)) == (rows, columns)
        table = result.tables[name]
        assert header == list(table.columns)
        for written, row in zip(body, table.rows, strict=True):
            for text, value in zip(written, row, strict=True):
                assert (float(text) if isinstance(value, float | int) else text) == value


def test_the_screen_shows_how_runs_end_and_the_verdicts(
    result: Reproduction, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("rich")
    monkeypatch.setenv("COLUMNS", "80")
    result.show()
    lines = capsys.readouterr().out.splitlines()
    text = "\n".join(lines)
    assert " ".join(lines[:2]).replace("  ", " ") == paper.PARAMETER_NOTE
    assert text.count("holds: ") == 11
    assert "pulling first at 1 s" in text


def test_bad_input_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="format = 'gif': must be one of"):
        reproduce(tmp_path, format="gif")
    with pytest.raises(ValueError, match=r"dt = -1\.0: must be finite and > 0"):
        reproduce(tmp_path, dt=-1.0)
    assert FORMATS == ("png", "pdf", "svg")
    assert not list(tmp_path.iterdir())


def test_an_interrupted_run_is_no_reproduction(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Interrupted:
        def run(self) -> dict[str, str]:
            return {"status": "interrupted"}

    monkeypatch.setattr("softpinch.run.request.Request.simulation", lambda *_: Interrupted())
    with pytest.raises(KeyboardInterrupt):
        reproduce(tmp_path)
