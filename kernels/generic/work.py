"""Workspace of the generic kernels: everything a world needs between two loops, in global memory.

The work is done in double precision whatever the precision of the states and parameters ("given"): a heap of
unequal masses needs it.
"""

from typing import Any

import warp as wp

from ..structure import Structure
from .topology import tables

WORK = wp.float64


@wp.struct
class Work:
    """Workspaces, indexed [item, slot]; a world has a slot of its own while it is stepped."""

    q: wp.array2d(dtype=WORK)  # (nv) by dof
    v0: wp.array2d(dtype=WORK)  # (nv) by dof, v before the step
    frame: wp.array2d(dtype=WORK)  # (4 nb) cos, sin, x, y of every body
    angle: wp.array2d(dtype=WORK)  # (nb)
    column: wp.array2d(dtype=WORK)  # (2 nv) Jacobian of one centre of mass
    vfree: wp.array2d(dtype=WORK)  # (nv), this and what follows by place
    v: wp.array2d(dtype=WORK)  # v'
    best_v: wp.array2d(dtype=WORK)
    balance: wp.array2d(dtype=WORK)  # M (v' - v_free) - J' lambda
    move: wp.array2d(dtype=WORK)  # right hand sides and their solutions
    most: wp.array2d(dtype=WORK)  # momentum that a step can exchange, as the data have it
    momentum: wp.array2d(dtype=WORK)  # in the data, by place
    lost: wp.array2d(dtype=WORK)  # rounding of M (v' - v_free)
    unseen: wp.array2d(dtype=WORK)  # what of it the rows do not see
    mass: wp.array2d(dtype=WORK)  # envelope of M
    mass_factor: wp.array2d(dtype=WORK)  # and of its factor, 1/L on the diagonal
    factor: wp.array2d(dtype=WORK)  # envelope of M + J' W J, then of its factor
    jac: wp.array2d(dtype=WORK)  # entries of J's rows
    gap: wp.array2d(dtype=WORK)  # (nr) d/h, this and what follows by row
    rate: wp.array2d(dtype=WORK)  # d/h, plus what Coulomb friction lifts it by
    scale: wp.array2d(dtype=WORK)  # D
    diag: wp.array2d(dtype=WORK)  # diag(A)
    alone: wp.array2d(dtype=WORK)  # impulse of the row if it were the only one
    own: wp.array2d(dtype=WORK)  # size of the terms that the data set of J v' + d/h
    unit: wp.array2d(dtype=WORK)  # the largest of these, its own or of a closing row of its island
    z: wp.array2d(dtype=WORK)
    best_z: wp.array2d(dtype=WORK)
    lam: wp.array2d(dtype=WORK)
    least: wp.array2d(dtype=WORK)  # lambda where rows yield
    a: wp.array2d(dtype=WORK)  # D lambda > 0
    w: wp.array2d(dtype=WORK)  # J v' + d/h > 0
    res: wp.array2d(dtype=WORK)  # J v' + d/h - w
    excess: wp.array2d(dtype=WORK)  # a w - m(a - w)
    p: wp.array2d(dtype=WORK)  # weight of dz in da
    slack: wp.array2d(dtype=WORK)  # weight of dz in -dw
    total: wp.array2d(dtype=WORK)  # what both were divided by
    dz: wp.array2d(dtype=WORK)
    normal: wp.array2d(dtype=WORK)  # (2 pairs) last normals
    lift: wp.array2d(dtype=WORK)  # (pairs) mu |J_t v'| of Coulomb friction, as the solver assumes it
    target: wp.array2d(dtype=WORK)  # and as it came out last
    miss: wp.array2d(dtype=WORK)  # difference of the two
    acting: wp.array2d(dtype=wp.int32)  # (nr) 1: the row is in the system
    active: wp.array2d(dtype=wp.int32)  # (nr) list of those rows
    island: wp.array2d(
        dtype=wp.int32
    )  # (nv) by first place of a block of M: the first that rows couple to it
    known: wp.array2d(dtype=wp.int32)  # (pairs) 1: geometry and rows are computed


def lengths(s: Structure) -> dict[str, int]:
    """Items of every workspace of a structure."""
    sizes = tables(s)[1]
    by_body = {"frame": 4 * s.nb, "angle": s.nb, "column": 2 * s.nv}
    matrices = {"mass": sizes.mass, "mass_factor": sizes.mass, "factor": sizes.matrix, "jac": sizes.entries}
    by_dof = ("q", "v0", "vfree", "v", "best_v", "balance", "move", "most", "lost", "unseen", "momentum",
              "island")  # fmt: skip
    rows = ("gap", "rate", "scale", "diag", "alone", "own", "unit", "z", "best_z", "lam", "least", "a", "w",
            "res", "excess", "p", "slack", "total", "dz", "acting", "active")  # fmt: skip
    pairs = {"normal": 2 * len(s.pairs)} | dict.fromkeys(("lift", "target", "miss", "known"), len(s.pairs))
    return by_body | dict.fromkeys(by_dof, s.nv) | matrices | dict.fromkeys(rows, s.nr) | pairs


def allocate_work(s: Structure, slots: int, device: Any) -> Work:
    """Workspaces of `slots` worlds: neighbours in memory are worlds on a GPU, items on a CPU."""
    work = Work()
    for name, length in lengths(s).items():
        kind = wp.int32 if name in ("acting", "active", "known", "island") else WORK
        if wp.get_device(device).is_cpu:
            array = wp.zeros((slots, length), dtype=kind, device=device).transpose()
        else:
            array = wp.zeros((length, slots), dtype=kind, device=device)
        setattr(work, name, array)
    return work


def bytes_per_world(s: Structure) -> int:
    """Memory of one slot."""
    return 8 * sum(lengths(s).values())
