"""A study whose driver is killed: begins it or goes on with it, a block and a part at a time."""

import sys
from typing import Any

import softpinch as sp

BLOCKS = 16
SCENE = sp.Scene(
    disturbances=[sp.Step(time=0.01), sp.Noise(force_std=1.0, moment_std=0.0, rate_hz=200.0)],
    duration=0.1,
)
GIVEN: dict[str, Any] = {
    "runs": BLOCKS * 1024 - 100,
    "seed": 6,
    "dt": 5e-4,
    "vary": {
        "grasped.mass": sp.Normal(0.1, 0.01),
        "disturbances.0.force": sp.Uniform((-40.0, -40.0), (40.0, 40.0)),
    },
    "summaries": ("final_state", "peak_rotation", "settling_time"),
    "threads": 1,
}


def main(store: str) -> None:
    """Says that it has begun, each new block, and how it ended."""
    from softpinch.store import folder, study

    folder.GATHER_SECONDS, study.PACE_SECONDS = 0.0, 0.0
    print("here", flush=True)
    last = 0

    def report(done: int, runs: int) -> None:
        nonlocal last
        if done // 1024 > last:
            last = done // 1024
            print(last, flush=True)

    kept = sp.monte_carlo(SCENE, store=store, progress=report, **GIVEN)
    print("done" if kept.complete else "interrupted", flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
