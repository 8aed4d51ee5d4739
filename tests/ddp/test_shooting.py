"""Multiple shooting: states to start from that no rollout gives, with gaps that the passes close."""

import numpy as np
import pytest
from ddp_examples import cart_pole, random_linear_problem

from slcp_warp import ddp


def balanced(horizon=60):
    """The pole stands, a little off; zero controls let it fall."""
    problem, _, _ = cart_pole("cpu", horizon=horizon)
    return problem, np.array([0.1, 0.1, 0.0, 0.0]), np.zeros((horizon, 1))


def replayed(problem, x0, us):
    """States that the dynamics goes through under controls."""
    return ddp.solve(problem, x0, us, ddp.Options(max_iterations=0)).xs


def test_a_linear_problem_is_solved_in_one_pass_from_any_states():
    """Whatever the gaps: the first full step closes them, and it is the minimum."""
    problem, data = random_linear_problem(3)
    rng = np.random.default_rng(0)
    us, xs = rng.standard_normal((15, 2)), 5.0 * rng.standard_normal((16, 4))
    options = ddp.Options(regularization=ddp.Regularization(0.0))
    shot = ddp.solve(problem, data["x0"], us, options, xs0=xs)
    rolled = ddp.solve(problem, data["x0"], us, options)
    assert shot.converged and shot.trace.step_size[0] == 1.0
    assert shot.trace.cost[0] == pytest.approx(rolled.cost, rel=1e-9)
    np.testing.assert_allclose(shot.us, rolled.us, atol=1e-8)
    np.testing.assert_allclose(shot.xs, replayed(problem, data["x0"], shot.us), atol=1e-9)


def test_expected_change_with_gaps_is_the_actual_one():
    """(M44), of a linear-quadratic problem exact: what is expected of the full step is what it brings."""
    problem, data = random_linear_problem(5)
    rng = np.random.default_rng(1)
    us, xs = rng.standard_normal((1, 15, 2)), rng.standard_normal((1, 16, 4))
    work = ddp.Workspace(problem, 1, ddp.Options(regularization=ddp.Regularization(0.0)))
    assert work.start(data["x0"], us, xs, limit=1) == 1
    before = shooting_cost(data, us[0], xs[0])
    change = work._state.expected.numpy()[0].sum()
    assert work.cost.numpy()[0] - before == pytest.approx(change, rel=1e-9)


def shooting_cost(data, us, xs):
    """Cost of states and controls, whether they belong together or not; the first state is x0."""
    e = np.vstack([data["x0"], xs[1:]]) - data["target"]
    running = sum(0.5 * (a @ data["Q"] @ a + u @ data["R"] @ u) for a, u in zip(e, us, strict=False))
    return running + 0.5 * e[-1] @ data["Qf"] @ e[-1]


def test_a_balanced_pole_from_zero_controls():
    """A rollout falls over and ends elsewhere; shooting from the first state, held, balances the pole."""
    problem, x0, us = balanced()
    held = np.tile(x0, (len(us) + 1, 1))
    shot = ddp.solve(problem, x0, us, xs0=held)
    fell = ddp.solve(problem, x0, us, ddp.Options(max_iterations=0))
    assert fell.cost > 1000.0 * shot.cost
    assert shot.converged and shot.positive_definite and shot.iterations <= 10
    np.testing.assert_allclose(shot.xs, replayed(problem, x0, shot.us), atol=1e-5)
    assert np.abs(shot.xs[:, 1]).max() < 0.3


def test_the_default_start_is_the_better_one():
    """Without controls: those of a stabilised start where a rollout under zeros is worse, else zeros."""
    problem, x0, us = balanced()
    starts = np.stack([x0, [0.0, np.pi, 0.0, 0.0]])
    found = ddp.solve(problem, starts)
    alone = ddp.solve(problem, x0, us, xs0=np.tile(x0, (len(us) + 1, 1)))
    assert found.cost[0] == pytest.approx(alone.cost, rel=1e-6)
    assert found.converged.all()
    one = ddp.solve(problem, x0)
    assert one.xs.ndim == 2 and one.cost == pytest.approx(alone.cost, rel=1e-6)


def test_gaps_that_passes_leave_open_are_closed_by_a_rollout():
    problem, x0, _ = cart_pole("cpu")
    rng = np.random.default_rng(2)
    xs = 3.0 * rng.standard_normal((4, problem.horizon + 1, 4))
    for passes in (0, 1, 3):
        found = ddp.solve(problem, np.tile(x0, (4, 1)), np.zeros((4, problem.horizon, 1)),
                          ddp.Options(max_iterations=passes), xs0=xs)  # fmt: skip
        good = np.isfinite(found.cost)
        assert good.any()
        again = ddp.solve(problem, found.xs[good, 0], found.us[good], ddp.Options(max_iterations=0))
        np.testing.assert_allclose(found.cost[good], again.cost, rtol=1e-6)
        assert (found.iterations <= passes).all()


def test_states_where_a_step_fails():
    problem, x0, us = balanced()
    held = np.tile(x0, (len(us) + 1, 1))
    held[7, 3] = 1e200
    found = ddp.solve(problem, x0, us, xs0=held)
    assert found.status in (ddp.Status.CONVERGED, ddp.Status.DYNAMICS_FAILED)
    assert np.isfinite(found.cost) == (found.status == ddp.Status.CONVERGED)


def test_gaps_that_a_part_of_a_step_leaves():
    """A step alpha leaves 1 - alpha of every gap: the states of the trajectory tell."""
    problem, data = random_linear_problem(7)
    rng = np.random.default_rng(4)
    us, xs = rng.standard_normal((1, 15, 2)), rng.standard_normal((1, 16, 4))
    xs[:, 0] = data["x0"]
    work = ddp.Workspace(problem, 1, ddp.Options(step_sizes=(0.25,), regularization=ddp.Regularization(0.0)))
    before = xs[0, :-1] @ data["A"].T + us[0] @ data["B"].T + data["c"] - xs[0, 1:]
    work.start(data["x0"], us, xs, limit=0)
    work.xs.assign(xs)
    work.us.assign(us)
    work._shooting.shoot()
    work._shooting.start()
    work.differentiate()
    work._shooting.backward()
    work._shooting.search()
    x, u = work.xs.numpy()[0], work.us.numpy()[0]
    gaps = x[:-1] @ data["A"].T + u @ data["B"].T + data["c"] - x[1:]
    np.testing.assert_allclose(gaps, 0.75 * before, atol=1e-9)
    np.testing.assert_allclose(work._shooting.policy.gaps.numpy()[0], gaps, atol=1e-9)


def test_neighbours_change_no_start():
    """A plan of a batch is the one that its problem has alone, beside starts that are stabilised or not."""
    problem, _, _ = cart_pole("cpu", horizon=60)
    x0 = np.zeros((6, 4))
    x0[:, 1] = [0.05, 0.3, 0.9, 1.6, 2.1, 3.1]
    options = ddp.Options(max_iterations=8)
    found = ddp.solve(problem, x0, None, options)
    for i, start in enumerate(x0):
        alone = ddp.solve(problem, start, None, options)
        np.testing.assert_array_equal(alone.us, found.us[i])
        assert (alone.cost, alone.iterations, alone.status) == (
            *(found.cost[i], found.iterations[i], found.status[i]),
        )
