"""What second derivatives of the generic step keep of a world beside what its adjoint does."""

import math
from typing import Any

import warp as wp

from ...generic.work import WORK
from ...structure import Structure

ROWS_BY_DOF, ROWS_MORE = 32, 64  # as many rows as a slot has room for, where a scene has more


@wp.struct
class Curves:
    """Workspaces, (slots, items), n_s = 2 nv + nu."""

    move: wp.array3d(dtype=WORK)  # (nv, n_s) dv'/ds
    root: wp.array3d(dtype=WORK)  # (rows, n_s) dz/ds by the list of acting rows; of hard ones D dlambda/ds
    strength: wp.array2d(dtype=WORK)  # (rows) s(z) = D lambda, by the same list
    edge: wp.array2d(dtype=wp.int32)  # (rows) 1: of a pair at the end of a side, where slopes have a kink
    by_state: wp.array2d(dtype=WORK)  # (2 nv) differences of slopes of L
    by_move: wp.array2d(dtype=WORK)  # (nv)
    by_lead: wp.array2d(dtype=WORK)  # (nv) by what the leapfrog predicts
    lead: wp.array3d(dtype=WORK)  # (outputs, nv) slopes of an output by what the leapfrog predicts
    coriolis: wp.array3d(dtype=WORK)  # (nv, nv) second derivatives of these forces
    by_root: wp.array2d(dtype=WORK)  # (rows)
    cross: wp.array2d(dtype=WORK)  # (n_s)
    found: wp.array3d(dtype=WORK)  # (n_s, n_s)


def lengths(s: Structure) -> dict[str, tuple[int, ...]]:
    """Items of every array of a structure."""
    width = 2 * s.nv + s.nu
    most = min(s.nr, ROWS_BY_DOF * s.nv + ROWS_MORE)
    rows = {"root": (most, width), "strength": (most,), "edge": (most,), "by_root": (most,)}
    return rows | {
        "move": (s.nv, width),
        "by_state": (2 * s.nv,),
        "by_move": (s.nv,),
        "by_lead": (s.nv,),
        "coriolis": (s.nv, s.nv),
        "lead": (max(s.nv, 1), s.nv),
        "found": (width, width),
        "cross": (width,),
    }


def allocate_curves(s: Structure, slots: int, device: Any) -> Curves:
    """Workspaces of `slots` worlds."""
    out = Curves()
    for name, shape in lengths(s).items():
        kind = wp.int32 if name == "edge" else WORK
        setattr(out, name, wp.zeros((slots, *shape), dtype=kind, device=device))
    return out


def bytes_per_world(s: Structure) -> int:
    """Memory of one slot."""
    return 8 * sum(math.prod(shape) for shape in lengths(s).values())
