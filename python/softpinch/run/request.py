"""`Request`: a scene and validated options, as the core takes them. Every run is computed here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

from .. import _core
from ..scene import Scene, jaws
from ..scene.parts import refuse_crossed
from ..support.arrays import Floats
from .options import MOST_STEPS, Options


@dataclass(frozen=True)
class Request:
    """A run that can be computed, again with other options, and with each step divided."""

    scene: Scene
    options: Options  # the arguments of `simulate`, validated

    def with_(self, scene: Scene | None = None, **options: Any) -> Self:
        """Returns the request with another scene or other options, which are not validated."""
        return replace(self, scene=scene or self.scene, options=replace(self.options, **options))

    def simulation(self, refine: int = 1, summaries: Sequence[str] = ()) -> _core.Simulation:
        """Makes the core's run, with each step divided into `refine` steps."""
        scene, options, start = self.scene, self.options, self.scene.start()
        return _core.Simulation(
            scene.parameters(),
            scene.inputs(),
            start,
            contact=scene.contact,
            duration=scene.duration,
            times=options.times,
            every=min(refine * options.every, MOST_STEPS),
            refine=refine,
            record=options.record,
            summaries=summaries,
            options=options.core,
        )

    def compute(self) -> Mapping[str, Any]:
        """Computes the core's result; after Ctrl-C its status is "interrupted"."""
        return self.simulation().run()

    def run_to_end(self, refine: int = 1) -> Mapping[str, Any]:
        """Computes the core's result with each step divided; recorded instants do not vary."""
        result = self.simulation(refine).run()
        if result["status"] == "interrupted":
            raise KeyboardInterrupt
        return result

    def rows_at(self, times: Floats, *more: str) -> Mapping[str, Any]:
        """Computes the run's states, and `more` groups, at increasing instants before its end."""
        # No violation of `stop_on` ends it: only events that always do can cut the rows.
        record = ("state", *more)
        return self.with_(times=times, every=1, record=record, stop_on=()).run_to_end()

    def linear_model(
        self,
        t: Floats,
        q: Floats,
        p: Floats,
        integral: Floats,
        *,
        contacts: Floats | None = None,
        inputs: Any = None,
        **how: bool,
    ) -> _core._Linear:
        """Linearises the motion at n states: t (n,), q (n, 9), p, integral.

        The tips stick, or are in the modes of `contacts` (n, 4) as in `State.contact`, where a
        frozen tilt of NaN is the present one. `inputs` take the place of the scene's own. Of `how`,
        `whole` computes B, C and D too; with `open_loop` torques turn the fingers instead of the
        scene's law; with `frozen` the inputs of the instant hold, as at an equilibrium.
        """
        parts = self.scene.parameters(), self.scene.inputs() if inputs is None else inputs
        name, gains = self.options.formulation, self.options.stabilization
        flags: Any = {"whole": False, "open_loop": False, "frozen": False} | how
        flags["contacts"] = contacts
        return _core.linearize(*parts, t, q, p, integral, name, gains.alpha, gains.beta, **flags)


def rest_scene(scene: Scene, time: float) -> _core.RestScene:
    """Makes the core's scene for equilibria and wrench limits under the inputs of one instant."""
    if scene.law == "torque" and all(jaws(scene)):
        why = "between which nothing centres the object: no rest is found"
        advice = "Pid, or driven fingers, hold it"
        raise ValueError(f"scene.control: Torque gives two jaws constant forces, {why}; {advice}")
    if scene.motion is not None:
        at = scene.motion.at(time)
        if at.tilt_rate or at.tilt_acceleration:
            raise ValueError(f"Scene.motion: turns at t = {time} s, where nothing is at rest in it")
    refuse_crossed(scene)
    return _core.RestScene(scene.parameters(), scene.inputs(), time)
