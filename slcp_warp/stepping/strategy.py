"""Which kernels a scene gets: specialised ones, or generic ones.

"specialised": every (scene, options, precision) compiles kernels of its own, unrolled, one world per thread
in registers: fastest for small mechanisms, and the only ones with every option. "generic": one kernel per
precision and residual serves every scene by tables, a world's state in memory (`kernels/generic/step.py`):
for scenes whose unrolled kernels would take minutes to compile and spill anyway, on a CPU for trees that
touch each other, which they step faster.
"""

import os
import warnings
from collections import Counter
from typing import Any

from slcp_warp.kernels.device.cache import for_gpu
from slcp_warp.kernels.generic.topology import NUMBERS
from slcp_warp.kernels.method import Method
from slcp_warp.kernels.solvers.law import law_of
from slcp_warp.kernels.structure import MOST_ROWS, WORLD, Structure, layout

from ..inputs.checks import choice, flag
from ..inputs.errors import ArgumentError

STRATEGIES = ("auto", "specialised", "generic")
RENAMED = {"registers": "specialised", "memory": "generic"}  # as they were called before
# nv times the larger of nr and nv, by whether the device is a CPU: beyond, specialised kernels compile for
# half a minute on a CPU and for minutes on a GPU (docs/performance.md)
LARGEST = {True: 200, False: 32}
# nv times nr from which generic kernels are the faster ones on a CPU where pairs join two trees and more
# (`slcp bench kernels --scene all`, docs/performance.md)
TOUCHING = 48
CROWDED = 4  # rows a degree of freedom from which they are under Coulomb's friction: all may act at once
UNROLLED = (
    8  # pairs up to which specialised kernels are worth their compiling on a CPU: each has code of its own
)
PAIRS = 2  # of which the rows that act together are few in most steps


class StrategyError(ArgumentError):
    """What was asked for is not offered with the kernels of this scene."""


def structure_facts(s: Structure) -> dict[str, int]:
    """What "auto" chooses by: degrees of freedom, rows, and the most trees that contact pairs join."""
    return {"nv": s.nv, "rows": s.nr, "trees": joined_trees(s)}


def joined_trees(s: Structure) -> int:
    """The most trees (bodies that joints hang on each other) that pairs may join, the world left out."""
    root = [b if body.parent == WORLD else -1 for b, body in enumerate(s.bodies)]
    for b, body in enumerate(s.bodies):
        if body.parent != WORLD:
            root[b] = root[body.parent]
    name = {r: r for r in root}

    def find(r: int) -> int:
        while name[r] != r:
            r = name[r]
        return r

    for pair in s.pairs:
        bodies = [s.mover(i) for i in (pair.shape_a, pair.shape_b)]
        if WORLD not in bodies:
            one, other = (find(root[b]) for b in bodies)
            name[max(one, other)] = min(one, other)
    return max(Counter(find(r) for r in name).values())


def missing(s: Structure, method: Method) -> str:
    """What keeps a scene from the generic kernels, or ""."""
    if not (method.hard or method.rem):
        return f"residual {method.residual!r}"
    if method.friction != "anitescu" and not (method.coulomb and method.hard):
        return f"friction {method.friction!r}"
    if method.trapezoidal:
        return f"integrator {method.integrator!r}"
    if method.state_noise:
        return f"noise {method.noise!r}"
    if method.tolerance is not None:
        return f"tolerance {method.tolerance!r}"
    if method.leapfrog and s.limited:
        return f"integrator {method.integrator!r} with force_limit of tendons"
    if method.end_gap:
        return f"gap {method.gap!r}"
    if method.converts:
        return f"deviation {method.deviation!r}"
    unknown = [name for name in layout(s).names if name not in NUMBERS]
    return f"parameters {unknown}" if unknown else ""


def of_generic_kernels(s: Structure, method: Method) -> str:
    """What keeps a scene from specialised kernels, or ""."""
    if method.depenetration_speed is not None:
        return f"depenetration_speed {method.depenetration_speed!r}"
    if method.leapfrog:
        return f"integrator {method.integrator!r}"
    if s.runs:
        return "driven_by of shapes"
    if s.limited:
        return "force_limit of tendons"
    return "restitution" if s.bounces else ""


def takes_fast_path(fast_path: Any, s: Structure, method: Method, device: Any, strategy: str) -> bool:
    """Whether specialised kernels without last resorts step first (`kernels/device/relay.py`); where None is
    given, as the environment variable SLCP_FAST_PATH says (0 or 1), else on a GPU, in scenes of few pairs.

    Raises:
        StrategyError: it is asked for, and there is none.
    """
    reason = ""
    if strategy == "generic":
        reason = "generic kernels step"
    elif s.nr == 0 and not s.couples:  # nothing that could lose digits, either
        reason = "the scene has neither rows nor couplings"
    elif not law_of(method, s.nr).fast:
        reason = f"the residual is {method.residual!r}"
    if fast_path is None:
        text = os.environ.get("SLCP_FAST_PATH", "").strip()
        if text not in ("", "0", "1"):
            raise ArgumentError(f"SLCP_FAST_PATH is {text!r}; 0 or 1 is needed")
        wanted = text == "1" if text else len(s.pairs) <= PAIRS and for_gpu(device)
        return wanted and not reason
    if flag("fast_path", fast_path) and reason:
        raise StrategyError(f"fast_path is True, but {reason}, and every step is made by one kernel")
    return fast_path


def current_name(strategy: Any) -> Any:
    """A strategy by its name of today; one of before is taken, with a warning where the public call is."""
    if not isinstance(strategy, str) or strategy not in RENAMED:
        return strategy
    name = RENAMED[strategy]
    warnings.warn(f"strategy {strategy!r} is called {name!r} now", DeprecationWarning, stacklevel=3)
    return name


def choose(strategy: str, s: Structure, method: Method, device: Any) -> str:
    """Specialised or generic kernels for a scene; a clear error where neither serves."""
    choice("strategy", strategy, STRATEGIES)
    lacks = missing(s, method)
    alone = of_generic_kernels(s, method)
    if alone and (strategy == "specialised" or lacks):
        if alone in lacks:
            raise StrategyError(f"{lacks} is not offered by any kernels")
        reason = f"; these do not offer {lacks}" if lacks else ""
        raise StrategyError(f"{alone} is offered by the generic kernels alone{reason}")
    if strategy == "generic" and lacks:
        raise StrategyError(f"{lacks} is not offered by the generic kernels; use strategy='specialised'")
    if s.nr > MOST_ROWS and (strategy == "specialised" or lacks):
        reason = f"; the generic kernels do not offer {lacks}" if lacks else "; use strategy='generic'"
        raise StrategyError(
            f"the scene has {s.nr} rows, specialised kernels take at most {MOST_ROWS}{reason}"
        )
    if strategy != "auto" or lacks:
        return "specialised" if strategy == "auto" else strategy
    on_cpu = not for_gpu(device)
    large = s.nr > MOST_ROWS or s.nv * max(s.nr, s.nv) > LARGEST[on_cpu]
    touching = s.nv * s.nr >= TOUCHING and joined_trees(s) > 1
    crowded = method.coulomb and s.nr >= CROWDED * s.nv
    generic = large or bool(alone) or on_cpu and (touching or crowded or len(s.pairs) > UNROLLED)
    return "generic" if generic else "specialised"
