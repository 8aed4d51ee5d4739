"""`slcp library`: what an interrupt leaves, and what goes on from it."""

import numpy as np
import pytest

pytest.importorskip("typer")
pytest.importorskip("pyarrow")

from test_cli import call

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.library import refinement
from slcp_warp.ddp.library.entries import NEEDED
from slcp_warp.scripts.stages.library import build_of_runs


def test_an_interrupted_library_is_saved_and_goes_on(tmp_path, monkeypatch):
    original = refinement.build_library

    def interrupted(problem, x0, count, options, progress=None, out=None):
        def stop(done, total):
            if done >= 2:
                raise KeyboardInterrupt

        return original(problem, x0, count, options, progress=stop, out=out)

    out, kept, size = tmp_path / "part.npz", tmp_path / "part.kept", ("--entries", 2, "--passes", 2)
    arguments = ("library", "--plans", 5, *size, "--rounds", 0, "--horizon", 15, "--device", "cpu", "--out")
    with monkeypatch.context() as patch:
        patch.setattr(refinement, "build_library", interrupted)
        result = call(*arguments, out, code=130)
    assert "interrupted; saved the 2 controllers there were; --resume goes on" in result.stderr
    assert len(ddp.Library.load(out)) == 2 and kept.is_dir()

    assert f"{kept} is what an earlier run left: --resume" in call(*arguments, out, code=2).stderr
    assert "options.seed: 0 there, 1 here" in call(*arguments, out, "--seed", 1, "--resume", code=2).stderr
    call(*arguments, out, "--resume")
    own = tmp_path / "own.npz"
    own.with_suffix(".kept").mkdir()
    assert "own.kept is nothing that a run has left" in call(*arguments, own, "--resume", code=2).stderr
    own.with_suffix(".kept").rmdir()
    call(*arguments, tmp_path / "whole.npz")
    assert list(tmp_path.glob("*.kept")) == []
    for name in NEEDED:
        found, whole = (getattr(ddp.Library.load(p), name) for p in (out, tmp_path / "whole.npz"))
        assert len(found) == len(whole) and found.tobytes() == whole.tobytes()


def test_runs_that_nothing_has_kept_are_not_gone_on_with(tmp_path):
    """A library of runs was replaced by one of chains."""
    out = tmp_path / "runs.npz"
    out.write_bytes(b"a library")
    told = call("library", "cart_pole_walls", "--resume", "--device", "cpu", "--out", out, code=2).stderr
    assert "runs.kept is not there; plans of chains are kept, and of runs none" in " ".join(told.split())
    assert out.read_bytes() == b"a library"


def test_a_library_begins_with_a_plan_that_is_there(tmp_path, monkeypatch):
    """Chains with its controls as one start, runs with it in place of one made for disturbed worlds."""
    plan, seen = tmp_path / "plan.npz", {}
    short = ("--horizon", 15, "--device", "cpu", "--out")
    call("optimise", "flicking_finger", "--starts", 1, "--passes", 2, *short, plan)
    us = ddp.Result.load(plan).us

    def chains(problem, x0, count, options, progress=None, out=None):
        seen["first"] = options.first
        raise KeyboardInterrupt

    arguments = ("library", "flicking_finger", "--plan", plan, "--plans", 2, "--rounds", 0)
    with monkeypatch.context() as patch:
        patch.setattr(refinement, "build_library", chains)
        call(*arguments, *short, tmp_path / "chains.npz", code=130)
    np.testing.assert_array_equal(seen["first"], us)
    told = call(*arguments, "--horizon", 20, "--device", "cpu", "--out", tmp_path / "x.npz", code=2).stderr
    assert "RecedingOptions.first has shape (15, 2); (20, 2) is needed" in told

    def runs(task, mpc, *more):
        seen["plan"] = mpc
        raise KeyboardInterrupt

    monkeypatch.setattr(ddp, "library_of_runs", runs)
    monkeypatch.setattr(ddp, "plan_in_worlds", None)
    task = slcp.load_task("cart_pole_walls")
    result = ddp.solve(ddp.problem_of(task), task.start[0], options=ddp.Options(max_iterations=1))
    with pytest.raises(KeyboardInterrupt):
        build_of_runs(task, ddp.problem_of(task), 2, ddp.RecedingOptions(), None, result)
    np.testing.assert_array_equal(seen["plan"].starts["plan"]._policy.us[0], result.us)
