"""The parts of a run: what scenes and states there are, and for how many steps every world is followed.

- steps: random mechanisms and states of five classes, one step;
- rollouts: the same, followed for 20 to 50 steps that hand on their warm starts;
- auto: mechanisms in which everything may touch everything, behind the broad phase where there are many
  pairs; followed for up to 30 steps;
- heaps: stacks, heaps, boxes that tumble, beams on many supports, followed;
- towers: stacks of 46 to 70 boxes, which are large islands, followed for fewer steps;
- relay: rollouts by the specialised kernels without last resorts and those that make what they leave;
- sweeps: `slcp.sweep` under a linear law and kicks, against a loop over steps;
- derivatives: one step by the common kernels, of which A, B, second derivatives and gradients are compared
  with differences;
- ends: gaps at the end of the step, and the trapezoidal rule under Coulomb's friction;
- locked: one step of mechanisms whose joints' limits meet;
- blocks: mechanisms with rectangles, followed for up to 20 steps;
- block-derivatives: derivatives of these;
- overlaps: pushed out by no more than a speed, and left where nothing opens them; overlap-derivatives;
- bounces: mechanisms with restitution, followed for up to 20 steps;
- bounce-derivatives: derivatives of these;
- rotors: one to four steps of mechanisms with armature at half of their joints;
- tendons: one to four steps of mechanisms with tendons, some with rectangles or restitution;
- tendon-derivatives: derivatives of these;
- limits: mechanisms with tendons whose force has a limit, followed for up to 20 steps; limit-derivatives;
- runs: mechanisms with surfaces that run, followed for up to 20 steps; run-derivatives;
- leaps: one step of mechanisms under the leapfrog, from where Euler's leads; leap-derivatives;
- rings: mechanisms in rings and with rings on their bodies, followed for up to 20 steps;
- ring-derivatives: derivatives of these.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from slcp_warp import Scene
from slcp_warp.options import Options

from .draws import Worlds, decades, draw_worlds, single
from .heaps import heap_worlds, random_heap, random_pile, random_tower
from .structures import (
    JOINTS,
    Size,
    random_auto,
    random_blocks,
    random_bouncers,
    random_limited,
    random_rings,
    random_runners,
    random_scene,
    random_tendons,
)

Rng = np.random.Generator
FOLLOWED = (20, 50)
FEWER = 3  # bodies less than other scenes have at most: more rows are limits
SPEEDS = (0.1, 1e9, 0.0, 10.0)
MEET, APART, HERE = 0.6, 0.3, 0.6  # shares: of what meets, of that what does not quite, and where it is


def _swept(rng: Rng, name: str, size: Size) -> Scene:
    """All worlds of a sweep have one step size."""
    return replace(random_scene(rng, name, size), step_size=0.01)


def _any(options: Options) -> bool:
    return True


def _relayed(options: Options) -> bool:
    return not options.residual.startswith("erm")


def _ends(options: Options) -> bool:
    return options.gap == "end" or (options.friction == "coulomb" and options.integrator == "trapezoidal")


def rotor_scene(rng: Rng, name: str, size: Size) -> Scene:
    """A random scene with armature at half of its joints."""
    scene = random_scene(rng, name, size)
    has = [[0.1 if rng.random() < 0.5 else None for _ in range(JOINTS[b.joint])] for b in scene.bodies]
    return replace(scene, bodies=tuple(replace(b, armature=tuple(own)) for b, own in zip(scene.bodies, has)))


def locked_scene(rng: Rng, name: str, size: Size) -> Scene:
    """A random scene half of whose coordinates have both limits."""
    scene = random_scene(rng, name, replace(size, bodies=max(1, size.bodies - FEWER)))
    bodies = []
    for body in scene.bodies:
        has = rng.random(JOINTS[body.joint]) < 0.5
        lower, upper = (tuple(bound if on else None for on in has) for bound in (-1.0, 1.0))
        bodies.append(replace(body, lower=lower, upper=upper))
    return replace(scene, bodies=tuple(bodies))


def locked_worlds(rng: Rng, scene: Scene, worlds: int) -> Worlds:
    """States as elsewhere, between limits that meet."""
    out, s = draw_worlds(rng, scene, worlds), scene.structure
    lower, upper = out.numbers["lower"].copy(), out.numbers["upper"].copy()
    for j in np.flatnonzero(np.array(s.lower, bool) & np.array(s.upper, bool)):
        meets = rng.random(worlds) < MEET
        away = rng.choice([-1.0, 1.0], worlds) * decades(rng, -7, -1, worlds)
        place = single(out.x[:, j] + np.where(rng.random(worlds) < HERE, 0.0, away))
        width = np.where(rng.random(worlds) < APART, decades(rng, -12, -2, worlds), 0.0)
        lower[:, j] = np.where(meets, single(place - 0.5 * width), lower[:, j])
        upper[:, j] = np.where(meets, np.maximum(lower[:, j], single(place + 0.5 * width)), upper[:, j])
    return replace(out, numbers=out.numbers | {"lower": lower, "upper": upper})


@dataclass(frozen=True)
class Part:
    """How a part draws scenes and states; steps, at least and at most; strategies; which methods of those
    that the library offers are drawn for own kernels; numbers that random numbers are seeded with beside the
    task's.
    """

    seeds: tuple[int, ...] = ()
    scene: Callable[[Rng, str, Size], Scene] = random_scene
    worlds: Callable[[Rng, Scene, int], Worlds] = draw_worlds
    steps: tuple[int, int] = (1, 1)
    strategies: tuple[str, ...] = ("generic", "specialised")
    wanted: Callable[[Options], bool] = _any
    differentiated: bool = False  # whether derivatives by common kernels are what it looks at
    depenetration: tuple[float, ...] = ()  # speeds, scene by scene; none: overlaps are pushed out in one step
    integrator: str = ""  # of all methods; none: their own


PARTS = {
    "steps": Part(),
    "rollouts": Part((99, 1), steps=FOLLOWED),
    "auto": Part((99, 2), random_auto, steps=(1, 30), strategies=("generic",)),
    "heaps": Part((99, 3), random_heap, heap_worlds, FOLLOWED, ("generic",)),
    "towers": Part((99, 8), random_tower, heap_worlds, (3, 9), ("generic",)),
    "piles": Part((99, 9), random_pile, heap_worlds, (3, 9), ("generic",)),
    "relay": Part((99, 4), steps=FOLLOWED, strategies=("relay",), wanted=_relayed),
    "sweeps": Part((99, 6), _swept, steps=FOLLOWED),
    "derivatives": Part((99, 7), strategies=("generic",), differentiated=True),
    "ends": Part((99, 5), strategies=("specialised",), wanted=_ends),
    "locked": Part((99, 7), locked_scene, locked_worlds),
    "blocks": Part((99, 11), random_blocks, steps=(1, 20)),
    "block-derivatives": Part((99, 12), random_blocks, strategies=("generic",), differentiated=True),
    "bounces": Part((99, 13), random_bouncers, steps=(1, 20), strategies=("generic",)),
    "bounce-derivatives": Part((99, 14), random_bouncers, strategies=("generic",), differentiated=True),
    "overlaps": Part((99, 19), steps=(1, 20), strategies=("generic",), depenetration=SPEEDS),
    "overlap-derivatives": Part((99, 20), strategies=("generic",), differentiated=True, depenetration=SPEEDS),
    "rotors": Part((99, 10), rotor_scene, steps=(1, 4)),
    "tendons": Part((99, 15), random_tendons, steps=(1, 4)),
    "tendon-derivatives": Part((99, 16), random_tendons, strategies=("generic",), differentiated=True),
    "limits": Part((99, 25), random_limited, steps=(1, 20), strategies=("generic",)),
    "limit-derivatives": Part((99, 26), random_limited, strategies=("generic",), differentiated=True),
    "runs": Part((99, 21), random_runners, steps=(1, 20), strategies=("generic",)),
    "run-derivatives": Part((99, 22), random_runners, strategies=("generic",), differentiated=True),
    "leaps": Part((99, 23), strategies=("generic",), integrator="leapfrog"),
    "leap-derivatives": Part((99, 24), strategies=("generic",), differentiated=True, integrator="leapfrog"),
    "rings": Part((99, 17), random_rings, steps=(1, 20)),
    "ring-derivatives": Part((99, 18), random_rings, strategies=("generic",), differentiated=True),
}
