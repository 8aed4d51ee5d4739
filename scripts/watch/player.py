"""A recorded run shown again: the engine's part of the page, without a simulation."""

from typing import Any

import numpy as np

from .engine import Engine
from .record import Replay
from .run import Run
from .world import Subject


class Player(Engine):
    """Shows a record's states, or a trajectory's; "seek" goes to a share of it.

    Args:
        replay: the record, or the run.
        device: as of a simulator.
    """

    def __init__(self, replay: Replay | Run, device: str | None = None) -> None:
        name, scene, options = replay.task()
        self.replay, self.at = replay, 0
        own = replay.parameters if isinstance(replay, Run) else None
        super().__init__(Subject(name, scene, options, replay.arrays["states"][0], own=own), device=device)
        if own is not None:
            self.worlds.turn({"step_size": float(np.ravel(own["step_size"])[0])})

    def tick(self) -> None:
        """Show the next state; from the beginning after the last."""
        arrays, worlds = self.replay.arrays, self.worlds
        self.at = 0 if self.at >= len(arrays["controls"]) else self.at
        if (variant := self.replay.variants[arrays["variant"][self.at]]) in worlds.sims:
            worlds.variant = variant
        given = dict(zip(self.replay.knobs, arrays["values"][self.at].tolist()))
        worlds.turn({name: value for name, value in given.items() if name != "speed"})
        worlds.before, worlds.state = arrays["states"][self.at], arrays["states"][self.at + 1]
        worlds.status, worlds.force = arrays["status"][self.at], arrays["forces"][self.at]
        self.controls = arrays["controls"][self.at]
        self.at += 1
        self.time += worlds.step_size

    def prepare(self) -> None:
        """Nothing is compiled."""

    def _do(
        self, client: int, do: str, at: Any = None, name: str = "", value: Any = None, world: int = 0
    ) -> None:
        if do == "seek":
            self.at = int(min(max(value, 0.0), 1.0) * (len(self.replay.arrays["controls"]) - 1))
            self.tick()
        elif do == "reset":
            self.at, self.time = 0, 0.0
        elif do in ("pause", "step") or (do == "set" and name == "speed"):
            super()._do(client, do, at, name, value, world)

    def hello(self) -> dict[str, Any]:
        """As the engine's, with what a record does not let a watcher turn left out."""
        found = super().hello()
        knobs = [knob for knob in found["knobs"] if knob["name"] == "speed"]
        return found | {"knobs": knobs, "policies": [], "variants": [], "pushes": [], "replay": True}
