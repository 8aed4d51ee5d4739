"""A world that cannot be stepped keeps its last valid state and has a status; others do not notice."""

import numpy as np
import pytest
import warp as wp
from simulators import scene, simulator

import slcp_warp as slcp
from slcp_warp import Status, measures

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


@pytest.mark.parametrize("friction", ["anitescu", "coulomb"])
@pytest.mark.parametrize("pile", [slcp.scenes.stack(3), slcp.scenes.heap(6)], ids=["stack", "heap"])
def test_generic_kernels_say_so_with_either_friction(pile, friction):
    """With Coulomb's friction it was NOT_CONVERGED, after every way to solve such rows had been tried."""
    sim = slcp.Simulator(pile, slcp.Options("hard", friction=friction), device="cpu", strategy="generic")
    x = np.tile(pile.x0, (5, 1))
    x[1, 1] = NAN
    x[2] = NAN
    x[3, pile.nv] = np.inf
    step = sim.step(x)
    assert step.status.tolist() == [Status.SOLVED, *[Status.NONFINITE] * 3, Status.SOLVED]
    np.testing.assert_array_equal(step.state[1:4], x[1:4])
    np.testing.assert_array_equal(step.state[[0, 4]], np.tile(sim.step(pile.x0).state, (2, 1)))


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


class Rest:
    """A policy on the host that does nothing."""

    def act(self, x, time, worlds):
        return np.zeros((len(x), 2))


FINGERS = pytest.mark.parametrize("strategy", ["specialised", "generic"])


def finger(device, strategy):
    if strategy == "specialised":
        return simulator("flicking_finger", device, wp.float64, "none")
    options = slcp.Options("hard")
    return slcp.Simulator(scene("flicking_finger"), options, device, dtype="float64", strategy=strategy)


@FINGERS
def test_what_is_recorded_of_steps_that_failed_is_no_number(device, strategy):
    """It was 0, which of a gap is touching; a measure took it, and the state where the world stopped."""
    us = np.zeros((3, 10, 2))
    us[1, 6, 1] = NAN
    sim = finger(device, strategy)
    run = sim.rollout(WORLDS, us, record=("controls", "impulse", "gap"))
    assert run.status.tolist() == [0, 3, 0]
    for recorded in (run.controls, run.impulse, run.gap):
        expected = np.zeros(recorded.shape, bool)
        expected[1, 6:] = True
        np.testing.assert_array_equal(np.isnan(recorded), expected)
    assert np.isnan(run.measure(measures.lowest_gap())).tolist() == [False, True, False]
    assert run.measure(measures.lowest_gap() > -9.0).tolist() == [True, False, True]
    lower = np.tile(sim.params["lower"], (3, 1))
    lower[1, 0] = 30.0
    params = sim.params.replace(lower=lower)
    asked = sim.rollout(WORLDS, None, params, policy=Rest(), steps=4, record=("controls", "gap"))
    assert asked.status.tolist() == [0, Status.INFEASIBLE, 0]
    for recorded in (asked.controls, asked.gap):
        assert np.isnan(recorded).all(axis=(1, 2)).tolist() == [False, True, False]
        assert not np.isnan(recorded[[0, 2]]).any()


@FINGERS
def test_a_failed_world_names_what_overlaps_in_its_last_state(device, strategy, tmp_path):
    sim = finger(device, strategy)
    lower, upper = (np.tile(sim.params[name], (3, 1)) for name in ("lower", "upper"))
    lower[2, 1], upper[2, 1] = X[1] + 0.5, X[1] - 0.25
    run = sim.rollout(WORLDS, np.zeros((3, 2, 2)), sim.params.replace(lower=lower, upper=upper))
    name = scene("flicking_finger").state_names[1]
    text = f"{name} lower by 0.5, {name} upper by 0.25"
    assert run.failures() == [(2, "INFEASIBLE", text)] and text in str(run)
    np.testing.assert_array_equal(run.last_gap(slice(1, 3)), run.last_gap([1, 2]))
    with pytest.raises(IndexError, match="worlds are 3; there are 3"):
        run.last_gap(3)
    assert run[:2].failures() == [] and "not SOLVED" not in str(run[:2])
    assert run[2].failures() == [(0, "INFEASIBLE", text)]
    step = sim.step(WORLDS, params=sim.params.replace(lower=lower, upper=upper))
    assert text in str(step)
    kept = slcp.Trajectory.load(run.save(tmp_path / "run.npz"))
    with pytest.raises(slcp.ArgumentError, match="no simulator"):
        kept.failures()
    assert "1 INFEASIBLE" in str(kept)


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


def test_what_turns_by_more_than_a_radian_a_step_is_said():
    """A torque in the wrong unit: velocities of a step's two ends have nothing to do with each other."""
    arm = slcp.Scene(
        "arm",
        (slcp.Body("arm", 1.0, 0.01), slcp.Body("rail", 1.0, 0.01, joint="prismatic")),
        actuators=(slcp.Actuator("arm"), slcp.Actuator("rail")),
        step_size=0.01,
    )
    sim = slcp.Simulator(arm, dtype="float64")
    us = np.zeros((2, 60, 2))
    us[1] = [10.0, 1e5]
    fast = sim.rollout(np.zeros((2, 4)), us)
    assert "arm.angle turns by up to 6 rad a step: beyond 1 steps give" in str(fast)
    assert "a step:" not in str(fast[0]) and "a step:" in str(fast[1])
