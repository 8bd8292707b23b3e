"""How often the interval of a study that `stop_when` ended contains the probability.

make bench-stopping

Draws 10 000 studies with a known probability for each setting. Each is looked at after every block
of 1024 runs and stops where half of its interval's width is small enough. Compares Wilson's
interval, which is that of a fixed number of runs, with the confidence sequence that `stop_when`
uses. Writes the table of docs/ensembles.md.
"""

from collections.abc import Callable
from functools import cache

import numpy as np

import softpinch as sp
from command import parser
from document import put
from machine import describe

BLOCK, LOOKS = 1024, 40
# Probability, and half width at which a study stops.
SETTINGS = ((0.5, 0.02), (0.1, 0.01), (0.02, 0.005), (0.003, 0.002), (0.001, 0.001), (0.999, 0.001))
KINDS: dict[str, Callable[[int, int], sp.Estimate]] = {
    "Wilson": cache(sp.Estimate.counted),
    "sequence": cache(sp.Estimate.at_every_look),
}


def studies(p: float, width: float, many: int, of: Callable[[int, int], sp.Estimate]) -> str:
    """Coverage at the stop with its interval, of all looks, and the mean number of runs."""
    counts = np.random.default_rng(1).binomial(BLOCK, p, (many, LOOKS)).cumsum(axis=1)
    at_stop, always, runs = 0, 0, 0
    for study in counts.tolist():
        looks = [of(count, BLOCK * look) for look, count in enumerate(study, 1)]
        stop = next((k for k, one in enumerate(looks) if one.half_width <= width), LOOKS - 1)
        at_stop += looks[stop].low <= p <= looks[stop].high
        always += all(one.low <= p <= one.high for one in looks)
        runs += looks[stop].runs
    share = sp.Estimate.counted(at_stop, many)
    covered = f"{share.value:.4f} ({share.low:.4f} to {share.high:.4f})"
    return f"{covered} | {always / many:.4f} | {runs / many:.0f}"


def main() -> None:
    quick = parser(__doc__).parse_args().quick
    print(describe())
    many, settings = (20, SETTINGS[:1]) if quick else (10_000, SETTINGS)
    lines = ["| p | half width | interval | at the stop | at all 40 looks | runs |"]
    lines += ["|---:|---:|---|---|---:|---:|"]
    for p, width in settings:
        for kind, of in KINDS.items():
            lines.append(f"| {p:g} | {width:g} | {kind} | {studies(p, width, many, of)} |")
    table = "\n".join(lines)
    print(table)
    if not quick:
        put("stopping", table)


if __name__ == "__main__":
    main()
