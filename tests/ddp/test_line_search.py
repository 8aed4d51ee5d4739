"""The choice of a step size: by the costs of the candidates, whatever they are."""

import numpy as np
import pytest
from ddp_examples import cart_pole

from slcp_warp import ddp
from slcp_warp.kernels.control.status import TRACE_COST, TRACE_REDUCTION, TRACE_STEP_SIZE

SIZES = (1.0, 0.5, 0.25)


def accept(costs, cost, expected=(-1.0, 0.0), failed=()):
    """What a pass makes of candidates: the workspace after `accept` on costs (3,), the nominal cost given."""
    problem, x0, u0 = cart_pole("cpu")
    work = ddp.Workspace(problem, 1, ddp.Options(step_sizes=SIZES))
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
    work._run_accept()
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
