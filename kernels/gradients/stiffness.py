"""Gradient by the parameters of h^2/2 P.K w, what implicit stiffness adds to the scalar of a step, (M50).

Notation of `mechanism/stiff_springs.py`: of a spring between points k (G V(P).V(w) + F (Delta.V(P))
(Delta.V(w))), V(y) the velocity of its second point against the first.
"""

from collections.abc import Callable

import warp as wp

from ..factories import cached
from ..mechanism.effective_mass import make_effective_mass
from ..mechanism.kinematics import make_types
from ..mechanism.stiff_springs import SHARE, make_stiff_spring
from ..specialisation import Specialisation
from ..structure import Structure, layout
from .places import make_places
from .tendons import make_tendon_gradient


@cached
def make_stiff_gradient(spec: Specialisation) -> Callable | None:
    """gradient(world, pose, P, w, grad): adds the derivative by every column; None where N has no K."""
    s, dtype, _ = spec
    mass = make_effective_mass(spec)
    if not mass.stiff_joints and not mass.stiff_springs and not mass.stiff_tendons:
        return None
    places = make_places(s, dtype)
    t = make_types(s, dtype)
    lay = layout(s)
    VQ, MQ = t.VQ, t.MQ
    H, STIFFNESS = lay.offset("step_size"), lay.offset("stiffness") if mass.stiff_joints else 0
    PART, ZERO, TWO = dtype(SHARE), dtype(0.0), dtype(2.0)
    add = places.add
    springs = tuple(make_stiff_spring_gradient(s, i, dtype) for i in range(len(mass.stiff_springs)))
    tendons = tuple(make_tendon_gradient(s, i, dtype) for i in range(len(mass.stiff_tendons)))

    @wp.func
    def gradient(world: t.World, pose: t.Pose, p: VQ, w: VQ, grad: wp.array(dtype=dtype)):
        h = world.params[wp.static(H)]
        share = PART * h * h
        for j in range(wp.static(s.nv)):
            if wp.static(j in mass.stiff_joints):
                if world.params[wp.static(STIFFNESS + j)] > ZERO:
                    add(grad, wp.static(STIFFNESS + j), share * p[j] * w[j])
        for i in range(wp.static(len(springs))):
            wp.static(springs[i])(world, pose, p, w, share, grad)
        for i in range(wp.static(len(tendons))):
            wp.static(tendons[i].stiffness)(world, p, w, share, grad)
        slope = wp.static(mass.stiff)(world, pose.frames, TWO * PART * h, MQ())
        add(grad, wp.static(H), wp.dot(p, slope * w))

    return gradient


@cached
def make_stiff_spring_gradient(s: Structure, index: int, dtype: type) -> wp.Function:
    """gradient(world, pose, P, y, share, grad): of share P.K y, by the columns of spring `index` and of all
    joints above its points.
    """
    stiff = make_stiff_spring(s, index, dtype)
    spring = stiff.spring
    places = make_places(s, dtype)
    t = spring.types
    lay = layout(s)
    VQ = t.VQ
    ZERO, ONE, TWO, SHORT = dtype(0.0), dtype(1.0), dtype(2.0), spring.SHORT
    K, L = (lay.offset(f"spring_{n}") + index for n in ("stiffness", "length"))
    POINT = lay.offset("spring_point") + 4 * index
    add, add2 = places.add, places.add2
    chain_a, chain_b = (places.make_chain(body) for body in s.springs[index])

    @wp.func
    def gradient(world: t.World, pose: t.Pose, p: VQ, y: VQ, given: dtype, grad: wp.array(dtype=dtype)):
        share = wp.where(world.params[wp.static(K)] > ZERO, given, ZERO)
        e = wp.static(spring.span)(world, pose.frames, VQ(), ZERO)
        rest = world.params[wp.static(L)]
        g = stiff.shares(e, rest)
        k = share * world.params[wp.static(K)]
        vp, vy = e.jb * p - e.ja * p, e.jb * y - e.ja * y
        ap, ay = wp.dot(e.delta, vp), wp.dot(e.delta, vy)
        both = wp.dot(vp, vy)
        add(grad, wp.static(K), share * (g[0] * both + g[1] * ap * ay))
        by_s = g[2] * both + g[3] * ap * ay
        by_rest = TWO * by_s * wp.static(spring.rounding)(rest) * SHORT
        root = wp.sqrt(e.inv)
        if rest * root < ONE:
            by_rest += root * (e.inv * ap * ay - both)
        add(grad, wp.static(L), k * by_rest)
        by_p = k * (g[0] * vy + (g[1] * ay) * e.delta)
        by_y = k * (g[0] * vp + (g[1] * ap) * e.delta)
        shift = k * (TWO * by_s * e.delta + g[1] * (ay * vp + ap * vy))
        own = chain_a(world, pose, e.pa, e.ja, -shift, -by_p, p, -by_y, y, ZERO, grad)
        add2(grad, wp.static(POINT), own)
        own = chain_b(world, pose, e.pb, e.jb, shift, by_p, p, by_y, y, ZERO, grad)
        add2(grad, wp.static(POINT + 2), own)

    return gradient
