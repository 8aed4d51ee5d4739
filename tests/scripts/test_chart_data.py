"""What charts and reports show: the numbers of the table, in the right place, on the right axis."""

import csv

import numpy as np
import pytest

pytest.importorskip("typer")
pytest.importorskip("matplotlib")

import slcp_warp as slcp
from slcp_warp.scripts.benchmarks.accuracy.charts import ratios
from slcp_warp.scripts.charts import questions, quickstart_report
from slcp_warp.scripts.charts import sweep as chart_sweep
from slcp_warp.scripts.stages import sweep

RNG = np.random.default_rng(0)
NAMES = ("mean_rate", "share_above", "share_spinning", "share_recovered")


def interval(middle):
    return (middle, middle - 0.011, middle + 0.013)


def case(residual, step_size, rate, shares, failed, worlds=40):
    numbers = dict(zip(NAMES, map(interval, (rate, *shares)), strict=True))
    statuses = {status.name: 0 for status in slcp.Status}
    statuses |= {"SOLVED": worlds - failed, "NOT_CONVERGED": failed - failed // 3, "NONFINITE": failed // 3}
    return {"residual": residual, "step_size": step_size, "worlds": worlds, "statuses": statuses, **numbers}


def report():
    """Three cases of different numbers everywhere; two share a residual, two a step size."""
    cases = [case("rem-logistic", 0.05, 0.83, (0.91, 0.72, 0.64), 3),
             case("hard", 0.05, 0.55, (0.47, 0.38, 0.29), 7),
             case("hard", 0.03, 0.25, (0.22, 0.14, 0.07), 11)]  # fmt: skip
    table = {
        "residual": np.repeat(["rem-logistic", "hard", "hard"], 40),
        "step_size": np.repeat([0.05, 0.05, 0.03], 40),
        "rate": np.concatenate([RNG.uniform(low, low + 0.2, 40) for low in (0.7, 0.4, 0.1)]),
        "recovery_time": np.concatenate([RNG.uniform(low, low + 2.0, 40) for low in (0.0, 3.0, 6.0)]),
    }
    table["recovery_time"][[3, 5, 50, 90]] = np.inf
    return slcp.SweepReport(cases, table, [], {"threshold": 0.5, "duration": 20.0, "window": 4.0, "seed": 0})


@pytest.fixture
def figures(monkeypatch, tmp_path):
    """The figures that charts save, instead of files."""
    kept = []
    monkeypatch.setattr(chart_sweep, "save", lambda figure, path: kept.append(figure) or path)
    yield kept
    for figure in kept:
        chart_sweep.plt.close(figure)


def test_chart_of_a_sweep_shows_its_rates_shares_and_recoveries(figures, tmp_path):
    made = report()
    chart_sweep.sweep_chart(made, tmp_path / "sweep.png")
    rates, shares, recovery = figures[0].axes
    rows = np.split(np.arange(120), 3)
    means = [line.get_xdata()[0] for line in rates.lines if len(set(line.get_xdata())) == 1]
    for own in rows:
        assert np.isclose(means, made.table["rate"][own].mean(), rtol=1e-12).sum() == 1
    drawn = [np.asarray(line.get_xdata(), float) for line in shares.lines]
    expected = []
    for entry in made.cases:  # all the time, then the second half: the interval and the share
        for name in ("share_above", "share_spinning"):
            share, low, high = (100.0 * value for value in entry[name])
            expected += [[low, high], [share]]
    assert len(drawn) == len(expected)
    for got, exact in zip(drawn, expected):
        np.testing.assert_allclose(got, exact, rtol=1e-12)
    assert [text.get_text() for text in shares.texts] == ["91.0", "72.0", "47.0", "38.0", "22.0", "14.0"]
    heights = [line.get_ydata()[0] for line in shares.lines]
    assert min(heights[:4]) > max(heights[4:8]) > max(heights[8:])  # from the top, beside their rates
    for line, own in zip(recovery.lines, rows, strict=True):
        times = made.table["recovery_time"][own]
        for x, y in zip(line.get_xdata(), line.get_ydata()):
            assert y == pytest.approx(100.0 * (times <= x).mean())
    assert [line.get_label() for line in recovery.lines] == [sweep.case_name(c) for c in made.cases]


def test_chart_of_sizes_shows_the_table(figures, tmp_path):
    rows = []
    for residual in ("rem-logistic", "hard"):
        for plans in (10, 100, 400):
            low, rate, high, below, share, above = np.sort(RNG.uniform(0.1, 0.9, 6))
            rows.append(dict(zip(chart_sweep.SIZE_COLUMNS, (plans, 4 * plans, residual, 0.05, 100, rate, low,
                                                            high, share, below, above))))  # fmt: skip
    with open(tmp_path / "size.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, chart_sweep.SIZE_COLUMNS)
        writer.writeheader()
        writer.writerows(rows)
    chart_sweep.size_chart(tmp_path / "size.csv", tmp_path / "size.png")
    for axis, name, scale in zip(figures[0].axes, ("mean_rate", "share_above"), (1.0, 100.0)):
        lines = [line for line in axis.lines if len(line.get_xdata()) == 3]
        for line, band, residual in zip(lines, axis.collections, ("rem-logistic", "hard"), strict=True):
            mine = [row for row in rows if row["residual"] == residual]
            np.testing.assert_allclose(line.get_xdata(), [row["plans"] for row in mine])
            np.testing.assert_allclose(line.get_ydata(), [scale * row[name] for row in mine])
            corners = band.get_paths()[0].vertices
            for end in ("_low", "_high"):
                for row in mine:
                    apart = np.abs(corners - [row["plans"], scale * row[name + end]]).max(axis=1)
                    assert apart.min() < 1e-9


def test_points_that_are_not_sound_reach_no_error():
    """At equal error only what solved every world and passed through nothing is compared."""
    fine = {"study": "contact", "problem": "p", "knob": "h", "error": 0.01, "missed": 0, "solved_share": 1.0}
    peer = fine | {"program": "peer", "curve": "peer", "value": 0.1, "seconds": 1.0}
    costs = {}
    for what, change in (("sound", {}), ("unsolved", {"solved_share": 0.9}), ("passed", {"missed": 1})):
        ours = fine | {"program": ratios.OURS, "curve": "Coulomb", "value": 0.1, "seconds": 0.25} | change
        (found,) = ratios.compare([ours, peer])
        costs[what] = found.equal_error[0][2]
    assert costs == {"sound": 4.0, "unsolved": 0.0, "passed": 0.0}


def test_report_of_a_sweep_says_what_its_cases_say():
    lines = quickstart_report._sweep_lines(report(), "Kicked")
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines if line.startswith("|")]
    head = rows[0]
    assert head[:2] == ["case", "mean rate [rad/s]"] and head[-1] == "failed"
    assert [row[-1] for row in rows[2:]] == ["3", "7", "11"]
    for row, entry in zip(rows[2:], report().cases, strict=True):
        assert row[0] == sweep.case_name(entry)
        numbers = [row[1].split()[0], *(cell.split()[0] for cell in row[2:5])]
        expected = [entry[name][0] * (1.0 if name == "mean_rate" else 100.0) for name in NAMES]
        np.testing.assert_allclose([float(n) for n in numbers], expected, rtol=1e-3)
    assert "**not reached**" in lines[-1]  # .47 of the second case, .22 of the third
    good = report()
    for entry in good.cases:
        entry["share_above"] = interval(0.95)
    assert quickstart_report._sweep_lines(good, "Kicked")[-1].endswith("every case: reached.")


def test_names_that_share_a_draw_fit_beside_their_bar():
    for few in ("a.mass", "a/b.friction, a/c.friction"):
        assert questions._short(few) == few
    assert questions._short(", ".join(f"a/b{i}.friction" for i in range(12))) == "a/b0.friction and 11 more"
