"""Random mechanisms, and random states near, at and far from contact, whose generator the test seeds; random
complementarity problems.
"""

import numpy as np
from oracle import Oracle

from slcp_warp import Actuator, Body, Contact, Scene, Shape

JOINTS = ("revolute", "prismatic", "free")


def random_tree(rng, bodies=3, joints=None, contacts=False):
    """A tree of bodies with every kind of offset; with `contacts`, ellipses and a tilted half-plane."""
    parts, names = [], []
    for i in range(bodies):
        joint = joints[i] if joints else rng.choice(JOINTS)
        dofs = {"revolute": 1, "prismatic": 1, "free": 3}[str(joint)]
        turn = rng.uniform(-np.pi, np.pi)
        parent = None if i == 0 else rng.choice([*names, None]) if joints is None else names[-1]
        parts.append(
            Body(f"body{i}", rng.uniform(0.3, 2.0), rng.uniform(0.05, 0.4), parent=parent, joint=str(joint),
                 anchor=tuple(rng.uniform(-0.6, 0.6, 2)), angle=rng.uniform(-1.5, 1.5),
                 axis=(np.cos(turn), np.sin(turn)), com=tuple(rng.uniform(-0.4, 0.4, 2)),
                 damping=tuple(rng.uniform(0.0, 0.5, dofs)))
        )  # fmt: skip
        names.append(f"body{i}")
    shapes, pairs = [], []
    if contacts:
        shapes = [Shape(f"shape{i}", name, "ellipse", tuple(rng.uniform(0.1, 0.5, 2)),
                        offset=tuple(rng.uniform(-0.3, 0.3, 2)), angle=rng.uniform(-1, 1))
                  for i, name in enumerate(names)]  # fmt: skip
        shapes.append(Shape("ground", None, "halfplane", offset=(0.1, -1.0), angle=rng.uniform(1.0, 2.0)))
        pairs = [Contact("ground", "shape0", 0.6), Contact(f"shape{bodies - 1}", "ground", None)]
        pairs += [Contact("shape0", f"shape{bodies - 1}", 0.3)] if bodies > 1 else []
    return Scene(
        f"tree{bodies}", tuple(parts), tuple(shapes), tuple(pairs),
        actuators=tuple(Actuator(name, gear=rng.uniform(-2, 2)) for name in names),
        gravity=(rng.uniform(-1, 1), -9.81), step_size=0.02,
    )  # fmt: skip


def near_contact(scene, rng, count, gaps=(0.0, 0.01, -0.01), speed=1.5, spread=0.5, **changes):
    """States (count, 2 nv) whose smallest contact gap is one of `gaps` (np.inf: left where it fell).

    A third of them start close to the scene's own initial state, where several pairs may touch at once.
    """
    oracle = Oracle(scene, **changes)
    nv, pairs = scene.nv, len(scene.structure.pairs)
    width = spread * rng.choice([1.0, 1.0, 0.02], (count, 1))
    q = scene.x0[:nv] + width * rng.standard_normal((count, nv))
    q = into_limits(scene, oracle, q, rng if spread else None)
    target = rng.choice(np.asarray(gaps, float), count)
    moved = np.isfinite(target) & (pairs > 0)
    for _ in range(25 if moved.any() else 0):
        found = [oracle.contact_jacobian(q[moved], k) for k in range(pairs)]
        nearest = np.argmin([gap for gap, _, _, _ in found], axis=0)
        gap = np.choose(nearest, [f[0] for f in found])
        row = np.choose(nearest[:, None], [f[1] for f in found])
        miss = (target[moved] - gap) / np.maximum(np.sum(row * row, -1), 1e-3)
        q[moved] += np.clip(miss, -0.3, 0.3)[:, None] * row
        q = into_limits(scene, oracle, q, None)
    return np.concatenate([q, speed * rng.standard_normal((count, nv))], axis=1)


def into_limits(scene, oracle, q, rng):
    """Angles outside their limits: drawn anew between them, or (without a generator) clipped."""
    s = scene.structure
    q = q.copy()
    for j in range(scene.nv):
        lo = oracle.p["lower"][j] if s.lower[j] else -np.inf
        up = oracle.p["upper"][j] if s.upper[j] else np.inf
        if rng is not None and np.isfinite(lo) and np.isfinite(up):
            q[:, j] = rng.uniform(lo, up, len(q))
        q[:, j] = np.clip(q[:, j], lo, up)
    return q


def problems(n, rank, count, seed=0):
    """Random feasible problems, (B, n, n) and (B, n)."""
    rng = np.random.default_rng(seed)
    g = rng.normal(size=(count, n, rank))
    a = g @ g.swapaxes(1, 2)
    b = np.einsum("bij,bj->bi", a, rng.normal(size=(count, n))) + 0.3 * np.abs(rng.normal(size=(count, n)))
    return a, b


def diagonal(a):
    return np.einsum("...ii->...i", a)
