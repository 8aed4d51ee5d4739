"""Contacts that a bound on the approach must not leave out: bodies that turn into each other."""

from dataclasses import replace

import numpy as np
import pytest
from oracle import Oracle
from random_scenes import near_contact
from simulators import scene

import slcp_warp as slcp

SPINS = {"a": (2,), "b": (5,), "both": (2, 5)}  # degrees of freedom of the pair that turn


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
@pytest.mark.parametrize("who", SPINS)
@pytest.mark.parametrize("centred", [False, True], ids=["off centre", "about their centres"])
def test_a_body_that_only_turns_is_not_left_out(device, strategy, who, centred):
    """A rollout leaves pairs out by a bound on their approach, a specialised step never does; same states.

    Where shapes turn about their centres, these stand still: the turning alone closes the gap.
    """
    sc = scene("turned_pair")
    if centred:
        sc = replace(sc, shapes=tuple(replace(shape, offset=(0.0, 0.0)) for shape in sc.shapes))
    whole = slcp.Simulator(sc, device=device, dtype="float64", strategy="specialised")
    sim = slcp.Simulator(sc, device=device, dtype="float64", strategy=strategy)
    rng = np.random.default_rng(0)
    x = near_contact(sc, rng, 300, gaps=(0.05, 0.2, 0.4), spread=0.3)
    x[:, sc.nv :] = 0.0
    spins = [sc.nv + j for j in SPINS[who]]
    x[:, spins] = rng.choice([-1, 1], (300, len(spins))) * rng.uniform(10.0, 60.0, (300, len(spins)))
    params = sim.params.replace(gravity=0.0)
    step = whole.step(x, None, params)
    run = sim.rollout(x, np.zeros((300, 1, 0)), params, record="impulse")
    solved = (step.status == 0) & (Oracle(sc).problem(x)["margin"] > 0.05)
    hit = np.abs(step.impulse).max(axis=1) > 1e-3
    assert (hit & solved).sum() > 20 and (~hit).sum() > 20
    np.testing.assert_array_equal(run.status[solved], 0)
    np.testing.assert_allclose(run.states[solved, 1], step.state[solved], rtol=0, atol=1e-8)
    np.testing.assert_allclose(run.impulse[solved, 0], step.impulse[solved], rtol=0, atol=1e-7)


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
def test_the_row_with_the_most_noise_decides_what_is_left_out(device, strategy):
    """A pair whose second row is uncertain by more than its first: a rollout is the step with all rows."""
    sc = scene("turned_pair")
    whole = slcp.Simulator(sc, device=device, dtype="float64", strategy="specialised")
    sim = slcp.Simulator(sc, device=device, dtype="float64", strategy=strategy)
    params = sim.params.replace(gravity=0.0, sigma=[0.001, 0.5])
    x = near_contact(sc, np.random.default_rng(1), 200, gaps=(0.05, 0.1), spread=0.3)
    x[:, sc.nv :] = 0.0
    step = whole.step(x, None, params)
    run = sim.rollout(x, np.zeros((200, 1, 0)), params, record="impulse")
    assert not step.status.any() and not run.status.any()
    assert (step.impulse[:, 1] > 1e-6).sum() > 100 and np.abs(step.impulse[:, 0]).max() < 1e-9
    np.testing.assert_allclose(run.impulse[:, 0], step.impulse, rtol=1e-6, atol=1e-12)
