"""What a world brings to every function of its step: its numbers and the forces on its bodies."""

from types import SimpleNamespace

import warp as wp

from ..factories import cached


@cached
def make_world(dtype: type) -> SimpleNamespace:
    """The struct `World`, and functions that make one.

    at(params, external, index): a world of the batch; one row of params serves all worlds, external without
    rows means no forces. unpushed(world): the same without external forces.
    """

    @wp.struct
    class World:
        params: wp.array(dtype=dtype)  # its row of the parameter table, see `layout`
        external: wp.array(dtype=dtype)  # (3 nb,), force and torque (fx, fy, torque) at every body
        pushed: int  # 1: there are external forces

    @wp.func
    def at(params: wp.array2d(dtype=dtype), external: wp.array2d(dtype=dtype), index: int):
        out = World()
        out.params = params[wp.where(params.shape[0] == 1, 0, index)]
        if external.shape[0] > 0:
            out.external = external[index]
            out.pushed = 1
        return out

    @wp.func
    def unpushed(world: World):
        out = World()
        out.params = world.params
        return out

    return SimpleNamespace(World=World, at=at, unpushed=unpushed)
