"""Verdicts on the paper's claims, by comparison with the runs; and findings beyond the paper.

Each finding is computed from runs only, and every claim can fail: NaN, or a run that ended early,
never passes. Some findings are of a real hand: the tips of the paper's bilateral contact pull where
they have to, and never slip; in the runs with unilateral contact they only push, and may slip.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..paper import PARAMETER_NOTE
from ..run import ContactMode, Run
from ..run import measures as m
from ..scene.fields import COORDINATE_UNITS, DISPLAY_UNITS
from ..support import checks
from .energy_minimum import WAYS, Rest, coordinates
from .experiment import Runs

HOLDS, FAILS, BEYOND = "holds", "does not hold", "not in the paper"

# From x, y, theta in SI units to the units of tables and figures, mm and degrees.
POSE = np.array([DISPLAY_UNITS[unit][1] for unit in COORDINATE_UNITS[:3]])
# Half width of the band for "converges", as far as the paper's figures can be read: for the
# object's settled pose, mm and degrees, and for the finger angles, degrees.
BAND = 0.05
# Half width of the band for x and y, m, and theta, rad.
BANDS = np.array([1e-3 * BAND, 1e-3 * BAND, np.deg2rad(BAND)])
# The slope of the energy that counts as zero, N: its error by differences is a tenth of it.
_FLAT = 1e-4
# Orders of magnitude that the paper states from its Fig. 6: |C^H| in m, |C^N| in m/s.
HOLONOMIC, NONHOLONOMIC = 1e-8, 1e-6


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A claim of the paper, or an observation beyond it, with its verdict."""

    claim: str  # in a few words
    source: str = ""  # section or figure of the paper; empty for an observation
    verdict: str = BEYOND  # "holds", "does not hold", or "not in the paper"
    measure: str  # description of `value`, with its unit
    value: float  # the number that decides the verdict
    limit: float = np.nan  # the number with which `value` is compared; nan for an observation
    evidence: str  # a sentence with the numbers


def observation(claim: str, measure: str, value: float, evidence: str) -> Finding:
    """An observation beyond the paper."""
    return Finding(claim=claim, measure=measure, value=value, evidence=evidence)


def _decided(holds: bool, value: float, limit: float) -> dict[str, Any]:
    """The part of a finding that decides it: whether a value is on the right side of a limit."""
    return {"verdict": HOLDS if holds else FAILS, "value": value, "limit": limit}


def _converges(run: Run) -> Finding:
    ranges = m.drift(run) * POSE
    moved, turned = float(ranges[:, :2].max()), float(ranges[:, 2].max())
    value = float(ranges.max())
    slowest = float(m.settling_times(run, BAND * 1e-3, np.deg2rad(BAND)).max())
    return Finding(
        claim="the object's position and orientation converge in every operation",
        source="VI-B-1, Fig. 5",
        **_decided(run.success and value <= BAND, value, BAND),
        measure="largest range over an operation's last quarter, mm or deg",
        evidence=(
            f"over the last quarter of every operation it moves by at most {moved:.2g} mm and "
            f"{turned:.2g} deg; it comes within {BAND:g} mm and {BAND:g} deg of where it ends "
            f"after at most {slowest:.2f} s"
        ),
    )


def _fingers_arrive(run: Run) -> Finding:
    value = float(np.rad2deg(m.finger_errors(run).max()))
    return Finding(
        claim="the fingers converge to the desired angles",
        source="VI-B-1, Fig. 5 (a, b)",
        **_decided(run.success and value <= BAND, value, BAND),
        measure="largest |theta_i - theta_i^d| at an operation's end, deg",
        evidence=f"at the end of every operation they are within {value:.2g} deg",
    )


def _holonomic_order(run: Run) -> Finding:
    value = float(np.abs(run.residuals[:, :2]).max())
    return Finding(
        claim="the holonomic residual C^H is at most of order 1e-8",
        source="VI-B-1, Fig. 6 (a, b)",
        **_decided(run.success and value <= HOLONOMIC, value, HOLONOMIC),
        measure="largest |C^H| of the whole run, m",
        evidence=f"at most {value:.1e} m at dt = {run.dt:g} s, switches included",
    )


def _nonholonomic_order(run: Run) -> Finding:
    away = ~m.near_switches(run)
    value = float(np.abs(run.residuals[away, 2:]).max(initial=0.0)) if away.any() else np.nan
    return Finding(
        claim="the nonholonomic residual C^N is at most of order 1e-6 except at the switches",
        source="VI-B-1, Fig. 6 (c, d)",
        **_decided(run.success and value <= NONHOLONOMIC, value, NONHOLONOMIC),
        measure=f"largest |C^N| later than {1e3 * m.AROUND_SWITCH:g} ms after a switch, m/s",
        evidence=f"at most {value:.1e} m/s away from the switches at dt = {run.dt:g} s",
    )


def _rises_at_switches(run: Run) -> Finding:
    size = np.abs(run.residuals[:, 2:]).max(axis=1)
    away = size[~m.near_switches(run)].max(initial=0.0)
    peaks = m.peak_residuals(run)[1:, 1]
    least = float(peaks.min(initial=np.inf))
    value = least / away if away > 0.0 else np.inf
    return Finding(
        claim="C^N rises at every switch, where the steps make the fingers fast",
        source="VI-B-1, Fig. 6 (c, d)",
        **_decided(run.success and value > 1.0, float(value), 1.0),
        measure="smallest peak of |C^N| around a switch over the largest |C^N| elsewhere",
        evidence=(
            f"from {least:.0e} to {peaks.max(initial=0.0):.0e} m/s around the switches, at most "
            f"{away:.0e} m/s elsewhere"
        ),
    )


def _survives(case: str, run: Run) -> Finding:
    moves = finger = np.nan
    if run.success:
        moves = float((m.drift_since(run) * POSE).max())
        finger = float(np.rad2deg(m.finger_errors(run)[-1].max()))
    value = float(np.maximum(moves, finger))
    pull = m.longest_pull(run, m.onset(run), np.inf)
    least = float(run.multipliers[m.since_onset(run), :2].min())
    caveat = f"; a tip has to pull, {least:.1f} N, for {1e3 * pull:.1f} ms" if pull > 0 else ""
    tilt = float(np.rad2deg(np.abs(m.response(run)[1][:, 2]).max()))
    return Finding(
        claim=f"disturbance ({case}) is survived and the fingers come back",
        source=f"VI-B-2, Fig. 7 ({case})",
        **_decided(run.success and value <= BAND, value, BAND),
        measure="largest range over the last quarter, mm or deg, or finger error, deg",
        evidence=(
            f"the object turns by up to {tilt:.2f} deg and comes to rest within {moves:.2g} mm or "
            f"deg, the fingers within {finger:.2g} deg of their targets{caveat}"
            if run.success
            else f"{run.status}: {run.message}"
        ),
    )


def _light_swings_more(light: tuple[Run, Run], strong: tuple[Run, Run]) -> Finding:
    # Each pair is a disturbed run and the same undisturbed.
    scale = np.array([1e3, 1e6, np.rad2deg(1.0)])
    more, less = m.swing(*light) * scale, m.swing(*strong) * scale
    # The claim concerns Fig. 7 (c) and (d), which show x and y.
    ratio = float(np.divide(more, less, out=np.full(3, np.nan), where=less > 0.0)[:2].min())
    back = m.swing_back(*light)[0], m.swing_back(*strong)[0]
    ended = light[0].success and strong[0].success
    return Finding(
        claim="the light grasp (iii) oscillates more than the strong one (ii)",
        source="VI-B-2, Fig. 7 (c, d)",
        **_decided(ended and ratio > 1.0, ratio, 1.0),
        measure="the smaller of the ratios of the ranges of x and y, (iii) over (ii)",
        evidence=(
            f"(iii) against (ii): x ranges over {more[0]:.3f} and {less[0]:.3f} mm, y over "
            f"{more[1]:.2f} and {less[1]:.2f} um, theta over {more[2]:.2f} and {less[2]:.2f} deg. "
            f"It is one swing rather than an oscillation: x swings back by {back[0]:.1%} and "
            f"{back[1]:.1%} of its peak"
        ),
    )


def _depends_on_the_way(run: Run, direct: Run) -> Finding:
    came, went = m.settled(run)[-1], m.settled(direct)[-1]
    value = float(np.rad2deg(came[2] - went[2]))
    return observation(
        "where the grasp settles depends on the way there",
        "theta at the end, after all operations less straight from the start, deg",
        value,
        f"the last angles end at {np.rad2deg(came[2]):.3f} deg after all the others, at "
        f"{abs(np.rad2deg(went[2])):.3f} deg straight from the start: the constraint is "
        "nonholonomic, so no one pose corresponds to the fingers' angles",
    )


def _pulls_at_switches(run: Run) -> Finding:
    pulls = [m.longest_pull(run, *piece) for piece in m.operations(run)]
    pulling = [k + 1 for k, pull in enumerate(pulls) if pull > 0]
    least = float(run.multipliers[:, :2].min())
    shortest = 1e3 * min((pull for pull in pulls if pull > 0), default=0.0)
    return observation(
        "at switches a tip would have to pull on the object",
        "operations with lambda^H < 0",
        float(len(pulling)),
        f"lambda^H falls below zero in operations {', '.join(map(str, pulling)) or 'none'} "
        f"for {shortest:.2g} to {1e3 * max(pulls):.2g} ms, down to {least:.0f} N; there no-slip "
        "asks for unbounded friction",
    )


def _only_as_printed(runs: Mapping[float, Run]) -> Finding:
    ends = {moment: "held" if run.success else run.status for moment, run in runs.items()}
    return observation(
        "whether the step (i) is survived depends on the moment that comes with its force",
        "moments survived",
        float(sum(run.success for run in runs.values())),
        "with the force (130 N, 130 N) and "
        + "; ".join(f"{moment:g} N m: {end}" for moment, end in ends.items()),
    )


def _reading_of_delta(run: Run) -> Finding:
    """The effect of (41), read as an ideal impulse."""
    ended = "the grasp holds" if run.success else f"{run.status} at {run.t[-1]:.4f} s"
    return observation(
        "how long the delta(t) of (41, 42) lasts is not said; we take 10 ms",
        "whether (ii) read as N s is survived",
        float(run.success),
        f"(ii) with its numbers read as N s and N m s: {ended}, onset at {m.onset(run):g} s",
    )


def _sign_of_the_shear(plus: Run, minus: Run, pushed: Run) -> Finding:
    """The effect of kappa = -1 on the operations, and on the pushed grasp of case (i)."""
    tilts = [np.rad2deg(m.settled(run)[:, 2]) for run in (plus, minus)]
    worst = int(np.argmax(np.nan_to_num(np.abs(tilts[0] - tilts[1]))))
    ended = "held" if pushed.success else f"lost ({pushed.status} at {pushed.t[-1]:.3f} s)"
    return observation(
        "(1)-(5) and (10)-(12) disagree on the sign of d_t; kappa = -1 takes the springs' side",
        "largest change of a settled theta, deg",
        float(np.abs(tilts[0] - tilts[1])[worst]),
        f"operation {worst + 1} ends at {tilts[1][worst]:.2f} deg and not {tilts[0][worst]:.2f}, "
        f"the last at {tilts[1][-1]:.3f} and not {tilts[0][-1]:.3f}; with kappa = -1 the grasp "
        f"is {ended} in (i)",
    )


def _residuals_follow_the_step(run: Run, coarse: Run) -> Finding:
    fine, rough = (np.abs(r.residuals).max(axis=0).reshape(2, 2).max(axis=1) for r in (run, coarse))
    ratios = np.divide(rough, fine, out=np.full(2, np.nan), where=fine > 0.0)
    return observation(
        "the residuals' orders say how long the step is, not how good the model",
        "largest |C^H| with twice the step over that with this one",
        float(ratios[0]),
        f"with twice the step the largest |C^H| is {ratios[0]:.1f} and the largest |C^N| "
        f"{ratios[1]:.1f} times as large; of a method of order four, 16 is to be expected",
    )


def _can_be_believed(run: Run) -> Finding:
    """The numerical quality of a run: `Run.check` and the closure of the energy ledger."""
    value = float(np.abs(run.energy.closure).max())
    try:
        run.check()
        checked = "run.check() finds nothing"
    except AssertionError as error:
        checked = f"but run.check() finds: {error}. Take a smaller step"
    return observation(
        "how wrong the numbers are",
        "largest |closure| of the energy ledger, J",
        value,
        f"the energy ledger closes within {value:.1e} J of {run.energy.exchanged:.3g} J exchanged "
        f"at dt = {run.dt:g} s; {checked}",
    )


def spells(run: Run, mode: ContactMode, begin: float, end: float) -> list[float]:
    """The durations, s, of a mode of either tip, each cut to [begin, end], in the order of time."""
    found = [
        (max(first, begin), min(last, end))
        for side in (0, 1)
        for first, last, which in m.contact_spans(run, side)
        if which is mode
    ]
    return [last - first for first, last in sorted(found) if last > first]


def survived(run: Run) -> list[bool]:
    """True for each operation at whose end both tips touch the object and it is at rest."""
    rests = [bool((ranges <= BANDS).all()) for ranges in m.drift(run)]
    opened = run.violation_intervals.get("opened", np.empty((0, 2)))
    # An opening at a switch belongs to the operation that begins.
    free = [((opened[:, 0] < end) & (opened[:, 1] >= end)).any() for _, end in m.operations(run)]
    return [bool(calm and not opens) for calm, opens in zip(rests, free, strict=True)]


def case_survived(run: Run) -> bool:
    """True if a disturbed grasp holds, and its object comes to rest."""
    return run.holds and bool((m.drift_since(run) <= BANDS).all())


def _which_survive(real: Mapping[float, Run], cases: Mapping[str, Mapping[float, Run]]) -> Finding:
    kept = {mu: survived(run) for mu, run in real.items()}
    count = len(next(iter(kept.values())))
    rows = {f"operation {k + 1}": {mu: kept[mu][k] for mu in kept} for k in range(count)}
    for case, runs in cases.items():
        rows[f"({case})"] = {mu: case_survived(run) for mu, run in runs.items()}
    # Frictions in words -> the operations and disturbances that hold with them.
    named: dict[str, list[str]] = {}
    for name, row in rows.items():
        every = ", ".join(f"{mu:g}" for mu in row)
        yes = ", ".join(f"{mu:g}" for mu, kept in row.items() if kept)
        how = f"with mu = {yes} only, of {every}" if yes else f"with no mu of {every}"
        of_some = named.setdefault(f"with every mu of {every}" if yes == every else how, [])
        # The word stands once before the numbers of several operations.
        of_some.append(name.removeprefix("operation ") if of_some else name)
    return observation(
        "which of the paper's operations and disturbances a real hand would survive: its tips "
        "push and never pull, and stick only as far as friction allows",
        f"operations and disturbances, of {len(rows)}, that are survived with every mu tried",
        float(sum(all(row.values()) for row in rows.values())),
        "; ".join(f"survived {how}: {', '.join(names)}" for how, names in named.items()),
    )


def _falls_in_operations(paper: Run, real: Mapping[float, Run]) -> Finding:
    opened: dict[int, list[float]] = {}
    for run in real.values():
        for k, piece in enumerate(m.operations(run)):
            if found := spells(run, ContactMode.FREE, *piece):
                opened.setdefault(k + 1, []).extend(found)
    every = [time for found in opened.values() for time in found]
    openings = "no tip opens"
    if every:
        numbers = ", ".join(map(str, sorted(opened)))
        times = f"{1e3 * min(every):.2g} to {1e3 * max(every):.2g} ms"
        openings = f"tips open for {times} in operations {numbers}"
    height = m.settled(paper)[-1, 1]
    lower = {mu: 1e3 * float(height - m.settled(run)[-1, 1]) for mu, run in real.items()}
    ends = ", ".join(
        f"{_end(run) if np.isnan(lower[mu]) else f'{lower[mu]:.1f} mm'} (mu = {mu:g})"
        for mu, run in real.items()
    )
    slips = [1e3 * sum(spells(run, ContactMode.SLIP, *run.t[[0, -1]])) for run in real.values()]
    return observation(
        "how far down the object works its way between the tips of a real hand in the operations",
        "how much lower than in the paper's model it ends, with the friction that is worst, mm",
        float(np.max(list(lower.values()))),
        f"{openings}; they slip for {max(slips):.2g} ms in all with the friction that lets them "
        f"slip most, for {min(slips):.2g} ms with the one that does least. The object ends lower "
        f"than in the paper's model by: {ends}",
    )


def _end(run: Run) -> str:
    """The end of a run that did not hold, in words."""
    if not run.success:
        return f"{run.status} at {run.t[-1]:.4f} s"
    return "not held, a tip is free at the end" if not run.holds else "not at rest at the end"


def is_minimum(rest: Rest) -> bool:
    """True if the operation ended at a minimum of elastic energy and gravity without slip."""
    arrived = bool((np.abs(rest.moved) <= BANDS).all())
    return arrived and rest.slope <= _FLAT and rest.curvature > 0.0 and rest.turning > 0.0


def _without_slipping(run: Run, found: Sequence[Rest]) -> Finding:
    """LMEE in the sense that holds: elastic energy and gravity, displacements without slip."""
    every = len(found) == len(m.operations(run)) and all(map(is_minimum, found))
    curvature = np.array([rest.curvature for rest in found])
    value = float(curvature.min()) if every else np.nan
    words = "some operations have no such rest"
    if every:
        turning = np.array([rest.turning for rest in found])
        rise = min(rest.rise for rest in found)
        off = np.max([np.abs(rest.moved) for rest in found], axis=0) * [1e6, 1e6, 180e3 / np.pi]
        words = (
            f"it holds with the energy of gravity, and while no tip slips: on {len(WAYS)} ways "
            f"from each of the {len(found)} rests elastic energy and gravity have no slope, "
            f"second derivatives of {1e-3 * value:.1f} to {1e-3 * curvature.max():.1f} N/mm on "
            f"the softest way, and rise by {1e3 * rise:.1f} mJ or more on 1 mm. Gravity does not "
            "change where the object only turns about its centre of gravity: there elastic energy "
            f"alone has the minimum, with {turning.min():.1f} to {turning.max():.1f} N m/rad. The "
            f"operations end within {off[:2].max():.2g} um and {off[2]:.2g} mdeg of these rests"
        )
    return Finding(
        claim="the object rests in a local minimum of elastic energy (LMEE)",
        source="VII, by [1], [2]",
        **_decided(every and value > 0.0, value, 0.0),
        measure="smallest second derivative of elastic energy and gravity without slip, N/m",
        evidence=words,
    )


def _elastic_alone(found: Sequence[Rest]) -> Finding:
    there = [coordinates(rest.weightless) - rest.q for rest in found]
    rises = [1e3 * float(move[1]) for move in there]
    turns = [1e3 * float(np.rad2deg(abs(move[2]))) for move in there]
    less = [1e3 * (rest.found.elastic_energy - rest.weightless.elastic_energy) for rest in found]
    weights = [-rest.elastic_slope for rest in found]
    return observation(
        "elastic energy alone is not stationary at rest: its slope in y is the weight",
        "how far the rest is below the minimum of elastic energy alone, mm",
        max(rises),
        f"the weight is {_span(weights, '.3f')} N. Without gravity the minimum would be "
        f"{_span(rises, '.3f')} mm higher, turned by at most {max(turns):.2g} mdeg, with "
        f"{_span(less, '.3f')} mJ less of the "
        f"{_span([1e3 * rest.found.elastic_energy for rest in found], '.0f')} mJ: so close that "
        "it makes little difference",
    )


def _span(values: Sequence[float], style: str) -> str:
    """The range of numbers in words."""
    low, high = format(min(values), style), format(max(values), style)
    return low if low == high else f"{low} to {high}"


def find(runs: Runs) -> tuple[Finding, ...]:
    """Judges every claim of the paper by the runs, and adds observations beyond the paper."""
    checks.instance("runs", runs, Runs)
    known = [rest for rest in runs.rests if rest.found.state and rest.weightless.state]
    return (
        _converges(runs.operations),
        _fingers_arrive(runs.operations),
        _holonomic_order(runs.operations),
        _nonholonomic_order(runs.operations),
        _rises_at_switches(runs.operations),
        *(_survives(case, run) for case, run in runs.cases.items()),
        _light_swings_more(
            (runs.cases["iii"], runs.held["iii"]), (runs.cases["ii"], runs.held["ii"])
        ),
        _without_slipping(runs.operations, runs.rests),
        *([_elastic_alone(known)] if known else []),
        _depends_on_the_way(runs.operations, runs.direct),
        _pulls_at_switches(runs.operations),
        _only_as_printed(runs.moments),
        _reading_of_delta(runs.ideal),
        _which_survive(runs.real, runs.real_cases),
        _falls_in_operations(runs.operations, runs.real),
        _sign_of_the_shear(runs.operations, runs.other_operations, runs.other_cases["i"]),
        _residuals_follow_the_step(runs.operations, runs.coarse),
        _can_be_believed(runs.operations),
        observation("the parameters are ours", "", np.nan, PARAMETER_NOTE),
    )
