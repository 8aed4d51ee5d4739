"""Options.tolerance: where Newton's iteration stops, judged by the independent residual."""

import math

import numpy as np
import pytest
import warp as wp
from oracle import Oracle, residual
from random_scenes import near_contact
from simulators import scene, simulator

import slcp_warp as slcp
from slcp_warp.options import OptionError


@pytest.mark.parametrize("value", [0.0, -1e-6, 1.0, 1e-16, math.nan, math.inf, "fine", True])
def test_a_tolerance_out_of_range_is_refused(value):
    with pytest.raises(OptionError, match=r"Options.tolerance is .* in \[1e-15, 0.1\]"):
        slcp.Options(tolerance=value)


@pytest.mark.parametrize("choice", [{"residual": "erm-normal"}, {"residual": "hard", "friction": "coulomb"}])
def test_solvers_with_tolerances_of_their_own_refuse_it(choice):
    with pytest.raises(OptionError, match="tolerance of its own"):
        slcp.Options(tolerance=1e-6, **choice)


def test_kernels_in_memory_have_no_tolerance():
    finger, options = scene("flicking_finger"), slcp.Options(tolerance=1e-6)
    with pytest.raises(slcp.StrategyError, match="tolerance 1e-06"):
        slcp.Simulator(finger, options, device="cpu", strategy="generic")
    assert slcp.Simulator(finger, options, device="cpu").strategy == "specialised"


@pytest.mark.slow
def test_the_residual_is_within_the_tolerance_and_not_far_within(device):
    """Impulses are as coarse as asked for; the impulse-momentum balance stays exact."""
    finger, rng = scene("flicking_finger"), np.random.default_rng(0)
    x, u = near_contact(finger, rng, 250, (0.0, 1e-3, -1e-3, 0.02)), rng.standard_normal((250, 2))
    problem = Oracle(finger).problem(x, u, scaling="none")
    worst = {}
    for tolerance in (None, 1e-3):
        sim = simulator("flicking_finger", device, wp.float64, "none")
        if tolerance is not None:
            options = slcp.Options(scaling="none", tolerance=tolerance)
            sim = slcp.Simulator(finger, options, device=device, dtype="float64")
        step = sim.step(x, u)
        assert (step.status == slcp.Status.SOLVED).mean() > 0.95
        solved = (step.status == slcp.Status.SOLVED) & (problem["margin"] > 1e-3)
        v = step.state[:, finger.nv :]
        r1, r2 = residual(problem, v, step.impulse)
        scale = 1.0 + np.abs(v).max(axis=1) + np.abs(problem["vfree"]).max(axis=1)
        assert np.abs(r1[solved]).max() < 1e-11
        worst[tolerance] = (np.abs(r2).max(axis=1) / scale)[solved].max()
    assert worst[None] < 1e-12
    assert 1e-6 < worst[1e-3] < 1e-3 * 5.0  # terms here are the largest velocities, there their sum
