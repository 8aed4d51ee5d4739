"""Gradient by the parameters of springs between points; notation of `springs.py`.

A spring adds G A to the scalar P.F1, A = a.P = Delta.V(P) with V(y) the velocity of its second point against
the first, and G(s, m; k, c, L) with s = |Delta|^2 + eps(L)^2, m = Delta.V(y), and a share of k.
"""

import warp as wp

from ..factories import cached
from ..mechanism.springs import make_spring
from ..structure import Structure, layout
from .places import make_places


@cached
def make_spring_gradient(s: Structure, index: int, dtype: type) -> wp.Function:
    """gradient(world, pose, y, P, share, grad).

    It adds the columns of spring `index` and of all joints above its points.
    """
    spring = make_spring(s, index, dtype)
    places = make_places(s, dtype)
    t = spring.types
    lay = layout(s)
    VQ = t.VQ
    ZERO, ONE, TWO, SHORT = dtype(0.0), dtype(1.0), dtype(2.0), spring.SHORT
    K, C, L = (lay.offset(f"spring_{n}") + index for n in ("stiffness", "damping", "length"))
    POINT = lay.offset("spring_point") + 4 * index
    add, add2 = places.add, places.add2
    chain_a, chain_b = (places.make_chain(body) for body in s.springs[index])

    @wp.func
    def gradient(world: t.World, pose: t.Pose, y: VQ, p: VQ, share: dtype, grad: wp.array(dtype=dtype)):
        e = wp.static(spring.span)(world, pose.frames, y, share)
        k = share * world.params[wp.static(K)]
        rest = world.params[wp.static(L)]
        root = wp.sqrt(e.inv)
        work = wp.dot(e.a, p)
        add(grad, wp.static(K), share * work * (ONE - rest * root))
        add(grad, wp.static(C), work * wp.dot(e.a, y) * e.inv)
        by_eps = TWO * e.g[1] * wp.static(spring.rounding)(rest)
        add(grad, wp.static(L), work * (by_eps * SHORT - k * root))
        along = e.g[0] * e.delta  # by V(P)
        across = (work * e.g[2]) * e.delta  # by V(y)
        shift = e.g[0] * (e.jb * p - e.ja * p)
        shift += work * (TWO * e.g[1] * e.delta + e.g[2] * (e.jb * y - e.ja * y))
        own = chain_a(world, pose, e.pa, e.ja, -shift, -along, p, -across, y, ZERO, grad)
        add2(grad, wp.static(POINT), own)
        own = chain_b(world, pose, e.pb, e.jb, shift, along, p, across, y, ZERO, grad)
        add2(grad, wp.static(POINT + 2), own)

    return gradient
