"""The rule of the nearest neighbour, over a library of states with controls and gains."""

from functools import partial

import warp as wp

from ..factories import cached
from .contract import PolicyFunctions, PolicyKernel
from .pieces import make_hold, make_wrap
from .tree import make_search, waiting

STACKS = (28, 56)  # children that wait in a search: of trees of at most 32,768 and of 1.3e8 points


@cached
def make_nearest(stack: int, nx: int, nu: int, dtype: type) -> PolicyFunctions:
    """The nearest-neighbour rule (20), (M37).

    Points y = W x_j stand in a tree, those of entries with a periodic component with their images within half
    a period of [0, period), so that the search needs no wrapping.
    """
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(max(nu, 1), dtype)
    ZERO = dtype(0.0)
    found = make_search(stack, nx, dtype)
    Tree, search = found.Tree, found.search
    wrapped, held = make_wrap(dtype), make_hold(dtype)

    @wp.struct
    class Nearest:
        us: wp.array2d(dtype=dtype)  # (L, nu)
        xs: wp.array2d(dtype=dtype)  # (L, nx)
        gain: wp.array3d(dtype=dtype)  # (L, nu, nx)
        tree: Tree  # of W x_j and its images
        whitening: wp.array2d(dtype=dtype)  # (nx, nx) W
        period: wp.array(dtype=dtype)  # (nx,)
        limit: dtype  # the feedback term K dx is clamped to +- limit
        lower: wp.array2d(dtype=dtype)  # (0 or L, nu) limits of the controls
        upper: wp.array2d(dtype=dtype)

    @wp.func
    def whitened(policy: Nearest, x: VX):
        """W x with periodic components taken into [0, period)."""
        turned = VX()
        for j in range(wp.static(nx)):
            turned[j] = x[j]
            if policy.period[j] > ZERO:
                turned[j] = x[j] - policy.period[j] * wp.floor(x[j] / policy.period[j])
        y = VX()
        for i in range(wp.static(nx)):
            value = ZERO
            for j in range(wp.static(nx)):
                value += policy.whitening[i, j] * turned[j]
            y[i] = value
        return y

    @wp.func
    def control(policy: Nearest, world: int, k: int, x: VX):
        e = search(policy.tree, whitened(policy, x))
        u = VU()
        for i in range(wp.static(nu)):
            value = ZERO
            for j in range(wp.static(nx)):
                value += policy.gain[e, i, j] * wrapped(x[j] - policy.xs[e, j], policy.period[j])
            u[i] = policy.us[e, i] + wp.clamp(value, -policy.limit, policy.limit)
            if policy.lower.shape[0] > 0:
                u[i] = held(u[i], policy.lower[e, i], policy.upper[e, i])
        return u

    return PolicyFunctions(Nearest, control)


NEAREST = PolicyKernel("nearest", partial(make_nearest, STACKS[0]), apart=True)
DEEP = PolicyKernel("nearest, deep", partial(make_nearest, STACKS[1]), apart=True)


def nearest_kernel(points: int) -> PolicyKernel:
    """The rule's kernel for a tree of so many points."""
    return NEAREST if waiting(points) <= STACKS[0] else DEEP
