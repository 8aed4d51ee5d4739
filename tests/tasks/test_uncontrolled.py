"""Tasks of scenes without controls: starts and parameters drawn, measures, a success, no policy, no plan."""

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp import measures as m

SCENE = slcp.scenes.ball_drop()
HARD = slcp.Options(residual="hard")  # the kernels of all tests here: one sweep in float64
TIME, FAR = 0.6, 0.5
FALL = {
    "start": {"ball.x": 0.1, "ball.vx": slcp.Uniform(0.5, 1.5)}, "parameters": {"ball.mass": 0.2},
    "kick_times": (0.3,), "kicks": {"ball.vx": 0.2},
}  # fmt: skip


def throw(**changes):
    fields = {"name": "throw", "scene": SCENE, "duration": TIME, "options": HARD,
              "success": m.final("ball.x") > FAR, "disturbances": slcp.Disturbances(**FALL),
              "measures": {"x": m.final("ball.x"), "y": m.final("ball.y")}}  # fmt: skip
    return slcp.Task(**fields | changes)


def exact(worlds):
    """Where the balls are at the end, from their starts and kicks: nothing pushes them sideways."""
    return worlds.x0[:, 0] + TIME * worlds.x0[:, 3] + (TIME - 0.3) * worlds.kicks[:, 0, 0]


def test_a_sweep_needs_no_policy(device):
    report = slcp.sweep(throw(), worlds=40, seed=3, device=device, dtype="float64")
    assert [row["policy"] for row in report.summary] == ["none", "none"] and len(report.summary) == 2
    found, x = report.part("none"), exact(slcp.draw_worlds(throw(), 40, 3, dtype="float64", device=device))
    np.testing.assert_allclose(found["x"], x, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found["success"], x > FAR)
    assert 0 < found["success"].sum() < 40 and not found["status"].any()
    np.testing.assert_allclose(found["y"], 0.1, atol=1e-9)  # all of them lie on the ground
    assert np.ptp(found["drawn_ball.mass"]) > 0.1


def test_questions_need_none_either(device):
    cpu = {"device": device, "dtype": "float64"}
    factors = slcp.sensitivity(throw(), measure="x", samples=256, **cpu)
    share = {name: total[0] for name, total in zip(factors.names, factors.total)}
    variance = {"ball.x": 0.1**2, "ball.vx": TIME**2 / 12.0, "kick_0_ball.vx": (0.3 * 0.2) ** 2}
    for name, part in variance.items():
        assert abs(share[name] - part / sum(variance.values())) < 0.15, name
    grid = slcp.robustness_map(throw(), None, ("ball.x", [-2.0, 0.0]), ("mass", [1.0, 2.0]), worlds=8, **cpu)
    assert grid.policy == "none" and not grid.successes[:, 0].any()
    failing = slcp.failure_share(throw(), islands=4, particles=100, smallest=0.01, **cpu)
    counted = 1.0 - slcp.sweep(throw(), worlds=4000, seed=9, **cpu).summary[0]["success"][0]
    assert failing.low - 0.03 < counted < failing.high + 0.03
    found = slcp.falsify(throw(), by="kick", worlds=64, rounds=3, strategies=2, **cpu)
    run = found.replay(None)
    assert found.found and run.states[0, -1, 0] <= FAR and (run.status == 0).all()


def test_files_and_names(tmp_path):
    slcp.save_task(throw(), tmp_path / "throw.json")
    again = slcp.load_task(tmp_path / "throw.json")
    assert (
        again.horizon is None
        and again.cost is slcp.costs.NO_COST
        and again.disturbances == throw().disturbances
    )
    assert "plans of" not in repr(again) and "runs of 0.6 s" in repr(again)
    assert slcp.Task("plan", SCENE, horizon=20).duration == 20 * SCENE.step_size


PUSH = slcp.scenes.push_block()


@pytest.mark.parametrize(
    "wrong, text",
    [
        (lambda: slcp.Task("throw", SCENE), "Task.duration is None and Task.horizon, too"),
        (lambda: throw(measures={"c": m.cost()}), "Task.measures.'c'. is of the cost; the task has none"),
        (lambda: ddp.plan(throw()), "task 'throw' has no controls and no cost and no horizon"),
        (lambda: ddp.problem_of(slcp.Task("push", PUSH, horizon=9)), "has no cost; there is nothing to plan"),
        (lambda: slcp.sweep(slcp.tasks.catch()), "policy is None; scene 'catch' has the controls"),
        (lambda: slcp.costs.terms(SCENE, [slcp.costs.effort(1.0)]), "but of controls, of which there are"),
    ],
)
def test_what_is_missing_is_named(wrong, text):
    with pytest.raises(slcp.InputError, match=text):
        wrong()
