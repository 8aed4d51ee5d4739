"""Many starts in chunks: to the bits of one batch, kept on disk, and spread over other processes."""

import functools
import os
import signal
from dataclasses import fields
from pathlib import Path

import ddp_examples
import numpy as np
import pytest
from ddp_examples import cart_pole

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.multistart import chunks
from slcp_warp.ddp.multistart.travel import content_of, read_starts, write_starts
from slcp_warp.ddp.results.result import ARRAYS
from slcp_warp.runs.executors import processes

pytest.importorskip("pyarrow")

OPTIONS = ddp.Options(max_iterations=60)
SCHEDULES = ddp.Regularization(
    initial=[0.0, 1e-2, 10.0], state_weight=[1.0, 0.0, 1.0], control_weight=[0.0, 1.0, 0.0]
)


@functools.cache
def given():
    """Problem, start and controls."""
    problem, x0, u0 = cart_pole("cpu")
    return problem, x0, np.stack([u0, -u0, np.zeros_like(u0), 0.3 * u0, 2.0 * u0])


@functools.cache
def whole():
    """In one batch."""
    return ddp.solve_multistart(*given(), OPTIONS, SCHEDULES)


def same(one, other):
    assert one.index == other.index and one.complete == other.complete
    for name in ARRAYS:
        assert getattr(one.all, name).tobytes() == getattr(other.all, name).tobytes(), name
        assert getattr(one.best, name).tobytes() == getattr(other.best, name).tobytes(), name
    for f in fields(one.all.trace):
        np.testing.assert_array_equal(getattr(one.all.trace, f.name), getattr(other.all.trace, f.name))


@pytest.fixture
def solved(monkeypatch):
    """Starts solved by this process, one after the other."""
    seen = []
    solve = chunks.Starts.solve
    monkeypatch.setattr(chunks.Starts, "solve", lambda s, *a: (seen.append(len(s.us)), solve(s, *a))[1])
    return seen


@pytest.mark.parametrize("chunk", [1, 2, 5])
def test_chunks_give_the_bits_of_one_batch(chunk, tmp_path, solved):
    same(ddp.solve_multistart(*given(), OPTIONS, SCHEDULES, out=tmp_path, chunk=chunk), whole())
    solved.clear()
    same(ddp.solve_multistart(*given(), OPTIONS, SCHEDULES, out=tmp_path), whole())
    assert solved == [], "all of them were there, in the chunks of the folder"


def test_it_goes_on_after_a_signal(tmp_path, solved):
    def strike(standing):
        if standing.done == 2:
            os.kill(os.getpid(), signal.SIGTERM)

    part = ddp.solve_multistart(*given(), OPTIONS, SCHEDULES, out=tmp_path, progress=strike)
    assert not part.complete and len(part.all.cost) in (6, 9)
    assert part.best.cost == part.all.cost[part.all.converged].min()
    done = sum(solved)
    same(ddp.solve_multistart(*given(), OPTIONS, SCHEDULES, out=tmp_path), whole())
    assert sum(solved) == 5 and done < 5


@pytest.mark.slow
def test_processes_solve_them(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(ddp_examples.__file__).parent))
    with processes(2) as executor:
        # by processes, too: their compiler inlines more than the tests' does, and may round otherwise
        together = ddp.solve_multistart(*given(), OPTIONS, SCHEDULES, executor=executor, chunk=5)
        assert together.all.converged.all()
        np.testing.assert_allclose(together.all.cost, whole().all.cost, rtol=1e-9)
        same(ddp.solve_multistart(*given(), OPTIONS, SCHEDULES, executor=executor), together)

        seen = []

        def kill(standing):
            if standing.done == 2 and not seen:
                seen.append([p for pool in executor.pools.pools for p in pool._processes])
                os.kill(seen[0][0], signal.SIGKILL)

        kept = ddp.solve_multistart(
            *given(), OPTIONS, SCHEDULES, executor=executor, out=tmp_path, progress=kill
        )
        assert seen
        same(kept, together)


@pytest.mark.parametrize(
    "change, said",
    [
        ({"x0": [0.0, 3.0, 0.0, 0.0]}, r"another multistart: x0: "),
        ({"options": ddp.Options(max_iterations=61)}, r"options\.max_iterations: 60 there, 61 here"),
        ({"schedules": ddp.Regularization(initial=[0.0, 1.0])}, "schedules: "),
        ({"chunk": 3}, "cut otherwise: starts: 2 there, 3 here"),
        ({"horizon": 41}, r"problem\.horizon: 40 there, 41 here"),
    ],
)
def test_others_in_the_folder_are_refused(change, said, tmp_path):
    problem, x0, starts = given()
    job = chunks.MultistartJob(chunks.Starts(problem, x0, starts, OPTIONS, SCHEDULES), 2)
    slcp.runs.Store.open(tmp_path, job)
    problem = cart_pole("cpu", horizon=change.pop("horizon", 40))[0]
    starts = np.zeros((5, problem.horizon, 1)) if problem.horizon != 40 else starts
    call = {"x0": x0, "options": OPTIONS, "schedules": SCHEDULES, "out": tmp_path} | change
    with pytest.raises(slcp.FileError, match=said):
        ddp.solve_multistart(problem, starts=starts, **call)


def test_what_workers_cannot_make_is_refused_with_advice(tmp_path):
    problem, x0, starts = given()

    def make(dtype, VX, VU):
        return ddp_examples.make_cart_pole(dtype, VX, VU)

    dynamics = ddp.WarpDynamics(make, 4, 1, {"step_size": 0.05}, "cpu")
    own = ddp.Problem(dynamics, problem.cost, 40)
    with pytest.raises(slcp.ArgumentError, match="Problem.dynamics is made by .*which other processes"):
        ddp.solve_multistart(own, x0, starts, executor=processes(1), out=tmp_path)
    plain = ddp.Problem(problem.dynamics, ddp.costs.plain(ddp_examples.make_finite_difference_cost), 40)
    with pytest.raises(slcp.ArgumentError, match="Problem.cost is made by"):
        ddp.solve_multistart(plain, x0, starts, executor=processes(1))
    limited = ddp.Problem(problem.dynamics, problem.cost, 40, control_limits=(-np.ones((2, 1)), 9.0))
    with pytest.raises(slcp.ArgumentError, match="control_limits are for 2 problems"):
        ddp.solve_multistart(limited, x0, starts, out=tmp_path)


def test_a_task_travels_as_a_file(tmp_path):
    task = slcp.tasks.flicking_finger()
    sim = slcp.Simulator(task.scene, task.options, device="cpu", dtype="float32")
    params = sim.params.replace(sigma=0.3)
    problem = ddp.Problem(sim, task.cost, 20, params, (-2.0, [1.0, 2.0]), None)
    starts = chunks.Starts(problem, task.start[0], np.zeros((2, 20, 2)), OPTIONS, SCHEDULES)
    job = chunks.MultistartJob(starts, 1, tmp_path)
    job.pack()
    arrived = slcp.runs.job.rebuild(job.reference())
    assert arrived.specification() == job.specification()
    file = tmp_path / "inputs" / chunks.FILE
    write_starts(file, problem.with_params(sigma=0.4), job._arrays(), OPTIONS)
    with pytest.raises(slcp.FileError, match="not what was written"):
        slcp.runs.job.rebuild(job.reference())
    assert (
        content_of(problem, {}, OPTIONS)[0]["cost"]["make"]
        == "slcp_warp.kernels.control.cost_terms:make_terms"
    )
    with pytest.raises(FileNotFoundError):
        read_starts(tmp_path / "nowhere.npz", "")
