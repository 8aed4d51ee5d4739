"""Published problems of optimal control: one default call comes to the cost that is known."""

import numpy as np
import pytest

from slcp_warp import ddp
from slcp_warp.scripts.studies.published.models import PROBLEMS, balanced_pole

KNOWN = {"rendezvous": 23370.774, "acrobot": 44.5133, "cart-pole": 1.4943, "car": 1.4361}


def test_the_acrobot_is_trajaxs():
    """Its cost under zero controls is in trajax's tests."""
    given = PROBLEMS["acrobot"]("cpu")
    still = ddp.solve(given.problem, given.x0, np.zeros((50, 1)), ddp.Options(max_iterations=0))
    assert float(still.cost) == pytest.approx(4959.476212, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", KNOWN)
def test_one_default_call(name):
    given = PROBLEMS[name]("cpu")
    best = ddp.plan(given.problem, x0=given.x0).best
    assert best.status == ddp.Status.CONVERGED and best.positive_definite
    assert float(best.cost) == pytest.approx(KNOWN[name], rel=5e-5)
    again = ddp.solve(given.problem, given.x0, best.us, ddp.Options(max_iterations=0))
    assert float(again.cost) == pytest.approx(float(best.cost), rel=1e-9)


@pytest.mark.slow
def test_a_balanced_pole_from_one_default_call():
    """A rollout under zeros swings through; it costs hundreds of times what balancing does."""
    given = balanced_pole("cpu")
    fell = ddp.solve(given.problem, given.x0, np.zeros((100, 1)), ddp.Options(max_iterations=0))
    best = ddp.solve(given.problem, given.x0)
    assert best.converged and float(fell.cost) > 100.0 * float(best.cost)
    assert np.abs(best.xs[:, 1] - np.pi).max() < 0.11 and best.iterations <= 10
