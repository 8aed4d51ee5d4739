"""The worlds of a sweep: parameters and a start for each, drawn by the world's number."""

import warp as wp

from ..device.compile import specialised
from ..device.random import make_normal, philox
from ..factories import cached
from ..structure import STEP_SIZE
from .disturbances import CHOICE, PARAMETER, START


@cached
def make_draws(dtype: type) -> type:
    """Struct of what worlds are drawn from."""

    @wp.struct
    class Draws:
        seed: int
        base: wp.array(dtype=dtype)  # (P,) parameters without a draw
        spread: wp.array(dtype=dtype)  # (P,) standard deviation of the logarithm
        group: wp.array(dtype=wp.int32)  # (P,) columns of one group share their random number
        starts: wp.array2d(dtype=dtype)  # (M, nx), one of them for each world
        deviation: wp.array(dtype=dtype)  # (nx,) of the start
        longest: dtype  # largest step size [s]
        in_order: int  # 1: world i begins at start i, 0: at one drawn

    return Draws


@cached
def make_draw_kernel(nx: int, dtype: type) -> wp.Kernel:
    """Parameter tables and initial states of worlds `world0 + i`."""
    rng = make_normal(dtype)
    Draws = make_draws(dtype)

    @specialised
    def draw_kernel(
        first: int,
        world0: int,
        d: Draws,
        params: wp.array2d(dtype=dtype),  # out (B, P)
        x0: wp.array2d(dtype=dtype),  # out (B, nx)
    ):
        i = first + wp.tid()
        world = world0 + i
        for c in range(d.base.shape[0]):
            value = d.base[c]
            if d.spread[c] > dtype(0.0):
                value *= wp.exp(d.spread[c] * rng.normals(d.seed, world, d.group[c], PARAMETER)[0])
            if c == STEP_SIZE:
                value = wp.min(value, d.longest)
            params[i, c] = value
        word = philox(
            wp.uint64(world),
            wp.uint64(0),
            wp.uint64(CHOICE),
            wp.uint64(0),
            wp.uint64(d.seed) & wp.uint64(0xFFFFFFFF),
            wp.uint64(0),
        )
        pick = int(word[0] % wp.uint64(d.starts.shape[0]))
        if d.in_order == 1:
            pick = world % d.starts.shape[0]
        for j in range(wp.static(nx)):
            x0[i, j] = d.starts[pick, j] + d.deviation[j] * rng.normals(d.seed, world, j, START)[0]

    return draw_kernel
