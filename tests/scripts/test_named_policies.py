"""Policies as the commands name them: what `mpc` and `mpc:FILE` plan from."""

from dataclasses import replace

import pytest

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.scripts.support.policies import named_policy


@pytest.fixture(scope="module")
def task():
    """A run as long as a plan: six steps of the finger."""
    return slcp.tasks.flicking_finger().replace(horizon=6, duration=0.3, measures={}, success=None)


def test_mpc_plans_ahead_and_no_further_than_the_run(task):
    policy, facts = named_policy("mpc", task.scene, task)
    assert facts == {"policy": "mpc"} and policy.end == 6
    assert list(policy.starts) == ["shift", "plan", "zero", "noise"]
    run = task.simulator().rollout(task.start, policy=policy, steps=6, record="controls")
    best = ddp.plan(task).best
    assert policy.failures == 0 and abs(cost(task, run) - float(best.cost)) < 1e-6
    longer, _ = named_policy("mpc", task.scene, task.replace(duration=0.35))
    assert longer.end is None


def cost(task, run):
    """Of section V: sum of -theta_3 + .05 |u|^2."""
    return float((0.05 * (run.controls[0] ** 2).sum(1) - run.states[0, :-1, 2]).sum())


def test_mpc_takes_a_file_of_a_plan(task, tmp_path):
    plan = ddp.solve(ddp.problem_of(task), task.start[0], [[0.1, 0.0]] * 6, ddp.Options(max_iterations=3))
    path = plan.save(tmp_path / "plan.npz")
    policy, _ = named_policy(f"mpc:{path}", task.scene, task)
    assert list(policy.starts) == ["shift", "plan", "zero", "noise"] and policy.end == 6
    other = slcp.tasks.hopper_hop()
    with pytest.raises(slcp.InputError, match="was planned for scene 'flicking_finger'"):
        named_policy(f"mpc:{path}", other.scene, other)
    small = replace(plan, us=plan.us[:, :1])
    with pytest.raises(slcp.InputError, match=r"plan.us has shape \(6, 1\)"):
        ddp.MPC(ddp.problem_of(task), plan=small)
