"""Groups of rows that nothing couples: what is fast in one is no measure of another."""

import math

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape
from slcp_warp.kernels.step.groups import blocks_of_rows

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
