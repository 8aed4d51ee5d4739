"""Sweeps against a loop over single steps in NumPy that hands on what these remember.

What a loop ends at may hang on a rounding: a second one, from starts moved by one, says by how much. Sweep
and loop are compared within that; worlds that it takes elsewhere are left out. Points that meet lose the
normal between them, and a step from there has a handful of ends that hang on the last bit: worlds that differ
are looped over again, a rounding in every step, and left out where one of these loops parts.
"""

import zlib
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp import Scene, measures, policies
from slcp_warp.description.kinematics import Array
from slcp_warp.options import Options, Status

from .draws import Worlds
from .judged import numbers_for, parameters, simulator

ROUNDED, WITHIN = 1e-13, 1e4  # by what starts are moved, relatively; times what that changes may differ
LEAST, MOST = 1e-9, 1e-3  # what may differ anyhow, and what is too much to compare by, beside |x| + 1
LAST_BIT, LOOPS = 2.0**-52, 24  # relative, of every state; loops that each have roundings of their own
KICKS = (0.3, 0.7)  # when velocities are changed, as parts of a run


def compare(scene: Scene, worlds: Worlds, us: Array, options: Options, strategy: str,
            device: str = "cpu") -> tuple[Array, Array]:  # fmt: skip
    """Which worlds a sweep and a loop end alike in (B,), and which of them can be compared (B,). The controls
    are a linear law about the first of `us` (B, steps, nu), whose others are gains and kicks.
    """
    sim = simulator(scene, options, "float64", strategy, device)
    numbers = numbers_for(sim, worlds) | {"step_size": np.full(len(worlds.x), scene.step_size)}
    params, steps = parameters(sim, numbers), us.shape[1]
    rng = np.random.default_rng(zlib.crc32(scene.name.encode()))
    gain = 0.1 * rng.standard_normal((scene.nu, 2 * scene.nv))
    kicks = np.stack([_kicks(x, scene.nv) for x in worlds.x])
    times = tuple((round(part * steps) + 0.25) * scene.step_size for part in KICKS)
    law = policies.Linear(gain, scene.x0, us[0, 0]) if scene.nu else None
    names = scene.state_names
    task = slcp.Task("fuzz", scene, options=options, duration=steps * scene.step_size,
                     measures={name: measures.final(name) for name in names},
                     disturbances=slcp.Disturbances(kick_times=times, kick=1.0))  # fmt: skip
    given = slcp.Worlds(worlds.x, params.table(), kicks)
    report = slcp.sweep(
        task, law, worlds=given, cases=options, dtype="float64", device=device, strategy=strategy
    )
    found = report.part(report.parts[0]["policy"])
    at = [round(time / scene.step_size) for time in times]
    sudden = dict(zip(at, kicks.swapaxes(0, 1)))

    def asked(x: Array) -> Array:
        return us[0, 0] + (x - scene.x0) @ gain.T

    starts = (worlds.x, worlds.x * (1.0 + ROUNDED))
    loops = [_loop(sim, params, x, asked, sudden, steps) for x in starts]
    (state, status), second = loops
    moved = np.abs(second[0] - state).max(1)
    size = 1.0 + np.abs(state).max(1)
    trusted = _stays(loops[0], second) & (np.abs(state) < 1e6).all(1)
    ended = np.stack([np.asarray(found[name], float) for name in names], 1)
    near = np.abs(ended - state).max(1) <= LEAST * size + WITHIN * moved
    equal = (np.asarray(found["status"]) == status) & (near | (status != Status.SOLVED))
    for i in np.flatnonzero(trusted & ~equal):
        rows = np.full(LOOPS, i)
        numbers_there = {name: value[rows] for name, value in numbers.items()}
        there = {k: kick[rows] for k, kick in sudden.items()}
        again = _loop(sim, parameters(sim, numbers_there), worlds.x[rows], asked, there, steps, rng)
        trusted[i] = _stays((state[rows], status[rows]), again).all()
    return equal, trusted


def _kicks(x: Array, nv: int) -> Array:
    """Of the world that starts there, whatever others it is run with."""
    rng = np.random.default_rng(zlib.crc32(np.ascontiguousarray(x).tobytes()))
    return 0.3 * rng.standard_normal((len(KICKS), nv))


def _stays(loop: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """Which worlds end near enough to compare them by."""
    moved, size = np.abs(other[0] - loop[0]).max(1), 1.0 + np.abs(loop[0]).max(1)
    return (loop[1] == other[1]) & (WITHIN * moved < MOST * size)


def _loop(sim: Any, params: Any, x: Array, law: Any, kicks: dict[int, Array], steps: int,
          rounded: np.random.Generator | None = None) -> tuple[Array, Array]:  # fmt: skip
    """Last states and statuses; a world that fails stays. `rounded`: states are, in every step."""
    status, warm = np.zeros(len(x), int), None
    for k in range(steps):
        start = x.copy()
        if rounded is not None:
            start *= 1.0 + LAST_BIT * rounded.integers(-1, 2, x.shape)
        start[:, sim.scene.nv :] += kicks.get(k, 0.0)
        done = sim.step(start, law(start) if sim.nu else None, params, warm_start=warm)
        going = status == Status.SOLVED
        x = np.where(going[:, None], done.state, x)
        status, warm = np.where(going, done.status, status), done.multiplier
    return x, status
