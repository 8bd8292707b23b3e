"""A digest of the bits of a few runs of every method, formulation, kind of fingers and of steps.

`results_digests.json` keeps the digests beside the results version that they belong to. A study, a
capsule and a worker trust that version: two builds with the same version give the same bits. So
bits may change only together with `RESULTS_VERSION`, and this program writes the file again
(`make digests`) only if that number was raised.
"""

import hashlib
import json
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import softpinch as sp
from softpinch import _core

STORED = Path(__file__).with_name("results_digests.json")
ADVICE = (
    "the bits changed: raise RESULTS_VERSION in rust/softpinch/src/lib.rs, build, and write the "
    "digests again with `make digests`; if no bit was meant to change, the change is a fault"
)

# (dt, tolerance): steps of equal length, and as long as the error allows.
STEPS = {"fixed": {"dt": 1e-3}, "free": {"tolerance": 1e-5}}
# Gains that every method damps at this dt.
GAINS = sp.Stabilization(alpha=300.0, beta=300.0)
EVERYTHING = ("state", "multipliers", "residuals", "energy", "torque")
# By name, so that a new summary leaves the digests as they are.
SUMMARIES = (
    "final_state",
    "peak_rotation",
    "min_compression",
    "peak_friction_angle",
    "settling_time",
    "max_residual",
    "energy_closure",
    "peak_torque",
)
RUNS = 11  # More than the lanes of any level, so that a lane takes a second run.


def scene(fingers: str) -> sp.Scene:
    """A grasp with every kind of disturbance, at instants that no step of equal length hits."""
    return sp.Scene(
        fingers=fingers,
        schedule=sp.Schedule.minimum_jerk([0.0, 0.0137], [[0.09, 0.09], [0.14, 0.07]], 0.0211),
        disturbances=[
            sp.Step(time=0.0111, force=(2.0, -1.0), moment=0.01),
            sp.Impulse(time=0.0237, impulse=(0.01, -0.02), angular_impulse=1e-5),
            sp.Sine(frequency_hz=40.0, force=(1.0, 2.0), time=0.005, duration=0.03),
            sp.Noise(force_std=2.0, moment_std=0.01, rate_hz=150.0, duration=0.04),
        ],
        friction=0.8,
        duration=0.04,
    )


def digest(arrays: dict[str, Any]) -> str:
    """The first half of a SHA-256 of names, shapes and bytes."""
    found = hashlib.sha256()
    for name, values in arrays.items():
        numbers = np.ascontiguousarray(values, dtype="<f8")
        found.update(f"{name} {numbers.shape}\n".encode())
        found.update(numbers.tobytes())
    return found.hexdigest()[:32]


def alone(scene: sp.Scene, how: dict[str, Any]) -> str:
    """The digest of everything that one run records."""
    run = sp.simulate(scene, stabilization=GAINS, record=EVERYTHING, **how)
    assert run.success, run.message
    columns = {name: getattr(run, name) for name in ("t", "q", "p", "multipliers", "residuals")}
    return digest({**columns, "torque": run.torque, "closure": run.energy.closure})


def together(scene: sp.Scene, how: dict[str, Any]) -> str:
    """The digest of the rows of several runs, computed in lanes where the method has them."""
    numbers = np.arange(RUNS)
    study = sp.monte_carlo(
        scene,
        RUNS,
        # Arrays and no distributions: how numbers are drawn is NumPy's affair.
        vary={"grasped.mass": 0.07 + 0.01 * numbers, "duration": 0.02 + 0.002 * numbers},
        summaries=SUMMARIES,
        stabilization=GAINS,
        threads=1,
        progress=False,
        **how,
    )
    assert (study.status == "completed").all()
    columns = {name: study[name] for name in SUMMARIES}
    return digest({**columns, "end_time": study.end_time, "steps": study.steps})


def cases() -> Iterator[tuple[str, partial[str]]]:
    """Name -> how its digest is computed."""
    for method in _core.METHODS:
        for kind, steps in STEPS.items():
            if kind == "free" and method not in _core.ADAPTIVE_METHODS:
                continue
            for formulation in _core.FORMULATIONS:
                for fingers in ("pid", "driven"):
                    how: dict[str, Any] = {"method": method, "formulation": formulation, **steps}
                    for of in (alone, together):
                        name = f"{method} {formulation} {fingers} {kind} {of.__name__}"
                        yield name, partial(of, scene(fingers), how)


def compute() -> dict[str, str]:
    """The digests of this build, at the SIMD level that is in force."""
    return {name: of() for name, of in cases()}


def stored() -> tuple[int, dict[str, str]]:
    """The results version and the digests of the file."""
    kept = json.loads(STORED.read_text())
    return kept["results_version"], kept["digests"]


def changed(kept: dict[str, str], found: dict[str, str]) -> list[str]:
    """The cases that both have, with other bits."""
    return [name for name, bits in kept.items() if found.get(name, bits) != bits]


def main() -> int:
    """Writes the file again, unless bits changed and the results version did not."""
    version, kept = stored() if STORED.exists() else (_core.RESULTS_VERSION, {})
    found = compute()
    others = changed(kept, found)
    if others and version >= _core.RESULTS_VERSION:
        print(f"not written: {ADVICE}. RESULTS_VERSION is {_core.RESULTS_VERSION}, as it was with")
        print("other bits of: " + "; ".join(others))
        return 1
    document = {"results_version": _core.RESULTS_VERSION, "digests": found}
    STORED.write_text(json.dumps(document, indent=1) + "\n")
    print(f"{len(found)} digests, {len(others)} of them changed, results version {version}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
