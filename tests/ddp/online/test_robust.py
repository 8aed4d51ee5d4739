"""Plans for disturbed worlds: made for those in which the nominal plan fails, judged in all."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import ddp

SHOVE = Path(__file__).parents[3] / "examples" / "tasks" / "shove.toml"


@pytest.mark.slow
def test_a_shove_is_planned_for_other_blocks():
    """More of the worlds end well than under the nominal plan, in a sweep of others, too."""
    own = slcp.Disturbances(parameters={"mass": 0.2, "friction": 0.2})
    task = slcp.load_task(SHOVE).replace(disturbances=own)
    found = ddp.plan_in_worlds(task, models=12, worlds=128, rounds=1)
    assert found.index > 0 and found.success[found.index] == found.success.max()
    assert found.success[found.index] > found.success[0] + 0.1
    assert (found.problem.params["mass"] != task.simulator().params["mass"]).all()
    moved = ddp.solve(found.problem, task.start[0], found.best.us, ddp.Options(max_iterations=0))
    np.testing.assert_allclose(moved.cost, found.best.cost, rtol=1e-9)
    policies = {
        name: ddp.TrackingPolicy(plan, task.scene.state_period)
        for name, plan in (("robust", found.best), ("nominal", ddp.plan(task).best))
    }
    report = slcp.sweep(task, policies, worlds=512, seed=11, cases=replace(task.options, residual="hard"))
    held = {name: report.part(name)["success"].mean() for name in policies}
    assert held["robust"] > held["nominal"] + 0.05
    for name, told in (("robust", found.chosen), ("nominal", found.nominal)):
        assert told[1] - 0.05 < held[name] < told[2] + 0.05
    assert found.nominal[0] < found.chosen[0]


@pytest.mark.full
def test_a_grip_is_planned_for_heavier_discs():
    """The nominal plan holds what it was made for; judged anew, in worlds that nobody planned for."""
    task = slcp.tasks.grasp_hold()
    found = ddp.plan_in_worlds(task, models=8, worlds=128)
    assert found.success[0] < 0.87 and found.success[found.index] > 0.95
    assert found.success[found.index] == found.success.max() and found.problem.params.worlds is None
    period, case = task.scene.state_period, replace(task.options, residual="hard")
    nominal = ddp.plan(task).best
    policies = {
        "robust": ddp.TrackingPolicy(found.best, period),
        "nominal": ddp.TrackingPolicy(nominal, period),
    }
    report = slcp.sweep(task, policies, worlds=256, seed=11, cases=case)
    held = {name: report.part(name)["success"].mean() for name in policies}
    assert held["robust"] > 0.95 and held["nominal"] < 0.9
    assert report.part("robust", arm="undisturbed")["success"].all()
    moved = ddp.solve(found.problem, task.start[0], found.best.us, ddp.Options(max_iterations=0))
    np.testing.assert_allclose(moved.cost, found.best.cost, rtol=1e-9)


@pytest.mark.full
def test_numbers_are_lent_by_worlds_in_which_the_best_plan_fails():
    """Of one round: where the nominal plan is tracked with the numbers of the plan that is kept, it fails."""
    task = slcp.tasks.grasp_hold()
    found = ddp.plan_in_worlds(task, models=8, worlds=128, rounds=1)
    assert found.index > 0 and found.success[found.index] > found.success[0]
    hard = slcp.Simulator(task.scene, replace(task.options, residual="hard"), device="cpu")
    own = {name: found.problem.params[name] for name in ("mass", "inertia", "friction")}
    lowest = []
    for plan in (ddp.plan(task).best, found.best):
        policy = ddp.TrackingPolicy(plan, task.scene.state_period)
        run = hard.rollout(task.start[0], params=hard.params.replace(**own), policy=policy, steps=task.steps)
        lowest.append(run.states[:, 3].min())
    assert lowest[0] < -0.05 < lowest[1]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"task": "grasp_hold"}, "task is a str"),
        ({"models": 0}, "models is 0"),
        ({"case": "hard"}, "case is a str"),
        ({"task": slcp.tasks.grasp_hold().replace(success=None)}, "has no success"),
        ({"task": slcp.tasks.flicking_finger()}, "runs 400 steps, and its plans have 75"),
    ],
)
def test_what_cannot_be_judged_is_refused(changes, message):
    with pytest.raises(slcp.InputError, match=message):
        ddp.plan_in_worlds(**{"task": slcp.tasks.grasp_hold(), **changes})
