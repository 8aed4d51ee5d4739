"""Steps so short that what moves in one is near the rounding of lengths in single precision."""

import numpy as np
import pytest
import wedge

import slcp_warp as slcp

COULOMB = slcp.Options(residual="hard", friction="coulomb")


@pytest.mark.parametrize("step_size, speed", [(1e-3, 0.01), (1e-4, 0.01), (1e-5, 0.01), (1e-5, 1.0)])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("strategy", ["specialised", "generic"])
def test_the_law_holds_on_the_scale_of_the_data(step_size, speed, dtype, strategy):
    """Of a disc between a wedge, a wall and the floor, whose gaps are of the size of h v, as float32 has
    them: w of 4e-7 m / h was let pass, a third of the speeds, SOLVED.
    """
    sim = slcp.Simulator(wedge.SCENE, COULOMB, device="cpu", dtype=dtype, strategy=strategy)
    x = wedge.states(np.random.default_rng(0), 200, step_size, speed).astype(np.float32).astype(float)
    step = sim.step(x, np.zeros((200, 0)), sim.params.replace(step_size=step_size))
    v, impulse, gap = (np.asarray(a, float) for a in (step.state[:, 4:], step.impulse, step.gap))
    assert (step.status == slcp.Status.SOLVED).all()
    assert wedge.violation(x, v, impulse, gap, step_size).max() < 1e-4


def test_what_enters_by_more_than_a_rounding_is_jammed():
    """A foot on a guide that friction holds: in double precision none has a solution, in single precision
    those that are less than 4e-7 m inside rest there, and their velocities do not enter.
    """
    angle, speed, h = 0.2, 0.1, 1e-3
    body = slcp.Body("foot", 1.0, 1.0, joint="prismatic", axis=(np.cos(angle), np.sin(angle)))
    shapes = (
        slcp.Shape("ground", None, "halfplane", angle=np.pi / 2),
        slcp.Shape("tip", "foot", "disc", 0.1),
    )
    scene = slcp.Scene("guide", (body,), shapes, (slcp.Contact("ground", "tip", 0.5),))
    rng = np.random.default_rng(0)
    x = np.stack(
        [(0.1 - h * speed * rng.uniform(0, 0.3, 200)) / np.sin(angle), -speed * rng.uniform(0.1, 1, 200)], 1
    )
    for dtype in ("float64", "float32"):
        sim = slcp.Simulator(scene, COULOMB, device="cpu", dtype=dtype, strategy="specialised")
        step = sim.step(x, np.zeros((200, 0)), sim.params.replace(step_size=h))
        solved = step.status == slcp.Status.SOLVED
        assert set(step.status[~solved].tolist()) == {int(slcp.Status.JAMMED)}
        assert (step.gap[solved, 0] > -4e-7).all() and solved.sum() < 10
        assert (np.sin(angle) * step.state[solved, 1] > -1e-5 * speed).all()
