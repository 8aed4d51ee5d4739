"""Upper ends of shares of failures that a margin does not lead to, and margins beyond their bounds."""

import numpy as np
import pytest
from scipy import stats
from simulators import driven_cart

import slcp_warp as slcp
from slcp_warp import measures
from slcp_warp.ensembles.questions.rare.estimate import estimate
from slcp_warp.ensembles.questions.rare.interval import island_interval
from slcp_warp.ensembles.questions.rare.margin import Margin
from slcp_warp.ensembles.questions.rare.silent import Silent
from slcp_warp.ensembles.questions.rare.splitting import Effort, Moves, StuckError, pilot, run_islands
from slcp_warp.ensembles.statistics import share_interval
from slcp_warp.measures import final, first_time, state

CART = driven_cart(1.0)
SHIFT, SPEED = 0.1, 0.02  # standard deviations at the start; nothing pushes the cart
STILL = slcp.policies.Linear([[0.0, 0.0]])
EFFORT = {"islands": 8, "particles": 200, "length": 10, "case": slcp.Options("hard", "none"), "device": "cpu"}


def fast(sds):
    """Of carts that are faster: never, unless one starts so, and then at once."""
    return first_time(state("cart.vshift") > sds * SPEED) > 1.0


def task(success, **changes):
    drawn = slcp.Disturbances(start={"cart.shift": slcp.Normal(SHIFT), "cart.vshift": slcp.Normal(SPEED)})
    return slcp.Task("drift", CART, duration=0.2, disturbances=drawn, measures={}, success=success, **changes)


def islands(score, seed, most=14):
    """Of two numbers: eight islands, and the levels they went down."""
    rng, effort, moves = np.random.default_rng(seed), Effort(200, 10, most=most), Moves(2)
    levels = pilot(score, moves, effort, 800, rng)
    return run_islands(score, levels, moves, effort, 8, rng)


def hidden(beta, far):
    """Fails in one number, of which the margin says nothing: it falls in the other one, up to `far`."""
    return lambda z: np.where(z[:, 1] > beta, -1.0, far - z[:, 0])


@pytest.mark.parametrize("beta, far, alone", [(2.88, 99.0, False), (3.8, 99.0, False), (4.75, 99.0, False),
                                              (3.8, 5.0, True), (4.75, 5.0, True)])  # fmt: skip
def test_the_interval_holds_what_no_level_leads_to(beta, far, alone):
    """Where nothing fails along the margin; where something does, and a condition is known to be silent."""
    truth, found = stats.norm.sf(beta) + stats.norm.sf(far), []
    for seed in range(40):
        of = islands(hidden(beta, far), seed)
        found.append(estimate(of, alone))
        assert len(of.ended) > 0 or not of.failing.any()  # what failed is kept, also where chains lost it
        assert (hidden(beta, far)(of.ended) <= 0.0).all()
    assert sum(each.low <= truth <= each.high for each in found) >= 37


def test_levels_that_lead_to_failing_bound_it_alone():
    """As tight as the islands' spread, and nothing that would be said of it."""
    jumps = 0
    for seed in range(20):
        found = islands(lambda z: 4.265 - z[:, 0], seed, most=30)
        of = estimate(found)
        jumps += of.jumps
        assert of.jumps or (of.share, of.low, of.high) == pytest.approx(island_interval(found.shares))
        assert of.jumps or of.high < 0.2 * of.plain
    assert jumps <= 2


def test_every_level_has_the_share_as_its_mean():
    rng, effort = np.random.default_rng(0), Effort(100, 10)
    levels = pilot(lambda z: 2.33 - z[:, 0], Moves(2), effort, 800, rng)
    found = run_islands(lambda z: 2.33 - z[:, 0], levels, Moves(2), effort, 3000, rng)
    for level in range(len(found.totals)):
        own = found.failed(level)
        assert own.mean() == pytest.approx(stats.norm.sf(2.33), abs=4.0 * own.std() / np.sqrt(3000))
    np.testing.assert_allclose(own, found.shares)


def test_failures_that_chains_lose_are_counted():
    """Met by plain worlds, and not below: of the level that met them, and said."""
    found = islands(lambda z: 5.0 - z[:, 0], 0)
    met, below = np.zeros_like(found.failing), found.failing.copy()
    met[0, 0], below[0, :4] = 3, 30
    for failing, high in ((met, 3 / 1600), (below, 120 / 1600)):
        found.failing = failing
        of = estimate(found)
        assert of.jumps and of.low < high < of.high
    assert estimate(found).share == found.failed(len(found.totals) - 1).mean()


@pytest.mark.parametrize("seed", range(3))
def test_a_condition_that_is_silent_is_named(seed):
    """The time of what never happens: of two conditions, the levels lead to the other one."""
    both = task(final("cart.shift").between(-0.65, 0.65) & fast(3.8))
    found = slcp.failure_share(both, seed=seed, policy=STILL, **EFFORT)
    assert found.silent == (repr(first_time(state("cart.vshift") > 3.8 * SPEED)),)
    assert found.low < stats.norm.sf(3.8) < found.high and found.high >= found.plain > 0.0023
    assert "plain worlds alone bound failing by first_time" in str(found).splitlines()[0]


def test_conditions_that_say_something_are_not_silent():
    clear = final("cart.shift").between(-0.4, 0.4) & (final("cart.vshift") < 0.08)
    found = slcp.failure_share(task(clear), seed=0, policy=STILL, **EFFORT)
    assert found.silent == () and not found.jumps and found.high < 0.2 * found.plain
    assert found.low < 3.0 * stats.norm.sf(4.0) < found.high  # up to what the speed moves the cart by


def test_silent_are_those_that_are_the_same_where_worlds_succeed():
    ends, time, mean = (
        final("cart.shift"),
        first_time(state("cart.vshift") > 1.0),
        measures.mean("cart.shift"),
    )
    own = task((ends < 1.0) & (time > 1.0) & (mean < 2.0))
    values = np.array([[0.1, np.inf, 3.0], [0.2, np.inf, 3.0], [0.3, 0.5, 7.0]])
    silent = Silent(own, Margin(own))
    silent.look(values, np.array([True, True, False]))
    assert silent.names == (repr(time), repr(mean))
    silent.look(values + 1.0, np.ones(3, bool))
    assert silent.names == ()
    failing = own.replace(failure=state("cart.shift") > 5.0)
    assert Silent(failing, Margin(failing)).names[-1] == "failure"
    assert Silent(failing, Margin(failing, ends)).names == ()


@pytest.mark.parametrize("smallest", [1e-3, 1e-6])
def test_where_nothing_fails_plain_worlds_bound_it(smallest):
    found = slcp.failure_share(task(final("cart.shift") > -9.0), smallest=smallest, policy=STILL, **EFFORT)
    assert found.share == found.low == 0.0 and found.high == found.plain == share_interval(0, 1600)[2]
    assert found.led < 10.0 * smallest and f"leads to failing: {found.led:.2g}" in str(found)
    assert found.failing is None and found.levels[-1] == found.reached[-1] == 0.0


def test_a_margin_goes_on_falling_beyond_its_bound():
    """A bound before the task's own, and measures below 0, lead to failing as the success itself does."""
    ends, truth = final("cart.shift"), stats.norm.sf(0.4, scale=np.hypot(SHIFT, 0.2 * SPEED))
    for margin in (ends > -0.2, ends, ends > -0.6):
        found = slcp.failure_share(task(ends > -0.4), margin=margin, seed=1, policy=STILL, **EFFORT)
        assert found.low < truth < found.high and found.high < 4.0 * found.share
        assert found.levels[-1] == -np.inf and (np.diff(found.levels) < 0.0).all()


def test_scores_have_the_order_of_the_given_margin():
    ends = final("cart.shift")
    judge = Margin(task(ends > -3.0), ends > -1.0)
    scores = judge.score(np.array([[0.0], [-1.5], [-2.5], [np.nan], [-5.0]]), np.arange(5) < 4)
    assert scores[:3].tolist() == [1.0, -0.5, -1.5] and scores[3] > judge.event == scores[4] == -np.inf


def test_a_stuck_margin_says_what_to_give():
    with pytest.raises(
        StuckError, match="Give as `margin` a measure that goes on falling until the task fails"
    ):
        slcp.failure_share(task(fast(9.0)), policy=STILL, **EFFORT)
