"""The rule of the nearest neighbour, over a library of states with controls and gains."""

from functools import cache, partial

import warp as wp

from ..factories import cached
from .contract import PolicyFunctions, PolicyKernel
from .pieces import make_hold, make_wrap
from .tree import make_search, waiting

STACKS = (28, 56)  # children that wait in a search: of trees of at most 32,768 and of 1.3e8 points


@cached
def make_nearest(stack: int, timed: bool, turns: int, nx: int, nu: int, dtype: type) -> PolicyFunctions:
    """The nearest-neighbour rule (20), (M37); `timed`: among the entries of the step alone.

    Points y = W x_j stand in a tree, those of entries with periodic components, `turns` in number, with their
    images within half a period of [0, period), of which the one within half a period of x counts: the last
    `turns` rows of W are of periodic components alone. Where entries belong to steps of a run
    their step is one more coordinate, times `clock`, which is larger than what else can tell points apart:
    entries of other steps are farther than all of the same. A step without entries asks as the nearest step
    that has some (`due`), so that nothing of the distance between states is lost beside that of steps.
    """
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(max(nu, 1), dtype)
    VY = wp.types.vector(nx + int(timed), dtype)
    ZERO = dtype(0.0)
    SAME = dtype(1e-3)  # of a step: times that differ by less are the same
    found = make_search(stack, nx + int(timed), dtype, (turns, nx - turns))
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
        clock: dtype  # of one step of the entries; this and the next three are of timed entries
        rate: dtype  # steps of the entries in one that is made
        begin: dtype  # step of the entries at which a rollout begins
        due: wp.array(dtype=dtype)  # (steps) for every step the one whose entries act; the last one is held
        limit: dtype  # the feedback term K dx is clamped to +- limit
        lower: wp.array2d(dtype=dtype)  # (0 or L, nu) limits of the controls
        upper: wp.array2d(dtype=dtype)

    @wp.func
    def whitened(policy: Nearest, k: int, x: VX):
        """W x with periodic components taken into [0, period), and the step."""
        turned = VX()
        for j in range(wp.static(nx)):
            turned[j] = x[j]
            if policy.period[j] > ZERO:
                turned[j] = x[j] - policy.period[j] * wp.floor(x[j] / policy.period[j])
        y = VY()
        for i in range(wp.static(nx)):
            value = ZERO
            for j in range(wp.static(nx)):
                value += policy.whitening[i, j] * turned[j]
            y[i] = value
        if wp.static(timed):
            step = int(wp.floor(policy.begin + dtype(k) * policy.rate + SAME))
            y[wp.static(nx)] = policy.clock * policy.due[wp.clamp(step, 0, policy.due.shape[0] - 1)]
        return y

    @wp.func
    def control(policy: Nearest, world: int, k: int, x: VX):
        e = search(policy.tree, whitened(policy, k, x))
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


@cache
def _kernel(deep: bool, timed: bool, turns: int) -> PolicyKernel:
    name = "nearest" + timed * " in time" + deep * ", deep" + bool(turns) * f", {turns} periodic"
    return PolicyKernel(name, partial(make_nearest, STACKS[deep], timed, turns), apart=True)


def nearest_kernel(points: int, timed: bool = False, turns: int = 0) -> PolicyKernel:
    """The rule's kernel for a tree of so many points, of states with so many periodic components."""
    return _kernel(waiting(points) > STACKS[0], timed, turns)
