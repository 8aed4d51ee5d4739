"""Hard contact with Coulomb's friction: the natural map by an independent oracle, and physics."""

import functools
import math

import numpy as np
import pytest
import warp as wp
from oracle import Oracle
from random_scenes import near_contact
from simulators import NUMPY, WIDTH, rounded, scene

import slcp_warp as slcp
from slcp_warp import scenes
from slcp_warp.scene import Body, Contact, Scene, Shape

COULOMB = slcp.Options(residual="hard", friction="coulomb")
G = 9.81
TOLERANCE = {wp.float64: 1e-11, wp.float32: 2e-5}


def wedge() -> Scene:
    """A disc with three points on it over coincident and opposed planes: redundant, and it may jam."""
    angles = (0.5, 0.5, 0.9, 0.1)  # outward normals, in units of pi: two that coincide and two walls
    planes = tuple(Shape(f"plane{i}", None, "halfplane", angle=math.pi * a) for i, a in enumerate(angles))
    body = Body("disc", 1.0, 0.02, joint="free")
    shapes = (Shape("disc", "disc", "disc", 0.2), Shape("foot", "disc", "disc", offset=(0.1, -0.2)))
    pairs = tuple(Contact(p.name, s.name, 0.5) for p in planes for s in shapes)
    return Scene("wedge", (body,), (*planes, *shapes), pairs, initial_state=(0.0, 0.3, 0.0, 0.0, 0.0, 0.0))


def rod() -> Scene:
    """Painleve's slender rod of length 2 and mass 1; its lower end slides on the ground."""
    return Scene(
        "rod",
        (Body("rod", 1.0, 1.0 / 3.0, joint="free"),),
        (Shape("end", "rod", "disc", offset=(-1.0, 0.0)), Shape("ground", None, "halfplane", angle=math.pi / 2)),
        (Contact("ground", "end", 1.0),),
    )


MAKERS = {"wedge": wedge, "rod": rod}


@functools.cache
def named(name):
    return MAKERS[name]() if name in MAKERS else scene(name)


@functools.cache
def simulator(name, device, dtype=wp.float64, options=COULOMB):
    return slcp.Simulator(named(name), options, device=device, dtype=WIDTH[dtype])


def natural_map(sc, dtype, x, u, step, **changes):
    """The worst violation of Coulomb's contact law in every world, relative to the size of its terms."""
    s = sc.structure
    numbers = {k: rounded(dtype, v)[0] for k, v in {**sc.default_parameters(), **changes}.items()}
    oracle = Oracle(sc, **numbers)
    x, u = rounded(dtype, x, u)
    q, v0 = x[:, : sc.nv], x[:, sc.nv :]
    v, lam = np.asarray(step.state, float)[:, sc.nv :], np.asarray(step.impulse, float)
    problem = oracle.problem(x, u)
    gaps, jac, _ = oracle.rows(q)
    contacts = [oracle.contact_jacobian(q, k) for k in range(len(s.pairs))]
    inverse, h = np.linalg.inv(problem["M"]), problem["h"][..., None]
    rows = np.zeros(jac.shape)
    rate = np.zeros(gaps.shape)
    for i, row in enumerate(s.rows):
        if row.kind == "limit" or row.sign == 0:
            rows[:, i], rate[:, i] = jac[:, i], gaps[:, i] / h[..., 0]
        else:
            rows[:, i] = contacts[row.index][1 if row.sign > 0 else 2]
            rate[:, i] = gaps[:, i] / h[..., 0] if row.sign > 0 else 0.0
    diag = np.maximum(np.einsum("bij,bjk,bik->bi", rows, inverse, rows), 1e-30)
    w = np.einsum("bij,bj->bi", rows, v) + rate
    size = np.abs(rate) + np.einsum("bij,bj->bi", np.abs(rows), np.abs(v0) + np.abs(problem["vfree"]))
    size = size.max(1) + 1e-12
    motion = np.einsum("bij,bj->bi", problem["M"], v) - problem["f"] - np.einsum("bij,bi->bj", rows, lam)
    fast = (np.abs(v) + np.abs(v0) + np.abs(problem["vfree"])).max(1) + 1e-12
    worst = np.abs(np.einsum("bij,bj->bi", inverse, motion)).max(1) / fast
    for i, row in enumerate(s.rows):
        a = diag[:, i] * lam[:, i]
        if row.kind == "limit" or row.sign >= 0:
            miss = np.abs(np.minimum(a, w[:, i]))
        else:
            mu = np.broadcast_to(oracle.p["friction"], (len(x), len(s.pairs)))[:, row.index]
            bound = diag[:, i] * mu * np.maximum(lam[:, i - 1], 0.0)
            miss = np.abs(a - np.clip(a - w[:, i], -bound, bound))
        worst = np.maximum(worst, miss / size)
    return worst
