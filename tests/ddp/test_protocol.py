"""What DDP makes of a simulator: derivatives along a batch of trajectories as at single states, and the same
passes whichever kernels step; on a stack of boxes, too.
"""

import runpy
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from simulators import scene, simulator

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.dynamics import WarpDynamics, dynamics_of, linear_system
from slcp_warp.ddp.dynamics.protocol import REQUIRED

EXAMPLE = Path(__file__).resolve().parents[2] / "examples/tasks/push_stack.py"
STRATEGIES = ("specialised", "generic")


def test_a_simulator_has_nothing_of_the_protocol_that_ddp_makes_for_it():
    own = {"nx", "nu", "dtype", "device", "parameter_array"}  # what a simulator is asked for by others, too
    asked = [*REQUIRED, "prepare_linearize", "state_type", "control_type", "carry_type", "kernel_key"]
    assert [name for name in asked if hasattr(slcp.Simulator, name) and name not in own] == []
    assert [name for name in asked if hasattr(WarpDynamics, name) and name.endswith("_type")] == []


def test_a_problem_keeps_the_simulator_that_it_was_given():
    sim = simulator("flicking_finger", "cpu", wp.float64, "none")
    problem = ddp.Problem(sim, ddp.costs.quadratic(np.eye(6), np.eye(2)), 3)
    assert problem.dynamics is sim and problem.params is sim.params
    made = dynamics_of(sim)
    assert all(getattr(made, name) is not None for name in REQUIRED) and dynamics_of(made) is made


def test_derivatives_along_trajectories_are_those_of_single_states(device):
    sim = simulator("flicking_finger", device, wp.float64, "none")
    made, rng = dynamics_of(sim), np.random.default_rng(4)
    problems, steps, nz = 3, 4, sim.nx + sim.nu
    xs = sim.scene.x0 + 0.5 * rng.standard_normal((problems, steps + 1, sim.nx))
    us = rng.standard_normal((problems, steps, sim.nu))
    fx, fu = sim.empty(problems, steps, sim.nx, sim.nx), sim.empty(problems, steps, sim.nx, sim.nu)
    second = sim.empty(problems * steps, made.nw, nz, nz)
    status = wp.full((problems, steps), -1, dtype=wp.int32, device=sim.device)
    active = wp.array([1, 0, 1], dtype=wp.int32, device=sim.device)
    table = made.parameter_array(sim.params, problems)
    arrays = [wp.array(a, dtype=sim.dtype, device=sim.device) for a in (xs, us)]
    made.linearize_into(*arrays, table, fx, fu, second, status, active)
    chosen = [0, 2]
    at = sim.linearize(xs[chosen, :-1].reshape(-1, sim.nx), us[chosen].reshape(-1, sim.nu), second=True)
    np.testing.assert_array_equal(fx.numpy()[chosen].reshape(at.A.shape), at.A)
    np.testing.assert_array_equal(fu.numpy()[chosen].reshape(at.B.shape), at.B)
    curved = second.numpy().reshape(problems, steps, made.nw, nz, nz)
    np.testing.assert_array_equal(curved[chosen].reshape(at.second.shape), at.second)
    assert not fx.numpy()[1].any() and (status.numpy()[1] == -1).all()
    lift = sim.empty(problems, made.nw, sim.nx)
    made.lift_into(table, lift)
    weights = rng.standard_normal((problems, sim.nx))
    mine = np.einsum("bwi,bi,bwjk->bjk", lift.numpy(), weights, curved[:, 0])
    whole, _ = slcp.weighted_hessian(sim, xs[chosen, 0], us[chosen, 0], weights[chosen])
    np.testing.assert_allclose(mine[chosen], whole, rtol=1e-12, atol=1e-12 * np.abs(whole).max())


def test_what_lacks_a_part_of_the_protocol_is_refused_by_name():
    whole = linear_system(np.eye(2), np.ones((2, 1)), device="cpu")
    assert dynamics_of(whole) is whole
    for name in REQUIRED:
        some = {other: getattr(whole, other) for other in REQUIRED if other != name}
        with pytest.raises(TypeError, match=f"dynamics must have '{name}'"):
            dynamics_of(SimpleNamespace(**some))


def finger(strategy, horizon=12):
    sim = slcp.Simulator(scene("flicking_finger"), device="cpu", strategy=strategy)
    cost = slcp.tasks.flicking_finger().cost
    return ddp.Problem(sim, cost, horizon, control_limits=(-2.0, 2.0))


@pytest.mark.parametrize("method", ["second-order", pytest.param("gauss-newton", marks=pytest.mark.slow)])
def test_same_passes_as_specialised(method):
    """Two problems with numbers of their own, from controls and by multiple shooting."""
    rng = np.random.default_rng(0)
    x0 = scene("flicking_finger").x0 + 0.05 * rng.standard_normal((2, 6))
    us = 0.5 * rng.standard_normal((2, 12, 2))
    xs = x0[:, None] + 0.02 * rng.standard_normal((2, 13, 6))
    options = ddp.Options(max_iterations=4, method=method)
    found = []
    for strategy in STRATEGIES:
        problem = finger(strategy)
        problem = problem.with_params(damping=np.array([[0.2, 0.2, 0.7], [0.1, 0.3, 0.6]]))
        found.append([ddp.solve(problem, x0, us, options, **given) for given in ({}, {"xs0": xs})])
    for ours, theirs in zip(*found):
        np.testing.assert_allclose(ours.cost, theirs.cost, rtol=1e-6)
        np.testing.assert_allclose(ours.xs, theirs.xs, atol=1e-5)
        np.testing.assert_allclose(ours.K, theirs.K, rtol=1e-4, atol=1e-3)
        np.testing.assert_array_equal(ours.status, theirs.status)


def test_a_problem_that_cannot_be_stepped_fails_alone():
    x0 = np.tile(scene("flicking_finger").x0, (2, 1))
    x0[1, 4] = 1e200
    plan = ddp.solve(finger("generic"), x0, np.zeros((12, 2)), ddp.Options(max_iterations=2))
    assert plan.status[1] == ddp.Status.DYNAMICS_FAILED and plan.status[0] != ddp.Status.DYNAMICS_FAILED
    assert np.isfinite(plan.cost[0]) and plan.cost[1] == np.inf


def test_a_stack_is_pushed():
    """The lower of two boxes is pushed, the upper one comes along; the plan is a rollout, and MPC goes on."""
    task = runpy.run_path(str(EXAMPLE))["push_stack"](2)
    sim = slcp.Simulator(task.scene, task.options, device="cpu", strategy="generic")
    problem = ddp.Problem(sim, task.cost, 30, control_limits=(-40.0, 40.0))
    options = ddp.Options(max_iterations=12, method="gauss-newton")
    push = np.full((30, 1), 15.0)
    first = ddp.solve(problem, task.scene.x0, push, ddp.Options(max_iterations=0, method="gauss-newton"))
    plan = ddp.solve(problem, task.scene.x0, push, options)
    assert plan.cost < 0.5 * first.cost
    box0, box1 = (task.scene.state_names.index(f"box{i}.x") for i in range(2))
    assert abs(plan.xs[-1, box0] - 0.3) < 0.1 and abs(plan.xs[-1, box1] - plan.xs[-1, box0]) < 0.03
    again = sim.rollout(task.scene.x0, plan.us)
    np.testing.assert_allclose(again.states, plan.xs, atol=1e-9)
    follow = sim.rollout(task.scene.x0, policy=ddp.TrackingPolicy(plan), steps=10)
    np.testing.assert_allclose(follow.states, plan.xs[:11], atol=1e-7)
    tried = ddp.sample(problem, task.scene.x0, push, ddp.Sampling(samples=8, iterations=2))
    assert tried.cost <= first.cost and tried.cost == tried.best[-1]
    np.testing.assert_allclose(sim.rollout(task.scene.x0, tried.us).states, tried.xs, atol=1e-9)
    mpc = ddp.MPC(problem, passes=1, options=options)
    run = sim.rollout(task.scene.x0, policy=mpc, steps=3)
    assert run.status == slcp.Status.SOLVED


def test_discs_on_a_table_stay_until_the_finger_comes():
    """The example's scene: without gravity and controls nothing moves, torques bring the finger to a disc."""
    path = EXAMPLE.with_name("among_discs.py")
    task = runpy.run_path(str(path))["among_discs"](2)
    sim = slcp.Simulator(task.scene, slcp.Options("hard", "none"), device="cpu", strategy="generic")
    still = sim.rollout(task.scene.x0, np.zeros((30, 2)))
    assert still.status == slcp.Status.SOLVED
    np.testing.assert_array_equal(still.states, np.tile(task.scene.x0, (31, 1)))
    pushed = sim.rollout(task.scene.x0, np.full((30, 2), -2.0))
    assert (
        pushed.status == slcp.Status.SOLVED
        and np.abs(pushed.states[-1, 2:4] - task.scene.x0[2:4]).max() > 0.02
    )


def test_generic_kernels_give_no_second_derivatives_that_are_not_weighed():
    sim = slcp.Simulator(scene("flicking_finger"), device="cpu", strategy="generic")
    with pytest.raises(ValueError, match=r"second is an array of shape \(2, 6, 8, 8\); None is needed"):
        dynamics_of(sim).prepare_linearize(None, None, None, None, None, sim.empty(2, 6, 8, 8), None, None)
