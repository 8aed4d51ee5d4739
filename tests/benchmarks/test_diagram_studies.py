"""Work-precision studies: their counts, errors and charts, at tiny sizes."""

import csv

import numpy as np
import pytest

from slcp_warp import scenes
from slcp_warp.scripts.benchmarks.accuracy import bias, ddp, derivatives, solver, sweep
from slcp_warp.scripts.benchmarks.accuracy.charts import bias as chart_bias
from slcp_warp.scripts.benchmarks.accuracy.charts import ddp as chart_ddp
from slcp_warp.scripts.benchmarks.accuracy.charts import derivatives as chart_derivatives
from slcp_warp.scripts.benchmarks.accuracy.charts import scaling as chart_scaling
from slcp_warp.scripts.benchmarks.accuracy.charts import solver as chart_solver
from slcp_warp.scripts.benchmarks.accuracy.charts import sweep as chart_sweep
from slcp_warp.scripts.benchmarks.accuracy.roofline import Peak, Work, step_work
from slcp_warp.scripts.benchmarks.mechanics.scene import distance
from slcp_warp.scripts.benchmarks.shared.differences import SIXTH, central, converged, forward, relative


def through_csv(rows, path):
    """Rows as a chart reads them back from a file."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    with open(path, "w", newline="") as file:
        writer = csv.DictWriter(file, names, restval="")
        writer.writeheader()
        writer.writerows(rows)
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def test_step_work_has_the_orders_of_its_algorithms():
    """Newton's part is linear in rows and iterations and quadratic in nv; inverting M is cubic."""
    rows = [step_work(20, n).operations for n in (10, 20, 30)]
    assert rows[2] - rows[1] == pytest.approx(rows[1] - rows[0])
    newton = [step_work(nv, 1e6).operations - step_work(nv, 0.0).operations for nv in (100, 200)]
    assert 3.5 < newton[1] / newton[0] < 4.1
    assert 7.5 < step_work(8000, 0.0).operations / step_work(4000, 0.0).operations < 8.1
    # docs/performance.md
    assert 800.0 < step_work(3, 1.0, 2, ellipses=1, near=1.0).operations < 2500.0


def test_roofline_is_the_slower_of_arithmetic_and_memory():
    peak = Peak(scalar=1e9, serial=1e8, wide=4e9, bandwidth=1e9)
    bound = [peak.roofline(Work(*counts), 2)["roofline_seconds"] for counts in ((4.0, 1.0), (1.0, 4.0))]
    np.testing.assert_allclose(bound, [2e-9, 4e-9])


def test_error_of_blocks_falls_with_the_square_root():
    values = np.random.default_rng(0).standard_normal(1 << 18)
    errors = [sweep.block_error(values, n, 0.0) for n in (16, 256, 4096)]
    np.testing.assert_allclose(errors, [1 / 4, 1 / 16, 1 / 64], rtol=0.25)


@pytest.mark.slow
def test_sweep_study(tmp_path):
    """Errors of blocks agree with the expected ones within chance."""
    rows = sweep.study((16, 1024), 2048, 1, ("float64",))
    for row in rows:
        if row["value"] == 16:
            assert 0.6 < row["error"] / row["expected"] < 1.5
        assert row["seconds"] > 0.0 and row["solved_share"] == 1.0
    assert len(rows) == 4
    assert chart_sweep.draw(through_csv(rows, tmp_path / "rows.csv"), tmp_path / "sweep.png").exists()


def test_scaling_chart_reads_rows_of_a_file(tmp_path):
    """Without curves that were not measured (a GPU's), and with a scene of no contact rows."""
    rows = [
        {"study": "scaling", "program": "slcp-warp", "problem": problem, "curve": curve, "value": value,
         "rate": 1e5, "roofline_seconds": 1e-6, "fraction": 0.1}
        for problem, *_ in chart_scaling.PANELS for curve in ("one", "two") for value in (0, 10)
    ]  # fmt: skip
    peer = [row | {"program": "Peer", "curve": "Peer, 1 thread"} for row in rows[:1]]
    assert chart_scaling.ahead(rows + peer) == ""
    assert chart_scaling.ahead(rows + [peer[0] | {"rate": 2e5}]) == "ahead of ours: Peer, 1 thread at 0"
    path = chart_scaling.draw(through_csv(rows, tmp_path / "rows.csv"), tmp_path / "scaling.png")
    assert path.stat().st_size > 10_000
    with pytest.raises(ValueError, match="no rows of study 'scaling'"):
        chart_scaling.draw([{"study": "ddp"}], path)


@pytest.mark.full
def test_solver_study(tmp_path):
    """Both strategies agree to rounding, float32 to its own, and a tolerance of 1e-3 leaves about that."""
    chosen = solver.variants({"float64": (1e-3, None)}, ())
    case = solver.finger_case(64)
    rows = solver.study("finger", case, chosen, (0.1,), 1)
    coarse, fine, memory = (row["error_max"] for row in rows)
    assert 1e-7 < coarse < 1e-2 and fine < 1e-12 and memory < 1e-12
    assert [row["solved_share"] for row in rows] == [1.0] * 3
    assert [row["value"] for row in rows] == [1e-3, 2e-14, 2e-14]
    assert chart_solver.draw(through_csv(rows, tmp_path / "rows.csv"), tmp_path / "s.png").exists()


def smooth(z):
    """Two functions of three variables."""
    return np.stack([np.sin(z[:, 0] + 2 * z[:, 1]) * np.exp(z[:, 2]), z[:, 0] * z[:, 1] ** 3], axis=1)


def smooth_jacobian(z):
    a, b, c = z.T
    wave, slope = np.sin(a + 2 * b) * np.exp(c), np.cos(a + 2 * b) * np.exp(c)
    return np.stack([np.stack([slope, 2 * slope, wave], 1), np.stack([b**3, 3 * a * b**2, 0 * a], 1)], axis=1)


def test_differences_have_their_orders():
    z = np.random.default_rng(0).standard_normal((20, 3))
    exact = smooth_jacobian(z)
    for method, order in (
        (forward, 1), (central, 2), (lambda f, z, eps: central(f, z, eps, SIXTH), 6)
    ):  # fmt: skip
        coarse, fine = (np.median(relative(method(smooth, z, eps), exact)) for eps in (0.1, 0.05))
        assert np.log2(coarse / fine) == pytest.approx(order, abs=0.3)


def test_converged_differences_know_how_far_they_are_settled():
    """To rounding where the function is smooth; noise of 1e-9 leaves about 1e-7, and it is noticed."""
    z = np.random.default_rng(0).standard_normal((20, 3))
    jacobian, apart = converged(smooth, z)
    assert relative(jacobian, smooth_jacobian(z)).max() < 1e-11
    rng = np.random.default_rng(1)
    noisy, noticed = converged(lambda z: smooth(z) + 1e-9 * rng.standard_normal((len(z), 2)), z)
    error = relative(noisy, smooth_jacobian(z))
    assert np.median(error) < 1e-5 and np.median(noticed) > 0.1 * np.median(error)
    assert np.median(noticed) > 1e3 * np.median(apart)


def test_states_are_moved_to_a_gap():
    finger, rng = scenes.flicking_finger(), np.random.default_rng(0)
    z = np.tile([-1.0, -1.2, 0.4, 0.0, 0.0, 0.0, 0.0, 0.0], (8, 1)) + 0.1 * rng.standard_normal((8, 8))
    target = rng.uniform(0.0, 1e-6, 8)
    moved = derivatives.at_gap(finger, z, target)
    np.testing.assert_allclose(distance(finger, moved[:, :3]), target, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(moved[:, 3:], z[:, 3:])


@pytest.mark.slow
def test_derivatives_study(tmp_path):
    """Exact ones to rounding at every kind of state; MuJoCo's differences across its edge are far off."""
    pytest.importorskip("mujoco")
    rows = derivatives.study(40, (0.1,), (1e-6,), 1, dtypes=("float64",))
    for row in rows:
        if row["curve"].startswith("exact"):
            assert row["error_p90"] < 1e-10
    across = [r for r in rows if r["program"] == "MuJoCo" and r["problem"] == "finger, edge"]
    assert across and all(row["error_p90"] > 1.0 for row in across)
    assert chart_derivatives.draw(through_csv(rows, tmp_path / "r.csv"), tmp_path / "d.png").exists()


@pytest.mark.parametrize("residual", ["rem-logistic", "rem-normal"])
def test_resting_gap_solves_its_equation(residual):
    """s(z) = push and s(-z) = w: w - push + z = 0 with z found again from s, at every noise level."""
    for sigma in (3.0, 0.3, 0.05):
        w = bias.resting_gap(residual, sigma, 0.2)
        z = 0.2 - w
        noise = np.linspace(-45.0, 45.0, 400001)  # s(z) is the mean of max(z + noise, 0)
        if residual == "rem-logistic":
            density = 1.0 / (2.0 * np.cosh(noise / 2.0)) ** 2  # of the logistic distribution
        else:
            density = np.exp(-0.5 * noise**2) / np.sqrt(2.0 * np.pi)
        mean = (np.maximum(z + sigma * noise, 0.0) * density).sum() * (noise[1] - noise[0])
        assert mean == pytest.approx(0.2, rel=1e-4)


@pytest.mark.slow
def test_bias_study(tmp_path):
    """The ball rests at the closed form; the finger's distance falls with sigma."""
    chosen = {"finger impact": ("rem-logistic",), "resting ball": ("rem-logistic",)}
    rows = bias.study(chosen, (0.1, 0.003), 4, 1)
    finger = [row["error"] for row in rows if row["problem"] == "finger impact" and row["value"]]
    ball = [row for row in rows if row["problem"] == "resting ball"]
    assert finger[1] < 0.5 * finger[0] < 0.1
    for row in ball:
        assert row["error"] == pytest.approx(row["closed_form"], rel=1e-9, abs=1e-15)
        assert row["speed"] < 1e-12
    assert chart_bias.draw(through_csv(rows, tmp_path / "r.csv"), tmp_path / "b.png").exists()


@pytest.mark.slow
def test_ddp_study(tmp_path):
    """Cost never rises; near an optimum three passes of second-order DDP do what Gauss-Newton's do not."""
    rows = ddp.study({"second-order": 60, "gauss-newton": 5}, ("float64",), 1, horizon=30)
    last = {}
    for key in {(row["problem"], row["method"]) for row in rows}:
        part = [row for row in rows if (row["problem"], row["method"]) == key]
        cost = np.array([row["cost"] for row in part])
        assert (np.diff(cost) <= 0.0).all() and [row["value"] for row in part] == list(range(len(part)))
        last[key] = part[-1]
    near = "finger from near an optimum"
    assert last[near, "second-order"]["error"] < 1e-9 < last[near, "gauss-newton"]["error"]
    assert last[near, "second-order"]["value"] <= 6
    assert chart_ddp.draw(through_csv(rows, tmp_path / "r.csv"), tmp_path / "d.png").exists()
