"""Which of many starts is kept."""

from types import SimpleNamespace

import numpy as np
import pytest
from ddp_examples import cart_pole

from slcp_warp import ddp
from slcp_warp.ddp.multistart import solve as multistart


@pytest.mark.parametrize(
    "cost, converged, best",
    [
        ([3.0, 1.0, 2.0, 5.0], [1, 1, 1, 1], 1),
        ([3.0, 1.0, 2.0, 5.0], [1, 0, 1, 1], 2),  # a lower cost that is not a minimum does not count
        ([3.0, 1.0, 2.0, 5.0], [0, 0, 0, 1], 3),
        ([3.0, 1.0, 2.0, 5.0], [0, 0, 0, 0], 1),  # none converged: the lowest
        ([np.inf, 4.0, np.inf, 5.0], [0, 0, 0, 0], 1),
    ],
)
def test_the_best_is_the_lowest_that_converged(monkeypatch, cost, converged, best):
    converged = np.array(converged, bool)
    status = np.where(converged, ddp.Status.CONVERGED, ddp.Status.MAX_ITERATIONS)
    made = SimpleNamespace(cost=np.array(cost), converged=converged, status=status, select=lambda i: i)
    seen = {}

    class Workspace:
        def __init__(self, problem, batch, options):
            seen.update(batch=batch, schedule=options.regularization.rows())

        def solve(self, x0, us):
            seen.update(us=us)
            return made

    monkeypatch.setattr(multistart, "Workspace", Workspace)
    problem, x0, u0 = cart_pole("cpu")
    starts = np.arange(2.0)[:, None, None] * np.ones((2, *u0.shape))
    schedules = multistart.Regularization(
        initial=[0.5, 1.5], state_weight=[1.0, 0.0], control_weight=[0.0, 1.0]
    )
    found = multistart.solve_multistart(problem, x0, starts, schedules=schedules)
    assert (found.index, found.best) == (best, best) and seen["batch"] == 4
    # every start under every schedule: entry i is start i // 2 under schedule i % 2
    np.testing.assert_array_equal(seen["us"][:, 0, 0], [0.0, 0.0, 1.0, 1.0])
    np.testing.assert_array_equal(seen["schedule"][:, 0], [0.5, 1.5, 0.5, 1.5])
