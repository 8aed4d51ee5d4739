"""The worlds of a sweep: rows of numbers, each drawn by the world's number and its own address."""

import warp as wp

from ..device.compile import specialised
from ..device.random import make_normal, philox
from ..factories import cached
from .disturbances import CHOICE

LAWS = ("none", "log-normal", "normal", "uniform")
NONE, LOG_NORMAL, NORMAL, UNIFORM = range(len(LAWS))


@cached
def make_columns(dtype: type) -> type:
    """Struct of what the columns of a table are drawn from."""

    @wp.struct
    class Columns:
        seed: int
        base: wp.array2d(dtype=dtype)  # (M, C), one of these rows for each world
        law: wp.array(dtype=wp.int32)  # (C,) one of LAWS
        first: wp.array(dtype=dtype)  # (C,) standard deviation, of the logarithm or not; lower end
        second: wp.array(dtype=dtype)  # (C,) upper end
        most: wp.array(dtype=dtype)  # (C,) what no number exceeds
        step: wp.array(dtype=wp.int32)  # (C,) address of the random number beside seed and world
        stream: wp.array(dtype=wp.int32)

    return Columns


@cached
def make_draw_kernel(dtype: type) -> wp.Kernel:
    """Rows of worlds `world0 + i`."""
    rng = make_normal(dtype)
    Columns = make_columns(dtype)

    @specialised
    def draw_kernel(
        first: int,
        world0: int,
        d: Columns,
        pick: wp.array(dtype=wp.int32),  # (0 or B,) rows of the base; without: the first
        out: wp.array2d(dtype=dtype),  # (B, C)
    ):
        i = first + wp.tid()
        world = world0 + i
        row = int(0)
        if pick.shape[0] > 0:
            row = pick[i]
        for c in range(out.shape[1]):
            value = d.base[row, c]
            law = d.law[c]
            if law == wp.static(UNIFORM):
                at = rng.share(d.seed, world, d.step[c], d.stream[c])
                value = d.first[c] + (d.second[c] - d.first[c]) * dtype(at)
            elif law != wp.static(NONE):
                spread = d.first[c] * rng.normal(d.seed, world, d.step[c], d.stream[c])
                if law == wp.static(LOG_NORMAL):
                    value *= wp.exp(spread)
                else:
                    value += spread
            out[i, c] = wp.min(value, d.most[c])

    return draw_kernel


@specialised
def pick_kernel(first: int, world0: int, seed: int, starts: int, pick: wp.array(dtype=wp.int32)):
    """Which start worlds `world0 + i` begin near."""
    i = first + wp.tid()
    zero = wp.uint64(0)
    key = wp.uint64(seed) & wp.uint64(0xFFFFFFFF)
    word = philox(wp.uint64(world0 + i), zero, wp.uint64(wp.static(CHOICE)), zero, key, zero)
    pick[i] = int(word[0] % wp.uint64(starts))
