"""The solvers of `peers` as `work_precision` takes them."""

from typing import Any

import null_space
import peers as others
import softpinch as sp
from null_space import Floats
from peers import MISSING as MISSING

# Every so many settings of a ladder: whole powers of ten, or of two.
_STRIDE = 4
# Below this most complain, and round-off is what they find.
_TIGHTEST = 1e-13


def peers(scene: sp.Scene) -> list[sp.Peer]:
    """All that are installed; of a scene that only stiff solvers manage, those that may."""
    stiff = _is_stiff(scene)
    return [
        _adapted(name, peer, scene)
        for name, peer in others.PEERS.items()
        if peer.for_stiff or not stiff
    ]


def _is_stiff(scene: sp.Scene) -> bool:
    """Whether stability asks an explicit method for more than a hundred thousand steps."""
    return scene.duration / sp.max_stable_dt(scene, measure=False).predicted > 1e5 / 4


def _adapted(name: str, peer: others.Peer, scene: sp.Scene) -> sp.Peer:
    # Where absolute tolerances go with relative ones, those of a hundredth: the middle ladder.
    ladder = peer.ladders[len(peer.ladders) // 2][::_STRIDE]
    settings = {_number(each): each for each in ladder if _number(each) >= _TIGHTEST}
    parameters = null_space.parameters(scene)

    def prepare(scene: sp.Scene) -> Any:
        solve = peer.prepare(scene)
        return lambda value: solve(settings[value])

    def ends(state: Any) -> tuple[Floats, Floats]:
        return peer.ends(state, parameters)

    kind = "steps" if isinstance(next(iter(settings.values())), int) else "rtol"
    return sp.Peer(name=name, setting=kind, values=list(settings), prepare=prepare, ends=ends)


def _number(setting: Any) -> float:
    return float(setting[0] if isinstance(setting, tuple) else setting)
