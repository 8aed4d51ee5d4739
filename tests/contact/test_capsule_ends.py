"""Discs exactly by the ends of a capsule or of a rectangle's side, as the corners of equal boxes on each
other: there the point that is touched begins to wander with the normal, and the curvature of its distance
"""

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape

HALF, RADIUS, LINK = 0.04, 0.01, 0.3
THICK = 0.03  # half of a rectangle's height
KINDS = pytest.mark.parametrize("kind", ["capsule", "rectangle"])
STRATEGIES = pytest.mark.parametrize("strategy", ["generic", "specialised"])


def bench(turned, moved, kind="capsule"):
    """A sledge on two runners upon a bar of their distance that slides, at the origin or turned and far."""
    up = RADIUS if kind == "capsule" else THICK
    c, s = np.cos(turned), np.sin(turned)
    at = np.array([3.0, -2.0]) * (turned > 0.0)
    size = (RADIUS, HALF) if kind == "capsule" else (HALF + RADIUS, THICK)
    bar = Shape("bar", "bar", kind, size, corner_radius=0.0 if kind == "capsule" else RADIUS)
    runners = [
        Shape(name, "sledge", "disc", RADIUS, offset=(x, -RADIUS)) for name, x in (("l", -HALF), ("r", HALF))
    ]
    bodies = (Body("bar", 2.0, 1e-2, joint="free"), Body("sledge", 1.0, 1e-3, joint="free"))
    touches = tuple(Contact("bar", shape.name, 0.5) for shape in runners)
    above = at + np.array([[c, -s], [s, c]]) @ np.array([moved, up + 2.0 * RADIUS - 1e-4])
    fall = 0.05 * np.array([s, -c])
    start = (*at, turned, *above, turned, 0.0, 0.0, 0.0, *fall, 0.0)
    return Scene(
        "bench", bodies, (bar, *runners), touches, gravity=(0.0, 0.0), sigma=0.03, initial_state=start
    )


def simulator(scene, strategy, residual):
    return slcp.Simulator(scene, slcp.Options(residual), device="cpu", strategy=strategy)


@KINDS
@STRATEGIES
@pytest.mark.parametrize("residual", ["rem-logistic", "hard"])
@pytest.mark.parametrize("turned", [0.0, 0.7, 2.0])
def test_a_step_is_continuous_by_an_end(kind, strategy, residual, turned):
    """The lever of the other end was taken where a rounding told which one a normal points to: v' jumped."""
    sim = simulator(bench(turned, 0.0, kind), strategy, residual)
    ways = np.array([0.0, 1e-16, -1e-16, 3e-16, -3e-16, 1e-15, -1e-15, 1e-14, -1e-14, 1e-12, -1e-12, 1e-10])
    x = np.array([bench(turned, way, kind).x0 for way in ways])
    done = sim.step(x)
    assert (done.status == 0).all() and (done.impulse.sum(1) > 0.01).all()
    np.testing.assert_allclose(done.state, np.tile(done.state[-1], (len(x), 1)), atol=1e-6)


def central(sim, x, spacing):
    """dx'/dx by central differences."""
    there = sim.step(np.concatenate([x + spacing * np.eye(12), x - spacing * np.eye(12)])).state
    return (there[:12] - there[12:]).T / (2.0 * spacing)


@KINDS
@STRATEGIES
@pytest.mark.parametrize("turned", [0.0, 0.7])
def test_derivatives_by_an_end_are_those_of_differences(kind, strategy, turned):
    """One runner goes beyond its end where the other one comes beside the bar: the mean of both is exact."""
    own = bench(turned, 0.0, kind)
    sim = simulator(own, strategy, "rem-logistic")
    x = own.x0
    slopes = 2.0 * central(sim, x, 1e-7) - central(sim, x, 2e-7)  # what jumps in them is of first order
    A = sim.linearize(x[None]).A[0]
    size = np.abs(slopes).max()
    np.testing.assert_allclose(A, slopes, atol=1e-6 * size)
    weight = np.random.default_rng(0).standard_normal(12)
    states = np.zeros((1, 2, 12))
    states[0, 1] = weight
    pulled = slcp.vjp(sim, x[None], np.zeros((1, 1, 0)), states).x0[0]
    np.testing.assert_allclose(pulled, weight @ slopes, atol=1e-5 * size)


@pytest.mark.parametrize("residual", ["rem-logistic", "hard"])
def test_boxes_side_by_side_on_a_floor_do_not_feel_a_rounding(residual):
    """Their corners stand by the ends of each other's sides."""
    boxes = [
        part
        for name, high in (("a", 0.1), ("b", 0.08))
        for part in slcp.box(name, name, 0.1, high, corner_radius=0.01, sides=True)
    ]
    floor = Shape("floor", None, "halfplane", angle=np.pi / 2, contype=0)
    bodies = [Body(name, 0.3, 5e-4, joint="free") for name in "ab"]
    start = np.array([0.0, 0.05, 0.0, 0.1, 0.04, *([0.0] * 7)])
    own = Scene("two", tuple(bodies), (floor, *boxes), contacts="auto", friction=0.4, sigma=0.02,
                actuators=(slcp.Actuator("a", 0),), initial_state=tuple(start))  # fmt: skip
    sim = simulator(own, "generic", residual)
    x = start + np.outer([0.0, 1e-12, -1e-12, 1e-10], np.eye(12)[4])
    done = sim.step(x, np.full((4, 1), 2.6))
    assert (done.status == 0).all()
    np.testing.assert_allclose(done.state, np.tile(done.state[0], (4, 1)), atol=1e-7)
