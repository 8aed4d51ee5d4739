"""When DDP calls a plan CONVERGED: relative to what the data set, and not where nothing can be felt."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from ddp_examples import cart_pole, random_linear_problem

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.kernels.control.racing_car import make_car
from slcp_warp.scripts.studies.car_model import START, car_problem, cautious_drive

NAMES = {"float32", "float64"}


def scaled_problem(dtype, scale, seed=3):
    """A linear-quadratic problem whose cost is multiplied by a number; its start and its solution."""
    problem, data = random_linear_problem(seed, dtype=dtype)
    cost = ddp.costs.quadratic(*(scale * data[n] for n in ("Q", "R", "Qf")), data["target"])
    return ddp.Problem(problem.dynamics, cost, problem.horizon), data["x0"]


@pytest.mark.parametrize("dtype", sorted(NAMES))
def test_a_unit_of_the_cost_changes_nothing(dtype):
    """An absolute tolerance ended at pass 0 where the cost is small, and never where it is large."""
    found = []
    for scale in (1e-8, 1.0, 1e8):
        problem, x0 = scaled_problem(dtype, scale)
        result = ddp.solve(problem, x0, np.zeros((problem.horizon, problem.nu)))
        assert result.converged and 0 < result.iterations < 20
        found.append(result.us)
    limit = 1e-6 if dtype == "float64" else 2e-2
    for us in found:
        np.testing.assert_allclose(us, found[1], atol=limit * np.abs(found[1]).max())


def test_single_precision_finds_the_optimum_of_double_precision():
    costs = []
    for dtype in sorted(NAMES):
        problem, x0, us = cart_pole(dtype=dtype)
        result = ddp.solve(problem, x0, us, ddp.Options(max_iterations=300))
        assert result.iterations > 3
        costs.append(float(result.cost))
    assert abs(costs[0] - costs[1]) < 1e-3 * abs(costs[1])


def make_push(dtype, VX, VU):
    """A hand (x0, v0) and a block (x1, v1) in front of it, pushed by a one-sided spring."""
    h, zero, stiff = dtype(0.05), dtype(0.0), dtype(50.0)

    @wp.func
    def step(params: wp.array2d(dtype=dtype), row: int, x: VX, u: VU):
        force = stiff * wp.max(x[0] - x[1], zero)
        return VX(x[0] + h * x[2], x[1] + h * x[3], x[2] + h * (u[0] - force), x[3] + h * force)

    return step


@pytest.mark.parametrize("dtype", sorted(NAMES))
def test_a_push_from_rest_is_flat(dtype):
    """The block is out of reach and ought to be 1 m further: no control can be felt, so nothing converged."""
    dynamics = ddp.WarpDynamics(make_push, 4, 1, device="cpu", dtype=dtype)
    cost = ddp.costs.quadratic(
        np.zeros((4, 4)), [[0.01]], np.diag([0.0, 10.0, 0.0, 0.0]), np.array([0, 1.5, 0, 0])
    )
    problem = ddp.Problem(dynamics, cost, 20)
    apart, touching = np.array([0.0, 0.5, 0.0, 0.0]), np.array([0.51, 0.5, 0.0, 0.0])
    resting = ddp.solve(problem, apart, np.zeros((20, 1)))
    assert resting.status == ddp.Status.FLAT and not resting.converged and resting.iterations == 0
    assert "nothing can be felt" in ddp.Status(int(resting.status)).explanation
    pushed = ddp.solve(problem, touching, np.zeros((20, 1)))
    assert pushed.status != ddp.Status.FLAT and pushed.cost < 0.5 * resting.cost
    both = ddp.solve_multistart(problem, apart, np.stack([np.zeros((20, 1)), np.full((20, 1), 2.0)]))
    assert both.best.status != ddp.Status.FLAT and both.best.cost < 0.5 * resting.cost


def test_one_call_finds_what_zero_controls_do_not_feel():
    """Nothing is said of a start: the block is found by samples. A neighbour that feels keeps every bit."""
    dynamics = ddp.WarpDynamics(make_push, 4, 1, device="cpu")
    cost = ddp.costs.quadratic(
        np.zeros((4, 4)), [[0.01]], np.diag([0.0, 10.0, 0.0, 0.0]), np.array([0, 1.5, 0, 0])
    )
    problem = ddp.Problem(dynamics, cost, 20)
    apart, touching = np.array([0.0, 0.5, 0.0, 0.0]), np.array([0.51, 0.5, 0.0, 0.0])
    flat, pushed = ddp.solve(problem, apart, np.zeros((20, 1))), ddp.solve(problem, touching)
    both = ddp.solve(problem, np.stack([apart, touching]))
    assert both.converged.all() and both.cost[0] < 0.5 * flat.cost
    for name in ("us", "xs", "K", "cost", "status", "iterations"):
        np.testing.assert_array_equal(getattr(both, name)[1], getattr(pushed, name))
    again = ddp.solve(problem, apart, both.us[0], ddp.Options(max_iterations=0))
    assert again.cost == both.cost[0] and np.isnan(both.trace.cost[1, int(pushed.iterations) + 1 :]).all()


def test_a_start_at_the_optimum_is_converged():
    problem, data = random_linear_problem(1)
    still = ddp.Problem(ddp.linear_system(data["A"], data["B"], device="cpu"),
                        ddp.costs.quadratic(data["Q"], data["R"], data["Qf"]), 15)  # fmt: skip
    result = ddp.solve(still, np.zeros(4), np.zeros((15, 2)))
    assert result.status == ddp.Status.CONVERGED and result.iterations == 0


@pytest.mark.parametrize("dtype", sorted(NAMES))
def test_what_vanishes_is_converged(dtype):
    """All terms of J and of Q_u go to 0 with the controls: no tolerance is relative to anything then."""
    A, B = np.eye(4) + 0.1 * np.eye(4, k=1), np.zeros((4, 2))
    B[1] = 0.1, 0.05
    cost = ddp.costs.quadratic(np.diag([1.0, 1.0, 0.0, 0.0]), 0.1 * np.eye(2))
    problem = ddp.Problem(ddp.linear_system(A, B, device="cpu", dtype=dtype), cost, 15)
    result = ddp.solve(problem, np.zeros(4), np.ones((15, 2)))
    assert result.status == ddp.Status.CONVERGED and result.cost == 0.0


@pytest.mark.slow
def test_the_racing_car_in_both_precisions():
    """Single precision finds the cost of double precision."""
    costs = {}
    for dtype in sorted(NAMES):
        problem = car_problem(0.5, 0.25, "cpu")
        if dtype == "float32":
            values = {name: float(problem.params.values[name]) for name in problem.params.shapes}
            dynamics = ddp.WarpDynamics(make_car, 5, 2, values, "cpu", dtype)
            problem = replace(problem, dynamics=dynamics, params=None)
        result = ddp.solve(problem, START, cautious_drive(), ddp.Options(max_iterations=200))
        assert result.iterations > 5
        costs[dtype] = float(result.cost)
    assert abs(costs["float32"] - costs["float64"]) < 0.05 * abs(costs["float64"])


def test_the_finger_at_rest_without_gravity_is_flat():
    sim = slcp.Simulator(slcp.scenes.flicking_finger(), slcp.Options(scaling="none"), device="cpu")
    params = sim.params.replace(gravity=(0.0, 0.0), sigma=0.1, step_size=0.05)
    problem = ddp.Problem(sim, slcp.tasks.flicking_finger().cost, 75, params)
    assert ddp.solve(problem, sim.scene.x0, np.zeros((75, 2))).status == ddp.Status.FLAT
