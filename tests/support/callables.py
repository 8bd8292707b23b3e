"""Every public callable with arguments that it takes, for `test_arguments` to spoil."""

import inspect
import math
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

import softpinch as sp
from softpinch import paper, plot, reference, reproduce, stress
from softpinch.support.record import Record

SCENE = sp.Scene(duration=0.002, friction=0.5)
STEPPED = replace(SCENE, control=sp.Torque(), duration=1.0)
STEP = 1e-3
TIMES, ANGLES = [0.0, 0.1], [[0.1, 0.1], [0.2, 0.2]]
# One pair, so that what compares pairs takes no time.
PAIR: dict[str, Any] = {"formulations": "csm", "methods": "rk4"}
# Classes that users make, beside the records: others are results.
MADE = {"Peer", "Simulator", "VectorSimulator"}
# Without an object of their own: their methods are those of what is derived.
BASES = {"Disturbance", "Distribution", "Results"}
# Inner workings without underscore: what compiles, makes results, and is in every mapping.
INNER = {"compile_runs", "Discretisation.of", "Lost.of", "get"}


@cache
def run() -> sp.Run:
    return sp.simulate(SCENE, STEP, record=sp._core.RECORDABLE)


@cache
def unilateral_run() -> sp.Run:
    scene = replace(SCENE, contact="unilateral")
    return sp.simulate(scene, STEP, record=sp._core.RECORDABLE)


@cache
def many() -> sp.Ensemble:
    return sp.monte_carlo(
        SCENE,
        4,
        vary={"grasped.mass": sp.Normal(0.1, 0.01), "control.kp": sp.Normal(100.0, 1.0)},
        dt=STEP,
        summaries=("final_state", "peak_rotation"),
        progress=False,
    )


@cache
def study() -> sp.Study:
    folder = Path(tempfile.mkdtemp()) / "study"
    vary = {"grasped.mass": sp.Normal(0.1, 0.01)}
    return sp.monte_carlo(SCENE, 4, vary=vary, dt=STEP, store=folder, progress=False)


@cache
def runs() -> reproduce.Runs:
    """Not to be held against the paper's claims, which need seconds of them."""
    fields = reproduce.Runs.__dataclass_fields__
    return reproduce.Runs(**dict.fromkeys(fields, run()))  # type: ignore[arg-type]


@cache
def sweep() -> sp.StabilizationSweep:
    return sp.stabilization_sweep(SCENE, STEP, products=[0.1, 1.0])


@cache
def precision() -> sp.WorkPrecision:
    return sp.work_precision(SCENE, **PAIR, dt=[STEP], tolerances=(), progress=False)


@cache
def stability() -> sp.StabilityMap:
    return sp.stability_map(
        SCENE, "object_mass", [0.1], dt=[STEP], pairs=[("csm", "rk4")], progress=False
    )


@cache
def equilibria() -> sp.EquilibriumMap:
    return sp.equilibrium_map(SCENE, {"grip": [0.0], "grasped.mass": [0.1]}, progress=False)


@cache
def wrenches() -> sp.WrenchLimits:
    return sp.wrench_limits(SCENE, [[0.0, 1.0, 0.0]])


@cache
def fitted() -> sp.Fit:
    data = run().q[1:, 1] + [1e-5, -2e-5]
    return sp.fit(SCENE, run().t[1:], {"y": data}, {"gravity": (0.0, 20.0)}, dt=STEP, noise=1e-5)


@cache
def differentiated() -> sp.Run:
    return sp.simulate(SCENE, STEP, sensitivities=("gravity", "schedule.angles"))


@cache
def pushed() -> sp.Ensemble:
    scene = replace(SCENE, disturbances=[sp.Step(time=0.0)])
    vary = {"disturbances.0.force": np.ones((2, 2))}
    return sp.monte_carlo(scene, vary=vary, dt=STEP, progress=False)


@cache
def modes() -> sp.Modes:
    return sp.modes(SCENE, run().t, run().q, run().p, run().integral)


@cache
def peer() -> sp.Peer:
    return sp.Peer(
        name="p", setting="s", values=[1.0], prepare=lambda _: lambda _: None, ends=lambda _: None
    )


@cache
def capsule() -> sp.Capsule:
    thrown = replace(SCENE, disturbances=[sp.Impulse(time=0.0, impulse=(50.0, 0.0))])
    vary = {"grasped.mass": [0.1]}
    return sp.monte_carlo(thrown, vary=vary, dt=STEP, progress=False).failures()[0]


class Stepped(sp.Simulator):
    """A simulator that is ready for every method, whichever was called before."""

    def step(self, torque: Any) -> sp.Observation:
        self.reset()
        return super().step(torque)

    def run(self, record: Any = "state", every: int = 1) -> sp.Run:
        self.step((1.0, 1.0))
        return super().run(record, every)


@cache
def objects() -> dict[str, Any]:
    """One of each class whose methods take arguments."""
    return {
        "Run": run(),
        "Ensemble": many(),
        "Study": study(),
        "Modes": modes(),
        "Fit": fitted(),
        "Sensitivity": differentiated().sensitivity,
        "LinearModel": sp.linearize(SCENE, SCENE.start()),
        "StabilityMap": stability(),
        "EquilibriumMap": equilibria(),
        "WorkPrecision": precision(),
        "Capsule": capsule(),
        "Scene": SCENE,
        "Schedule": sp.Schedule.steps([0.0], [[0.1, 0.1]]),
        "Noise": sp.Noise(force_std=1.0, moment_std=0.0, rate_hz=10.0),
        "Advice": sp.advise(SCENE, 1e-3, **PAIR),
        "Simulator": Stepped(STEPPED),
        "VectorSimulator": sp.VectorSimulator(STEPPED, 2),
        **DRAWS,
    }


DRAWS: dict[str, Any] = {
    "Choice": sp.Choice([1.0, 2.0]),
    "LogNormal": sp.LogNormal(1.0, 0.1),
    "LogUniform": sp.LogUniform(1.0, 2.0),
    "Normal": sp.Normal(1.0, 0.1),
    "TruncatedNormal": sp.TruncatedNormal(1.0, 0.1, 0.5, 1.5),
    "Uniform": sp.Uniform(1.0, 2.0),
}


@cache
def arguments() -> dict[str, dict[str, Any]]:
    """What each takes, every parameter that has no default among them, by "Class.method"."""
    q = SCENE.start().q
    rows = {"t": [0.0], "q": [q], "p": [[0.0] * 9], "integral": [[0.0, 0.0]]}
    own: dict[str, dict[str, Any]] = {
        "GraspedObject.box": {"width": 0.05, "height": 0.05, "mass": 0.1},
        "GraspedObject.cylinder": {"length": 0.05, "radius": 0.02, "mass": 0.1},
        "Schedule": {"kind": "steps", "times": TIMES, "angles": ANGLES},
        "Schedule.steps": {"times": TIMES, "angles": ANGLES},
        "Schedule.ramps": {"times": TIMES, "angles": ANGLES},
        "Schedule.minimum_jerk": {"times": TIMES, "angles": ANGLES, "move_time": 0.05},
        "Schedule.in_degrees": {"kind": "steps", "times": TIMES, "angles": ANGLES},
        "Schedule.sampled": {"times": TIMES, "angles": ANGLES},
        "Schedule.target": {"t": [0.0, 0.1]},
        "Scene.from_toml": {"source": "duration = 1.0"},
        "Scene.with_": {"values": {"grasped.mass": 0.2}},
        "Choice": {"values": [1.0, 2.0], "weights": [1.0, 1.0]},
        "Impulse": {"time": 0.0},
        "LogNormal": {"median": 1.0, "sigma": 0.1},
        "LogUniform": {"low": 1.0, "high": 2.0},
        "Noise": {"force_std": 1.0, "moment_std": 0.0, "rate_hz": 10.0},
        "Normal": {"mean": 1.0, "std": 0.1},
        "Peer": {field: getattr(peer(), field) for field in sp.Peer.__dataclass_fields__},
        "Pulse": {"time": 0.0, "duration": 0.1},
        "Sampled": {"times": TIMES, "force": ANGLES, "moment": [0.0, 0.1]},
        "Sine": {"frequency_hz": 1.0},
        "State": {"q": q},
        "Step": {"time": 0.0},
        "TruncatedNormal": {"mean": 1.0, "std": 0.1, "low": 0.5, "high": 1.5},
        "Uniform": {"low": 1.0, "high": 2.0},
        "State.consistent": {"scene": SCENE},
        "Capsule.from_toml": {"source": capsule().to_toml()},
        "Capsule.from_dict": {"data": capsule().to_dict()},
        "Capsule.agrees": {"run": run()},
        "Noise.samples": {"count": 3},
        "Estimate.of": {"happened": [True, False]},
        "Estimate.counted": {"count": 1, "n": 2},
        "Mean.of": {"values": [1.0, 2.0]},
        "Run.at": {"times": [0.001]},
        "Run.check": {"residual": math.inf, "closure": math.inf},
        "Run.save": {"path": Path(tempfile.mkdtemp()) / "run.csv"},
        "EquilibriumMap.equilibrium": {"i": 0, "j": 0},
        "EquilibriumMap.save": {"path": Path(tempfile.mkdtemp()) / "map.csv"},
        "StabilityMap.save": {"path": Path(tempfile.mkdtemp()) / "map.csv"},
        "WorkPrecision.save": {"path": Path(tempfile.mkdtemp()) / "work.csv"},
        "WorkPrecision.cheapest": {"error": 0.1},
        "Modes.stable_step": {"method": "rk4"},
        "Modes.leading": {"k": 0, "rate": 1.0 + 0.0j},
        "Study.open": {"path": study().path},
        "Study.extend": {"runs": 4, "progress": False},
        "Study.resume": {"progress": False},
        "SampledController": {
            "period": 1e-3,
            **{name: [[0.1, 0.0], [0.0, 0.1]] for name in "ABCD"},
            "measures": ("angle_error",),
            "limits": (-1.0, 1.0),
        },
        "SampledController.pid": {"period": 1e-3},
        "SampledController.compile_runs": {"values": {}, "numbers": None, "seed": 0},
        "Simulator": {"scene": STEPPED},
        "Simulator.run": {"record": "state"},
        "Simulator.set_state": {"state": sp.Simulator(STEPPED).state()},
        "Simulator.step": {"torque": [1.0, 1.0]},
        "VectorSimulator": {"scene": STEPPED, "n": 2},
        "VectorSimulator.message": {"run": 0},
        "VectorSimulator.scene": {"run": 0},
        "VectorSimulator.set_state": {"state": sp.Simulator(STEPPED).state()},
        "VectorSimulator.state": {"run": 0},
        "VectorSimulator.step": {"actions": [[1.0, 1.0]] * 2},
        "advise": {"scene": SCENE, "tolerance": 1e-3, **PAIR},
        "equilibrium": {"scene": SCENE},
        "grip": {"scene": SCENE, "force": 5.0},
        "equilibrium_map": {"scene": SCENE, "axes": {"grasped.mass": [0.1]}, "progress": False},
        "wrench_limits": {"grasp": SCENE, "directions": [[0.0, 1.0, 0.0]]},
        "evaluate": {"scene": SCENE, "t": 0.0, "q": q, "p": [0.0] * 9},
        "explain": {"scene": SCENE, "measure": False},
        "linearize": {"scene": SCENE, "state": SCENE.start()},
        "max_stable_dt": {"scene": SCENE, "measure": False},
        "modes": {"scene": SCENE, **rows},
        "monte_carlo": {
            "scene": SCENE,
            "runs": 3,
            "vary": {"grasped.mass": [0.1, 0.2, 0.3]},
            "dt": STEP,
            "progress": False,
        },
        "sensitivity": {"ensemble": many()},
        "simulate": {"scene": SCENE, "dt": STEP},
        "stability_map": {
            "scene": SCENE,
            "axis": "object_mass",
            "values": [0.1],
            "dt": [STEP],
            "pairs": [("csm", "rk4")],
            "progress": False,
        },
        "stabilization_sweep": {"scene": SCENE, "dt": STEP, "products": [0.1]},
        "work_precision": {
            "scene": SCENE,
            **PAIR,
            "dt": [STEP],
            "tolerances": (),
            "longest": 0.1,
            "progress": False,
        },
        "reference.solve": {"scene": SCENE, "times": [0.0, 0.001]},
        "reference.confirmed": {"scene": SCENE, "times": [0.0, 0.001]},
        "reference.parameters": {"scene": SCENE},
        "reproduce.find": {"runs": runs()},
        "reproduce.simulate_all": {"dt": STEP},
        "paper.disturbance": {"case": "ii"},
        "reproduce.reproduce": {"out": Path(tempfile.mkdtemp())},
        "plot.save": {"figure": plot.motion(run()), "path": Path(tempfile.mkdtemp()) / "a.svg"},
        "plot.animate": {"run": run(), "path": Path(tempfile.mkdtemp()) / "a.gif"},
        "plot.snapshots": {"run": run(), "times": [0.0], "titles": ["start"]},
        "plot.disturbances": {"runs": {"i": run()}, "undisturbed": {"i": run()}},
        "plot.contact": {"run": unilateral_run()},
        "plot.contact_models": {"columns": {"scene": {"bilateral": run()}}},
        "plot.tilt_coupling": {"run_plus": run(), "run_minus": run()},
        "plot.modes": {"found": sp.equilibrium(SCENE)},
        "plot.compliance": {"found": sp.equilibrium(SCENE)},
        "plot.histogram": {"ensemble": many(), "name": "peak_rotation"},
        "plot.success_map": {"ensemble": many(), "x": "grasped.mass", "y": "control.kp"},
        "plot.failure_times": {"ensemble": many()},
        "plot.importance": {"ensemble": many()},
        "plot.stabilization_sweep": {"results": sweep()},
        "plot.work_precision": {"result": precision()},
        "plot.stability_map": {"map": stability()},
        "plot.equilibria": {"map": equilibria()},
        "plot.fit": {"fit": fitted()},
        "fit": {
            "scene": SCENE,
            "times": run().t[1:],
            "measured": {"y": run().q[1:, 1]},
            "vary": {"gravity": (0.0, 20.0)},
            "dt": STEP,
            "noise": 1e-5,
        },
        "Fit.profile": {"path": "gravity"},
        "Fit.save": {"path": Path(tempfile.mkdtemp()) / "fit.json"},
        "plot.wrench_limits": {"limits": wrenches(), "ensemble": pushed()},
    }
    for name in ("motion", "residuals", "forces", "run", "snapshot"):
        own[f"plot.{name}"] = {"run": run()}
    for name in ("Ensemble", "Study"):
        own |= {
            f"{name}.happened": {"what": "pulling"},
            f"{name}.has": {"run": 0},
            f"{name}.mean": {"name": "grasped.mass"},
            f"{name}.quantile": {"name": "grasped.mass", "q": 0.5},
            f"{name}.replay": {"run": 0},
            f"{name}.scene_of": {"run": 0},
        }
    for name, record in DRAWS.items():
        own[f"{name}.ppf"] = {"u": [[0.5]]}
        own[f"{name}.sample"] = {"rng": np.random.default_rng(1), "n": 2}
        own[f"{name}.from_dict"] = {"data": record.to_dict()}
    own["Distribution.from_dict"] = own["Normal.from_dict"]
    for record in (SCENE, sp.Hand(), sp.Finger(), sp.Fingertip(), sp.GraspedObject(), sp.Pid()):
        own[f"{type(record).__name__}.from_dict"] = {"data": record.to_dict()}
    law = sp.SampledController.pid(1e-3)
    for record in (law, sp.Torque(), sp.Stabilization(), SCENE.start(), SCENE.schedule):
        own[f"{type(record).__name__}.from_dict"] = {"data": record.to_dict()}
    for kind in ("Impulse", "Noise", "Pulse", "Sampled", "Sine", "Step"):
        own[f"{kind}.from_dict"] = {"data": getattr(sp, kind)(**own[kind]).to_dict()}
    own["Disturbance.from_dict"] = own["Step.from_dict"]
    return own


MODULES: tuple[ModuleType, ...] = (paper, plot, reference, reproduce, stress)


def _inside(name: str, cls: type) -> Iterator[str]:
    """The constructor of a class, and its methods that have no underscore."""
    if issubclass(cls, Record) or name in MADE:
        yield name
    for inside in dir(cls):
        member = inspect.getattr_static(cls, inside)
        if inspect.isfunction(member) or isinstance(member, classmethod):
            full = f"{name}.{inside}"
            if inside.startswith("_") or {inside, full} & INNER:
                continue
            if isinstance(member, classmethod) or name not in BASES:
                yield full


def public() -> Iterator[str]:
    """The name of every public callable, methods as "Class.method"."""
    for name in sp.__all__:
        value = getattr(sp, name)
        if inspect.isclass(value) and not issubclass(value, Exception):
            yield from _inside(name, value)
        elif inspect.isfunction(value):
            yield name
    for module in MODULES:
        for name in getattr(module, "__all__", vars(module)):
            value = getattr(module, name)
            if not inspect.isfunction(value) or name.startswith("_"):
                continue
            if hasattr(module, "__all__") or value.__module__ == module.__name__:
                yield f"{module.__name__.partition('.')[2]}.{name}"


def parameters(name: str) -> list[str]:
    """What a callable takes by name, itself apart, and without what goes on to another one."""
    owner, _, inside = name.rpartition(".")
    value = getattr(sp, owner, None) if owner else sp
    function = getattr(value, inside)
    kinds = (inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL)
    found = inspect.signature(function).parameters.values()
    return [each.name for each in found if each.kind not in kinds and each.name != "self"]


def called(name: str) -> Callable[..., Any]:
    """The callable of this name, a method on an object that is ready for it."""
    owner, _, inside = name.rpartition(".")
    if not owner:
        return getattr(sp, name)  # type: ignore[no-any-return]
    there = objects().get(owner, getattr(sp, owner, None))
    return getattr(there, inside)  # type: ignore[no-any-return]
