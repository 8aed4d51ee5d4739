"""Random numbers and states for many worlds of one scene.

All are exact in float32, so that both precisions see the same problem.

Classes of states: far (nothing touches), touching (bisected between far and deep), entering (touching, and
fast towards it), deep (centimetres inside, limits overrun), jammed (limits crossed, guides nearly along a
surface, deep).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from slcp_warp import Scene
from slcp_warp.description.kinematics import Array
from slcp_warp.description.topology import contact_ends

from ..mechanics.contact import gaps, touches
from ..mechanics.tree import Mechanics, worlds_of

Rng = np.random.Generator
CLASSES = ("far", "touching", "entering", "deep", "jammed")
CHUNK = 500  # worlds that are drawn at once: world i of a structure is always the same
COARSE = 48  # directions of distances while states are drawn
BISECTIONS, TRIES = 12, 9


@dataclass(frozen=True)
class Worlds:
    """Worlds of a scene: numbers by parameter name (B, ...), states (B, 2 nv), controls (B, nu), class (B,).

    A class is an index of CLASSES.
    """

    numbers: dict[str, Array]
    x: Array
    u: Array
    kind: Array

    def part(self, keep: Any) -> "Worlds":
        """Some of the worlds."""
        keep = np.atleast_1d(keep)
        return Worlds(worlds_of(self.numbers, keep), self.x[keep], self.u[keep], self.kind[keep])


def single(value: Any) -> Array:
    """Numbers rounded to float32."""
    return np.asarray(value, np.float32).astype(float)


def decades(rng: Rng, low: float, high: float, *shape: int) -> Array:
    """10 to the power of numbers between."""
    return 10.0 ** rng.uniform(low, high, shape)


def draw_numbers(rng: Rng, scene: Scene, worlds: int) -> dict[str, Array]:
    """Parameters of every world."""
    s, n = scene.structure, worlds
    nb, nv, ns, base = s.nb, s.nv, len(s.shapes), scene.default_parameters()

    def u(low: float, high: float, *shape: int) -> Array:
        return rng.uniform(low, high, (n, *shape))

    def often(chance: float, value: Array) -> Array:  # zero in the other worlds
        return np.where(rng.random((n,) + (1,) * (value.ndim - 1)) < chance, value, 0.0)

    wide = rng.random((n, 1)) < 0.4
    mass = np.where(wide, decades(rng, -4, 4, n, nb), u(0.3, 3.0, nb))
    h = decades(rng, -3, -1, n)
    turned = np.array([shape.turned for shape in s.shapes], float).reshape(ns)
    radius = u(0.04, 0.4, ns, 2)
    for i, shape in enumerate(s.shapes):
        if shape.kind == "disc":
            radius[:, i] = radius[:, i, :1] if base["radius"][i, 0] > 0.0 else 0.0
        elif shape.kind == "ring":
            radius[:, i] = u(0.45, 2.5, 1)  # what is in it is smaller
    cosine = u(-np.pi, np.pi, nb)
    most = 4.0 if getattr(scene, "implicit_damping", True) else 0.0  # of c h / m, decades
    stiff = mass[:, [b for b in s.dof_body]] / h[:, None] * decades(rng, -1, most, n, nv)
    damping = np.where(rng.random((n, 1)) < 0.3, stiff, often(0.6, u(0.0, 0.5, nv)))
    out: dict[str, Any] = {
        "step_size": h,
        "gravity": np.where(rng.random((n, 1)) < 0.6, [0.0, -9.81], often(0.5, u(-10.0, 10.0, 2))),
        "sigma": decades(rng, -4, -0.5, n, 1) * decades(rng, -0.3, 0.3, n, s.nr),
        "mass": mass,
        "inertia": mass * u(0.1, 0.5, nb) ** 2 * decades(rng, -1, 0, n, nb),
        "com": often(0.6, u(-0.3, 0.3, nb, 2)),
        "anchor": u(-0.6, 0.6, nb, 2),
        "angle": often(0.7, u(-3.0, 3.0, nb)),
        "axis": np.stack([np.cos(cosine), np.sin(cosine)], -1),
        "damping": damping,
        "lower": u(-1.0, -0.05, nv),
        "upper": u(0.05, 1.0, nv),
        "gear": u(-2.0, 2.0, s.nu),
        "friction": often(0.9, u(0.0, 2.0, len(s.pairs))),
        "radius": radius,
        "shape_offset": u(-0.3, 0.3, ns, 2),
        "shape_angle": (u(-3.1, 3.1, ns) + 0.01) * turned,
    }
    if s.sprung:
        out |= {"stiffness": decades(rng, -1, 4, n, nv), "rest": u(-0.5, 0.5, nv)}
        out["stiffness"] = stiffened(rng, scene, out["stiffness"], mass[:, list(s.dof_body)], h)
        out["stiffness"][:, [j for j in range(nv) if j not in s.sprung]] = 0.0
    if "corner_radius" in base:
        least = np.min(radius, -1) * np.array([shape.kind == "rectangle" for shape in s.shapes])
        out["corner_radius"] = least * u(0.02, 0.98, ns)
    if s.armature:
        out["armature"] = mass[:, list(s.dof_body)] * often(0.9, decades(rng, -4, 2, n, nv))
        out["armature"][:, [j for j in range(nv) if j not in s.armature]] = 0.0
    if s.springs:
        k = len(s.springs)
        out |= {"spring_stiffness": decades(rng, 0, 4, n, k), "spring_length": u(0.0, 0.8, k),
                "spring_damping": often(0.7, decades(rng, -2, 0.75 * most, n, k)),
                "spring_point": u(-0.5, 0.5, k, 2, 2)}  # fmt: skip
        tied = mass[:, [max(ends) for ends in s.springs]]
        out["spring_stiffness"] = stiffened(rng, scene, out["spring_stiffness"], tied, h)
    if s.tendons:
        out |= _tendons(rng, scene, mass, h, most)
    out |= _of_surfaces(rng, scene, n)
    _lay_guides(rng, scene, out, cosine)
    _alike(scene, out)
    return {name: single(value) for name, value in out.items()}


def _tendons(rng: Rng, scene: Scene, mass: Array, h: Array, most: float) -> dict[str, Array]:
    """Numbers of tendons."""
    tendons, n = scene.structure.tendons, len(h)
    k, m = len(tendons), sum(map(len, tendons))
    pulled = mass[:, [scene.structure.dof_body[dofs[-1]] for dofs in tendons]]
    slow = np.where(rng.random((n, 1)) < 0.7, decades(rng, -2, 0.75 * most, n, k), 0.0)
    limited = scene.structure.limited
    limits = {"tendon_force_limit": decades(rng, -2, 4, n, k) * pulled} if limited else {}
    if limited:
        uncertain = rng.random((n, 1)) < rng.choice([0.0, 0.5, 1.0])
        noise = np.where(uncertain, decades(rng, -3, 0.5, n, k), 0.0)
        limits["tendon_force_sigma"] = noise * limits["tendon_force_limit"]
    return limits | {
        "tendon_stiffness": stiffened(rng, scene, decades(rng, 0, 4, n, k), pulled, h),
        "tendon_damping": slow,
        "tendon_length": rng.uniform(-0.5, 0.5, (n, k)),
        "tendon_coefficient": rng.choice([-1.0, 1.0], (n, m)) * decades(rng, -1.5, 0.5, n, m),
    }


def _of_surfaces(rng: Rng, scene: Scene, worlds: int) -> dict[str, Array]:
    """How far surfaces run, zero of those that do not, and restitution, where a scene has such."""
    s, out = scene.structure, dict[str, Array]()
    if s.runs:
        size = worlds, len(s.shapes)
        ratio = rng.choice([-1.0, 1.0], size) * rng.uniform(0.1, 2.0, size)
        out["surface_ratio"] = np.where([shape.driver >= 0 for shape in s.shapes], ratio, 0.0)
    if s.bounces:
        out["restitution"] = _shares(rng, worlds, len(s.pairs))
    return out


def _shares(rng: Rng, *shape: int) -> Array:
    """Numbers from 0 to 1, in a fifth of the worlds (the first axis) these two alone."""
    whole = rng.choice([0.0, 1.0], shape)
    return np.where(rng.random((shape[0], 1)) < 0.2, whole, rng.uniform(0.0, 1.0, shape))


def _alike(scene: Scene, out: dict[str, Any]) -> None:
    """All pairs of a contact have one coefficient."""
    first = 0
    for contact in scene.all_contacts:
        pairs = range(first, first + len(contact_ends(scene.shapes, contact)))
        for name in ("friction", "restitution"):
            if name in out:
                has = getattr(contact, name) is not None
                out[name][:, pairs] = out[name][:, pairs[:1]] if has else 0.0
        first = pairs.stop


def stiffened(rng: Rng, scene: Scene, stiffness: Array, mass: Array, h: Array) -> Array:
    """Stiffnesses (B, n), in a third of the worlds with (h omega)^2 from .01 to 1e6 where that is stable.
    Drawn aside: what else a world is drawn as stays what it is.
    """
    (rng,) = rng.spawn(1)
    if not getattr(scene, "implicit_stiffness", True):
        return stiffness
    stiff = mass / h[:, None] ** 2 * decades(rng, -2, 6, *stiffness.shape)
    return np.where(rng.random((len(h), 1)) < 0.3, stiff, stiffness)


def _lay_guides(rng: Rng, scene: Scene, numbers: dict[str, Array], cosine: Array) -> None:
    """In a third of the worlds the grounds of the world lie nearly along the axis of the first slider."""
    sliders = [i for i, b in enumerate(scene.structure.bodies) if b.joint == "prismatic" and b.parent < 0]
    for i, shape in enumerate(scene.structure.shapes):
        if sliders and shape.kind == "halfplane" and shape.body < 0 and shape.turned:
            side = rng.choice([-1.0, 1.0], len(cosine))
            tilt = side * (np.pi / 2 + decades(rng, -3, -0.3, len(cosine)))
            here = rng.random(len(cosine)) < 0.35
            numbers["shape_angle"][here, i] = (cosine[:, sliders[0]] + tilt)[here]


def draw_worlds(rng: Rng, scene: Scene, worlds: int = CHUNK) -> Worlds:
    """Numbers, states and controls; world i is of class i modulo their number where the scene allows it."""
    s = scene.structure
    numbers = draw_numbers(rng, scene, worlds)
    kind = np.arange(worlds) % len(CLASSES)
    span = np.array([np.pi if j == "revolute" else 0.8 for j in s.dof_kind])
    lower, upper = (np.where(np.array(has), numbers[name], bound * np.inf)
                    for name, has, bound in (("lower", s.lower, -1.0), ("upper", s.upper, 1.0)))  # fmt: skip
    m = Mechanics(scene, numbers)

    def tried(wider: float = 1.0) -> Array:
        q = wider * span * rng.uniform(-1.0, 1.0, (worlds, s.nv))
        return np.clip(q, lower, upper)

    outside, inside = tried(), tried()
    if s.pairs:
        least = [gaps(m, q, COARSE).min(1) for q in (outside, inside)]
        for i in range(TRIES):
            q = tried(1.0 + 0.25 * i)  # free bodies may have to go far to be free of all
            gap = gaps(m, q, COARSE).min(1)
            freer, deeper = gap > least[0], (gap < least[1]) & (gap > -0.4)
            deeper |= least[1] < -0.4
            outside, inside = np.where(freer[:, None], q, outside), np.where(deeper[:, None], q, inside)
            least = [np.where(freer, gap, least[0]), np.where(deeper, gap, least[1])]
    target = np.where(rng.random(worlds) < 0.4, 0.0, rng.choice([-1.0, 1.0], worlds))
    target *= decades(rng, -6, -2, worlds)
    q = np.where((kind == 0)[:, None], outside, inside)
    near = np.flatnonzero((kind == 1) | (kind == 2))
    if s.pairs and len(near):
        q[near] = _bisected(
            Mechanics(scene, worlds_of(numbers, near)), outside[near], inside[near], target[near]
        )
    deep = np.flatnonzero(kind >= 3)
    over = rng.uniform(-0.2, 0.2, (len(deep), s.nv)) * (rng.random((len(deep), 1)) < 0.5)
    q[deep] += over
    at_limit = (kind[:, None] == 1) & (rng.random(q.shape) < 0.2)
    q = np.where(at_limit & np.isfinite(lower), lower, q)
    _cross_limits(rng, s, numbers, q, kind)
    v = rng.standard_normal((worlds, s.nv)) * decades(rng, -2, 1, worlds, 1)
    q, v = single(q), single(_towards(rng, Mechanics(scene, numbers), q, v, kind))
    u = single(rng.standard_normal((worlds, s.nu)) * decades(rng, -1, 3, worlds, 1))
    return Worlds(numbers, np.concatenate([q, v], 1), u, kind)


def _bisected(m: Mechanics, outside: Array, inside: Array, target: Array) -> Array:
    """Positions between two whose smallest distance is nearly the target."""
    lo, hi = np.zeros(len(outside)), np.ones(len(outside))
    for _ in range(BISECTIONS):
        mid = 0.5 * (lo + hi)
        free = gaps(m, outside + mid[:, None] * (inside - outside), COARSE).min(1) > target
        lo, hi = np.where(free, mid, lo), np.where(free, hi, mid)
    q = outside + lo[:, None] * (inside - outside)
    for _ in range(8):  # along the normal: the last digits, and what a straight line misses
        t = touches(m, q)
        k = t.gap.argmin(1)[:, None]
        row = np.take_along_axis(t.normal, k[..., None], 1)[:, 0]
        miss = target - np.take_along_axis(t.gap, k, 1)[:, 0]
        size = np.sum(row * row, -1)
        move = miss / np.where(size > 1e-4, size, np.inf)
        q = q + np.clip(move, -0.25, 0.25)[:, None] * row
    return q


def _cross_limits(rng: Rng, s: Any, numbers: dict[str, Array], q: Array, kind: Array) -> None:
    """In half of the jammed worlds some limits exclude each other, or all but do."""
    for j in range(s.nv):
        if s.lower[j] and s.upper[j]:
            here = (kind == 4) & (rng.random(len(q)) < 0.5)
            width = rng.choice([-1.0, -1.0, 0.0, 1.0], len(q)) * decades(rng, -6, -1, len(q))
            numbers["lower"][here, j] = single(q[here, j] - 0.5 * width[here])
            numbers["upper"][here, j] = single(q[here, j] + 0.5 * width[here])


def _towards(rng: Rng, m: Mechanics, q: Array, v: Array, kind: Array) -> Array:
    """Velocities, those of class entering turned towards the nearest pair and faster."""
    if not m.s.pairs:
        return v
    t = touches(m, q)
    row = np.take_along_axis(t.normal, t.gap.argmin(1)[:, None, None], 1)[:, 0]
    sign = np.where(np.sum(row * v, -1) > 0.0, -1.0, 1.0)
    fast = sign * decades(rng, 0, 1.5, len(v))
    return np.where((kind == 2)[:, None], v * fast[:, None], v)
