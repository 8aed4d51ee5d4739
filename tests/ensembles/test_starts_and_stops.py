"""What a sweep notes of worlds beside measures: which begin in overlap, and when a step was not solved."""

import warnings
from typing import Any

import numpy as np
import pytest
import warp as wp

import slcp_warp as slcp
from slcp_warp import measures, policies

HARD = slcp.Options("hard")
H = 0.01


def ball():
    """A ball driven along the floor on which it lies, beside a wall that it may not pass."""
    bodies = (slcp.Body("ball", 1.0, 0.004, joint="free", upper=(2.0, None, None)),)
    shapes = (
        slcp.Shape("floor", None, "halfplane", angle=np.pi / 2),
        slcp.Shape("ball", "ball", "disc", 0.1),
    )
    return slcp.Scene(
        "ball", bodies, shapes, (slcp.Contact("floor", "ball", 0.5),), actuators=(slcp.Actuator("ball"),),
        step_size=H, initial_state=(0.0, 0.1, 0.0, 0.0, 0.0, 0.0),
    )  # fmt: skip


@wp.func
def breaks(data: Any, world: int, step: int, x: Any):
    u = data.gain[0]
    if step == data.when[world]:
        u = u / (u - u)
    return wp.vector(u, length=1)


def until(when):
    return policies.Function(breaks, gain=np.ones(1), when=np.asarray(when, np.int32))


def task(**changes):
    found = {
        "start": (0.0, 0.1, 0.0, 0.0, 0.0, 0.0),
        "duration": 0.2,
        "measures": {"x": measures.final("ball.x")},
    }
    return slcp.Task("roll", ball(), **(found | changes))


def still(x, time):
    return np.zeros((len(x), 1))


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
@pytest.mark.parametrize("policy", [until([-1] * 40), policies.Callback(still)], ids=["kernel", "host"])
def test_drawn_sizes_that_overlap_are_told(strategy, policy):
    disturbed = task(disturbances=slcp.Disturbances(parameters={"ball.radius": 0.1}))
    with pytest.warns(RuntimeWarning, match="of 40 worlds begin in overlap, of .* at most") as told:
        report = slcp.sweep(disturbed, policy, worlds=40, cases=HARD, dtype="float64", strategy=strategy)
    assert len(told) == 1
    drawn = slcp.Parameters(disturbed.scene).from_table(slcp.draw_worlds(disturbed, 40).params)
    radius = drawn["radius"][:, 1, 0]
    deep = np.maximum(radius - 0.1, 0.0)
    part = report.part("policy")
    np.testing.assert_allclose(part["start_overlap"], deep, atol=1e-8)  # drawn in single precision
    assert np.isposinf(part["unsolved_time"]).all()
    (row, alone) = report.summary
    assert row["overlapping"]["worlds"] == (deep > 1e-6).sum() > 5
    assert row["overlapping"]["deepest"] == pytest.approx(deep.max(), abs=1e-8)
    assert alone["overlapping"] == {"worlds": 0, "deepest": 0.0}
    assert "begin in overlap" in str(report) and f"{(deep > 1e-6).sum()}, to " in str(report)


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
def test_limits_that_are_passed_at_the_start_count(strategy):
    beyond = task(start=(2.3, 0.1, 0.0, 0.0, 0.0, 0.0))
    with pytest.warns(
        RuntimeWarning, match="4 of 4 worlds begin in overlap, of 0.3 at most, .* to 30 a second"
    ):
        report = slcp.sweep(beyond, until([-1] * 4), worlds=4, cases=HARD, strategy=strategy)
    np.testing.assert_allclose(report.table["start_overlap"], 0.3, rtol=1e-5)


def test_what_lies_where_it_should_is_not_told():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        report = slcp.sweep(task(), until([-1] * 4), worlds=4, cases=HARD)
    assert "overlap" not in str(report)


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
def test_when_a_world_stopped(strategy):
    when = np.array([-1, 0, 7, 19])
    report = slcp.sweep(task(), until(when), worlds=4, cases=HARD, strategy=strategy, dtype="float64")
    part = report.part("policy")
    expected = np.where(when < 0, np.inf, when * H)
    np.testing.assert_allclose(part["unsolved_time"], expected, atol=1e-12)
    np.testing.assert_array_equal(part["status"] == slcp.Status.SOLVED, when < 0)
    np.testing.assert_array_equal(np.isnan(part["start_overlap"]), when == 0)  # that step has no numbers


def test_the_columns_are_kept_in_files_and_folders(tmp_path):
    disturbed = task(disturbances=slcp.Disturbances(parameters={"ball.radius": 0.1}))
    policy = policies.Linear(np.zeros((1, 6)), np.zeros(6), np.zeros(1))
    with pytest.warns(RuntimeWarning, match="begin in overlap"):
        report = slcp.sweep(disturbed, policy, worlds=40, cases=HARD, out=tmp_path / "run", chunk=7)
    there = slcp.load_report(tmp_path / "run")
    for name in ("start_overlap", "unsolved_time"):
        np.testing.assert_array_equal(there.table[name], report.table[name])
        for end in ("csv", "npz", "parquet"):
            again = slcp.Report.load(report.save(tmp_path / f"table.{end}"))
            np.testing.assert_array_equal(again.table[name], report.table[name])
            assert again.measures == report.measures
    assert repr(there.summary) == repr(report.summary)


def test_a_table_of_before_is_read(tmp_path):
    report = slcp.sweep(task(), until([-1] * 4), worlds=4, cases=HARD)
    lines = [line.split(",") for line in report.save(tmp_path / "new.csv").read_text().splitlines()]
    left = [i for i, name in enumerate(lines[0]) if name not in ("start_overlap", "unsolved_time")]
    old = tmp_path / "old.csv"
    old.write_text("\n".join(",".join(line[i] for i in left) for line in lines) + "\n")
    again = slcp.Report.load(old)
    assert again.measures == ("x",) and again.summary[0]["overlapping"] == {}
    assert "overlap" not in str(again)


def test_failed_worlds_are_played_again_step_by_step():
    """With the sweep's own bits: torque noise, drawn masses and kicks."""
    disturbed = task(
        disturbances=slcp.Disturbances(
            parameters={"ball.mass": 0.2}, torque=0.3, kick_times=(0.02,), kick=0.1, velocity=0.1
        )
    )
    policy = until([-1, 5, -1, 12, -1, -1])
    report = slcp.sweep(disturbed, policy, worlds=6, seed=3, cases=HARD)
    part = report.part("policy")
    failed = np.flatnonzero(part["status"] != slcp.Status.SOLVED)
    np.testing.assert_array_equal(failed, [1, 3])
    worlds = slcp.draw_worlds(disturbed, 6, seed=3)
    run = slcp.replay(disturbed, policy, worlds[failed], seed=3, case=HARD)
    np.testing.assert_array_equal(run.status, part["status"][failed])
    stands = [int(np.argmax((state == state[-1]).all(axis=1))) for state in run.states]
    np.testing.assert_allclose(np.array(stands) * H, part["unsolved_time"][failed], atol=1e-12)
    assert [world for world, _, _ in run.failures()] == [0, 1]
    kept = slcp.replay(disturbed, policy, worlds[[0, 2, 4, 5]], seed=3, case=HARD)
    np.testing.assert_array_equal(
        kept.states[:, -1, 0].astype(np.float32), part["x"][[0, 2, 4, 5]].astype(np.float32)
    )
    other = slcp.replay(disturbed, policy, worlds[[0, 2, 4, 5]], seed=4, case=HARD)
    assert (other.states[:, -1, 0] != kept.states[:, -1, 0]).all()


def test_what_cannot_be_played_again_is_refused():
    with pytest.raises(slcp.ArgumentError, match="worlds have 2 step sizes"):
        params = slcp.Parameters(ball()).replace(step_size=[0.01, 0.02]).table()
        slcp.replay(task(), until([-1] * 2), slcp.Worlds(np.zeros((2, 6)) + 0.1, params))
    with pytest.raises(slcp.ArgumentTypeError, match="worlds is .*slcp_warp.Worlds"):
        slcp.replay(task(), until([-1]), 4)
    with pytest.raises(slcp.ArgumentError, match="worlds has none; at least one is needed"):
        slcp.replay(task(), until([-1]), slcp.draw_worlds(task(), 3)[np.zeros(0, int)])


def test_all_questions_tell_of_worlds_that_overlap():
    """Maps by the cell, the smallest failing disturbance of its own world."""
    x = measures.final("ball.x")
    high = measures.largest("ball.y") < 0.15
    laid = task(success=high, measures={"x": x})
    policy = policies.Linear(np.zeros((1, 6)), np.zeros(6), np.zeros(1))
    offsets = ("ball.y", (-0.02, 0.0, 0.02)), ("ball.mass", (0.9, 1.1))
    with pytest.warns(RuntimeWarning, match="12 of 36 worlds begin in overlap, of 0.02 at most"):
        found = slcp.robustness_map(laid, policy, *offsets, worlds=6, case=HARD)
    np.testing.assert_array_equal(found.overlapping, [[6, 0, 0]] * 2)
    assert "*: worlds begin in overlap" in str(found) and "*" in str(found).splitlines()[-1]
    drawn = laid.replace(disturbances=slcp.Disturbances(parameters={"ball.radius": 0.3}))
    with pytest.warns(RuntimeWarning, match="begin in overlap"):
        slcp.sensitivity(drawn, policy, measure="x", samples=8, case=HARD)
    with pytest.warns(RuntimeWarning, match="begin in overlap"):
        slcp.compare_sequentially(drawn, {"a": policy, "b": policy}, worlds=16, batch=8, case=HARD)
    with pytest.warns(RuntimeWarning, match="begin in overlap"):
        slcp.failure_share(drawn, policy, islands=2, particles=20, length=4, case=HARD)
    smallest = slcp.falsify(drawn, policy, "parameters", case=HARD, gradients=False)
    assert smallest.found and smallest.overlap > 1e-3
    assert f"it begins in overlap, by {smallest.overlap:.2g}" in repr(smallest)
    sunk = drawn.replace(start=(0.0, 0.05, 0.0, 0.0, 0.0, 0.0))
    already = slcp.falsify(sunk, policy, "parameters", case=HARD, gradients=False)
    assert (
        already.size == 0.0 and "has its median" in repr(already) and "in overlap, by 0.05" in repr(already)
    )
