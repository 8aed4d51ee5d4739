"""Cases of many contacts: columns, stacks of boxes, heavy on light, and more supports than a body needs."""

import functools

import numpy as np

from . import scenes
from .bodies import cheap, energy_gain
from .case import Array, Case, Grid, Run, Start


def _column(grid: Grid, steps: int) -> Start:
    """The top disc is `variant` times as heavy as the others; everything touches."""
    mass = np.ones((grid.size, 3))
    mass[:, -1] = grid.variant
    return Start(np.zeros((grid.size, 6)), {"mass": mass, "inertia": mass})


def _largest_shift(run: Run) -> Array:
    return np.abs(run.states[:, -1, : run.nv]).max(1)


def _stack(boxes: int, grid: Grid, steps: int) -> Start:
    scene = scenes.stack(boxes)
    mass = np.ones((grid.size, boxes))
    mass[:, -1] = grid.variant
    return Start(np.tile(scene.x0, (grid.size, 1)), {"mass": mass, "inertia": mass / 60.0})


def _shift(run: Run) -> Array:
    """Largest distance of any box from where it began, angles (times half a width) included [m]."""
    moved = np.abs(run.states[:, -1, : run.nv] - run.states[:, 0, : run.nv]) * np.tile(
        [1, 1, 0.2], run.nv // 3
    )
    return moved.max(1)


def _thrown(boxes: int, grid: Grid, steps: int) -> Start:
    """Velocities N(0, 1), other ones for every world."""
    scene = scenes.stack(boxes)
    x0 = np.tile(scene.x0, (grid.size, 1))
    x0[:, scene.nv :] += np.random.default_rng([boxes, grid.size]).standard_normal((grid.size, scene.nv))
    return Start(x0)


def _thrown_gain(grid: Grid) -> Array:
    """Rows at gap 0 push each other as far as their layers reach; hard contact adds nothing."""
    noise = np.nan_to_num(grid.sigma)
    return 1e-9 + 50.0 * grid.layer + 10.0 * noise**2


def _beam(grid: Grid, steps: int) -> Start:
    return Start(np.tile([0.0, 0.1, 0.0, 0.0, 0.0, 0.0], (grid.size, 1)))


def _stack_case(boxes: int, ratios: tuple[float, ...], hs: tuple[float, ...], what: str) -> Case:
    return Case(
        f"stack of {boxes}", what, functools.partial(scenes.stack, boxes), functools.partial(_stack, boxes),
        _shift, 1e-3, duration=1.0, label="top mass", variants=ratios, step_sizes=hs,
        generic=True,
    )  # fmt: skip


def _thrown_case(boxes: int, worlds: int, hs: tuple[float, ...]) -> Case:
    many = 4 * boxes >= 32
    return Case(
        f"{boxes} tumbling boxes", "a stack thrown apart gains no energy",
        functools.partial(scenes.stack, boxes),
        functools.partial(_thrown, boxes), energy_gain, _thrown_gain, "", steps=75, single=1e-3,
        label="world", variants=tuple(map(float, range(worlds))), step_sizes=hs, only=cheap, generic=many,
    )  # fmt: skip


def _beam_case(supports: int, spread: bool) -> Case:
    kind = "spread" if spread else "coincident"
    return Case(
        f"{kind} supports", "a beam on more points than it needs",
        functools.partial(scenes.beam, supports, spread), _beam, _shift, 1e-3, duration=1.0, label="supports",
        variants=(float(supports),), step_sizes=(0.01, 0.05, 0.1), generic=True,
    )  # fmt: skip


PILE_CASES = (
    Case("column", "three discs on each other, frictionless; the top one heavy", scenes.column, _column,
         _largest_shift, 1e-3, duration=2.0, label="top mass", only=cheap, variants=(1.0, 1e3, 1e6)),
    _stack_case(2, (1.0, 1e3, 1e6, 1e7, 1e8), (1e-3, 0.01, 0.05, 0.1), "two boxes; the top one heavy"),
    _stack_case(3, (1.0, 1e3), (0.01, 0.05, 0.1), "three boxes"),
    _stack_case(10, (1.0,), (0.01, 0.05, 0.1), "ten boxes"),
    _stack_case(30, (1.0,), (0.05, 0.1), "thirty boxes"),
    *(_beam_case(n, spread) for spread in (True, False) for n in (2, 4, 8, 16, 64, 100)),
    _thrown_case(2, 50, (0.01, 0.05)),
    _thrown_case(3, 50, (0.01, 0.05)),
    _thrown_case(8, 20, (0.01, 0.05)),
)  # fmt: skip
