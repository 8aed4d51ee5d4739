"""Sensitivity indices against closed forms (Ishigami 1990, the g-function) and against SciPy's."""

import math

import numpy as np
import pytest
from scipy import stats

import slcp_warp as slcp
from slcp_warp.ensembles.statistics.given_data import first_order
from slcp_warp.ensembles.statistics.sensitivity import Sensitivity
from slcp_warp.ensembles.statistics.sobol import sobol_indices
from slcp_warp.ensembles.statistics.source import MemorySource

KEY = ("policy", "hard", 0.01, "disturbed")


def ishigami(u):
    """Of (3, n) numbers in (0, 1)."""
    x = np.pi * (2.0 * u - 1.0)
    return np.sin(x[0]) + 7.0 * np.sin(x[1]) ** 2 + 0.1 * x[2] ** 4 * np.sin(x[0])


def of_ishigami():
    """Indices of first and total order in closed form (Saltelli et al. 2008), a = 7, b = .1."""
    a, b, p = 7.0, 0.1, math.pi
    one, two = 0.5 * (1.0 + b * p**4 / 5.0) ** 2, a**2 / 8.0
    both = b**2 * p**8 * (1.0 / 18.0 - 1.0 / 50.0)
    total = one + two + both
    return np.array([one, two, 0.0]) / total, np.array([one + both, two, both]) / total


WEIGHTS = np.array([0.0, 1.0, 4.5, 9.0, 99.0])


def g_function(u):
    """Of (5, n) numbers in (0, 1)."""
    return np.prod((np.abs(4.0 * u - 2.0) + WEIGHTS[:, None]) / (1.0 + WEIGHTS[:, None]), axis=0)


def of_g_function():
    part = 1.0 / (3.0 * (1.0 + WEIGHTS) ** 2)
    total = np.prod(1.0 + part) - 1.0
    return part / total, part * np.prod(1.0 + part) / (1.0 + part) / total


FUNCTIONS = {"ishigami": (ishigami, of_ishigami), "g": (g_function, of_g_function)}


def results(function, count, seed=0):
    """A, B and AB of a function of independent numbers."""
    dimension = len(FUNCTIONS[function][1]()[0])
    a, b = np.random.default_rng(seed).random((2, dimension, count))
    f, ab = FUNCTIONS[function][0], np.repeat(a[None], dimension, 0)
    for j in range(dimension):
        ab[j, j] = b[j]
    return f(a), f(b), np.array([f(x) for x in ab])


@pytest.mark.parametrize("function", FUNCTIONS)
def test_indices_are_those_of_the_closed_form(function):
    """Within three half widths of their intervals, which are at most .05 wide."""
    found = sobol_indices(*results(function, 16384))
    for intervals, exact in zip((found.first, found.total), FUNCTIONS[function][1]()):
        value, low, high = np.array(intervals).T
        half = 0.5 * (high - low)
        assert (low <= value).all() and (value <= high).all() and half.max() < 0.05
        assert (np.abs(value - exact) < 3.0 * half + 1e-3).all()


def test_indices_are_those_of_scipy():
    a, b, ab = results("ishigami", 1024)
    ours = sobol_indices(a, b, ab)
    theirs = stats.sobol_indices(func={"f_A": a[None], "f_B": b[None], "f_AB": ab[:, None]}, n=1024)
    np.testing.assert_allclose(np.array(ours.first)[:, 0], theirs.first_order.ravel(), rtol=1e-10)
    np.testing.assert_allclose(np.array(ours.total)[:, 0], theirs.total_order.ravel(), rtol=1e-10)


def test_intervals_hold_the_truth_as_often_as_they_say():
    """Of 100 repetitions 95 in the mean; 88 or fewer have a probability of .3 % then."""
    truth = np.concatenate(of_ishigami())
    inside = np.zeros(len(truth))
    for seed in range(100):
        found = sobol_indices(*results("ishigami", 512, seed), seed)
        low, high = np.array([*found.first, *found.total]).T[1:]
        inside += (low <= truth) & (truth <= high)
    assert inside.min() > 88, inside


def seldom(x):
    """Success of (3, n) normal numbers, in 3 % of them; the index of total order of each, by quadrature."""
    return (x[0] + 0.5 * x[1] + 0.3 * x[2] * x[0] > 2.2).astype(float)


@pytest.mark.parametrize("count, least", [(160, 0.0), (1600, 0.9)])
def test_intervals_of_a_rare_result_hold_the_truth_or_are_none(count, least):
    """Indices from 400,000 rows; of 160, five fail: half of the intervals of first order were too narrow."""
    rng = np.random.default_rng(0)

    def drawn(n):
        a, b = rng.standard_normal((2, 3, n))
        ab = np.repeat(a[None], 3, 0)
        for j in range(3):
            ab[j, j] = b[j]
        return sobol_indices(seldom(a), seldom(b), np.array([seldom(x) for x in ab]))

    known, held, told = drawn(400_000), np.zeros(6), np.zeros(6)
    truth = np.array([v for v, _, _ in (*known.first, *known.total)])
    for _ in range(60):
        found = drawn(count)
        value, low, high = np.array([*found.first, *found.total]).T
        assert np.isfinite(value).all()
        told += np.isfinite(low)
        held += (low <= truth) & (truth <= high)
    assert (held >= 0.8 * told - 2.0).all()
    assert told[[0, 3]].min() >= least * 60  # of the first number, which matters most
    assert (told[1:3] <= 6).all()  # of first order of the others too few rows say something


def test_rows_without_a_number_are_left_out():
    a, b, ab = results("g", 1024)
    ab[2, ::7] = np.nan
    keep = np.arange(1024) % 7 > 0
    found = sobol_indices(a, b, ab)
    assert found == sobol_indices(a[keep], b[keep], ab[:, keep]) and found.samples == keep.sum()
    nothing = sobol_indices(np.ones(8), np.ones(8), np.ones((2, 8)))
    assert np.isnan(nothing.first).all() and nothing.variance == 0.0
    assert np.isnan(sobol_indices(a[:1], b[:1], ab[:, :1]).total).all()


def sweep_of(function, count, seed=0, cuts=()):
    dimension = len(FUNCTIONS[function][1]()[0])
    u = np.random.default_rng(seed).random((dimension, count))
    y = FUNCTIONS[function][0](u) + 1e5
    rows = {"world": np.arange(count), **{f"drawn_{j}": u[j].astype(np.float32) for j in range(dimension)},
            "y": y, "success": y > np.median(y), "status": np.zeros(count, np.int32)}  # fmt: skip
    source = MemorySource()
    edges = [0, *cuts, count]
    for begin, end in list(zip(edges, edges[1:]))[::-1]:
        source.add(KEY, {name: column[begin:end] for name, column in rows.items()})
    return source


@pytest.mark.parametrize("function", FUNCTIONS)
def test_the_table_of_a_sweep_has_the_indices_of_first_order(function):
    """Bins miss what a function varies within them: a hundredth at most here."""
    source, exact = sweep_of(function, 32768), FUNCTIONS[function][1]()[0]
    for j, truth in enumerate(exact):
        value, low, high = first_order(source, KEY, f"drawn_{j}", "y")
        assert high - low < 0.05 and abs(value - truth) < 1.5 * (high - value) + 0.01


def test_intervals_from_a_table_hold_the_truth_as_often_as_they_say():
    truth = of_ishigami()[0]
    inside = np.zeros(3)
    for seed in range(60):
        source = sweep_of("ishigami", 2048, seed)
        found = [first_order(source, KEY, f"drawn_{j}", "y") for j in range(3)]
        inside += [low <= t <= high for (_, low, high), t in zip(found, truth)]
    assert inside.min() >= 51, inside  # of 57 in the mean; fewer have a probability of .8 %


def way(speed, friction):
    """How far a box slides, its mean by a bell's speed to other powers, by quadrature."""
    return np.sign(speed) * speed**2 / (19.62 * friction)


@pytest.mark.parametrize("count", [100, 400, 1600])
def test_what_matters_most_is_not_made_less_by_wide_bins(count):
    """A bell has half of what it varies in a few bins at its ends, within which a function is no constant."""
    bell, weight = np.polynomial.hermite_e.hermegauss(80)
    even, share = np.polynomial.legendre.leggauss(80)
    weight, share = weight / weight.sum(), share / share.sum()
    all_ways = way(1.0 + 0.2 * bell[:, None], 0.35 + 0.15 * even)
    means = all_ways @ share
    spread = weight @ (all_ways**2 @ share) - (weight @ means) ** 2
    truth = (weight @ means**2 - (weight @ means) ** 2) / spread
    found = []
    for seed in range(200):
        rng, source = np.random.default_rng(seed), MemorySource()
        speed, friction = 1.0 + 0.2 * rng.standard_normal(count), rng.uniform(0.2, 0.5, count)
        rows = {"world": np.arange(count), "drawn_0": speed, "y": way(speed, friction)}
        source.add(KEY, rows | {"success": speed > 1.0, "status": np.zeros(count, np.int32)})
        found.append(first_order(source, KEY, "drawn_0", "y"))
    value, low, high = np.array(found).T
    assert abs(value.mean() - truth) < 0.01  # a mean for every bin: .05, .03 and .013 below
    assert ((low <= truth) & (truth <= high)).mean() > 0.9
    assert (high < truth).mean() < 0.06


def test_a_report_says_what_matters(tmp_path):
    source = sweep_of("g", 8192)
    rows = source.pieces[KEY][0]
    rounding = 1e-4 * np.random.default_rng(9).random(8192)  # puts some neighbours in another order
    rows |= {"drawn_same_0": 2.0 * rows["drawn_0"] + rounding, "drawn_constant": np.ones(8192)}
    assert (np.argsort(rows["drawn_same_0"]) != np.argsort(rows["drawn_0"])).any()
    report = slcp.Report(None, source)
    found = report.sensitivity("y")
    assert set(found.names) == {"0, same_0", "1", "2", "3", "4"} and found.worlds == 8192
    assert [found.names[i] for i in found.order[:2]] == ["0, same_0", "1"]
    assert str(found).splitlines()[3].startswith("  0, same_0") and np.isnan(found.total).all()
    assert report.sensitivity().measure == "success"
    cut = slcp.Report(None, sweep_of("g", 8192, cuts=(1, 1000, 4097))).sensitivity("y")
    assert cut.first == [found.first[i] for i in range(5)]
    lines = found.save(tmp_path / "sensitivity.csv").read_text().splitlines()
    assert len(lines) == 6 and lines[1].startswith('y,policy,8192,"0, same_0",')


def test_what_does_not_vary_has_no_shares_and_says_so():
    source = sweep_of("g", 1024)
    source.pieces[KEY][0] |= {"y": np.full(1024, 3.0)}
    found = slcp.Report(None, source).sensitivity("y")
    assert np.isnan(found.first).all() and "no shares: y is the same in all worlds" in str(found)
    assert "no shares" not in str(slcp.Report(None, sweep_of("g", 1024)).sensitivity("y"))


def test_indices_say_which_rows_they_are_of():
    source = sweep_of("g", 8192)
    rows = source.pieces[KEY][0]
    rows["y"] = np.where(np.arange(8192) % 4, np.inf, rows["y"])
    found = slcp.Report(None, source).sensitivity("y")
    assert found.finite == 0.25 and "of the 25 % of samples where y is finite" in str(found)
    assert slcp.Report(None, sweep_of("g", 8192)).sensitivity("y").finite == 1.0


def test_what_cannot_be_answered_is_refused(tmp_path):
    report = slcp.Report(None, sweep_of("g", 100))
    assert np.isnan(slcp.Report(None, sweep_of("g", 4)).sensitivity("y").first).all()
    with pytest.raises(slcp.InputError, match="measure is 'z'"):
        report.sensitivity("z")
    with pytest.raises(slcp.InputError, match="policy is 'mpc'; choose from"):
        report.sensitivity("y", "mpc")
    with pytest.raises(slcp.InputError, match="ends in '.txt'"):
        report.sensitivity("y").save(tmp_path / "a.txt")
    bare = MemorySource()
    bare.add(KEY, {"world": np.arange(9), "success": np.ones(9, bool), "status": np.zeros(9, int)})
    with pytest.raises(slcp.InputError, match="no columns drawn_"):
        slcp.Report(None, bare).sensitivity()


def test_shares_beyond_one_are_said_to_be_none():
    """One world in 256 makes all the variance: whose number it was, so few samples cannot tell."""
    rng = np.random.default_rng(3)
    a, b = rng.standard_normal((2, 256))
    ab = np.stack([np.where(np.arange(256) == 7, 1e4, a), a])
    found = sobol_indices(a, b, ab)
    told = Sensitivity("x", "p", ("one", "two"), found.first, found.total, 1024)
    assert found.total[0][0] > 10.0 and "shares beyond 1 are none" in str(told)
    fine = sobol_indices(a, b, np.stack([b, a]))
    assert "beyond 1" not in str(Sensitivity("x", "p", ("one", "two"), fine.first, fine.total, 1024))
