"""Terms of points of bodies: against frames and differences; a plan, a file, and what is refused."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from oracle import Oracle
from random_scenes import random_tree
from test_costs import evaluate

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.costs import Point, Term, centre_of_mass

KINDS = ("linear", "square", "cosine", "absolute", "above", "below")


def scenes():
    """Chains of every joint, with a free body and without."""
    kinds = (
        ("free", "revolute", "prismatic", "revolute"),
        ("prismatic", "revolute", "revolute"),
        ("revolute",) * 3,
    )
    return [random_tree(np.random.default_rng(4), len(joints), joints) for joints in kinds]


@functools.cache
def oracle_of(scene):
    return Oracle(scene)


def places(scene, point, q):
    """(..., 2) by the oracle's frames."""
    names = [body.name for body in scene.bodies]
    if point.of_mass:
        chosen = (point.body,) if isinstance(point.body, str) else point.body or names
        bodies = [scene.bodies[names.index(name)] for name in chosen]
        parts = [b.mass * places(scene, Point(b.name, b.com), q) for b in bodies]
        return sum(parts) / sum(b.mass for b in bodies)
    if point.body is None:
        return np.broadcast_to(point.at, (*q.shape[:-1], 2))
    return oracle_of(scene).point(q, names.index(point.body), np.array(point.at))


@pytest.mark.parametrize("scene", scenes(), ids=lambda s: "-".join(b.joint for b in s.bodies))
def test_values_and_derivatives(scene):
    rng = np.random.default_rng(5)
    tip, other = Point(scene.bodies[-1].name, (0.3, -0.2)), Point(scene.bodies[1].name, (0.1, 0.4))
    ground = Point(None, (0.7, -0.1))
    every, two = centre_of_mass(), centre_of_mass(scene.bodies[-1].name, scene.bodies[0].name)
    of = [(tip, None), (tip, other), (every, two), (ground, every)]
    group = [
        Term(kind, 0.5 + i, point=a, minus=b, axis=axis, target=0.1 * i, width=0.3)
        for i, kind in enumerate(KINDS) for (a, b), axis in zip(of, ("x", "y", None, None))
    ]  # fmt: skip
    group += [Term("square", 0.3, state=0, minus=1), Term("cosine", 0.2, state=2)]
    cost = slcp.costs.terms(scene, [*group, slcp.costs.effort(0.1)] if scene.nu else group, group[::-1])
    nx = 2 * scene.nv
    x = rng.normal(size=(3, 2, nx))
    us = np.zeros((3, 1, max(scene.nu, 1)))

    def value(x):
        """Of one node, in NumPy."""
        shapes = {
            "linear": lambda e, d: e, "square": lambda e, d: e * e, "cosine": lambda e, d: 1.0 - np.cos(e),
            "absolute": lambda e, d: np.sqrt(e * e + d * d) - d,
            "above": lambda e, d: np.maximum(e, 0.0) ** 2, "below": lambda e, d: np.minimum(e, 0.0) ** 2,
        }  # fmt: skip
        total = 0.0
        for term in group:
            if term.point is None:
                s = x[term.state] - (0.0 if term.minus is None else x[term.minus])
                total += term.weight * shapes[term.kind](s - term.target, term.width)
                continue
            p = places(scene, term.point, x[: scene.nv])
            p = p if term.minus is None else p - places(scene, term.minus, x[: scene.nv])
            for axis in (0, 1) if term.axis is None else (("x", "y").index(term.axis),):
                total += term.weight * shapes[term.kind](p[axis] - term.target, term.width)
        return total

    found = evaluate(cost, x, us, "cpu")
    h = 1e-4
    moved = x[:, None] + h * np.array([s * e for e in np.eye(nx) for s in (1, -1)])[None, :, None]
    near = evaluate(cost, moved.reshape(-1, 2, nx), np.repeat(us, 2 * nx, 0), "cpu")["lx"].reshape(
        3, nx, 2, 2, nx
    )
    bent = np.moveaxis(near[:, :, 0] - near[:, :, 1], 1, -1) / (2.0 * h)
    np.testing.assert_allclose(found["lxx"], bent, atol=1e-6 * (1.0 + np.abs(bent).max()))
    for b in range(3):
        for k in range(2):
            slope = gradient(value, x[b, k])
            np.testing.assert_allclose(found["lx"][b, k], slope, atol=1e-8 * (1.0 + np.abs(slope).max()))


def gradient(f, x, h=1e-4):
    """Sixth-order central differences."""
    out = np.zeros(len(x))
    for j in range(len(x)):
        for n, share in ((1, 0.75), (2, -0.15), (3, 1.0 / 60.0)):
            d = np.zeros(len(x))
            d[j] = n * h
            out[j] += share * (f(x + d) - f(x - d)) / h
    return out


def reaching_terms(tip):
    """Running and final ones."""
    rest = [Term("square", 1.0, state=name) for name in ("upper.vangle", "fore.vangle")]
    return [slcp.costs.effort(1e-4)], [Term("square", 500.0, point=tip, target=(0.3, 0.6)), *rest]


def reaching():
    """A finger of two links that is to touch a mark with its tip."""
    scene = slcp.Scene(
        "reaching",
        (slcp.Body("upper", 1.0, 0.05, com=(0.25, 0.0), damping=0.1),
         slcp.Body("fore", 0.5, 0.02, parent="upper", anchor=(0.5, 0.0), com=(0.2, 0.0), damping=0.1)),
        actuators=(slcp.Actuator("upper"), slcp.Actuator("fore")), gravity=(0.0, 0.0), step_size=0.02,
    )  # fmt: skip
    tip = Point("fore", (0.4, 0.0))
    cost = slcp.costs.terms(scene, *reaching_terms(tip))
    return slcp.Task(name="reach", scene=scene, cost=cost, horizon=40), tip


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_a_finger_reaches_a_mark(dtype):
    task, tip = reaching()
    sim = task.simulator(device="cpu", dtype=dtype)
    found = ddp.solve(ddp.problem_of(task, sim), task.start[0])
    assert found.status in (ddp.Status.CONVERGED, ddp.Status.SMALL_IMPROVEMENT)
    where = slcp.costs.position(task.scene, tip, found.xs)
    np.testing.assert_allclose(where[-1], [0.3, 0.6], atol=5e-3)
    np.testing.assert_allclose(where, places(task.scene, tip, found.xs[:, :2]), atol=1e-6)


def test_a_centre_of_mass_is_planned_for():
    """Where `slcp.momentum` says it is; to the mark that the arm can bring it to."""
    task, _ = reaching()
    mark = slcp.costs.position(task.scene, centre_of_mass(), np.array([0.7, 0.9, 0.0, 0.0]))
    rest = [Term("square", 1.0, state=name) for name in ("upper.vangle", "fore.vangle")]
    final = [Term("square", 500.0, point=centre_of_mass(), target=tuple(mark)), *rest]
    task = task.replace(cost=slcp.costs.terms(task.scene, [slcp.costs.effort(1e-4)], final))
    sim = task.simulator(device="cpu", dtype="float64")
    found = ddp.solve(ddp.problem_of(task, sim), task.start[0])
    assert found.status in (ddp.Status.CONVERGED, ddp.Status.SMALL_IMPROVEMENT)
    place = slcp.momentum(found.xs, sim.params).place
    np.testing.assert_allclose(place[-1], mark, atol=5e-3)
    np.testing.assert_allclose(slcp.costs.position(task.scene, centre_of_mass(), found.xs), place, atol=1e-12)


def test_a_cost_of_points_is_kept_in_a_file(tmp_path):
    task, _ = reaching()
    cost = slcp.costs.terms(
        task.scene,
        [Term("above", 2.0, point=Point("fore"), minus=Point("upper", (0.1, 0.2)), axis="y", target=0.1)],
        [
            Term("square", 3.0, point=Point("fore", (0.4, 0.0)), target=(0.3, 0.6)),
            Term("square", 3.0, point=Point(), minus=Point(None, (0.0, 0.2))),
            Term("absolute", 1.0, point=centre_of_mass(), minus=centre_of_mass("fore", "upper"), axis="y"),
        ],
    )
    path = tmp_path / "task.json"
    slcp.save_task(task.replace(cost=cost), path)
    again = slcp.load_task(path).cost
    np.testing.assert_array_equal(again.weights, cost.weights)
    assert again.points == cost.points and again.make is cost.make
    twice = again.with_weights(again.weights)
    assert twice.points == cost.points


def test_a_task_of_another_scene_has_its_lengths():
    """A tip of 1 m was planned as one of .4."""
    task, tip = reaching()
    bodies = task.scene.bodies
    longer = replace(task.scene, bodies=(bodies[0], replace(bodies[1], anchor=(1.0, 0.0))))
    other = task.replace(scene=longer)
    same = slcp.costs.terms(longer, *(reaching_terms(tip)))
    np.testing.assert_array_equal(other.cost.weights, same.weights)
    np.testing.assert_array_equal(other.replace(scene=task.scene).cost.weights, task.cost.weights)
    with pytest.raises(slcp.InputError, match="other joints or lengths than those of scene 'reaching'"):
        ddp.Problem(slcp.Simulator(longer), task.cost, 5)
    renamed = replace(task.scene, bodies=(bodies[0], replace(bodies[1], name="hand")), actuators=())
    with pytest.raises(slcp.InputError, match="Task.cost"):
        task.replace(scene=renamed)


@pytest.mark.parametrize("make, message", [
    (lambda s: Term("square", 1.0, point="tip"), "Term.point is .* costs.Point"),
    (lambda s: Term("square", 1.0), "one of them is needed"),
    (lambda s: Term("square", 1.0, state=0, point=Point("fore")), "one of them is needed"),
    (lambda s: Term("square", 1.0, state=0, axis="x"), "Term.axis is 'x' without a point"),
    (lambda s: Term("square", 1.0, state=0, minus=Point("fore")), "without a point that it is taken off"),
    (lambda s: Term("square", 1.0, point=Point("fore"), minus="upper.angle"), "Term.minus is .* costs.Point"),
    (lambda s: Term("square", 1.0, point=Point("fore"), axis="z"), "Term.axis is 'z'; 'x', 'y' or None"),
    (lambda s: Term("square", 1.0, point=Point("fore"), axis=np.zeros(2)), "Term.axis is"),
    (lambda s: Term("square", 1.0, point=Point("fore"), target=(1.0, 2.0, 3.0)), "Term.target has shape"),
    (lambda s: Term("square", 1.0, point=Point("fore"), axis="x", target=(1.0, 2.0)), "Term.target"),
    (lambda s: Point("fore", (1.0, np.nan)), "Point.at"),
    (lambda s: Point(3), "Point.body is 3; the name of a body or None"),
    (lambda s: Point(("fore", "upper")), "Point.body is .* the name of a body or None"),
    (lambda s: Point("fore", "tip"), "Point.at is 'tip'; .x, y., or 'centre of mass'"),
    (lambda s: centre_of_mass("fore", 1), "Point.body is .* names of bodies are needed"),
    (lambda s: centre_of_mass("fore", "fore"), "each body once"),
    (lambda s: slcp.costs.terms(s, [Term("square", 1.0, point=centre_of_mass("hand"))]), "is 'hand'"),
    (lambda s: slcp.costs.terms(s, [Term("square", 1.0, point=Point("hand"))]), "Point.body is 'hand'"),
    (lambda s: slcp.costs.position(s, Point("fore"), np.zeros(3)), r"states has shape \(3,\)"),
])  # fmt: skip
def test_what_is_no_point_is_refused(make, message):
    with pytest.raises(slcp.InputError, match=message):
        make(reaching()[0].scene)
