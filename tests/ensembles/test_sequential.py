"""Intervals that hold at all times: exact wealth, errors as promised under peeking, decisions."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from slcp_warp.ensembles.questions.sequential import Look, decision
from slcp_warp.ensembles.statistics.any_law import RunningBoundedMean, RunningMedian, rank_above
from slcp_warp.ensembles.statistics.bets import log_wealth
from slcp_warp.ensembles.statistics.moments import Moments
from slcp_warp.ensembles.statistics.sequential import (
    RunningDifference,
    paired_share_interval,
    running_mean_interval,
)


def wealth(mean, gained, lost, worlds):
    """Mean wealth of bets that the mean is larger, by quadrature over the share of what may be lost."""

    def log(u):
        stake = u / (1.0 + mean)
        return (gained * math.log1p(stake * (1 - mean)) + lost * math.log1p(-stake * (1 + mean))
                + (worlds - gained - lost) * math.log1p(-stake * mean))  # fmt: skip

    most = max(log(u) for u in np.linspace(1e-6, 1 - 1e-6, 5001))
    return quad(lambda u: math.exp(log(u) - most), 0.0, 1.0, limit=400)[0] * math.exp(most)


@pytest.mark.parametrize(
    "gained, lost, worlds", [(30, 10, 1000), (12, 0, 5000), (400, 300, 1000), (0, 3, 50)]
)
def test_ends_are_where_the_bets_have_earned_what_they_must(gained, lost, worlds):
    value, low, high = paired_share_interval(gained, lost, worlds, 0.05)
    assert value == (gained - lost) / worlds and -1.0 <= low < value < high <= 1.0
    assert wealth(low, gained, lost, worlds) == pytest.approx(40.0, rel=0.05)
    assert wealth(-high, lost, gained, worlds) == pytest.approx(40.0, rel=0.05)
    mirrored = paired_share_interval(lost, gained, worlds, 0.05)
    assert mirrored == pytest.approx((-value, -high, -low), abs=1e-12)


def test_without_worlds_nothing_is_known():
    assert all(math.isnan(end) for end in paired_share_interval(0, 0, 0, 0.05))
    assert paired_share_interval(1, 0, 1, 0.05)[1:] == pytest.approx((-0.97468, 1.0), abs=1e-4)
    assert math.isnan(running_mean_interval(Moments.of(np.ones(1)), 0.05)[1])


def ever_outside(outside, repetitions=200):
    """In how many repetitions the truth is outside of the interval at any look."""
    return sum(bool(outside(np.random.default_rng(seed)).any()) for seed in range(repetitions))


def successes(gain, loss):
    def draw(rng, worlds):
        u = rng.random(worlds)
        return {"success": u < gain}, {"success": (u >= gain) & (u < gain + loss)}

    return draw


@pytest.mark.parametrize("gain, loss", [(0.1, 0.1), (0.01, 0.01), (0.3, 0.1), (0.02, 0.0)])
def test_the_truth_is_outside_at_any_look_as_seldom_as_promised(gain, loss):
    """Of 200 repetitions 5 % are 10; 19 or more have a probability of .7 % if the promise just holds."""

    def outside(rng):
        gained, lost, _ = rng.multinomial(64, (gain, loss, 1 - gain - loss), size=100).cumsum(axis=0).T
        worlds, truth, most = 64 * np.arange(1, 101), gain - loss, math.log(40.0)
        return np.array([
            log_wealth(truth, a, b, n) >= most or log_wealth(-truth, b, a, n) >= most
            for a, b, n in zip(gained.tolist(), lost.tolist(), worlds.tolist())
        ])  # fmt: skip

    assert ever_outside(outside) < 19


def test_means_of_skewed_numbers_are_outside_as_seldom_as_promised():
    def outside(rng):
        known, ends = RunningDifference("x", 0.05), []
        for _ in range(60):
            known.add({"x": rng.exponential(size=128)}, {"x": np.ones(128)})
            ends.append(known.interval()[1:])
        low, high = np.array(ends)[1:].T
        return (low > 0.0) | (high < 0.0)

    assert ever_outside(outside) < 19


def test_seldom_losses_are_not_overlooked():
    """Equal means, of a small gain in 999 worlds and a large loss in one: before it came all is undecided."""

    def outside(rng):
        known, said = RunningDifference("x", 0.05), []
        for _ in range(16):
            gains = np.where(rng.random(256) < 1e-3, -999.0, 1.0)
            known.add({"x": gains}, {"x": np.zeros(256)})
            said.append(decision(Look(known.worlds, *known.interval()), None, 256) != "undecided")
        return np.array(said)

    same = running_mean_interval(Moments.of(np.ones(10_000)), 0.05)
    assert same == (1.0, -math.inf, math.inf)
    assert (
        ever_outside(outside) < 50
    )  # of 200: more than of numbers that are nearly normal, not three in four


HEAVY = {  # differences with median 0, of which most have no mean that a sample tells
    "Cauchy": lambda rng, n: rng.standard_cauchy(n),
    "lognormal": lambda rng, n: np.exp(3.0 * rng.standard_normal(n)) - 1.0,
    "a seldom loss": lambda rng, n: np.where(rng.random(n) < 1e-3, -999.0, 1.0) * (rng.random(n) < 0.5),
    "t of 1.5": lambda rng, n: rng.standard_t(1.5, n),
}
MOST = math.log(100.0)
LOSSES = {  # values in [0, 1] and their means
    "seldom": (lambda rng, n: (rng.random(n) < 1e-3).astype(float), 1e-3),
    "lognormal, cut": (lambda rng, n: np.exp(np.minimum(3 * rng.standard_normal(n) - MOST, 0)), 0.126718569),
    "even": (lambda rng, n: rng.random(n), 0.5),
}


def wrong_medians(draw, repetitions, looks):
    def outside(rng):
        known, ends = RunningMedian(0.05), []
        for _ in range(looks):
            known.add(draw(rng, 256))
            ends.append(known.interval()[1:])
        low, high = np.array(ends).T
        return (low > 0.0) | (high < 0.0)

    return ever_outside(outside, repetitions)


def wrong_bounded_means(draw, mean, repetitions, looks):
    def outside(rng):
        known, ends = RunningBoundedMean(0.0, 1.0, 0.05), []
        for _ in range(looks):
            known.add(draw(rng, 256))
            ends.append(known.interval()[1:])
        low, high = np.array(ends).T
        return (low > mean) | (high < mean)

    return ever_outside(outside, repetitions)


@pytest.mark.parametrize("law", HEAVY)
def test_medians_are_outside_as_seldom_as_promised_whatever_the_law(law):
    assert wrong_medians(HEAVY[law], 200, 8) < 19


@pytest.mark.parametrize("law", LOSSES)
def test_bounded_means_are_outside_as_seldom_as_promised_whatever_the_law(law):
    assert wrong_bounded_means(*LOSSES[law], 200, 8) < 19


@pytest.mark.full
def test_of_two_thousand_repetitions_at_most_a_twentieth_is_wrong():
    """With -s: of how many the interval leaves out the truth at some of 32 looks, 256 worlds apart."""

    def mean(rng, draw, truth):
        known, ends = RunningDifference("x", 0.05), []
        for _ in range(32):
            known.add({"x": draw(rng, 256)}, {"x": np.zeros(256)})
            ends.append(known.interval()[1:])
        low, high = np.array(ends).T
        return (low > truth) | (high < truth)

    for law, draw in HEAVY.items():
        wrong = wrong_medians(draw, 2000, 32)
        print(f"median, {law}: {wrong} of 2,000")
        assert wrong <= 100
    for law, (draw, truth) in LOSSES.items():
        wrong = wrong_bounded_means(draw, truth, 2000, 32)
        without = ever_outside(lambda rng, draw=draw, truth=truth: mean(rng, draw, truth), 2000)
        print(f"mean within bounds, {law}: {wrong} of 2,000; without bounds {without}")
        assert wrong <= 100


@pytest.mark.parametrize("count", [1, 5, 8, 40, 1000])
def test_a_median_is_judged_by_signs(count):
    """As many below as bets that half are had to become rich: by quadrature."""
    rank = rank_above(count, 0.05)
    assert rank > count or wealth(0.0, rank, count - rank, count) >= 0.98 * 40.0
    assert wealth(0.0, rank - 1, count - rank + 1, count) <= 1.02 * 40.0
    known, values = RunningMedian(0.05), np.random.default_rng(count).standard_normal(count)
    known.add(values)
    middle, low, high = known.interval()
    assert middle == np.median(values) and low <= middle <= high
    assert (low == -math.inf) == (high == math.inf) == (rank > count)
    if rank <= count:
        assert (values <= high).sum() == rank == (values >= low).sum()


def test_a_bounded_mean_is_that_of_its_paper():
    """Theorem 2 of Waudby-Smith and Ramdas (2024), value after value; batches make no difference."""
    rng = np.random.default_rng(4)
    values = rng.beta(0.3, 2.0, 700)
    means, squares, sums = 0.5, 0.25, np.zeros(3)
    for i, x in enumerate(values, start=1):
        weight = min(math.sqrt(2 * math.log(40.0) / (squares / i * i * math.log(1 + i))), 0.5)
        sums += weight, weight * x, 4.0 * (x - means) ** 2 * (-math.log(1.0 - weight) - weight) / 4.0
        means = (0.5 + values[:i].sum()) / (i + 1)
        squares += (x - means) ** 2
    middle, half = sums[1] / sums[0], (math.log(40.0) + sums[2]) / sums[0]
    for cuts in ([], [1, 2, 300], [256, 512]):
        known = RunningBoundedMean(-2.0, 6.0, 0.05)
        for part in np.split(8.0 * values - 2.0, cuts):
            known.add(part)
        expected = (values.mean(), middle - half, middle + half)
        assert known.interval() == pytest.approx([8.0 * v - 2.0 for v in expected], abs=1e-9)


def test_what_is_beyond_bounds_counts_as_the_bound():
    known = RunningDifference("x", 0.05, bounds=(0.0, 10.0))
    known.add({"x": np.array([1.0, np.inf, 50.0, np.nan])}, {"x": np.array([3.0, np.inf, -np.inf, 1.0])})
    assert known.worlds == 3 and known.interval()[0] == pytest.approx((-2.0 + 0.0 + 10.0) / 3.0)
    median = RunningDifference("x", 0.05, "median")
    median.add({"x": np.array([np.inf, np.inf, 2.0])}, {"x": np.array([1.0, np.inf, 5.0])})
    assert median.worlds == 3 and median.interval() == (0.0, -math.inf, math.inf)


def test_fixed_intervals_do_not_hold_under_peeking():
    """What is avoided: the interval for one look leaves out the truth at some look."""

    def outside(rng):
        sums = 8.0 * rng.standard_normal(100).cumsum()
        return np.abs(sums) > 1.96 * np.sqrt(64 * np.arange(1, 101))

    assert ever_outside(outside) > 50


def test_a_difference_is_found():
    """16 % of the worlds differ by one; the fixed design of 80 % power needs 1,562 worlds for such a one."""
    stopped = []
    for seed in range(40):
        rng, known = np.random.default_rng(seed), RunningDifference("success", 0.05)
        while known.worlds < 20_000:
            known.add(*successes(0.05, 0.03)(rng, 256))
            if decision(Look(known.worlds, *known.interval()), None, 1) != "undecided":
                break
        assert known.interval()[1] > 0.0
        stopped.append(known.worlds)
    assert 700 < np.median(stopped) < 3500


@pytest.mark.parametrize(
    "low, high, worlds, said",
    [(0.1, 0.2, 300, "larger"), (-0.2, -0.1, 300, "smaller"), (-0.04, 0.03, 300, "equal"),
     (-0.06, 0.03, 300, "undecided"), (0.1, 0.2, 255, "undecided"), (0.0, 0.2, 300, "undecided"),
     (math.nan, math.nan, 300, "undecided")],
)  # fmt: skip
def test_decisions(low, high, worlds, said):
    assert decision(Look(worlds, 0.5 * (low + high), low, high), 0.05, 256) == said


def test_means_that_differ_by_chance_are_equal_within_a_margin():
    known = RunningDifference("x", 0.05)
    known.add({"x": 0.01 * np.random.default_rng(0).standard_normal(512)}, {"x": np.zeros(512)})
    assert decision(Look(known.worlds, *known.interval()), 0.05, 256) == "equal"


def test_worlds_without_a_number_count_for_no_mean():
    known = RunningDifference("x", 0.05)
    known.add({"x": np.array([1.0, np.nan, 3.0, np.inf])}, {"x": np.array([0.5, 1.0, 1.0, 1.0])})
    assert known.worlds == 2 and known.interval()[0] == 1.25


def test_the_study_of_stopping_counts_what_it_says():
    """A difference of a tenth is decided early everywhere, between equals nothing is."""
    from slcp_warp.scripts.studies.stopping import study

    rng = np.random.default_rng(8)
    first, second = rng.random((2, 20, 2048)) < np.array([0.9, 0.8])[:, None, None]
    ends = study(first.ravel(), second.ravel(), "success", 2048, 256)
    assert ends["sequential"].share("larger") == ends["fixed"].share("larger") == 1.0
    assert max(ends["sequential"].worlds) < 2048 == ends["fixed"].worlds[0]
    assert ends["sequential, equals"].share("larger", "smaller") <= 0.05
    assert len(ends["peeking, equals"].said) == 20
