"""Groups of rows that nothing couples: what is fast in one is no measure of another."""

import math

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape
from slcp_warp.kernels.step.groups import blocks_of_rows
from slcp_warp.scripts.benchmarks.fuzz.structures import baked
from slcp_warp.scripts.benchmarks.fuzz.tasks import Task

UP = {"joint": "prismatic", "axis": (0.0, 1.0), "lower": 0.0}


def tower_and_rocket() -> Scene:
    """Three sliders, each on the one before, all at their limits, and one apart from them."""
    bodies = (
        Body("low", 1.0, 0.1, **UP),
        Body("rocket", 1.0, 0.1, **UP),
        Body("middle", 3.0, 0.1, parent="low", **UP),
        Body("top", 2.0, 0.1, parent="middle", **UP),
    )
    return Scene("tower and rocket", bodies, step_size=0.01, sigma=0.01)


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
@pytest.mark.parametrize("residual", ["rem-logistic", "hard"])
def test_a_body_at_rest_keeps_its_digits_beside_a_fast_one(residual, strategy):
    """In float32 the tower's velocities were off by 2e-6 of the rocket's: at 10 km/s by .02 m/s, SOLVED."""
    rng = np.random.default_rng(0)
    x = np.zeros((60, 8))
    x[:, :4] = rng.uniform(0.0, 2e-4, (60, 4))
    x[:, 4] = rng.uniform(-0.1, 0.1, 60)
    x[:, 5] = -np.repeat([1.0, 1e3, 1e5], 20)
    x = x.astype(np.float32)
    done = {}
    for dtype, kernels in (("float32", strategy), ("float64", "generic")):
        options = slcp.Options(residual)
        sim = slcp.Simulator(tower_and_rocket(), options, device="cpu", dtype=dtype, strategy=kernels)
        done[dtype] = sim.step(x.astype(dtype))
    solved = done["float32"].status == slcp.Status.SOLVED
    assert solved.mean() > 0.95 and (done["float64"].status == slcp.Status.SOLVED).all()
    error = np.abs(done["float32"].state - done["float64"].state)[solved][:, [4, 6, 7]]
    assert error.max() < 2e-5 * 0.3  # of gravity, noise and speeds of the tower


def test_rows_are_coupled_by_trees_and_dampers():
    scene = tower_and_rocket()
    block, rows = blocks_of_rows(scene.structure)
    assert block[0] == block[2] == block[3] != block[1]
    assert [len(row) for row in rows] == [1] * 4 and len(set.union(*rows)) == 2
    tied = Scene("tied", scene.bodies, springs=(slcp.Spring("rocket", "top", damping=1.0),))
    assert len(set(blocks_of_rows(tied.structure)[0])) == 1
    disc = {"kind": "disc", "radius": 0.1}
    shapes = (Shape("a", "top", **disc), Shape("b", "rocket", **disc))
    touching = Scene("touching", scene.bodies, shapes, (Contact("a", "b", 0.5),))
    assert blocks_of_rows(touching.structure)[1][-1] == set(block)


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
def test_what_carries_both_bodies_of_a_contact_gets_nothing_of_its_impulse(strategy):
    """Two arms on one cart, pressed together against dampers of h c = 5e4 kg m^2: the cart stays at rest."""
    arm = {"parent": "cart", "damping": 5e6, "com": (0.0, 0.0)}
    cart = Body("cart", 1.0, 0.1, joint="prismatic", axis=(math.cos(0.7), math.sin(0.7)))
    bodies = (cart, Body("a", 1.0, 0.1, **arm), Body("b", 1.0, 0.1, anchor=(0.3, 0.2), **arm))
    shapes = (Shape("tip a", "a", "disc", 0.1, (0.17, 0.03)), Shape("tip b", "b", "disc", 0.1, (-0.13, 0.01)))
    scene = Scene("arms", bodies, shapes, (Contact("tip a", "tip b", 0.5),), gravity=(0.0, 0.0))
    options = slcp.Options("hard")
    sim = slcp.Simulator(scene, options, device="cpu", dtype="float64", strategy=strategy)
    rng = np.random.default_rng(0)
    x = np.zeros((50, 6))
    x[:, 1:3] = rng.uniform(-0.3, 0.3, (50, 2))
    done = sim.step(x)
    pressed = (done.status == slcp.Status.SOLVED) & (done.impulse.max(1) > 1e3)
    assert pressed.sum() > 20
    assert (done.state[pressed, 3] == 0.0).all()


def test_a_fast_row_that_touches_a_slow_one_is_not_its_measure():
    """A wedge of half a gram leaves at 17 km/s; over an open contact it is in one problem with a block of
    four tonnes at rest, whose limits were off by 2e-3 m/s and rad/s in float32, SOLVED: residuals, and a last
    step's curvature, counted beside the largest row. As one sees in float64.
    """
    task = Task(90019, 30, "specialised")
    one = task.worlds(2, task.make_scene()).part(35)
    scene = baked(task.make_scene(), {name: value[0] for name, value in one.numbers.items()})
    ((options, dtype),) = task.methods()
    assert options.integrator == "trapezoidal" and options.residual == "rem-normal"
    rng = np.random.default_rng(0)
    x = (one.x + 1e-3 * rng.uniform(-1.0, 1.0, (200, 10)) * (1.0 + np.abs(one.x))).astype(dtype)
    done = [
        slcp.Simulator(scene, options, device="cpu", dtype=kind, strategy="specialised").step(x.astype(kind))
        for kind in ("float32", "float64")
    ]
    solved = [step.status == slcp.Status.SOLVED for step in done]
    assert solved[1].all() and solved[0].mean() > 0.95
    assert np.abs(done[1].state[:, 5]).min() > 1e4  # the wedge
    error = np.abs(done[0].state - done[1].state)[solved[0]][:, 7:]
    assert error.max() < 2e-5 * 0.3  # of noise and speeds of the block


def sizes_by_row(w0, own, jac, inverse, diag, sigma):
    """What a row is relative to, in NumPy: its own terms, or what rows that shut, each stopped by itself, do
    to it. Shapes (B, rows), but for jac (rows, coordinates) and inverse masses (B, coordinates).
    """
    size, top = own.copy(), own.max(1, keepdims=True)
    reach = np.zeros_like(inverse)
    for _ in range(4):
        moved = reach @ np.abs(jac).T
        size = np.minimum(np.maximum(size, moved), top)
        shut = np.minimum(np.maximum(moved - w0, 0.0) + sigma, top)
        response = np.abs(jac)[None] * inverse[:, None]
        reach = np.maximum(reach, ((shut / diag)[:, :, None] * response).max(1))
    return size


@pytest.mark.parametrize("residual", ["rem-logistic", "hard"])
def test_rows_between_grams_and_tonnes_obey_the_law_on_their_own_scale(residual):
    """Three sliders on each other, 1e-4 to 1e4 kg at 1e-4 to 1e4 m/s: the law was missed by up to 7e-3 and
    6e-2 of what a row is relative to, SOLVED in float32, where the fastest row was the measure of all.
    """
    axis = {"joint": "prismatic", "axis": (0.0, 1.0)}
    names = ("low", "middle", "top")
    up, point = {"kind": "halfplane", "angle": math.pi / 2}, {"kind": "disc", "radius": 0.0}
    shapes = [Shape("floor", None, **up)]
    shapes += [Shape(f"{name} foot", name, **point) for name in names]
    shapes += [Shape(f"on {name}", name, **up) for name in names[:2]]
    contacts = [
        Contact(*pair) for pair in zip(("floor", "on low", "on middle"), (f"{n} foot" for n in names))
    ]
    bodies = tuple(Body(name, 1.0, 0.1, **axis) for name in names)
    scene = Scene("column", bodies, tuple(shapes), tuple(contacts), step_size=0.01, sigma=0.01)
    rng = np.random.default_rng(4)
    count, h, sigma = 6000, 0.01, 0.0 if residual == "hard" else 0.01
    mass = (10.0 ** rng.uniform(-4.0, 4.0, (count, 3))).astype(np.float32)
    gaps = np.where(rng.random((count, 3)) < 0.4, 0.0, 10.0 ** rng.uniform(-6.0, -1.0, (count, 3)))
    v = rng.choice([-1.0, 1.0], (count, 3)) * 10.0 ** rng.uniform(-4.0, 4.0, (count, 3))
    x = np.concatenate([np.cumsum(gaps, 1), v], 1).astype(np.float32)
    sim = slcp.Simulator(scene, slcp.Options(residual), device="cpu", dtype="float32", strategy="specialised")
    done = sim.step(x, None, sim.params.replace(mass=mass))
    solved = done.status == slcp.Status.SOLVED
    assert solved.mean() > 0.5
    jac = np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]])
    q, v, inverse = x[:, :3].astype(float), x[:, 3:].astype(float), 1.0 / mass.astype(float)
    free, rate = v - 9.81 * h, q @ jac.T / h
    diag, w0 = inverse @ (jac**2).T, rate + free @ jac.T
    own = np.abs(rate) + np.abs(free) @ np.abs(jac).T + np.abs(w0) + sigma
    size = sizes_by_row(w0, own, jac, inverse, diag, sigma)
    w = rate + done.state[:, 3:].astype(float) @ jac.T
    pressed = diag * done.impulse.astype(float)
    z = pressed - w
    law = np.maximum(z, 0.0)
    if sigma:
        law = law + sigma * np.log1p(np.exp(-np.abs(z) / sigma))
    rounding = 3e-7 * np.abs(q).max(1, keepdims=True) / h  # of gaps, which are differences of places
    missed = np.maximum(np.abs(pressed - law) - rounding, 0.0) / size
    assert missed[solved].max() < 1e-4
