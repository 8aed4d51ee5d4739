"""The rule of the nearest neighbour, over a library of states with controls and gains."""

from functools import partial

import warp as wp

from ..factories import cached
from .contract import PolicyFunctions, PolicyKernel
from .pieces import make_hold, make_wrap

# branches that wait in a search: one a level, of trees of less than 2^(this + 1) nodes
STACKS = (12, 32)


@cached
def make_nearest(stack: int, nx: int, nu: int, dtype: type) -> PolicyFunctions:
    """The nearest-neighbour rule (20), (M37).

    Points y = W x_j are stored as a balanced k-d tree in one array: the node of a range is its middle, its
    split dimension stands beside it. Entries with a periodic component are stored with their images within
    half a period of [0, period), so that the search needs no wrapping. The search is exact.
    """
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(max(nu, 1), dtype)
    VI, VD = wp.types.vector(stack, wp.int32), wp.types.vector(stack, dtype)
    ZERO = dtype(0.0)
    FAR = dtype(1e30)
    wrapped, held = make_wrap(dtype), make_hold(dtype)

    @wp.struct
    class Nearest:
        us: wp.array2d(dtype=dtype)  # (L, nu)
        xs: wp.array2d(dtype=dtype)  # (L, nx)
        gain: wp.array3d(dtype=dtype)  # (L, nu, nx)
        nodes: wp.array2d(dtype=dtype)  # (T, nx) tree of W x_j and its images
        split: wp.array(dtype=wp.int32)  # (T,) dimension that a node splits
        entry: wp.array(dtype=wp.int32)  # (T,) entry of a node
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
    def nearest(policy: Nearest, x: VX):
        """Index of the nearest entry."""
        y = whitened(policy, x)
        low = VI()
        high = VI()
        gap = VD()
        high[0] = policy.nodes.shape[0]
        depth = int(1)
        best = int(0)
        least = ZERO + FAR
        while depth > 0:
            depth -= 1
            if gap[depth] < least:
                a = low[depth]
                b = high[depth]
                while a < b:
                    m = (a + b) / 2
                    distance = ZERO
                    for i in range(wp.static(nx)):
                        delta = y[i] - policy.nodes[m, i]
                        distance += delta * delta
                    if distance < least:
                        least = distance
                        best = m
                    k = policy.split[m]
                    across = y[k] - policy.nodes[m, k]
                    far_low = wp.where(across < ZERO, m + 1, a)
                    far_high = wp.where(across < ZERO, b, m)
                    a = wp.where(across < ZERO, a, m + 1)
                    b = wp.where(across < ZERO, m, b)
                    if across * across < least and far_low < far_high:
                        low[depth] = far_low
                        high[depth] = far_high
                        gap[depth] = across * across
                        depth += 1
        return policy.entry[best]

    @wp.func
    def control(policy: Nearest, world: int, k: int, x: VX):
        e = nearest(policy, x)
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


def nearest_kernel(nodes: int) -> PolicyKernel:
    """The rule's kernel for a tree of so many nodes: a level fewer than the tree has wait at once."""
    return NEAREST if nodes.bit_length() - 1 <= STACKS[0] else DEEP
