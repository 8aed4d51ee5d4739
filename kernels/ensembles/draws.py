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
        numbers: wp.array2d(dtype=dtype)  # (3, C): standard deviation, of the logarithm or not, or lower end;
        # upper end; what no number exceeds
        address: wp.array2d(dtype=wp.int32)  # (3, C): one of LAWS; step and stream of the random number

    return Columns


@cached
def make_draw_kernel(dtype: type) -> wp.Kernel:
    """Rows of worlds `world0 + i`, or of those that have numbers of their own."""
    rng = make_normal(dtype)
    Columns = make_columns(dtype)

    @specialised
    def draw_kernel(
        first: int,
        world0: int,
        number: wp.array(dtype=wp.int32),  # (0 or B,) of the worlds
        d: Columns,
        pick: wp.array(dtype=wp.int32),  # (0 or B,) rows of the base; without: the first
        out: wp.array2d(dtype=dtype),  # (B, C)
    ):
        i = first + wp.tid()
        world = world0 + i
        if number.shape[0] > 0:
            world = number[i]
        row = int(0)
        if pick.shape[0] > 0:
            row = pick[i]
        for c in range(out.shape[1]):
            value = d.base[row, c]
            law = d.address[0, c]
            if law == wp.static(UNIFORM):
                at = rng.share(d.seed, world, d.address[1, c], d.address[2, c])
                value = d.numbers[0, c] + (d.numbers[1, c] - d.numbers[0, c]) * dtype(at)
            elif law != wp.static(NONE):
                spread = d.numbers[0, c] * rng.normal(d.seed, world, d.address[1, c], d.address[2, c])
                if law == wp.static(LOG_NORMAL):
                    value *= wp.exp(spread)
                else:
                    value += spread
            out[i, c] = wp.min(value, d.numbers[2, c])

    return draw_kernel


@cached
def make_corners_kernel(dtype: type) -> wp.Kernel:
    """Keep column `columns[k, 0]` within the columns 1 and 2 beside it."""

    @specialised
    def corners_kernel(
        first: int,
        columns: wp.array2d(dtype=wp.int32),  # (R, 3)
        out: wp.array2d(dtype=dtype),  # (B, C)
    ):
        i = first + wp.tid()
        for k in range(columns.shape[0]):
            c = columns[k, 0]
            out[i, c] = wp.min(out[i, c], wp.min(out[i, columns[k, 1]], out[i, columns[k, 2]]))

    return corners_kernel


@cached
def make_follow_kernel(dtype: type) -> wp.Kernel:
    """Starts that go with parameters: what these are more than the scene's, times a factor, is added."""

    @specialised
    def follow_kernel(
        first: int,
        by: wp.array2d(dtype=wp.int32),  # (F, 2): component of the start, column of the parameters
        numbers: wp.array2d(dtype=dtype),  # (F, 2): factor, the scene's number
        params: wp.array2d(dtype=dtype),  # (B, P)
        x0: wp.array2d(dtype=dtype),  # (B, nx)
        out: wp.array2d(dtype=dtype),  # (B, nx)
    ):
        i = first + wp.tid()
        for j in range(out.shape[1]):
            out[i, j] = x0[i, j]
        for n in range(by.shape[0]):
            more = numbers[n, 0] * (params[i, by[n, 1]] - numbers[n, 1])
            out[i, by[n, 0]] = out[i, by[n, 0]] + more

    return follow_kernel


@specialised
def pick_kernel(
    first: int,
    world0: int,
    number: wp.array(dtype=wp.int32),  # (0 or B,)
    seed: int,
    starts: int,
    pick: wp.array(dtype=wp.int32),  # out (B,)
):
    """Which start worlds `world0 + i` begin near, or those that have numbers of their own."""
    i = first + wp.tid()
    world = world0 + i
    if number.shape[0] > 0:
        world = number[i]
    zero = wp.uint64(0)
    key = wp.uint64(seed) & wp.uint64(0xFFFFFFFF)
    word = philox(wp.uint64(world), zero, wp.uint64(wp.static(CHOICE)), zero, key, zero)
    pick[i] = int(word[0] % wp.uint64(starts))
