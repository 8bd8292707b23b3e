"""Capsules: a failed run, shown again to the same bits from its capsule alone."""

import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

import softpinch as sp
from failing import KINDS, study
from softpinch import _core


def require_same(a: sp.Run, b: sp.Run) -> None:
    """Two runs to the bit, with everything that says how they ended."""
    assert (a.status, a.message, a.violations, a.stats) == (
        b.status, b.message, b.violations, b.stats
    )  # fmt: skip
    assert a.t.tobytes() == b.t.tobytes()
    assert a.arrays().keys() == b.arrays().keys()
    for name, array in a.arrays().items():
        assert array.tobytes() == b.arrays()[name].tobytes(), name


@pytest.mark.parametrize("kind", KINDS)
def test_a_capsule_replays_to_the_bits_of_the_study_from_memory_and_from_a_file(
    kind: str, tmp_path: Path
) -> None:
    ensemble = study(kind)
    capsules = ensemble.failures()
    assert len(capsules) == 4
    for capsule in capsules[1::2]:
        run = capsule.run
        assert capsule.status == ensemble.status[run]
        assert capsule.time == ensemble.failure_time[run] == ensemble.end_time[run]
        assert capsule.message == ensemble.message[run]
        assert capsule.scene == ensemble.scene_of(run)
        for path, value in capsule.parameters.items():
            np.testing.assert_array_equal(value, ensemble.parameters[path][run])
        there = ensemble.replay(run)
        assert capsule.agrees(there) and capsule.agrees(capsule.replay((), every=7))
        require_same(capsule.replay(), there)
        path = tmp_path / "capsule.toml"
        path.write_text(capsule.to_toml(), encoding="utf-8")
        for again in (
            sp.Capsule.from_toml(path),
            sp.Capsule.from_toml(capsule.to_toml()),
            sp.Capsule.from_dict(capsule.to_dict()),
            pickle.loads(pickle.dumps(capsule)),
        ):
            assert again == capsule and hash(again) == hash(capsule)
            assert again.to_toml() == capsule.to_toml()
            require_same(again.replay(), there)


def test_capsules_are_equal_where_all_they_say_is() -> None:
    first, second = study("mass").failures()[:2]
    assert first != second and first != "capsule"
    assert study("mass").failures()[0] == first
    for other in (
        {"run": 7}, {"time": 0.5}, {"status": "crushed"}, {"message": ""}, {"results_version": 0},
        {"parameters": {"grasped.mass": 0.3}}, {"options": replace(first.options, dt=1e-3)},
    ):  # fmt: skip
        assert replace(first, **other) != first
    again = sp.Capsule.from_toml(first.to_toml())
    assert again == first != replace(again, parameters={})


def test_a_replay_that_ends_otherwise_does_not_agree() -> None:
    capsule = study("mass").failures()[0]
    run = capsule.replay(())
    assert not replace(capsule, status="crushed").agrees(run)
    assert not replace(capsule, time=np.nextafter(capsule.time, 1.0)).agrees(run)


# What is changed in a capsule's data -> what is said.
Change = Callable[[dict[str, Any]], object]
BAD: dict[str, tuple[Change, str]] = {
    "unknown table": (lambda d: d.update(scenes={}), r'Capsule\.scenes: .*did you mean "scene"'),
    "a number for a table": (lambda d: d.update(capsule=3), r"\(in capsule\) = 3: must be a table"),
    "no run": (lambda d: d["capsule"].pop("run"), r"Capsule\.run \(in capsule\): is missing"),
    "status": (lambda d: d["capsule"].update(status="gone"), r"status = 'gone': must be one of"),
    "message": (lambda d: d["capsule"].update(message=3), r"Capsule\.message = 3: must be text"),
    "path": (lambda d: d["capsule"]["parameters"].update({"grasped.mas": 1.0}),
             r"parameters\['grasped\.mas'\]: .*did you mean \"grasped.mass\""),
    "shape": (lambda d: d["capsule"]["parameters"].update({"disturbances.0.force": [1.0]}),
              r"parameters\['disturbances\.0\.force'\] = \[1\.0\]: must equal the scene's val"),
    "another value than the scene's": (lambda d: d["scene"]["grasped"].update(mass=0.3),
                                       r"'grasped\.mass'\] = 0\..*: must equal .* value, 0\.3"),
    "scene": (lambda d: d["scene"].update(duration=0), r"Scene\.duration = 0\.0: .*\(in scene\)"),
    "no step": (lambda d: d["simulate"].pop("dt"), r"Capsule\.dt \(in simulate\): is missing"),
    "method": (lambda d: d["simulate"].update(method="rk5"), r'"rk4"\? \(in simulate\)'),
}  # fmt: skip


@pytest.mark.parametrize("slip", BAD)
def test_a_slip_in_a_capsule_is_named_with_file_and_place(slip: str, tmp_path: Path) -> None:
    change, message = BAD[slip]
    data = study("paths together").failures()[0].to_dict()
    change(data)
    path = tmp_path / "bad.toml"
    path.write_text(tomli_w.dumps(data), encoding="utf-8")
    with pytest.raises(ValueError, match=message) as error:
        sp.Capsule.from_toml(path)
    assert str(error.value).startswith(f"{path}: ")
    with pytest.raises(ValueError, match=message):
        sp.Capsule.from_toml(path.read_text(encoding="utf-8"))


def test_a_noise_of_another_run_is_refused() -> None:
    data = study("noise").failures()[0].to_dict()
    data["capsule"]["run"] = 1
    with pytest.raises(ValueError, match=r"noise must have the seed = 11 and run = 1 of the caps"):
        sp.Capsule.from_dict(data)


def test_a_scene_file_is_not_a_capsule(tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(sp.Scene().to_toml(), encoding="utf-8")
    with pytest.raises(ValueError, match=r"bad\.toml: Capsule\.\w+: unknown name; must be"):
        sp.Capsule.from_toml(path)


def test_another_cores_capsule_is_read_and_keeps_its_version() -> None:
    capsule = study("mass").failures()[0]
    old = replace(capsule, version="0.0.9", results_version=capsule.results_version - 1)
    again = sp.Capsule.from_toml(old.to_toml())
    assert (again.version, again.results_version) == ("0.0.9", _core.RESULTS_VERSION - 1)
    assert again == old != capsule
