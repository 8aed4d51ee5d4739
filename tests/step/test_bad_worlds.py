"""A world that cannot be stepped keeps its last valid state and has a status; others do not notice."""

import numpy as np
import pytest
import warp as wp
from simulators import scene, simulator

from slcp_warp import Status

X = scene("flicking_finger").x0
WORLDS = np.tile(X, (3, 1))
NAN = np.nan


@pytest.mark.parametrize("residual", ["rem-logistic", "hard"])
def test_a_state_or_control_that_is_no_number_is_a_status(device, dtype, residual):
    simulated = simulator("flicking_finger", device, dtype, "inertia", residual)  # as in test_step
    x, u = WORLDS.copy(), np.zeros((3, 2))
    x[0, 4] = NAN
    u[1, 0] = np.inf
    step = simulated.step(x, u)
    assert step.status.tolist() == [Status.NONFINITE, Status.NONFINITE, Status.SOLVED]
    np.testing.assert_array_equal(step.state[:2], x[:2].astype(step.state.dtype))  # the last valid state
    np.testing.assert_array_equal(step.state[2], simulated.step(X).state)  # the neighbour does not notice


def test_a_force_that_is_no_number_is_a_status(device):
    simulated = simulator("flicking_finger", device, wp.float64, "none")
    force = np.zeros((3, 3, 3))
    force[1, 2, 0] = NAN
    assert simulated.step(WORLDS, external_force=force).status.tolist() == [0, 3, 0]


def test_a_world_that_fails_on_the_way_stays_where_it_was(device):
    us = np.zeros((3, 10, 2))
    us[1, 6, 1] = NAN
    traj = simulator("flicking_finger", device, wp.float64, "none").rollout(WORLDS, us)
    assert traj.status.tolist() == [0, 3, 0] and np.isfinite(traj.states).all()
    np.testing.assert_array_equal(traj.states[1, 6:], np.tile(traj.states[1, 6], (5, 1)))
    np.testing.assert_array_equal(traj.states[0], traj.states[2])


def test_a_penetrating_start_opens(device):
    """Pushed .02 to .3 m into each other: the first step is solved and moves the bodies apart."""
    simulated = simulator("flicking_finger", device, wp.float64, "none")
    q = np.linspace(-1.2, -1.55, 40)
    x = np.zeros((40, 6))
    x[:, 0], x[:, 1] = q, -0.02
    before = simulated.step(x)
    deep = (before.gap[:, 4] < -0.02) & (before.gap[:, 4] > -0.3)
    assert deep.sum() > 5 and (before.status[deep] == 0).all()
    traj = simulated.rollout(x[deep], np.zeros((deep.sum(), 3, 2)), record=("gap",))
    assert (traj.status == 0).all()
    assert (traj.gap[:, 1, 4] > before.gap[deep, 4] + 0.01).all()


def test_crossed_joint_limits_are_infeasible(device):
    simulated = simulator("flicking_finger", device, wp.float64, "none")
    step = simulated.step(X, params=simulated.params.replace(lower=3.0))
    assert step.status == Status.INFEASIBLE
    np.testing.assert_array_equal(step.state, X)


def test_a_warm_start_that_is_no_number_does_no_harm(device):
    simulated = simulator("flicking_finger", device, wp.float64, "none")
    warm = np.full((3, simulated.nr + 2), NAN)
    step = simulated.step(WORLDS, warm_start=warm)
    assert (step.status == 0).all()
    np.testing.assert_allclose(step.state, simulated.step(WORLDS).state, atol=1e-10)
