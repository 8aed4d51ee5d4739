"""Streamed statistics of synthetic tables against NumPy on whole columns, in chunks of any size and order."""

import math
import warnings
import weakref

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import slcp_warp as slcp
from slcp_warp.ensembles.statistics.intervals import quantile_interval, share_interval, shares_interval
from slcp_warp.ensembles.statistics.moments import Z95, Moments
from slcp_warp.ensembles.statistics.quantiles import quantile_intervals
from slcp_warp.ensembles.statistics.source import BLOCK, MemorySource, in_blocks
from slcp_warp.scripts.benchmarks.cost.statistics import Made

A, B = ("a", "hard", 0.01, "disturbed"), ("b", "hard", 0.01, "disturbed")


def rows(seed, count):
    """A part with failed worlds, infinite values and a measure that is much larger than its spread."""
    rng = np.random.default_rng(seed)
    status = rng.choice([0, 0, 0, 0, 2, 3], count).astype(np.int32)
    x = (1e6 + rng.standard_normal(count)).astype(np.float32)
    time = np.where(rng.random(count) < 0.1, np.inf, rng.exponential(size=count))
    solved = status == 0
    return {
        "world": np.arange(count), "drawn_mass_0": rng.random(count).astype(np.float32),
        "x": np.where(solved, x, np.nan), "time": np.where(solved, time, np.nan),
        "success": (rng.random(count) < 0.7) & solved, "status": status,
    }  # fmt: skip


def cut(columns, edges):
    return [{name: column[a:b] for name, column in columns.items()} for a, b in zip(edges, edges[1:])]


def source(chunks, reverse=False):
    """Two parts, cut at some worlds, their chunks in order or backwards."""
    found = MemorySource()
    for key, seed, count in ((A, 1, 3 * BLOCK + 17), (B, 2, 2 * BLOCK + 5)):
        edges = sorted({0, count, *(world for world in chunks if world < count)})
        for piece in cut(rows(seed, count), edges)[:: -1 if reverse else 1]:
            found.add(key, piece)
    return found


def report(*given):
    return slcp.Report(None, source(*given))


WHOLE = report(())
CHUNKS = {
    "one world first": ([1], False),
    "blocks": ([BLOCK, 2 * BLOCK, 3 * BLOCK], True),
    "prime": (range(0, 4 * BLOCK, 997), True),
    "two": ([2 * BLOCK + 1], False),
}


@pytest.mark.parametrize("chunks", CHUNKS)
def test_no_bit_depends_on_chunks(chunks):
    other = report(*CHUNKS[chunks])
    assert other.summary == WHOLE.summary
    assert other.quantiles() == WHOLE.quantiles()
    assert other.compare("a", "b") == WHOLE.compare("a", "b")
    for name, column in WHOLE.table.items():
        np.testing.assert_array_equal(other.table[name], column)


def test_two_reports_compare_as_one_does():
    one, two = (MemorySource() for _ in range(2))
    for found, (key, seed, count) in ((one, (A, 1, 3 * BLOCK + 17)), (two, (B, 2, 2 * BLOCK + 5))):
        found.add(key, rows(seed, count))
    first, second = slcp.Report(None, one), slcp.Report(None, two)
    with pytest.warns(RuntimeWarning, match="Report.compare: mass_0 of worlds of the same number differ"):
        assert first.compare("a", "b", other=second) == WHOLE.compare("a", "b")
    assert first.compare("a", "b", peeking=True, other=second) == WHOLE.compare("a", "b", peeking=True)
    assert first.compare("a", "a", other=first) == WHOLE.compare("a", "a")
    with pytest.raises(slcp.ArgumentError, match="policy is 'a'; choose from"):
        first.compare("a", "a", other=second)
    with pytest.raises(TypeError, match="other is a MemorySource; a Report is needed"):
        first.compare("a", "b", other=two)


def test_what_is_compared_is_of_one_case_and_is_told():
    """The first of several is taken with a warning; another report's of the same one, where it has that."""
    both, turned = MemorySource(), MemorySource()
    cases = {"hard": 3, "soft": 4}
    for policy, more in (("a", 0), ("b", 10)):
        for case in cases:
            both.add((policy, case, 0.01, "disturbed"), rows(cases[case] + more, 40))
        for case in reversed(cases):
            turned.add((policy, case, 0.01, "disturbed"), rows(cases[case] + more, 40))
    first, second = slcp.Report(None, both), slcp.Report(None, turned)
    named = first.compare("a", "b", case="hard")
    with pytest.warns(RuntimeWarning, match="Report.compare: of case hard, soft it is of hard; case= says"):
        assert first.compare("a", "b") == named
    assert first.compare("a", "b", case="hard", other=second) == named
    with pytest.warns(RuntimeWarning, match="it is of hard"):
        assert first.compare("a", "b", other=second) == named
    coarse = MemorySource()
    coarse.add(("b", "hard", 0.02, "disturbed"), rows(13, 40))
    with pytest.warns(RuntimeWarning, match="are of other cases or step sizes"):
        first.compare("a", "b", "hard", other=slcp.Report(None, coarse))


@pytest.mark.parametrize("change, alike", [
    (lambda mass: mass, True), (lambda mass: 1.7 * mass, True), (lambda mass: mass + 2.0, True),
    (lambda mass: 0.5 + 0.5 * mass, False), (lambda mass: mass[::-1], False),
])  # fmt: skip
def test_reports_of_other_worlds_are_told(change, alike):
    """What a design draws about a number of its own is the same draw."""
    one, two = MemorySource(), MemorySource()
    rows_of = rows(1, 300)
    one.add(("a", "hard", 0.01, "disturbed"), rows_of)
    mass = change(rows_of["drawn_mass_0"].astype(float)).astype(np.float32)
    two.add(("a", "hard", 0.01, "disturbed"), rows_of | {"drawn_mass_0": mass})
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        slcp.Report(None, one).compare("a", "a", other=slcp.Report(None, two))
    assert [str(each.message)[:25] for each in said] == ([] if alike else ["Report.compare: mass_0 of"])


def test_the_summary_is_that_of_the_columns():
    for row, (seed, count) in zip(WHOLE.summary, ((1, 3 * BLOCK + 17), (2, 2 * BLOCK + 5))):
        columns = rows(seed, count)
        assert row["worlds"] == count
        assert row["success"] == share_interval(int(columns["success"].sum()), count)
        for status in slcp.Status:
            assert row["statuses"][status.name] == (columns["status"] == status).sum()
        for name in ("x", "time"):
            values = columns[name][np.isfinite(columns[name])].astype(float)
            half = Z95 * values.std(ddof=1) / math.sqrt(len(values))
            assert row["finite"][name] == len(values)
            expected = (values.mean(), values.mean() - half, values.mean() + half)
            np.testing.assert_allclose(row[name], expected, rtol=1e-14)
            assert 0.5 * (row[name][2] - row[name][1]) == pytest.approx(half, rel=1e-6)


def test_quantiles_are_values_of_the_column():
    wanted = (0.0, 0.01, 0.5, 0.95, 1.0)
    found = WHOLE.quantiles(wanted)[0]
    columns = rows(1, 3 * BLOCK + 17)
    for name in ("x", "time"):
        assert found[name] == {q: quantile_interval(columns[name], q) for q in wanted}
    assert found["time"][0.95][0] == np.inf


SPECIAL = st.sampled_from([0.0, -0.0, np.nan, np.inf, -np.inf, 5e-324, -5e-324, 1.0, np.nextafter(1.0, 2.0)])


@given(st.lists(st.floats() | SPECIAL, max_size=60), st.integers(1, 7), st.floats(0.0, 1.0))
def test_quantiles_of_any_numbers(values, size, q):
    values = np.array(values, float)
    pieces = [values[i : i + size] for i in range(0, len(values), size)]
    (found,) = quantile_intervals(lambda: iter(pieces), (q,))
    np.testing.assert_array_equal(found, quantile_interval(values, q))


def test_differences_are_over_the_worlds_that_both_have():
    a, b = rows(1, 3 * BLOCK + 17), rows(2, 2 * BLOCK + 5)
    for name, found in WHOLE.compare("a", "b").items():
        both = np.isfinite(a[name][: 2 * BLOCK + 5]) & np.isfinite(b[name])
        apart = a[name][: 2 * BLOCK + 5][both].astype(float) - b[name][both]
        assert found[0] == pytest.approx(apart.mean(), abs=1e-12)
        half = Z95 * apart.std(ddof=1) / math.sqrt(len(apart))
        if name == "success":
            assert found == shares_interval(int((apart > 0).sum()), int((apart < 0).sum()), len(apart))
        else:
            assert found[2] - found[0] == pytest.approx(half, rel=1e-12)


def test_worlds_that_are_missing_are_left_out_of_a_comparison():
    """An interrupted sweep lacks chunks of one policy; a block may be missing as a whole."""
    a, b = rows(1, 3 * BLOCK), rows(2, 3 * BLOCK)
    found = MemorySource()
    found.add(A, a)
    keep = (b["world"] % 3 > 0) & (b["world"] // BLOCK != 1)
    found.add(B, {name: column[keep] for name, column in b.items()})
    apart = (a["success"].astype(float) - b["success"])[keep]
    assert slcp.Report(None, found).compare("b", "a")["success"][0] == pytest.approx(-apart.mean(), abs=1e-14)


def test_moments_join():
    """Of values that are far from zero: by parts as at once, and against exact arithmetic."""
    rng = np.random.default_rng(0)
    values = 1e8 + rng.standard_normal(3000)
    parts = sum((Moments.of(piece) for piece in np.split(values, [1, 1, 700])), Moments())
    assert (parts.count, parts.mean) == (3000, pytest.approx(math.fsum(values) / 3000, rel=1e-15))
    assert parts.variance == pytest.approx(np.var(values - 1e8, ddof=1), rel=1e-7)
    assert all(math.isnan(value) for value in Moments().interval())
    assert math.isnan(Moments.of(np.ones(1)).interval()[1])
    assert Moments.of(np.full(2, 1.7e308)).mean == math.inf


def test_blocks_are_those_of_the_worlds():
    worlds = np.array([3, BLOCK - 1, BLOCK, 5 * BLOCK, 5 * BLOCK + 1])
    found = [block["world"].tolist() for block in in_blocks({"world": worlds[i : i + 2]} for i in (0, 2, 4))]
    assert found == [[3, BLOCK - 1], [BLOCK], [5 * BLOCK, 5 * BLOCK + 1]]
    for wrong in ([2, 2], [3, 1]):
        with pytest.raises(ValueError, match="do not rise"):
            list(in_blocks([{"world": np.array(wrong)}]))
    assert list(in_blocks([{"world": np.zeros(0, int)}])) == []


@pytest.mark.parametrize("given", [(), 0.5, (1.5,), ("a",), None])
def test_what_is_no_probability_is_refused(given):
    with pytest.raises(slcp.InputError, match="probabilities"):
        WHOLE.quantiles(given)


class Watched(Made):
    """Its blocks, counted while anything of them is held."""

    def __init__(self, worlds):
        super().__init__(worlds)
        self.held, self.most = [], 0

    def blocks(self, key, names=None):
        for block in super().blocks(key, names):
            own = {name: column.copy() for name, column in block.items()}
            self.held = [ref for ref in self.held if ref() is not None] + [weakref.ref(own["world"])]
            self.most = max(self.most, len(self.held))
            yield own


def test_no_more_than_a_few_blocks_are_held():
    source = Watched(12 * BLOCK)
    report = slcp.Report(None, source)
    report.summary, report.quantiles((0.05, 0.5, 0.95)), report.compare("a", "b")
    report.compare("a", "b", peeking=True), report.sensitivity("rate")
    assert 2 <= source.most <= 4  # two parts, each the block before until the next one is there
    assert len(report.table["world"]) == 2 * 12 * BLOCK
    assert source.most >= 12


def test_a_mean_that_leaves_worlds_out_says_so():
    """Times that are never reached are no part of a mean: what is printed says over how many worlds it is."""
    count = int(np.isfinite(rows(1, 3 * BLOCK + 17)["time"]).sum())
    assert 0 < count < 3 * BLOCK + 17 and f" of {count}" in str(WHOLE)
