"""Ensembles as tables, DataFrames and Datasets: the same numbers, a unit for each, provenance."""

import json
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import softpinch as sp
from ensembles import calm, pushed
from softpinch.scene import fields as units
from softpinch.scene.disturbance import DISTURBANCES
from softpinch.scene.fields import label
from softpinch.study import tables
from softpinch.support.record import Record

# Fields that are no numbers of a unit, or records themselves.
NO_UNIT = {"hand", "grasped", "control", "schedule", "disturbances", "initial", "right", "left",
           "tip", "kind", "hold", "check", "grid", "linearized", "seed", "run",
           "fingers", "contact", "motion", "controller", "measures", "anti_windup",
           "law", "relaxation", "jitter_kind", "outer", "switch"}  # fmt: skip
RECORDS: list[type[Record]] = [sp.Scene, sp.Hand, sp.Finger, sp.Fingertip, sp.GraspedObject,
    sp.Pid, sp.SampledController, sp.Schedule, sp.State, *DISTURBANCES.values()]  # fmt: skip


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.__name__)
def test_every_field_of_every_record_has_a_unit(record: type[Record]) -> None:
    for f in fields(record):
        assert (f.name in units.FIELDS) != (f.name in NO_UNIT), f.name


PATHS = [
    ("grasped.mass", (), "kg", ()),
    ("disturbances.0.force", (2,), "N", ("axis",)),
    ("disturbances.0.force.1", (), "N", ()),
    ("disturbances.12.force", (5, 2), "N", (None, "axis")),
    ("schedule.angles", (3, 2), "rad", (None, "finger")),
    ("schedule.angles.2.0", (), "rad", ()),
    ("initial.q", (9,), units.COORDINATE_UNITS, ("coordinate",)),
    ("friction", (), "1", ()),
    ("max_residual", (), "m or m/s", ()),
]


def test_a_schedule_of_torques_has_their_unit() -> None:
    scene = sp.Scene(control=sp.Torque(), duration=1e-3)
    vary = {"schedule.angles.0.1": sp.Uniform(0.1, 0.2)}
    many = sp.monte_carlo(scene, 2, vary=vary, dt=1e-3, progress=False)
    assert many.to_pandas().attrs["units"]["schedule.angles.0.1"] == "N m"


def test_matrices_of_a_controller_have_an_axis_for_each_index() -> None:
    control = sp.SampledController.pid(1e-3, limits=(-9.0, 9.0))
    assert control.D is not None and control.limits is not None
    vary = {
        "control.D": [control.D, 2.0 * control.D],
        "control.limits": [control.limits, 2.0 * control.limits],
    }
    scene = sp.Scene(control=control, duration=1e-3)
    many = sp.monte_carlo(scene, 2, vary=vary, dt=1e-3, progress=False)
    data = many.to_xarray()
    for name, shape in (("control.D", (2, 2, 4)), ("control.limits", (2, 2, 2))):
        assert data[name].dims == ("run", f"{name}.index", f"{name}.index_2")
        assert data[name].shape == shape
    assert np.array_equal(data["control.D"].values[1], 2.0 * control.D)


@pytest.mark.parametrize(("path", "shape", "unit", "axes"), PATHS, ids=lambda v: str(v)[:24])
def test_units_and_axes_of_paths(
    path: str, shape: tuple[int, ...], unit: object, axes: object
) -> None:
    assert units.units(path, shape) == unit
    assert units.axes(path, shape) == axes


def test_columns_hold_every_number_and_their_names_are_paths() -> None:
    ensemble = pushed()
    found = ensemble._spec.schema.split(ensemble.to_dict())
    assert sum(1 for _ in found) == sum(
        int(np.prod(values.shape[1:])) for values in ensemble.to_dict().values()
    )
    for path in ensemble._spec.schema.split(ensemble.parameters):
        sp.monte_carlo(ensemble.scene, vary={path: found[path].values[:1]}, progress=False, dt=1e-3)
    with pytest.raises(ValueError, match=r"several numbers: take one of \"disturbances.0.force.0"):
        tables.number(ensemble, "disturbances.0.force")
    with pytest.raises(ValueError, match='did you mean "peak_rotation"'):
        tables.number(ensemble, "peak_rotatoin")
    with pytest.raises(ValueError, match="was not computed: pass summaries"):
        tables.number(calm(), "final_state.x")
    np.testing.assert_array_equal(
        tables.number(ensemble, "completed").values, ensemble.status == "completed"
    )
    pulled = tables.number(ensemble, "pulling").values
    assert pulled.mean() == ensemble.probability("pulling").value


def test_a_dataframe_has_every_number_its_unit_and_where_it_comes_from(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    ensemble = pushed()
    frame = ensemble.to_pandas()
    assert frame.index.name == "run" and frame.index.tolist() == ensemble.run.tolist()
    assert set(frame.attrs["units"]) == set(frame.columns)
    known = {unit for unit in frame.attrs["units"].values()}
    assert known <= {"", "1", "s", "kg", "N", "N m", "m", "rad", "m/s", "rad/s", "J", "m or m/s"}
    assert frame.attrs["provenance"] == ensemble.provenance()
    assert frame["status"].tolist() == ensemble.status.tolist()
    for k, name in enumerate(("disturbances.0.force.0", "disturbances.0.force.1")):
        np.testing.assert_array_equal(frame[name], ensemble["disturbances.0.force"][:, k])
    angles = frame[["schedule.angles.0.0", "schedule.angles.0.1"]].to_numpy()
    np.testing.assert_array_equal(angles, ensemble["schedule.angles"][:, 0])
    states = [name for name in frame.columns if name.startswith("final_state.")]
    assert states[:3] == ["final_state.x", "final_state.y", "final_state.theta"]
    np.testing.assert_array_equal(frame[states], ensemble["final_state"])
    pytest.importorskip("pyarrow")
    frame.to_parquet(tmp_path / "runs.parquet")
    back = pandas.read_parquet(tmp_path / "runs.parquet")
    pandas.testing.assert_frame_equal(back, frame)
    assert back.attrs == frame.attrs


def test_a_dataset_has_every_number_its_unit_and_where_it_comes_from(tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("scipy")
    ensemble = pushed()
    data = ensemble.to_xarray()
    assert data.run.values.tolist() == ensemble.run.tolist()
    for name, values in ensemble.to_dict().items():
        np.testing.assert_array_equal(data[name].values, values)
    for name, variable in data.variables.items():
        assert isinstance(variable.attrs["units"], str), name
    assert data["schedule.angles"].dims == ("run", "schedule.angles.index", "finger")
    right = data["schedule.angles"].sel(finger="right").values[:, 0]
    np.testing.assert_array_equal(right, ensemble["schedule.angles"][:, 0, 0])
    across = data["disturbances.0.force"].sel(axis="x").values
    np.testing.assert_array_equal(across, ensemble["disturbances.0.force"][:, 0])
    theta = data.final_state.sel(state="theta")
    assert theta.state_unit.item() == "rad"
    np.testing.assert_array_equal(theta.values, ensemble["final_state"][:, 2])
    assert json.loads(data.attrs["provenance"]) == ensemble.provenance()
    facts = {name: data.attrs[name] for name in ("seed", "softpinch", "method", "dt")}
    assert facts == {"seed": 7, "softpinch": sp.__version__, "method": "rk4", "dt": 5e-4}
    data.to_netcdf(tmp_path / "runs.nc", engine="scipy")
    with xarray.open_dataset(tmp_path / "runs.nc", engine="scipy") as back:
        xarray.testing.assert_equal(back.load(), data)
        assert back.attrs["provenance"] == data.attrs["provenance"]


def test_a_varied_state_and_a_large_seed_go_out_too(tmp_path: Path) -> None:
    pytest.importorskip("xarray")
    scene = sp.Scene(duration=0.01)
    state = sp.State.consistent(scene, fingers=(0.1, 0.1))
    scene = sp.Scene(duration=0.01, initial=state)
    ensemble = sp.monte_carlo(scene, vary={"initial.q": np.array([state.q, state.q])},
                              seed=2**64 - 1, dt=1e-3, progress=False)  # fmt: skip
    data = ensemble.to_xarray()
    assert data["initial.q"].sel(coordinate="theta_1")["initial.q_unit"].item() == "rad"
    assert data.attrs["seed"] == str(2**64 - 1)
    data.to_netcdf(tmp_path / "runs.nc", engine="scipy")
    frame = ensemble.to_pandas()
    assert frame.attrs["units"]["initial.q.0"] == "m"
    assert frame.attrs["units"]["initial.q.8"] == "m"
    np.testing.assert_array_equal(frame["initial.q.3"], [0.1, 0.1])


LABELS = {
    "disturbances.0.force.1": "force y (disturbance 0)",
    "disturbances.3.force.7.0": "force 7 x (disturbance 3)",
    "hand.tip.left.youngs_modulus": "Young's modulus (hand tip left)",
    "control.kp": "$K_P$ (control)",
    "gravity": "gravity",
    "schedule.angles.2.1": "angles 2 left (schedule)",
    "schedule.times.1": "times 1 (schedule)",
    "initial.q.2": r"q $\theta_{\mathrm{obj}}$ (initial)",
    "final_state.rate of d_n1": "final rate of $d_{n1}$",
    "peak_rotation": "peak rotation",
    "not_finite": "not finite",
}


@pytest.mark.parametrize("name", LABELS)
def test_a_path_is_named_by_its_field_and_its_place(name: str) -> None:
    assert label(name) == LABELS[name]
    assert label(name, "m/s^2") == LABELS[name] + " [m/s$^2$]"


def test_counts_of_an_ensemble_and_its_table_agree() -> None:
    blows = [sp.Impulse(time=0.001, impulse=(20.0, 0.0))]
    scene = sp.Scene(disturbances=blows, duration=0.05)
    vary = {"disturbances.0.impulse.0": [20.0, 0.0]}
    found = sp.monte_carlo(scene, vary=vary, progress=False)
    first = found.status.tolist()
    assert first[0] != "completed" and first[1] == "completed"
    assert list(found.counts().items()) == [("completed", 1), (first[0], 1)]
    assert [row[:2] for row in next(iter(found._tables())).rows[:2]] == [*found.counts().items()]
