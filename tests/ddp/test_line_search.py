"""The choice of a step size: by the costs of the candidates, whatever they are."""

import numpy as np
import pytest
import warp as wp
from ddp_examples import cart_pole, random_linear_problem

from slcp_warp import ddp
from slcp_warp.ddp.parts.passes import Passes
from slcp_warp.kernels.control.status import TRACE_COST, TRACE_REDUCTION, TRACE_STEP_SIZE

SIZES = (1.0, 0.5, 0.25)


def accept(costs, cost, expected=(-1.0, 0.0), failed=(), ratio=np.inf):
    """What a pass makes of candidates: the workspace after `accept` on costs (3,), the nominal cost given."""
    problem, x0, u0 = cart_pole("cpu")
    work = ddp.Workspace(problem, 1, ddp.Options(step_sizes=SIZES, full_step_ratio=ratio))
    work.run(x0, u0, max_iterations=0)
    out, state = work._candidates, work._state
    state.active.fill_(1)
    state.status.zero_()
    state.cost.fill_(cost)
    state.expected.assign(np.array([expected]))
    before = state.mu.numpy().copy()
    out.cost.assign(np.array([costs]))
    out.status.assign(np.isin(np.arange(3), failed).astype(np.int32)[None])
    marks = np.arange(3.0)[None, :, None, None] + 1.0
    out.us.assign(np.broadcast_to(marks, out.us.shape).copy())
    out.xs.assign(np.broadcast_to(marks, out.xs.shape).copy())
    nominal = work.us.numpy().copy()
    work._passes._run_accept()
    taken = work.us.numpy()
    assert np.array_equal(taken, nominal) or (np.ptp(taken) == 0.0 and np.ptp(work.xs.numpy()) == 0.0)
    chosen = None if np.array_equal(taken, nominal) else int(taken.flat[0]) - 1
    raised = state.mu.numpy()[0] > before[0]
    return chosen, float(state.cost.numpy()[0]), raised, work._state.trace.numpy()[0, 0]


@pytest.mark.parametrize(
    "costs, chosen",
    [
        ((9.5, 9.2, 9.4), 1),  # the lowest, not the first or the last
        ((9.2, 9.4, 9.5), 0),
        ((12.0, 11.0, 9.9), 2),  # the long steps raise the cost
        ((12.0, 11.0, 10.1), None),  # all do
        ((10.0, 10.0, 10.0), None),  # nothing is gained
        ((np.inf, 9.7, np.inf), 1),  # two leave where the dynamics works
        ((np.inf, np.inf, np.inf), None),
    ],
)
def test_the_lowest_cost_below_the_nominal_is_taken(costs, chosen):
    taken, cost, raised, trace = accept(costs, 10.0)
    assert trace[TRACE_COST] == cost and trace[TRACE_REDUCTION] == 10.0 - cost
    assert trace[TRACE_STEP_SIZE] == (0.0 if chosen is None else SIZES[chosen])
    assert taken == chosen
    assert cost == (10.0 if chosen is None else costs[chosen])
    assert raised == (chosen is None)  # nothing gained: the next direction is more careful


def test_a_step_that_expects_a_rise_is_not_taken():
    """J should change by alpha dV1 + alpha^2 dV2: here it falls for the short step only."""
    taken, cost, _, trace = accept((9.0, 9.5, 9.9), 10.0, expected=(-1.0, 3.0))
    assert (taken, cost) == (2, 9.9)
    assert trace[TRACE_REDUCTION] == pytest.approx(0.1) and trace[TRACE_STEP_SIZE] == 0.25


@pytest.mark.parametrize("method", ["second-order", "gauss-newton", "first-order"])
def test_no_pass_raises_the_cost_where_full_steps_would(method):
    """From wild controls, with the costs that the trace claims rolled out again."""
    problem, x0, _ = cart_pole("cpu")
    wild = 30.0 * np.random.default_rng(3).standard_normal((problem.horizon, 1))
    seen = []
    for passes in range(8):
        result = ddp.solve(problem, x0, wild, ddp.Options(method=method, max_iterations=passes))
        again = ddp.solve(problem, x0, result.us, ddp.Options(max_iterations=0))
        assert again.cost == pytest.approx(result.cost, rel=1e-12)
        seen.append(result.cost)
    assert (np.diff(seen) <= 0.0).all() and seen[-1] < 0.9 * seen[0]


@pytest.mark.parametrize(
    "costs, ratio, chosen",
    [
        ((9.4, 9.0, 9.2), 0.5, 0),  # three fifths of what was promised: the first suffices
        ((9.6, 9.0, 9.2), 0.5, 1),  # two fifths: the others are asked
        ((9.4, 9.0, 9.2), np.inf, 1),  # it never does
        ((np.inf, 9.0, 9.2), 0.5, 1),
    ],
)
def test_the_first_step_size_suffices_where_it_keeps_its_promise(costs, ratio, chosen):
    assert accept(costs, 10.0, ratio=ratio)[0] == chosen


def test_stages_and_one_launch_give_the_same_bits():
    """Six problems, some of which need the others: which were rolled out changes nothing."""
    problem, x0, _ = cart_pole("cpu")
    us = 3.0 * np.random.default_rng(4).standard_normal((6, problem.horizon, 1))
    found, others = [], []
    for staged in (True, False):
        work = ddp.Workspace(problem, 6, ddp.Options(max_iterations=25))
        work._passes = Passes(work, work._policy, staged)
        work._candidates.cost.fill_(-7.0)
        found.append(work.solve(x0, us))
        others.append(work._candidates.cost.numpy()[:, 1:].copy())
    for name in ("xs", "us", "K", "Vxx", "cost", "status", "iterations"):
        assert np.array_equal(getattr(found[0], name), getattr(found[1], name)), name
    steps = found[0].trace.step_size
    assert (steps == 1.0).any() and ((steps > 0.0) & (steps < 1.0)).any()
    assert not (others[1] == -7.0).any()


def test_what_is_not_needed_is_not_rolled_out():
    """On a CPU the first step size alone, where it suffices."""
    problem, data = random_linear_problem(0)
    work = ddp.Workspace(problem, 1, ddp.Options(max_iterations=5, regularization=ddp.Regularization(0.0)))
    work._candidates.cost.fill_(-7.0)
    work.run(data["x0"], np.zeros((problem.horizon, problem.nu)))
    assert int(work.passes.numpy()[0]) >= 1 and (work._candidates.cost.numpy()[0, 1:] == -7.0).all()


def test_a_pass_of_a_gpu_reads_nothing(monkeypatch):
    """Rolled out with all step sizes at once, a pass waits for no number: that is asked after it."""
    problem, data = random_linear_problem(4)
    work = ddp.Workspace(problem, 2)
    work.start(np.tile(data["x0"], (2, 1)), np.zeros((problem.horizon, problem.nu)))
    work._passes = Passes(work, work._policy, staged=False)
    before = work.cost.numpy().copy()
    with monkeypatch.context() as patch:
        for name in ("numpy", "assign"):
            patch.setattr(wp.array, name, lambda *_: pytest.fail("copied over the host"))
        work.differentiate()
        work.backward()
        work.search()
    assert (work.cost.numpy() < before).all()
