"""Uses of the package for mypy, which `make lint` runs on this file. Nothing here is run."""

from typing import Any, assert_type

from pandas import DataFrame
from xarray import Dataset

import softpinch as sp
from softpinch.run.run import Run
from softpinch.scene.paths import PathTable
from softpinch.support.choices import Method


def results_have_their_types(scene: sp.Scene) -> None:
    """The types of results, as an editor shows them."""
    ensemble = sp.monte_carlo(scene, 3)
    assert_type(ensemble, sp.Ensemble)
    assert_type(sp.monte_carlo(scene, 3, store="study"), sp.Study)
    assert_type(ensemble.to_pandas(), DataFrame)
    assert_type(ensemble.to_xarray(), Dataset)
    assert_type(sp.simulate(scene, method="radau5", record=("state", "torque")), Run)
    assert_type(scene.with_({"grasped.mass": 0.2}), sp.Scene)
    assert_type(scene.vary_paths(), PathTable)
    assert_type(sp.advise(scene, methods=("rk4", "radau5"), formulations="csm"), sp.Advice)
    assert_type(sp.max_stable_dt(scene, "rk4").method, Method)
    assert_type(sp.grip(scene, force=5.0), sp.Grip)
    assert_type(sp.Schedule.in_degrees("ramps", [0.0], [[6, 6]]), sp.Schedule)


def wrong_names_are_refused(scene: sp.Scene) -> list[Any]:
    """A wrong name is an error of the type checker; an unneeded comment would be one too."""
    return [
        sp.simulate(scene, method="rk5"),  # type: ignore[arg-type]
        sp.simulate(scene, formulation="null_space"),  # type: ignore[arg-type]
        sp.simulate(scene, record="forces"),  # type: ignore[arg-type]
        sp.simulate(scene, stop_on=("lost",)),  # type: ignore[arg-type]
        sp.Scene(contact="glued"),  # type: ignore[arg-type]
        sp.Scene(fingers="free"),  # type: ignore[arg-type]
        sp.Schedule.sampled([0.0], [[0.1, 0.1]], hold="cubic"),  # type: ignore[arg-type]
        sp.Sampled(times=[0.0], force=[[1.0, 1.0]], moment=[0.0], hold="cubic"),  # type: ignore[arg-type]
        sp.advise(scene, formulations="null_space"),  # type: ignore[arg-type]
        sp.advise(scene, methods=("rk4", "rk5")),  # type: ignore[arg-type]
        sp.work_precision(scene, methods="rk5"),  # type: ignore[arg-type]
        sp.work_precision(scene, formulations=("dae",)),  # type: ignore[arg-type]
        sp.stability_map(scene, "object_mass", pairs=[("csm", "rk5")]),  # type: ignore[list-item]
        sp.max_stable_dt(scene, method="rk5"),  # type: ignore[arg-type]
        sp.max_stable_dt(scene, formulation="dae"),  # type: ignore[arg-type]
        sp.stabilization_sweep(scene, method="rk5"),  # type: ignore[arg-type]
        sp.modes(scene, [0.0], [[0.0]], [[0.0]], [[0.0]], formulation="dae"),  # type: ignore[arg-type]
        sp.evaluate(scene, 0.0, [0.0], [0.0], formulation="dae"),  # type: ignore[arg-type]
        sp.explain(scene, method="rk5"),  # type: ignore[arg-type]
        sp.fit(scene, [0.0], {"y": [0.0]}, {"gravity": None}, method="rk5"),  # type: ignore[arg-type]
        scene.with_(friction=0.3),  # type: ignore[arg-type]
    ]
