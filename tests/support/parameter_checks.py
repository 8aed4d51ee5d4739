"""Derivatives of a step by every number of its scene against differences, in float64."""

import dataclasses

import numpy as np
from differences import differences
from random_scenes import near_contact

import slcp_warp as slcp
from slcp_warp import Actuator, Body, Contact, Scene, Shape, Spring

SHIFTS = {1: 0.75, 2: -0.15, 3: 1.0 / 60.0}  # sixth-order central difference
WIDTHS = (1e-3, 1e-4, 1e-5)  # of the differences; the best one counts, state by state
RELATIVE = 1e-6


def alike(scene, name, at):
    """Entries of a parameter that can only change together with this one: both of a disc's radius."""
    if name == "radius" and scene.shapes[at[0]].kind in ("disc", "ring"):
        return {(at[0], 0), (at[0], 1)}
    return {at}


def acts(scene, name, row):
    """Whether a number may be changed at all: of limits, springs and friction, those that the scene has."""
    s = scene.structure
    has = {"lower": s.lower, "upper": s.upper, "friction": [pair.friction for pair in s.pairs],
           "shape_angle": [shape.turned for shape in s.shapes]}  # fmt: skip
    has |= dict.fromkeys(("stiffness", "rest"), [j in s.sprung for j in range(s.nv)])
    has["corner_radius"] = [shape.kind == "rectangle" for shape in s.shapes]
    has["restitution"] = [pair.restitution for pair in s.pairs]
    has["surface_ratio"] = [shape.driver >= 0 for shape in s.shapes]
    has["armature"] = [j in s.armature for j in range(s.nv)]
    return name not in has or has[name][row]


def columns(sim, params):
    """(name, entries of it that change together, unit of the change) for every number that may change."""
    for name in sim.params.names:
        for at in np.ndindex(*sim.params.layout.shape(name)):
            if not acts(sim.scene, name, at[0] if at else 0):
                continue
            if name in ("friction", "radius") and not sim.params[name][at]:
                continue  # a pair with a friction of 0, a half-plane
            if name.endswith("covariance"):
                if at[0] <= at[1]:
                    yield name, {at, at[::-1]}, params[name].max()
            else:
                together = alike(sim.scene, name, at)
                if at == min(together):
                    yield name, together, 1.0


def errors(sim, x, u, params, force, modes):
    """Exact derivatives of sum(weight * x') of one step by every column against differences: {(name, at):
    (B,) error relative to the largest derivative by that parameter, or to 1e-3 of its unit}; NaN where the
    contact modes (B, ...) change within the shortest difference's reach.
    """
    worlds = len(x)
    weight = np.zeros((worlds, 2, sim.nx))
    weight[:, 1] = np.random.default_rng(8).standard_normal((worlds, sim.nx))
    us = u[:, None]
    back = slcp.vjp(sim, x, us, weight, params, parameters=params.names, external_force=force)
    assert not back.status.any()
    here = modes(sim.rollout(x, us, params, external_force=force, record="impulse"), params)
    todo = list(columns(sim, params))
    best = {}
    for width in WIDTHS:
        points = [
            (name, at, sign * k * width * unit) for name, at, unit in todo for k in SHIFTS for sign in (-1, 1)
        ]
        tables = {name: np.tile(params[name], (len(points) * worlds,) + (1,) * params[name].ndim)
                  for name in params.names}  # fmt: skip
        for i, (name, at, change) in enumerate(points):
            for entry in at:
                tables[name][(slice(i * worlds, (i + 1) * worlds), *entry)] += change
        moved = params.replace(**tables)
        again = [np.tile(a, (len(points),) + (1,) * (a.ndim - 1)) for a in (x, us, force, weight)]
        traj = sim.rollout(*again[:2], moved, external_force=again[2], record="impulse")
        value = (traj.states * again[3]).sum((1, 2)).reshape(len(points), worlds)
        kept = (modes(traj, moved).reshape(len(points), *here.shape) == here).reshape(len(points), worlds, -1)
        kept = kept.all(2) & ~traj.status.reshape(len(points), worlds).astype(bool)
        shifts = np.array([sign * SHIFTS[k] for k in SHIFTS for sign in (-1, 1)]) / width
        for j, (name, at, unit) in enumerate(todo):
            own = slice(6 * j, 6 * j + 6)
            exact = sum(back.parameters[name][(slice(None), *entry)] for entry in at)
            error = np.where(kept[own].all(0), np.abs(shifts @ value[own] / unit - exact), np.nan)
            best[name, min(at)] = np.fmin(best.get((name, min(at)), np.nan), error)
    for name in ("lower", "upper", "stiffness", "rest", "friction"):
        for row in range(sim.params.layout.shape(name)[0] if name in sim.params.names else 0):
            assert acts(sim.scene, name, row) or not back.parameters[name][:, row].any(), (name, row)
    out = {}
    for name, at, unit in todo:
        largest = np.abs(back.parameters[name]).reshape(worlds, -1).max(1)
        out[name, min(at)] = best[name, min(at)] / np.maximum(largest, 1e-3 / unit)
    return out


def check(found):
    for key, error in found.items():
        assert np.isfinite(error).mean() > 0.8, key
        assert np.nanmax(error) < RELATIVE, (key, error)


def check_jacobians(sim, x, u):
    """A against differences, and adjoints of random weights of x' against A."""
    A, exact = sim.linearize(x, u).A, differences(lambda x, u: sim.step(x, u).state, x, u)[..., : sim.nx]
    error = np.abs(A - exact).max(axis=(1, 2)) / np.abs(exact).max(axis=(1, 2))
    assert error.max() < 1e-6, error
    weight = np.zeros((len(x), 2, sim.nx))
    weight[:, 1] = np.random.default_rng(0).standard_normal((len(x), sim.nx))
    back = slcp.vjp(sim, x, u[:, None], weight).x0
    np.testing.assert_allclose(back, np.einsum("bij,bi->bj", A, weight[:, 1]), rtol=1e-9, atol=1e-9)


def smooth(traj, params):
    """Without kinks."""
    return np.zeros(len(traj.states), int)


def states(sc, count, speed=1.5):
    rng = np.random.default_rng(4)
    x = near_contact(sc, rng, count, gaps=(0.0, 0.005, -0.02, np.inf), spread=0.3, speed=speed)
    return x, rng.standard_normal((count, sc.nu)), rng.standard_normal((count, sc.structure.nb, 3))


def crane():
    """An arm on a cart, with a capsule and a plane, under a hinged capsule with a disc; springs."""
    shapes = (
        Shape("bar", "arm", "capsule", (0.1, 0.5), offset=(0.5, 0.05), angle=0.2),
        Shape("plate", "arm", "halfplane", offset=(0.0, -0.6), angle=1.3),
        Shape("pill", "pill", "capsule", (0.15, 0.3), offset=(0.05, 0.0), angle=-0.4),
        Shape("ball", "pill", "disc", 0.2, offset=(0.05, 0.92)),
    )
    bodies = (
        Body("cart", 1.0, 0.1, joint="prismatic", axis=(0.8, 0.6), com=(0.1, 0.2), angle=0.2),
        Body("arm", 2.0, 0.5, parent="cart", anchor=(0.1, 0.05), damping=0.3, armature=0.2),
        Body("pill", 1.0, 0.1, anchor=(0.6, 0.45), com=(0.0, 0.1), lower=-0.2),
    )
    springs = (
        Spring("arm", "pill", (0.4, -0.1), (0.1, 0.2), stiffness=20.0, damping=1.5, length=0.5),
        Spring(None, "arm", (-0.5, 0.8), (0.3, 0.3), stiffness=8.0, damping=0.7, length=0.3),
    )
    contacts = (Contact("pill", "plate"), Contact("ball", "bar", 0.4))
    return Scene("crane", bodies, shapes, contacts, springs=springs, step_size=0.02)


def jib():
    """`crane` with rectangles in place of its capsules, the plate at a corner."""
    base = crane()
    bar, plate, pill, ball = base.shapes
    bar = dataclasses.replace(bar, kind="rectangle", radius=(0.5, 0.1), corner_radius=0.03)
    block = dataclasses.replace(pill, kind="rectangle", radius=(0.4, 0.15), corner_radius=0.06)
    shapes = (bar, dataclasses.replace(plate, offset=(0.0, -0.5)), block, ball)
    return dataclasses.replace(base, name="jib", shapes=shapes)


def hub():
    """`crane` with a ring in place of the bar, which the pill's ends and the disc are in."""
    base = crane()
    ring = Shape("bar", "arm", "ring", 0.75, offset=(0.35, 0.5), angle=0.2)
    pill = dataclasses.replace(base.shapes[2], offset=(-0.2, 0.1))
    ball = dataclasses.replace(base.shapes[3], offset=(0.1, 0.35))
    return dataclasses.replace(base, name="hub", shapes=(ring, pill, ball),
                               contacts=(Contact("pill", "bar"), Contact("ball", "bar", 0.4)))  # fmt: skip


def trampoline():
    """`jib` whose contacts give back most of the speed that they are met with."""
    base = jib()
    contacts = tuple(dataclasses.replace(each, restitution=0.7) for each in base.contacts)
    return dataclasses.replace(base, name="trampoline", contacts=contacts)


def lever():
    """`crane` without its capsules, the disc on the plate, a motor."""
    base = crane()
    shapes = tuple(shape for shape in base.shapes if shape.name in ("plate", "ball"))
    return dataclasses.replace(base, name="lever", shapes=shapes, contacts=(Contact("ball", "plate", 0.4),),
                               actuators=(Actuator("arm", gear=2.0),))  # fmt: skip
