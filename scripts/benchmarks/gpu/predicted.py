"""What the fast kernels of the finger take of a GPU, found from their code for sm_90 without one."""

from collections.abc import Callable
from typing import Any, NamedTuple

import warp as wp

import slcp_warp as slcp
from slcp_warp.kernels.control import rollouts
from slcp_warp.kernels.derivatives.expansion import make_linearize_kernel
from slcp_warp.kernels.ensembles.sweep import make_sweep_kernel
from slcp_warp.kernels.method import Method
from slcp_warp.kernels.policies.ask import make_ask_kernel
from slcp_warp.kernels.policies.held import HELD
from slcp_warp.kernels.policies.nearest import STACKS, nearest_kernel
from slcp_warp.kernels.policies.open_loop import OPEN_LOOP
from slcp_warp.kernels.policies.tree import WIDTH
from slcp_warp.kernels.specialisation import Specialisation
from slcp_warp.kernels.step.relayed import make_rollout_relay
from slcp_warp.kernels.step.rollout import make_transition

ARCH = 90
SINE = 32  # bytes of local memory of the argument reduction of sine and cosine
REGISTERS = 128  # a fast kernel has no more: what it spills costs less than the warps bring that find room
TREE = 8 * (STACKS[0] + 1) + 2 * 4 * WIDTH  # of a search in the library's tree: what waits, distances


class Most(NamedTuple):
    """A kernel, and what it takes at most: registers, bytes of local memory of a thread, bytes of code."""

    make: Callable[[], Any]
    registers: int
    frame: int
    code: int


def finger(part: str = "fast", **options: Any) -> Specialisation:
    """What the finger's kernels in single precision are made for."""
    structure = slcp.scenes.flicking_finger().structure
    return Specialisation(structure, wp.float32, Method(scaling="none", part=part, **options))


def line_search() -> Any:
    """DDP's rollouts, with the finger's cost."""
    cost = slcp.tasks.flicking_finger().cost.functions(wp.float32, 6, 2)
    step = make_transition(finger())
    functions = step.advance, step.cold_carry, cost.running, cost.final
    return rollouts.make_rollout_kernel(*functions, 6, 2, True, False, wp.float32, step)


FAST = {
    "rollout": Most(lambda: make_rollout_relay(finger(), OPEN_LOOP, False), REGISTERS, 264, 72_000),
    "hard rollout": Most(
        lambda: make_rollout_relay(finger(residual="hard"), OPEN_LOOP, False), REGISTERS, 184, 66_000
    ),
    "sweep": Most(lambda: make_sweep_kernel(finger(), HELD, spans=True), REGISTERS, 352, 132_000),
    "linearisation": Most(lambda: make_linearize_kernel(finger(), False), REGISTERS, 296, 112_000),
    "library": Most(lambda: make_ask_kernel(nearest_kernel(1, turns=1), 6, 2, wp.float32), 56, TREE, 24_000),
    "line search": Most(line_search, REGISTERS, 336, 90_000),
}
