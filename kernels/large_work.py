"""Workspace of the kernels for large scenes: everything a world needs between two loops, in global memory."""

import functools
from typing import Any

import warp as wp

from .large_topology import tables
from .structure import Structure


@functools.cache
def make_work(dtype: type) -> Any:
    """Struct of workspaces, indexed [item, slot]; a world has a slot of its own while it is stepped."""

    @wp.struct
    class Work:
        q: wp.array2d(dtype=dtype)  # (nv) by dof
        v0: wp.array2d(dtype=dtype)  # (nv) by dof, v before the step
        frame: wp.array2d(dtype=dtype)  # (4 nb) cos, sin, x, y of every body
        angle: wp.array2d(dtype=dtype)  # (nb)
        column: wp.array2d(dtype=dtype)  # (2 nv) Jacobian of one centre of mass
        vfree: wp.array2d(dtype=dtype)  # (nv), this and what follows by place
        v: wp.array2d(dtype=dtype)  # v'
        best_v: wp.array2d(dtype=dtype)
        balance: wp.array2d(dtype=dtype)  # M (v' - v_free) - J' lambda
        move: wp.array2d(dtype=dtype)  # right hand sides and their solutions
        mass: wp.array2d(dtype=dtype)  # envelope of M
        mass_factor: wp.array2d(dtype=dtype)  # and of its factor, 1/L on the diagonal
        factor: wp.array2d(dtype=dtype)  # envelope of M + J' W J, then of its factor
        jac: wp.array2d(dtype=dtype)  # entries of J's rows
        gap: wp.array2d(dtype=dtype)  # (nr) d/h, this and what follows by row
        rate: wp.array2d(dtype=dtype)  # d/h, plus what Coulomb friction lifts it by
        scale: wp.array2d(dtype=dtype)  # D
        diag: wp.array2d(dtype=dtype)  # diag(A)
        z: wp.array2d(dtype=dtype)
        best_z: wp.array2d(dtype=dtype)
        lam: wp.array2d(dtype=dtype)
        a: wp.array2d(dtype=dtype)  # D lambda > 0
        w: wp.array2d(dtype=dtype)  # J v' + d/h > 0
        res: wp.array2d(dtype=dtype)  # J v' + d/h - w
        excess: wp.array2d(dtype=dtype)  # a w - m(a - w)
        p: wp.array2d(dtype=dtype)  # weight of dz in da
        slack: wp.array2d(dtype=dtype)  # weight of dz in -dw
        total: wp.array2d(dtype=dtype)  # what both were divided by
        dz: wp.array2d(dtype=dtype)
        normal: wp.array2d(dtype=dtype)  # (2 pairs) last normals
        lift: wp.array2d(dtype=dtype)  # (pairs) mu |J_t v'| of Coulomb friction, as the solver assumes it
        target: wp.array2d(dtype=dtype)  # and as it came out last
        miss: wp.array2d(dtype=dtype)  # difference of the two
        acting: wp.array2d(dtype=wp.int32)  # (nr) 1: the row is in the system
        active: wp.array2d(dtype=wp.int32)  # (nr) list of those rows
        known: wp.array2d(dtype=wp.int32)  # (pairs) 1: geometry and rows are computed

    return Work


def lengths(s: Structure) -> dict[str, int]:
    """Items of every workspace of a structure."""
    sizes = tables(s)[1]
    by_body = {"frame": 4 * s.nb, "angle": s.nb, "column": 2 * s.nv}
    matrices = {"mass": sizes.mass, "mass_factor": sizes.mass, "factor": sizes.matrix, "jac": sizes.entries}
    by_dof = dict.fromkeys(("q", "v0", "vfree", "v", "best_v", "balance", "move"), s.nv)
    rows = ("gap", "rate", "scale", "diag", "z", "best_z", "lam", "a", "w", "res", "excess", "p", "slack",
            "total", "dz", "acting", "active")  # fmt: skip
    pairs = {"normal": 2 * len(s.pairs)} | dict.fromkeys(("lift", "target", "miss", "known"), len(s.pairs))
    return by_body | by_dof | matrices | dict.fromkeys(rows, s.nr) | pairs


def allocate_work(s: Structure, dtype: type, slots: int, device: Any) -> Any:
    """Workspaces of `slots` worlds: neighbours in memory are worlds on a GPU, items on a CPU."""
    work = make_work(dtype)()
    for name, length in lengths(s).items():
        kind = wp.int32 if name in ("acting", "active", "known") else dtype
        if wp.get_device(device).is_cpu:
            array = wp.zeros((slots, length), dtype=kind, device=device).transpose()
        else:
            array = wp.zeros((length, slots), dtype=kind, device=device)
        setattr(work, name, array)
    return work


def bytes_per_world(s: Structure, dtype: type) -> int:
    """Memory of one slot."""
    return sum(lengths(s).values()) * (8 if dtype is wp.float64 else 4)
