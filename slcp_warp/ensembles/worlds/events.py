"""What happens to single worlds, as the kernels of a sweep take it."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from slcp_warp.kernels.ensembles.disturbances import make_events
from slcp_warp.kernels.structure import WORLD

from ...simulator import Simulator
from ...tasks.disturbances import Push
from .arrays import Worlds


class Written(NamedTuple):
    """What kernels write of worlds (B, ...) while they run.

    Attributes:
        records: (B, S, R) of components of the state.
        noted: (B, NOTED), see `arrival`.
        told: (B, N, nx + nu + 3 nb) states, controls and forces that steps begin from; None: not wanted.
    """

    records: wp.array
    noted: wp.array
    told: wp.array | None = None


def events_of(sim: Simulator, worlds: Worlds, written: Written) -> Any:
    """The struct of worlds that are on the simulator's device, with room for the forces of a step."""
    out = make_events(sim.dtype)()
    for name, values in (("number", worlds.numbers), ("kick", worlds.kicks), ("push", worlds.pushes),
                         ("dropout", worlds.dropouts), ("timing", worlds.timing)):  # fmt: skip
        if values is not None:
            setattr(out, name, values)
    forces = (0, 0) if worlds.pushes is None else (len(worlds), 3 * sim.scene.structure.nb)
    out.external = sim.empty(*forces)
    if written.told is not None:
        out.told = written.told
    return out


def put_pushes(sim: Simulator, conditions: Any, pushes: Sequence[Push]) -> None:
    """Which bodies are pushed, where, and what turns them, into the struct of a sweep's conditions."""
    s, layout = sim.scene.structure, sim.params.layout
    names = [body.name for body in sim.scene.bodies]
    bodies = [names.index(push.body) for push in pushes]
    chains = [_chain(sim, body) for body in bodies]
    turns = [[s.turns(body, j) for j in range(s.nv)] for body in bodies]
    leans = np.full((len(pushes), max(map(len, chains))), -1)
    for row, chain in zip(leans, chains):
        row[: len(chain)] = layout.offset("angle") + np.array(chain)
    points = [(0.0, 0.0, 0.0) if push.at is None else (*push.at, 1.0) for push in pushes]
    for name, values in (("pushed", bodies), ("turns", turns), ("leans", leans)):
        setattr(conditions, name, wp.array(np.array(values, np.int32), dtype=wp.int32, device=sim.device))
    conditions.point = wp.array(np.array(points), dtype=sim.dtype, device=sim.device)
    conditions.com = layout.offset("com")


def _chain(sim: Simulator, body: int) -> list[int]:
    """A body and all that it hangs on."""
    out = []
    while body != WORLD:
        out.append(body)
        body = sim.scene.structure.bodies[body].parent
    return out
