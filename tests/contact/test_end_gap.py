"""Options(gap="end"): what is SOLVED is outside at the end of the step, by the oracle's distance there."""

import numpy as np
import pytest
from oracle import Oracle

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape

COULOMB = slcp.Options(residual="hard", friction="coulomb", gap="end")
INSIDE = {"float64": 1e-8, "float32": 1e-5}  # [m]; STEADY h, and the rounding of a position


def rail() -> Scene:
    """A capsule on a guide that lies along its own surface, against a fixed disc."""
    body = Body("cart", 1.0, 0.1, joint="prismatic")
    shapes = (Shape("bar", "cart", "capsule", (0.2, 0.4), angle=0.5),
              Shape("post", None, "disc", 0.3, offset=(0.5, -0.3)))  # fmt: skip
    return Scene("rail", (body,), shapes, (Contact("bar", "post", 0.6),), gravity=(0, 0), step_size=0.05)


def whip() -> Scene:
    """A link on a link with a small tip that may fold onto a post within a step, which J v does not show."""
    bodies = (Body("arm", 1.0, 0.1, com=(0.5, 0.0)), Body("hand", 1.0, 0.1, parent="arm", anchor=(1.0, 0.0)))
    shapes = (Shape("tip", "hand", "ellipse", (0.06, 0.03), offset=(0.5, 0.0)),
              Shape("post", None, "ellipse", (0.3, 0.2), offset=(0.4, 0.4)))  # fmt: skip
    return Scene("whip", bodies, shapes, (Contact("tip", "post", 0.5),), gravity=(0, 0), step_size=0.05)


def ends(scene, x, dtype):
    """The gaps before and after a step of Coulomb's hard problem, and its status."""
    sim, oracle = slcp.Simulator(scene, COULOMB, device="cpu", dtype=dtype), Oracle(scene)
    step = sim.step(x)
    start, end = x.astype(dtype), np.asarray(step.state)
    gap = [oracle.contact_jacobian(z[:, : scene.nv].astype(float), 0)[0] for z in (start, end)]
    return *gap, step.status


@pytest.mark.slow
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_a_capsule_along_its_guide_ends_outside(dtype):
    """Deep inside friction jams it, which has a status; from outside it is stopped."""
    rng, count = np.random.default_rng(0), 4000
    speed = rng.normal(size=count) * rng.choice([0.1, 1, 10], count)
    before, after, status = ends(rail(), np.stack([rng.uniform(-1.5, 2.5, count), speed], 1), dtype)
    solved = status == slcp.Status.SOLVED
    assert after[solved].min() > -INSIDE[dtype]
    assert solved[before >= 0].mean() > 0.99
    inside = before < -INSIDE[dtype]
    assert (status[inside] == slcp.Status.JAMMED).sum() > 100 and solved[inside].sum() > 100


@pytest.mark.slow
def test_what_folds_into_a_contact_within_the_step_is_seen():
    """At the start the tip's centre stands still: J v = 0, whatever the links do within the step."""
    rng, count = np.random.default_rng(0), 2000
    x = np.zeros((count, 4))
    x[:, 0] = rng.uniform(-0.2, 0.2, count)
    x[:, 1] = rng.uniform(-0.02, 0.02, count)
    x[:, 2] = rng.uniform(15.0, 25.0, count)
    x[:, 3] = -3.0 * x[:, 2]
    sim, oracle = slcp.Simulator(whip(), COULOMB, device="cpu"), Oracle(whip())
    run = sim.rollout(x, np.zeros((count, 1, 0)))  # a step works out every gap, a rollout those within reach
    solved = run.status == slcp.Status.SOLVED
    before, after = (oracle.contact_jacobian(run.states[:, n, :2], 0)[0] for n in (0, 1))
    assert (before > 0.3).all() and 0.9 > solved.mean() > 0.3  # what folds fast is NOT_CONVERGED
    assert after[solved].min() > -INSIDE["float64"]
