"""Mechanisms that branch: the mass matrix has zeros between branches, its factor and its inverse have not."""

import numpy as np
import pytest
from oracle import Oracle

import slcp_warp as slcp
from slcp_warp import Body, Scene


def candelabrum() -> Scene:
    """A trunk that swings, two arms on it, a hand on each; the second arm slides."""
    return Scene("candelabrum", (
        Body("trunk", 2.0, 0.3, com=(0.1, 0.4)),
        Body("left", 1.0, 0.1, parent="trunk", anchor=(-0.3, 0.8), com=(0.2, 0.1), angle=0.4),
        Body("left hand", 0.5, 0.05, parent="left", anchor=(0.6, 0.0), com=(0.1, -0.1)),
        Body("right", 1.5, 0.2, parent="trunk", joint="prismatic", anchor=(0.3, 0.8), com=(0.1, 0.0),
             axis=(0.6, 0.8)),
        Body("right hand", 0.4, 0.02, parent="right", anchor=(0.2, 0.5), com=(-0.1, 0.2)),
    ))  # fmt: skip


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
def test_free_motion_of_branches(device, strategy):
    sc = candelabrum()
    oracle = Oracle(sc)
    rng = np.random.default_rng(0)
    q, v = rng.standard_normal((2, 40, sc.nv))
    mass = oracle.mass_matrix(q)
    assert np.abs(mass[:, 1, 3]).max() < 1e-12 < np.abs(np.linalg.inv(mass)[:, 1, 3]).min()
    sim = slcp.Simulator(sc, device=device, dtype="float64", strategy=strategy)
    after = sim.step(np.hstack([q, v])).state
    h = sc.step_size
    expected = v + h * np.linalg.solve(mass, oracle.force(q, v)[..., None])[..., 0]
    size = 1.0 + np.abs(expected).max(axis=1, keepdims=True)
    assert (np.abs(after[:, sc.nv :] - expected) <= 1e-11 * size).all()
    assert (np.abs(after[:, : sc.nv] - q - h * expected) <= 1e-11 * size).all()
