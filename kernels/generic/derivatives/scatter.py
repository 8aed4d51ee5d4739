"""Numbers of no pattern, by which derivatives look for what depends on what."""

import warp as wp

from ..work import WORK

GOLDEN = WORK(0.6180339887498949)  # whose multiples' fractional parts never repeat
HALF = WORK(0.5)


@wp.func
def scattered(i: int):
    """The i-th, of -1/2 to 1/2; i >= 0."""
    x = GOLDEN * WORK(i + 1)
    return x - wp.floor(x) - HALF
