"""Rounds of multipliers where passes converge slowly, and what is said of limits that are not kept."""

from dataclasses import replace

import numpy as np
import pytest
from ddp_examples import cart_pole
from test_state_limits import double_integrator

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.results.excess import worst
from slcp_warp.scripts.commands.optimise import tell_limits

TASK = slcp.tasks.push_to_mark()
FAST = TASK.scene.state_index("block.vx")


def test_rounds_begin_though_passes_gain_a_little_still():
    """Gauss-Newton on a pole between walls: of 60 passes the first round had all, and missed by 9 cm."""
    free, x0, u0 = cart_pole("cpu", limits=(-15.0, 15.0))
    reach = 0.7 * np.abs(ddp.solve(free, x0, u0, ddp.Options(max_iterations=400)).xs[:, 0]).max()
    limits = (np.array([-reach, -np.inf, -np.inf, -np.inf]), np.array([reach, np.inf, np.inf, np.inf]))
    problem = replace(free, state_limits=limits)
    few, many = (
        ddp.solve(problem, x0, u0, ddp.Options(method="gauss-newton", max_iterations=n)) for n in (60, 200)
    )
    assert few.status == ddp.Status.MAX_ITERATIONS and many.converged
    assert few.keeps_limits(1e-3) and many.keeps_limits(1e-3)
    assert few.cost == pytest.approx(float(many.cost), rel=1e-3)


def test_rounds_are_each_problems_own():
    """One that needs rounds beside one that needs none comes out as alone, to the bit."""
    upper = np.array([[np.inf, 0.3], [np.inf, np.inf]])
    problem, x0 = double_integrator((np.full((2, 2), -np.inf), upper))
    options = ddp.Options(max_iterations=4, step_sizes=(0.25,))
    both = ddp.solve(problem, np.tile(x0, (2, 1)), np.zeros((2, 30, 1)), options)
    for i, row in enumerate(upper):
        alone = ddp.solve(double_integrator((-np.inf, row))[0], x0, np.zeros((30, 1)), options)
        assert both.us[i].tobytes() == alone.us.tobytes() and both.status[i] == alone.status


def test_what_ends_beyond_its_limits_says_by_how_much_and_when():
    """Passes that were used up left MAX_ITERATIONS, and no word of limits."""
    problem, x0 = double_integrator(([-np.inf, -np.inf], [np.inf, 0.4]))
    broken = ddp.solve(problem, x0, np.zeros((30, 1)), ddp.Options(max_iterations=1))
    step, by = int(broken.xs[:, 1].argmax()), broken.xs[:, 1].max() - 0.4
    said = f"x[1] by {by:.3g} in step {step}"
    assert broken.status == ddp.Status.STATE_LIMITS and by > 0.05
    assert broken.beyond_limits() == said and said in repr(broken) and said in str(broken)
    assert not broken.keeps_limits(1e-3) and broken.keeps_limits(1.01 * by)
    batch = broken.as_batch()
    assert batch.beyond_limits() == [said] and batch.keeps_limits(1e-3).tolist() == [False]
    lower, upper = broken.state_limits
    within = replace(broken, state_limits=(lower, upper + [0.0, by - 5e-4]))
    assert within.beyond_limits() == f"x[1] by 0.0005 in step {step}"  # less than the passes' tolerance
    assert "beyond its limits x" not in repr(within) and "by 0.0005" not in str(within)
    soft = ddp.solve(problem, x0, np.zeros((30, 1)), ddp.Options(max_iterations=1, limit_rounds=0))
    assert soft.status == ddp.Status.MAX_ITERATIONS
    free = ddp.solve(double_integrator(None)[0], x0, np.zeros((30, 1)))
    assert free.beyond_limits() == "" and free.keeps_limits(0.0) and "beyond" not in str(free)


def test_the_worst_is_relative_to_limits_above_one():
    xs = np.array([[[9.0, 9.0], [0.0, 1.5], [101.0, 0.0]]])
    limits = np.array([[-np.inf, -np.inf]]), np.array([[100.0, 1.0]])
    (found,) = worst(xs, limits)
    assert (found.state, found.step, found.by) == (1, 1, 0.5)
    assert found.text(("x", "y"), 0.1) == "y by 0.5 at 0.1 s"
    assert worst(xs, (limits[0], np.full((1, 2), np.inf))) == [None]


@pytest.fixture(scope="module")
def broken():
    """A push that is to be no faster than 1 cm/s, after two passes."""
    task = TASK.replace(state_limits={"block.vx": (-np.inf, 0.01)})
    start, options = np.full((task.horizon, 1), 5.0), ddp.Options(method="gauss-newton", max_iterations=2)
    return ddp.solve(ddp.problem_of(task, task.simulator(device="cpu")), task.start[0], start, options)


def test_a_file_keeps_the_limits_that_a_plan_was_to_keep(broken, tmp_path):
    again = ddp.Result.load(broken.save(tmp_path / "plan.npz"))
    assert "block.vx by " in broken.beyond_limits() and broken.beyond_limits().endswith(" s")
    assert again.beyond_limits() == broken.beyond_limits()
    for bad in ((np.zeros((1, 2)), np.ones((1, 2))), (np.ones((1, 8)), np.zeros((1, 8))),
                (np.zeros((3, 8)), np.ones((3, 8)))):  # fmt: skip
        path = replace(broken, state_limits=bad).save(tmp_path / "bad.npz")
        with pytest.raises(slcp.FileError, match="state"):
            ddp.Result.load(path)


def test_the_command_says_what_a_plan_breaks(broken, capsys):
    tell_limits(broken)
    said = " ".join(capsys.readouterr().err.split())
    assert "breaks the task's state_limits" in said and broken.beyond_limits() in said
    tell_limits(replace(broken, state_limits=None))
    assert not capsys.readouterr().err


def test_the_best_of_what_did_not_converge_keeps_its_limits():
    """What breaks them costs less, and was the best."""
    problem, x0 = double_integrator(([-np.inf, -np.inf], [np.inf, 0.4]))
    kept, free = (ddp.solve(p, x0, np.zeros((30, 1))).us for p in (problem, double_integrator(None)[0]))
    options = ddp.Options(max_iterations=0)
    found = ddp.solve_multistart(
        problem, x0, np.stack([0.99 * kept, 0.99 * free]), options, ddp.Regularization()
    )
    assert found.all.status.tolist() == [ddp.Status.MAX_ITERATIONS, ddp.Status.STATE_LIMITS]
    assert found.all.cost[1] < found.all.cost[0] and found.index == 0
