"""The modes in which the contacts of a state are linearised: given ones, or its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from .. import _core
from ..run.contact import ContactMode
from ..run.options import Options
from ..run.request import Request
from ..scene.scene import Scene, State
from ..support import checks
from ..support.arrays import Floats

# The modes of the right and of the left tip.
GivenModes: TypeAlias = Sequence[str | ContactMode]

# Name -> code in `State.contact`; "slip" takes its direction from the state.
_CODES = {mode.name.lower(): float(mode) for mode in ContactMode}
_CODES |= {"slip_up": _CODES["slip"], "slip_down": -_CODES["slip"]}
# Duration of the run whose start chooses the modes, s.
_MOMENT = 1e-9


def contact_row(scene: Scene, state: State, modes: GivenModes | None) -> Floats | None:
    """Returns the contacts (4,) of a state, as in `State.contact`; None if both tips stick.

    The frozen tilt of a tip that is free in the given modes only is NaN: the present one.
    """
    if scene.contact == "bilateral":
        if modes is not None:
            rule = 'must be None with contact = "bilateral", in which both tips always stick'
            raise ValueError(f"modes = {checks.shown(modes)}: {rule}")
        return None
    row = state.contact
    if modes is not None:
        row = _given(scene, state, modes)
    elif row is None:
        short = replace(scene, initial=state, duration=_MOMENT)
        row = Request(short, Options.checked(_MOMENT, record="state")).run_to_end()["contacts"][0]
    return None if (row[:2] == ContactMode.STICK).all() else np.asarray(row)


def _given(scene: Scene, state: State, modes: GivenModes) -> Floats:
    if isinstance(modes, str) or len(modes) != 2:
        raise TypeError(f"modes = {checks.shown(modes)}: must be two, of the right and left tip")
    slip = _core.residuals(scene.parameters(), state.q[None], state.p[None])[0, 2:]
    row = np.zeros(4)
    for k, mode in enumerate(modes):
        field = f"modes[{k}]"
        name = mode.name.lower() if isinstance(mode, ContactMode) else mode
        row[k] = _CODES[checks.choice(field, name, tuple(_CODES))]
        if name == "slip":
            if not slip[k]:
                rule = 'must be "slip_up" or "slip_down", because this state has no slip velocity'
                raise ValueError(f"{field} = {checks.shown(mode)}: {rule}")
            row[k] *= np.sign(slip[k])
        if name == "free":
            own = state.contact
            row[2 + k] = np.nan if own is None or own[k] != ContactMode.FREE else own[2 + k]
    return row
