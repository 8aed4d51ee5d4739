"""A pass of an adjoint step over the tree: twists to the leaves, what bodies weigh, slopes to the roots."""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...generic.topology import Topology
from ...generic.work import WORK, Slot
from .motion import make_motion
from .room import ROW, View


@cached
def make_passes(given: type, graded: bool) -> SimpleNamespace:
    """rise(t, k, w): twists of all rates but a row's, no slopes yet. bodies(t, k, w, share, whole, external,
    world), of Coriolis forces and of all else. fall(t, k, w). turn(t, k, w, share): all three, of Coriolis
    forces alone: adds slopes by q, and to w.by_v those by the rates that are in the place of v.
    """
    motion = make_motion(given, graded)
    move = motion.twists

    @wp.func(inline=False)
    def rise(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View]):
        sets = int(wp.static(ROW))  # a number that is not unrolled
        for i in range(t.nb):
            for set in range(sets):
                move.advance(t, k, w, set, i)
                w.by_twist[set * t.nb + i] = wp.vec3d()
            move.accelerate(t, k, w, i)
            w.by_acceleration[i] = wp.vec2d()
            w.by_frame[i] = wp.vec3d()
            w.by_arm[i] = wp.vec2d()

    @wp.func(inline=False)
    def fall(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View]):
        sets = int(wp.static(ROW))
        for back in range(t.nb):
            i = t.nb - 1 - back
            for set in range(sets):
                move.pull(t, k, w, set, i)
            move.settle(t, k, w, i)

    @wp.func
    def bodies(
        t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], share: WORK, whole: WORK,
        external: wp.array2d(dtype=given), world: int,
    ):  # fmt: skip
        for i in range(t.nb):
            force = wp.vec3d()
            if external.shape[0] > 0:
                for n in range(3):
                    force[n] = WORK(external[world, 3 * i + n])
            motion.body(t, k, w, i, force, share, whole)

    @wp.func(inline=False)
    def turn(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], share: WORK):
        rise(t, k, w)
        for i in range(t.nb):
            motion.body(t, k, w, i, wp.vec3d(), share, WORK(0.0))
        fall(t, k, w)

    return SimpleNamespace(motion=motion, rise=rise, bodies=bodies, fall=fall, turn=turn)
