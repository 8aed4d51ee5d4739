"""Starts of MPC that users write: what they are given and give, and plans of another scene."""

from dataclasses import replace

import numpy as np
import pytest
from simulators import driven_cart

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.costs import Term, effort, terms
from slcp_warp.inputs.errors import ArgumentError

N = 8
CART = driven_cart()
X0 = np.array([[0.1, 0.0], [-0.2, 0.3]])


@pytest.fixture(scope="module")
def problem():
    cost = terms(CART, [Term("square", 5.0, state="cart.shift", target=0.5), effort(0.01)])
    return ddp.Problem(slcp.Simulator(CART, device="cpu", dtype="float64"), cost, N)


def run(problem, *starts, **more):
    policy = ddp.MPC(problem, starts=list(starts), passes=0, **more)
    return policy, problem.dynamics.rollout(X0, policy=policy, steps=5, record="controls")


def policy_of(worlds, horizon):
    """Of a cart, of any sizes."""
    return ddp.StartPolicy(
        np.zeros((worlds, horizon, 1)), np.zeros((worlds, horizon + 1, 2)), np.zeros((worlds, horizon, 1, 2)),
        np.zeros((worlds, horizon, 1)),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("sizes", "said"),
    [((1, N), r"start 'mine' gave us of shape \(1, 8, 1\); \(2, 8, 1\) is needed"),
     ((2, N + 3), r"start 'mine' gave us of shape \(2, 11, 1\); \(2, 8, 1\) is needed")],
)  # fmt: skip
def test_a_policy_of_other_sizes_is_named(problem, sizes, said):
    def mine(s):
        return policy_of(*sizes)

    with pytest.raises(ArgumentError, match=said):
        run(problem, "shift", mine)


def test_a_start_that_is_not_finite_is_passed_over(problem):
    """In the worlds where it is not, and there alone; the others take it."""

    def halting(s):
        us = np.full((2, N, 1), 3.0)
        us[1, 4] = np.nan
        return us

    policy, found = run(problem, halting)
    steady = np.full((2, N, 1), 3.0)
    _, expected = run(problem, lambda s: steady)
    np.testing.assert_array_equal(found.controls[0], expected.controls[0])
    assert not found.controls[1].any() and policy.failures == 5


@pytest.mark.parametrize("field", ["x", "worlds", "noise", "last.us", "last.xs", "last.K", "last.k"])
def test_what_other_starts_are_made_from_cannot_be_changed(problem, field):
    def meddling(s):
        if s.last is not None:
            held = s
            for name in field.split("."):
                held = getattr(held, name)
            held += 1
        return None

    with pytest.raises(ValueError, match="read-only"):
        run(problem, "shift", "zero", meddling)


def test_a_copy_of_the_last_controls_is_a_start_of_its_own(problem):
    def pushed(s):
        return None if s.last is None else s.last.us + 1e3  # never the best

    _, alone = run(problem, "shift", "zero")
    policy, found = run(problem, "shift", "zero", pushed)
    assert policy.chosen["pushed"] == 0
    np.testing.assert_array_equal(found.controls, alone.controls)


def test_a_plan_of_a_scene_with_other_names_is_refused(problem):
    other = replace(CART, name="sledge", bodies=(replace(CART.bodies[0], name="sledge"),),
                    actuators=(slcp.Actuator("sledge"),))  # fmt: skip
    cost = terms(other, [Term("square", 1.0, state=0), effort(1.0)])
    plan = ddp.solve(ddp.Problem(slcp.Simulator(other, device="cpu", dtype="float64"), cost, N), other.x0)
    with pytest.raises(ArgumentError, match="plan is of scene 'sledge', with state_names"):
        ddp.MPC(problem, plan=plan)
