"""Signals of measures that users write: the task's cost, functions of (x, u, time)."""

from typing import Any

import warp as wp

from ..device.compile import translate
from ..factories import cached


def make_price(cost: Any, VX: type, VU: type, dtype: type) -> Any:
    """price(weights, x, u, k, last): running cost of step k, final one after the last; None without cost."""
    if cost is None:
        return None
    running, final = cost.running, cost.final

    @wp.func
    def price(weights: wp.array2d(dtype=dtype), x: VX, u: VU, k: int, last: int):
        if last == 1:
            return wp.float64(final(weights, 0, x))
        return wp.float64(running(weights, 0, x, u, k))

    return price


@cached
def check_user(function: wp.Function, nx: int, nu: int, dtype: type) -> None:
    """An error where a function is no number of (x, u, time): it is translated on its own."""
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(max(nu, 1), dtype)

    def measured(x: VX, u: VU, out: wp.array(dtype=wp.float64)):
        out[0] = wp.float64(function(x, u, out[1]))

    translate(measured)


def chained(users: tuple[wp.Function, ...], VX: type, VU: type) -> wp.Function:
    """user(place, x, u, time): the value of the function at this place, in float64."""
    if not users:

        @wp.func
        def none(place: int, x: VX, u: VU, time: wp.float64):
            return wp.float64(0.0)

        return none
    before, own, place_of_own = chained(users[:-1], VX, VU), users[-1], len(users) - 1

    @wp.func
    def user(place: int, x: VX, u: VU, time: wp.float64):
        if place == wp.static(place_of_own):
            return wp.float64(own(x, u, time))
        return before(place, x, u, time)

    return user
