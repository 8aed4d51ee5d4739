"""Cases of heaps, of discs in grooves that friction may lock, and of a long chain that swings at a wall."""

import functools
import math

import numpy as np

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape
from slcp_warp.kernels.method import Method
from slcp_warp.options import Status

from .bodies import cheap, energy_gain
from .case import Array, Case, Grid, Run, Start, states

RADIUS, MU, DEEP = 0.1, 0.5, 1e-3
LOCKS = math.atan(MU)  # half angle of a groove below which friction holds what is pressed into it [rad]
LINKS, LENGTH = 20, 0.1  # of the chain, and of a link [m]


def heap(discs: int, width: float, variety: float) -> Scene:
    """Discs between walls; everything may touch everything."""
    return slcp.scenes.heap(discs, width=width, variety=variety)


def groove() -> Scene:
    """A free disc between two half-planes that `shape_angle` opens upwards, with friction: 4 rows."""
    planes = tuple(Shape(name, None, "halfplane", angle=math.pi / 2) for name in ("left", "right"))
    return Scene("groove", (Body("disc", 1.0, 0.5 * RADIUS**2, joint="free"),),
                 (Shape("disc", "disc", "disc", RADIUS), *planes),
                 tuple(Contact(plane.name, "disc", MU) for plane in planes))  # fmt: skip


def chain() -> Scene:
    """A chain of rods that hangs from the origin, with a disc at its end, before a wall at .3 m: 2 rows."""
    bodies = tuple(
        Body(f"link{i}", 1.0, LENGTH**2 / 12.0, parent=f"link{i - 1}" if i else None,
             anchor=(LENGTH, 0.0) if i else (0.0, 0.0), com=(LENGTH / 2, 0.0))
        for i in range(LINKS)
    )  # fmt: skip
    shapes = (Shape("tip", bodies[-1].name, "disc", 0.05, offset=(LENGTH, 0.0)),
              Shape("wall", None, "halfplane", offset=(0.3, 0.0), angle=math.pi))  # fmt: skip
    return Scene("chain20", bodies, shapes, (Contact("wall", "tip", MU),))


def _thrown(make: functools.partial[Scene], grid: Grid, steps: int) -> Start:
    """Velocities N(0, 1), other ones for every variant."""
    scene = make()
    x0 = np.tile(scene.x0, (grid.size, 1))
    for row, variant in zip(x0, grid.variant):
        row[scene.nv :] += np.random.default_rng(int(variant)).standard_normal(scene.nv)
    return Start(x0)


def _gain(grid: Grid) -> Array:
    """Rows at gap 0 push each other as far as their layers reach; hard contact adds nothing."""
    return 1e-9 + 50.0 * grid.layer + 10.0 * np.nan_to_num(grid.sigma) ** 2


def _heavy(make: functools.partial[Scene], grid: Grid, steps: int) -> Start:
    """The last disc, on top, is `variant` times as heavy as the others."""
    scene = make()
    factor = np.ones((grid.size, len(scene.bodies)))
    factor[:, -1] = grid.variant
    numbers = {name: scene.default_parameters()[name] * factor for name in ("mass", "inertia")}
    return Start(np.tile(scene.x0, (grid.size, 1)), numbers)


def _entered(run: Run) -> Array:
    """Deepest penetration after any step [m]."""
    return np.maximum(-run.gap, 0.0).max(1)


def _pressed(grid: Grid, steps: int) -> Start:
    """The disc DEEP inside both sides of a groove whose half angle has `variant` times the tangent at which
    friction locks it; at rest.
    """
    half = np.arctan(grid.variant * math.tan(LOCKS))
    angle = np.zeros((grid.size, 3))
    angle[:, 1], angle[:, 2] = half, math.pi - half
    return Start(states(grid, 3, q1=(RADIUS - DEEP) / np.sin(half)), {"shape_angle": angle})


def _nothing(run: Run) -> Array:
    return np.zeros(run.grid.size)


def _chained(grid: Grid, steps: int) -> Start:
    """Straight down, turning at `variant` rad/s towards the wall."""
    return Start(states(grid, LINKS, q0=-math.pi / 2, v0=grid.variant))


def _layer(grid: Grid) -> Array:
    """By how far a curve falls below its tangent within a step of the fastest end."""
    return 1e-9 + 0.5 * (grid.h * grid.variant) ** 2 * LINKS * LENGTH + grid.layer


def _heap_case(discs: int, width: float, variety: float, worlds: int) -> Case:
    make = functools.partial(heap, discs, width, variety)
    return Case(
        f"heap of {discs}, thrown", "discs between walls gain no energy", make,
        functools.partial(_thrown, make), energy_gain, _gain, "", steps=50, single=1e-3, label="world",
        variants=tuple(map(float, range(worlds))), step_sizes=(0.01, 0.05), only=cheap, generic=True,
    )  # fmt: skip


def _heavy_case() -> Case:
    make = functools.partial(heap, 6, 0.62, 0.0)
    return Case(
        "heavy on a heap", "six discs in hollows between walls, the top one heavy: none enters another",
        make, functools.partial(_heavy, make), _entered, lambda grid: 1e-6 + grid.layer,
        steps=50, single=1e-4, label="top mass", variants=(1.0, 1e2, 1e4, 1e6), step_sizes=(0.01, 0.05),
        only=cheap, generic=True,
    )  # fmt: skip


def _coulomb(method: Method) -> bool:
    return method.coulomb


def _relaxed(method: Method) -> bool:
    return not method.coulomb and cheap(method)


HEAP_CASES = (
    _heap_case(8, 0.7, 0.3, 10),
    _heap_case(14, 0.9, 0.5, 10),
    _heavy_case(),
    Case("wedge leaves", "a disc 1 mm inside a groove too wide for friction to hold it", groove, _pressed,
         _entered, lambda grid: 1e-9 + grid.layer, steps=3, single=1e-5, label="tangent/lock", only=cheap,
         variants=(1.001, 1.1, 2.0, 5.0)),
    Case("wedge jams", "the same in a narrow one: no impulse opens it (Coulomb)", groove, _pressed, _nothing,
         0.0, "", steps=3, label="tangent/lock", variants=(0.1, 0.5, 0.9, 0.999), expect=Status.JAMMED,
         only=_coulomb),
    Case("wedge shut", "the same: no velocity opens its rows (Anitescu)", groove, _pressed, _nothing, 0.0, "",
         steps=3, label="tangent/lock", variants=(0.1, 0.5, 0.9, 0.999), expect=Status.INFEASIBLE,
         only=_relaxed),
    Case("long chain", "twenty links swing at a wall and stay before it", chain, _chained, _entered, _layer,
         steps=100, single=1e-4, label="rad/s", variants=(0.1, 1.0, 5.0), step_sizes=(1e-3, 0.01),
         only=cheap, generic=True),
)  # fmt: skip
