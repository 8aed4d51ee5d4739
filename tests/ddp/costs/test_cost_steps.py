"""Costs that are another one from step to step: targets of nodes and functions of the step's number, where
runs begin, go on or make steps of another size.
"""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from simulators import driven_cart

import slcp_warp as slcp
from slcp_warp import ddp, policies
from slcp_warp import measures as m
from slcp_warp.ddp.library.receding import build_library
from slcp_warp.inputs.errors import ArgumentError
from slcp_warp.kernels.control.costs import CostFunctions

H, N, SPEED = 0.1, 20, 0.8
CART = replace(driven_cart(), step_size=H)
PATH = np.stack([SPEED * H * np.arange(N + 1), np.full(N + 1, SPEED)], axis=1)
STILL = policies.Linear(np.zeros((1, 2)))


def by_nodes():
    weights = np.diag([50.0, 0.0])
    return slcp.costs.quadratic(weights, [[1e-3]], weights, PATH)


def make_by_step(dtype, VX, VU):
    AWAY, HALF, LITTLE = dtype(SPEED * H), dtype(25.0), dtype(5e-4)

    @wp.func
    def running(x: VX, u: VU, k: int):
        e = x[0] - AWAY * dtype(k)
        return HALF * e * e + LITTLE * u[0] * u[0]

    return running, None


def make_own(dtype, VX, VU):
    plain_running, _ = make_by_step(dtype, VX, VU)

    @wp.func
    def running(weights: wp.array2d(dtype=dtype), row: int, x: VX, u: VU, k: int):
        return plain_running(x, u, k)

    @wp.func
    def final(weights: wp.array2d(dtype=dtype), row: int, x: VX):
        return dtype(0.0)

    return CostFunctions(running, final)


def make_alike(dtype, VX, VU):
    own = make_own(dtype, VX, VU)

    @wp.func
    def running(weights: wp.array2d(dtype=dtype), row: int, x: VX, u: VU, k: int):
        return x[0] * x[0] + u[0] * u[0]

    return CostFunctions(running, own.final)


COSTS = {"nodes": by_nodes, "step": lambda: slcp.costs.plain(make_by_step)}


@pytest.fixture(scope="module")
def sim():
    return slcp.Simulator(CART, device="cpu", dtype="float64")


@pytest.mark.parametrize("kind", COSTS)
def test_mpc_plans_by_the_runs_time(sim, kind):
    """To the run's end it acts as the plan of the whole run; without an end it follows the path as well. It
    stayed where every cycle's path begins.
    """
    problem = ddp.Problem(sim, COSTS[kind](), N)
    plan = ddp.solve(problem, np.zeros(2), np.zeros((N, 1)))
    x0 = np.zeros((1, 2))
    ending = sim.rollout(x0, policy=ddp.MPC(problem, passes=3, end=N), steps=N)
    np.testing.assert_allclose(ending.states[0], plan.xs, atol=1e-6)
    going = sim.rollout(x0, policy=ddp.MPC(problem, passes=3), steps=N)
    assert np.abs(going.states[0, 4 : N - 2, 0] - PATH[4:-3, 0]).max() < 0.02
    late = ddp.MPC(problem, passes=3, end=N, lag=2)  # as of a task that delays
    own = slcp.Task("late", CART, COSTS[kind](), N, disturbances=slcp.Disturbances(delay=2 * H))
    around = policies.Around(STILL, delay=2)  # what acts before the first control is there
    assert np.abs(sim.rollout(x0, policy=around, steps=2).states[0]).max() == 0.0
    told = slcp.sweep(own.replace(measures={"x": m.final("cart.shift")}), late, worlds=1,
                      cases=slcp.Options("hard"), dtype="float64", device="cpu")  # fmt: skip
    assert abs(told.table["x"][0] - PATH[-1, 0]) < 0.1


@pytest.mark.parametrize("kind", COSTS)
def test_runs_of_other_steps_are_judged_in_time(kind):
    """A cart that moves along the path costs nothing, whatever the steps; it cost 13.3 at half of them."""
    task = slcp.Task("path", CART, COSTS[kind](), N, start=(0.0, SPEED), measures={"price": m.cost()})
    sizes = (0.5 * H, H, 2.0 * H)
    report = slcp.sweep(task, STILL, worlds=1, cases=slcp.Options("hard"), step_sizes=sizes, device="cpu")
    price = dict(zip(report.table["step_size"], report.table["price"]))
    assert price[H] < 1e-9 and price[2.0 * H] < 1e-9
    held = 0.0 if kind == "nodes" else 0.5 * 50.0 * N * (0.5 * H * SPEED) ** 2  # every second step is between
    assert price[0.5 * H] == pytest.approx(held, rel=1e-3, abs=1e-9)


def test_code_for_its_own_steps_alone_is_refused(sim):
    own = ddp.Problem(sim, ddp.Cost(make_own, nx=2, nu=1), N)
    with pytest.raises(ArgumentError, match="problem.cost is planned with from later steps"):
        ddp.MPC(own)
    task = slcp.Task("path", CART, own.cost, N, measures={"price": m.cost()})
    with pytest.raises(ArgumentError, match="step_sizes asks for 0.05 s"):
        slcp.sweep(task, STILL, worlds=1, step_sizes=(0.05,), device="cpu")
    ddp.MPC(ddp.Problem(sim, ddp.Cost(make_alike, nx=2, nu=1), N))


@pytest.mark.parametrize("kind", [*COSTS, "own"])
def test_chains_of_a_library_need_one_cost(sim, kind):
    cost = ddp.Cost(make_own, nx=2, nu=1) if kind == "own" else COSTS[kind]()
    with pytest.raises(ArgumentError, match="the same at every step"):
        build_library(ddp.Problem(sim, cost, N), np.zeros(2), 4)


def test_a_library_of_a_scene_without_rows(sim):
    """It was planned for, and then lost to an IndexError, as such scenes have no noise levels."""
    problem = ddp.Problem(sim, slcp.costs.quadratic(np.eye(2), [[1.0]]), N)
    library = build_library(problem, np.array([0.5, 0.0]), 8)
    assert len(library) >= 8 and library.header["sigma"] == CART.sigma


def test_a_policy_of_plans_has_one_step_size(sim):
    """Plans of a batch took the first one's: the second ended at .44 m in place of 1 m, without a word."""
    params = sim.params.replace(step_size=np.array([0.05, 0.1]))
    problem = ddp.Problem(sim, slcp.costs.quadratic(np.eye(2), [[1.0]]), N, params)
    plans = ddp.solve(problem, np.ones((2, 2)), np.zeros((2, N, 1)))
    with pytest.raises(ArgumentError, match="steps of 0.05 to 0.1 s"):
        ddp.TrackingPolicy(plans)
    assert [ddp.TrackingPolicy(plans.select(i)).step_size for i in range(2)] == [0.05, 0.1]


@pytest.mark.parametrize(
    "more, needs",
    [
        ({"disturbances": {"delay": 0.2}}, "Disturbances.delay"),
        ({"disturbances": {"hold": slcp.Uniform(0.1, 0.2)}}, "Disturbances.hold"),
        ({"disturbances": {}, "measures": {"price": m.cost()}}, "the cost that is measured"),
    ],
)
def test_worlds_of_steps_of_their_own_have_nothing_that_counts_in_steps(more, needs):
    """A delay of .2 s was .15 to .35 s in worlds whose steps were drawn, and windows of terms as much off."""
    drawn = slcp.Disturbances(parameters={"step_size": slcp.Uniform(0.05, 0.2)}, **more["disturbances"])
    terms = slcp.costs.terms(CART, [slcp.costs.Term("square", 1.0, control=0, start=0.2, end=0.4)])
    task = slcp.Task("drawn", CART, terms, N, disturbances=drawn, measures=more.get("measures", {}))
    with pytest.raises(ArgumentError, match=f"{needs} count.* in steps of 0.1 s; the worlds make steps"):
        slcp.sweep(task, STILL, worlds=4, cases=slcp.Options("hard"), device="cpu")
    slcp.sweep(task.replace(measures={}, disturbances=replace(drawn, delay=0.0, hold=0.0)), STILL, worlds=4,
               cases=slcp.Options("hard"), device="cpu")  # fmt: skip
