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
SAMPLED = replace(SCENE, control=sp.SampledController.pid(1e-3, 4.0, 0.05, 20.0))
STEP = 1e-3
TIMES, ANGLES = [0.0, 0.1], [[0.1, 0.1], [0.2, 0.2]]
# One pair, so that what compares pairs takes no time.
PAIR: dict[str, Any] = {"formulations": "csm", "methods": "rk4"}
RARE: dict[str, Any] = {
    "vary": {"grasped.mass": sp.Normal(0.1, 0.01)},
    "event": ("peak_rotation", ">", 1e-9),
    "runs": 1000,
    "dt": STEP,
    "progress": False,
}
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
def carries() -> sp.CarryLimits:
    return sp.carry_limits(SCENE, [[0.0, 1.0]])


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
        "Loop": sp.loop(SAMPLED),
        "StabilityMap": stability(),
        "EquilibriumMap": equilibria(),
        "WorkPrecision": precision(),
        "Capsule": capsule(),
        "MeasuredLaw": sp.MeasuredLaw(**CURVE),
        "SampledController": SAMPLED.control,
        "Scene": SCENE,
        "Schedule": sp.Schedule.steps([0.0], [[0.1, 0.1]]),
        "HandMotion": sp.HandMotion.constant(),
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
def typical() -> dict[str, Any]:
    """Name of a parameter -> a value that most callables take there."""
    folder = Path(tempfile.mkdtemp())
    return {
        **{"scene": SCENE, "grasp": SCENE, "progress": False, "measure": False},
        **{"times": TIMES, "angles": ANGLES, "kind": "steps", "source": "duration = 1.0"},
        **{"mass": 0.1, "width": 0.05, "height": 0.05, "length": 0.05, "radius": 0.02},
        **{"time": 0.0, "duration": 0.1, "frequency_hz": 1.0, "rate_hz": 10.0, "period": 1e-3},
        **{"force": ANGLES, "force_std": 1.0, "moment_std": 0.0, "t": 0.0, "p": [0.0] * 9},
        **{"q": SCENE.start().q, "integral": [[0.0, 0.0]], "state": sp.Simulator(STEPPED).state()},
        **{"low": 1.0, "high": 2.0, "mean": 1.0, "std": 0.1, "median": 1.0, "sigma": 0.1},
        **{"u": [[0.5]], "rng": np.random.default_rng(1), "n": 2, "count": 1, "values": [1.0, 2.0]},
        **{"happened": [True, False], "what": "pulling", "name": "grasped.mass", "i": 0, "k": 0},
        **{"run": run(), "runs": runs(), "run_plus": run(), "run_minus": run(), "fit": fitted()},
        **{"ensemble": many(), "limits": wrenches(), "results": sweep(), "result": precision()},
        **{"found": sp.equilibrium(SCENE), "figure": plot.motion(run()), "path": folder / "a.csv"},
        **{"x": "grasped.mass", "y": "control.kp", "axis": "object_mass", "case": "ii"},
        **{"axes": {"grasped.mass": [0.1]}, "vary": {"gravity": (0.0, 20.0)}, "out": folder},
        **{"torque": [1.0, 1.0], "actions": [[1.0, 1.0]] * 2, "error": 0.1, "method": "rk4"},
        **{"measured": {"y": [0.0762] * 2}, "rate": 1.0 + 0.0j},
    }


@cache
def special() -> dict[str, dict[str, Any]]:
    """Arguments that are not typical, and those without which a call takes seconds."""
    pair = {"dt": [STEP], "pairs": [("csm", "rk4")]}
    gains = {name: [[0.1, 0.0], [0.0, 0.1]] for name in "ABCD"}
    own: dict[str, dict[str, Any]] = {
        "Arc.from_dict": {"data": {"kind": "arc", "radius": 0.03}},
        "GainSwitch": {"D": gains["D"], "at": 0.1, "measure": "angle", "above": 0.1},
        "GraspedObject.disc": {"diameter": 0.06},
        "GraspedObject.wedge": {"angle": 0.05},
        "HandMotion.from_csv": {"path": _log()},
        "MeasuredLaw": CURVE,
        "MeasuredLaw.from_csv": {"path": _curve()},
        "MeasuredLaw.from_dict": {"data": sp.MeasuredLaw(**CURVE).to_dict()},
        "Maxwell": {"share": 0.5, "time": 0.1},
        "Maxwell.from_dict": {"data": {"share": 0.5, "time": 0.1}},
        "MeasuredLaw.predicted": {"compression": [1e-3, 2e-3]},
        "ParallelSprings": {"youngs_modulus": 1e5},
        "PowerLaw": {"coefficient": 1e5, "exponent": 2.0},
        "fit_law": {**CURVE, "kind": "power"},
        "plot.law": {"fit": sp.fit_law(**CURVE)},
        "HandMotion.breakpoints": {"begin": 0.0, "end": 1.0},
        "HandMotion.jerk_limited": {"points": ANGLES, "acceleration": 100.0, "jerk": 1e6},
        "HandMotion.minimum_jerk": {"points": ANGLES},
        "HandMotion.sampled": {"positions": ANGLES},
        "HandMotion.sine": {"amplitude": 0.01, "frequency": 1.0, "axis": "x"},
        "HandMotion.trapezoid": {"points": ANGLES, "acceleration": 100.0},
        "Noise.samples": {"count": 3},
        "Peer": {field: getattr(peer(), field) for field in sp.Peer.__dataclass_fields__},
        "SampledController.cascade": {"blocks": [SAMPLED.control]},
        "SampledController": {**gains, "measures": ("angle_error",), "limits": (-1.0, 1.0)},
        "Schedule.minimum_jerk": {"move_time": 0.05},
        "Scene.with_": {"values": {"grasped.mass": 0.2}},
        "Simulator": {"scene": STEPPED},
        "TruncatedNormal": {"low": 0.5, "high": 1.5},
        "VectorSimulator": {"scene": STEPPED},
        "Capsule.from_toml": {"source": capsule().to_toml()},
        "Capsule.from_dict": {"data": capsule().to_dict()},
        "EquilibriumMap.equilibrium": {"j": 0},
        "Fit.profile": {"path": "gravity"},
        "Fit.save": {"path": Path(tempfile.mkdtemp()) / "fit.json"},
        "Run.at": {"times": [0.001]},
        "Run.world": {"points": [[0.0, 0.0]] * len(run())},
        "Run.check": {"residual": math.inf, "closure": math.inf},
        "Study.open": {"path": study().path},
        "Study.extend": {"runs": 4},
        "advise": {"tolerance": 1e-3, **PAIR},
        "fit": {"times": run().t[1:], "dt": STEP, "noise": 1e-5},
        "compare": {"study_a": pushed(), "study_b": pushed()},
        "grip": {"force": 5.0},
        "linearize": {"state": SCENE.start()},
        "loop": {"scene": SAMPLED},
        "modes": {"t": [0.0], "q": [SCENE.start().q], "p": [[0.0] * 9]},
        "monte_carlo": {"vary": {"grasped.mass": [0.1, 0.2]}, "dt": STEP},
        "rare_event": RARE,
        "plot.rare_event": {"found": sp.rare_event(SCENE, **RARE)},
        "simulate": {"dt": STEP},
        "stability_map": {"values": [0.1], **pair},
        "stabilization_sweep": {"dt": STEP, "products": [0.1]},
        "work_precision": {**PAIR, "dt": [STEP], "tolerances": (), "longest": 0.1},
        "carry_limits": {"directions": [[0.0, 1.0]]},
        "wrench_limits": {"directions": [[0.0, 1.0, 0.0]]},
        "reference.solve": {"times": [0.0, 0.001]},
        "reference.confirmed": {"times": [0.0, 0.001]},
        "reproduce.simulate_all": {"dt": STEP, "progress": print},
        "reproduce.reproduce": {"progress": print},
        "plot.animate": {"path": Path(tempfile.mkdtemp()) / "a.gif"},
        "plot.carry_limits": {"limits": carries()},
        "plot.contact": {"run": unilateral_run()},
        "plot.contact_models": {"columns": {"scene": {"bilateral": run()}}},
        "plot.disturbances": {"runs": {"i": run()}, "undisturbed": {"i": run()}},
        "plot.equilibria": {"map": equilibria()},
        "plot.histogram": {"name": "peak_rotation"},
        "plot.save": {"path": Path(tempfile.mkdtemp()) / "a.svg"},
        "plot.snapshots": {"times": [0.0]},
        "plot.stability_map": {"map": stability()},
        "plot.wrench_limits": {"ensemble": pushed()},
    }
    for name in ("Ensemble", "Study"):
        own |= {f"{name}.{method}": {"run": 0} for method in ("has", "replay", "scene_of")}
        own[f"{name}.quantile"] = {"q": 0.5}
    own |= {f"VectorSimulator.{method}": {"run": 0} for method in ("message", "scene", "state")}
    law = sp.SampledController.pid(1e-3)
    records = [SCENE, SCENE.hand, SCENE.hand.right, sp.Fingertip(), SCENE.grasped, sp.Pid(), law]
    records += [
        sp.Jaw(),
        sp.Parallelogram(),
        sp.Face(),
        sp.PowerLaw(1e5, 2.0),
        sp.Maxwell(0.5, 0.1),
        sp.GainSwitch(at=0.1),
    ]
    records += [sp.ParallelSprings(1e5)]
    records += [sp.Torque(), sp.Stabilization(), SCENE.start(), SCENE.schedule, *DRAWS.values()]
    records += [getattr(sp, kind)(**arguments(kind)) for kind in LOADS]
    own |= {f"{type(one).__name__}.from_dict": {"data": one.to_dict()} for one in records}
    own["Disturbance.from_dict"] = own["Step.from_dict"]
    own["HandMotion.from_dict"] = {"data": sp.HandMotion.constant().to_dict()}
    own["Distribution.from_dict"] = own["Normal.from_dict"]
    return own


CURVE: dict[str, Any] = {"compression": [1e-3, 2e-3, 3e-3], "force": [1.0, 4.0, 9.0]}


def _curve() -> Path:
    """A file with a measured curve of a tip."""
    path = Path(tempfile.mkdtemp()) / "curve.csv"
    rows = [f"{d},{f}" for d, f in zip(CURVE["compression"], CURVE["force"], strict=True)]
    path.write_text("compression,force\n" + "\n".join(rows))
    return path


def _log() -> Path:
    """A file with the log of a move."""
    path = Path(tempfile.mkdtemp()) / "log.csv"
    path.write_text("time,x,y\n0,0,0\n1,0.1,0\n")
    return path


LOADS = ("Impulse", "Noise", "Pulse", "Sampled", "Sine", "Step")
# Without these, calls would print, or take half a second.
ALWAYS = ("progress", "measure")


def arguments(name: str) -> dict[str, Any]:
    """The arguments with which a callable can be called: those it needs, and some others."""
    own = special().get(name, {}) if name not in LOADS else {}
    found = inspect.signature(function(name)).parameters
    needed = [p for p, each in found.items() if each.default is each.empty or p in ALWAYS]
    return {p: typical()[p] for p in needed if p in typical()} | own


MODULES: tuple[ModuleType, ...] = (paper, plot, reference, reproduce, stress)


def _inside(name: str, cls: type) -> Iterator[str]:
    """The constructor of a class, and its methods that have no underscore."""
    if issubclass(cls, Record) or name in MADE:
        yield name
    for inside in dir(cls):
        member = inspect.getattr_static(cls, inside)
        if inspect.isfunction(member) or isinstance(member, classmethod | staticmethod):
            full = f"{name}.{inside}"
            if inside.startswith("_") or {inside, full} & INNER:
                continue
            if isinstance(member, classmethod | staticmethod) or name not in BASES:
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


def function(name: str) -> Callable[..., Any]:
    """The callable of this name, a method without its object."""
    owner, _, inside = name.rpartition(".")
    return getattr(getattr(sp, owner) if owner else sp, inside)  # type: ignore[no-any-return]


def parameters(name: str) -> list[str]:
    """The named parameters of a callable, without `self`."""
    kinds = (inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL)
    found = inspect.signature(function(name)).parameters.values()
    return [each.name for each in found if each.kind not in kinds and each.name != "self"]


def called(name: str) -> Callable[..., Any]:
    """The callable of this name, a method on an object that is ready for it."""
    owner, _, inside = name.rpartition(".")
    if not owner:
        return getattr(sp, name)  # type: ignore[no-any-return]
    there = getattr(sp, owner, None)
    if not inspect.ismethod(getattr(there, inside, None)):  # else of the class
        there = objects().get(owner, there)
    return getattr(there, inside)  # type: ignore[no-any-return]
