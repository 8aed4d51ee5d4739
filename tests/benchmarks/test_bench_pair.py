"""`slcp bench pair`: two interpreters take turns; intervals of the ratios."""

import shutil
import sys

import numpy as np
import pytest

from slcp_warp.scripts.benchmarks.cost.pair import PairError, bench_pair, median_interval

CASE = "finger, hard, float64"


def test_a_version_beside_itself():
    (row,) = bench_pair(sys.executable, 3, CASE)
    assert row["case"] == CASE and row["problem"] == ""
    assert 0.0 < row["low"] <= row["ratio"] <= row["high"]
    assert row["seconds"] > 0.0 and row["seconds_other"] > 0.0


def test_interpreters_that_cannot_run_are_named():
    with pytest.raises(PairError, match="cannot start 'no-such-interpreter'"):
        bench_pair("no-such-interpreter", 3, CASE)
    ends = shutil.which("true")
    with pytest.raises(PairError, match=f"{ends}.* ended in case"):
        bench_pair(ends, 3, CASE)


def test_intervals_of_medians():
    assert median_interval(np.array([0.5, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0])) == (1.0, 1.0, 1.0)
    ratio, low, high = median_interval(np.linspace(0.9, 1.1, 15))
    assert 0.9 <= low < ratio < high <= 1.1
