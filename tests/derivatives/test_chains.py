"""Chains that lie or land along a plane: every contact's gap follows from some others' wherever they are."""

import math

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape

HALF, RADIUS = 0.12, 0.04


def chain(links):
    """Capsules, hinged end to end, each with two contacts with the plane."""
    first = Body("link0", 1.0, 0.01, joint="free", com=(HALF, 0.0))
    more = [
        Body(f"link{i}", 1.0, 0.01, parent=f"link{i - 1}", anchor=(2.0 * HALF, 0.0), com=(HALF, 0.0))
        for i in range(1, links)
    ]
    ground = Shape("ground", None, "halfplane", angle=math.pi / 2)
    capsules = [
        Shape(f"side{i}", f"link{i}", "capsule", (RADIUS, 0.9 * HALF), offset=(HALF, 0.0))
        for i in range(links)
    ]
    touches = tuple(Contact("ground", shape.name, 0.5) for shape in capsules)
    motors = tuple(slcp.Actuator(body.name) for body in more)
    return Scene("chain", (first, *more), (ground, *capsules), touches, actuators=motors)


def simulator(links):
    options = slcp.Options("hard", friction="coulomb")
    return slcp.Simulator(chain(links), options, device="cpu", strategy="generic")


def thrown(sim, worlds, seed):
    """Flat, down onto the plane: all contacts may press in this step, few stick."""
    rng, nv = np.random.default_rng(seed), sim.scene.nv
    x = np.zeros((worlds, sim.nx))
    x[:, 1] = rng.uniform(RADIUS, 1.5 * RADIUS, worlds)
    x[:, 2:nv] = rng.normal(0.0, 0.05, (worlds, nv - 2))
    x[:, nv:] = rng.normal(0.0, 2.0, (worlds, nv))
    x[:, nv + 1] -= 6.0
    return x


def slopes(sim, x, u, spacing=1e-7):
    """dx'/dx of every world by differences; where one-sided ones along any direction are the same."""
    worlds, nx = x.shape
    ways = np.concatenate([np.eye(nx), np.random.default_rng(1).standard_normal((8, nx))])
    moved = np.concatenate([x[:, None] + spacing * ways, x[:, None] - spacing * ways], axis=1)
    after = sim.step(moved.reshape(-1, nx), np.repeat(u, 2 * len(ways), axis=0))
    assert (after.status == 0).all()
    change = after.state.reshape(worlds, 2, len(ways), nx) - sim.step(x, u).state[:, None, None]
    change[:, 1] = -change[:, 1]
    by_state = change[:, 0, :nx] / spacing
    size = np.abs(by_state).max((1, 2))
    off = np.abs(change / spacing - np.einsum("kj,bji->bki", ways, by_state)[:, None])
    return by_state.transpose(0, 2, 1), off.max((1, 2, 3)) < 1e-3 * size, size


@pytest.mark.parametrize(("links", "least"), [(2, 80), (3, 80), (7, 60)])
def test_a_chain_that_lands_flat_has_its_derivative(links, least):
    """More contacts press than the chain can follow, and one of them sticks."""
    sim = simulator(links)
    x, u = thrown(sim, 100, links), np.zeros((100, sim.nu))
    found, smooth, size = slopes(sim, x, u)
    assert smooth.sum() >= least
    impulse = sim.step(x).contact_impulse
    sticks = (impulse[..., 0] > 0) & (np.abs(impulse[..., 1]) < 0.499 * impulse[..., 0])
    redundant = (impulse[..., 0] > 0).sum(1) > links + 1
    assert (sticks.any(1) & redundant & smooth).sum() > 40
    lin = sim.linearize(x, u)
    assert (lin.status[smooth] == 0).all()
    assert (np.abs(lin.A - found).max((1, 2)) < 1e-4 * size)[smooth].all()
    weights = np.zeros((100, 2, sim.nx))
    weights[:, 1] = np.random.default_rng(2).standard_normal((100, sim.nx))
    pulled = slcp.vjp(sim, x, u[:, None], weights).x0
    expected = np.einsum("bij,bi->bj", found, weights[:, 1])
    assert (np.abs(pulled - expected).max(1) < 1e-4 * np.abs(expected).max(1))[smooth].all()


def test_a_chain_that_lies_still_is_held():
    """All of its contacts stick: by velocities and controls the derivative is 0, and by coordinates it is not
    much larger than differences are. It was that of a chain that slides freely, its gradients not numbers.
    """
    sim = simulator(7)
    rng = np.random.default_rng(0)
    x = np.zeros((100, sim.nx))
    x[:, 1] = RADIUS + rng.uniform(0.0, 0.05, 100)
    x[:, 2 : sim.scene.nv] = rng.normal(0.0, 0.05, (100, 7))
    u = rng.normal(0.0, 0.3, (100, 40, sim.nu))
    rolled = sim.rollout(x, u)
    still = np.abs(sim.step(rolled.states[:, 39], u[:, 39]).state[:, sim.scene.nv :]).max(1) < 1e-9
    assert still.sum() > 25
    x, u = rolled.states[still, 39], u[still, 39]
    lin = sim.linearize(x, u)
    assert (lin.status == 0).all()
    np.testing.assert_allclose(lin.A[:, :, sim.scene.nv :], 0.0, atol=1e-8)
    np.testing.assert_allclose(lin.B, 0.0, atol=1e-8)
    _, _, size = slopes(sim, x, u)
    assert (np.abs(lin.A).max((1, 2)) < 1.2 * size).all()
    weights = np.zeros((len(x), 2, sim.nx))
    weights[:, 1] = np.random.default_rng(2).standard_normal((len(x), sim.nx))
    pulled = slcp.vjp(sim, x, u[:, None], weights).x0
    expected = np.einsum("bij,bi->bj", lin.A, weights[:, 1])
    np.testing.assert_allclose(pulled, expected, atol=1e-6 * np.abs(expected).max())
