"""Published problems of optimal control: one default call comes to the cost that is known."""

import numpy as np
import pytest

from slcp_warp import ddp
from slcp_warp.scripts.studies.published.models import PROBLEMS, balanced_pole, cart_pole

KNOWN = {"rendezvous": 23370.774, "acrobot": 44.5133, "cart-pole": 1.4943, "car": 1.4361}


def test_the_acrobot_is_trajaxs():
    """Its cost under zero controls is in trajax's tests."""
    given = PROBLEMS["acrobot"]("cpu")
    still = ddp.solve(given.problem, given.x0, np.zeros((50, 1)), ddp.Options(max_iterations=0))
    assert float(still.cost) == pytest.approx(4959.476212, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["car", "acrobot", *(pytest.param(name, marks=pytest.mark.full) for name in ("rendezvous", "cart-pole"))],
)
def test_one_default_call(name):
    given = PROBLEMS[name]("cpu")
    best = ddp.plan(given.problem, x0=given.x0).best
    # which of the two it is, is up to rounding: from the minimum on improvements drown in it
    assert best.status in (ddp.Status.CONVERGED, ddp.Status.SMALL_IMPROVEMENT) and best.positive_definite
    assert float(best.cost) == pytest.approx(KNOWN[name], rel=5e-5)
    again = ddp.solve(given.problem, given.x0, best.us, ddp.Options(max_iterations=0))
    assert float(again.cost) == pytest.approx(float(best.cost), rel=1e-9)


@pytest.mark.full
@pytest.mark.parametrize(
    ("order", "cost", "constrained"),
    [(2, 1.449817, 1.451226), (3, 1.494334, 1.495874), (4, 1.484706, 1.486187)],
)
def test_the_cart_poles_cost_is_its_rules(order, cost, constrained):
    """With the goal as a final cost, and with a weight that makes it Altro's constraint."""
    soft, hard = (cart_pole("cpu", order, weight) for weight in (100.0, 1e6))
    best = ddp.plan(soft.problem, x0=soft.x0).best
    assert best.converged and float(best.cost) == pytest.approx(cost, abs=2e-6)
    held = ddp.solve(hard.problem, hard.x0, best.us)
    assert held.converged and float(held.cost) == pytest.approx(constrained, abs=2e-6)
    assert np.abs(held.xs[-1] - [0.0, np.pi, 0.0, 0.0]).max() < 1e-6


@pytest.mark.slow
def test_a_balanced_pole_from_one_default_call():
    """A rollout under zeros swings through; it costs hundreds of times what balancing does."""
    given = balanced_pole("cpu")
    fell = ddp.solve(given.problem, given.x0, np.zeros((100, 1)), ddp.Options(max_iterations=0))
    best = ddp.solve(given.problem, given.x0)
    assert best.converged and float(fell.cost) > 100.0 * float(best.cost)
    assert np.abs(best.xs[:, 1] - np.pi).max() < 0.11 and best.iterations <= 10
