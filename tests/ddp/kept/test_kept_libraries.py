"""Libraries that keep what is finished: the same bit for bit, however often they were ended."""

import multiprocessing
import os
import random
import signal
import time

import pytest

import slcp_warp as slcp
from slcp_warp import ddp, scenes
from slcp_warp.ddp.library import receding, refinement
from slcp_warp.ddp.library.entries import NEEDED

pytest.importorskip("pyarrow")


SCENE = scenes.flicking_finger()
OPTIONS = ddp.RecedingOptions(entries=2, passes=2, first_passes=3, noisy=0, recalled=0, seed=4)
COST = slcp.tasks.flicking_finger().cost


@pytest.fixture(scope="module")
def problem():
    sim = slcp.Simulator(SCENE, slcp.Options(scaling="none"), device="cpu")
    return ddp.Problem(sim, COST, horizon=15)


@pytest.fixture
def planned(monkeypatch):
    """How many plans were made, by this process."""
    seen = []
    keep_best = receding._Chains._keep_best
    monkeypatch.setattr(receding._Chains, "_keep_best", lambda *a: (seen.append(1), keep_best(*a))[1])
    return seen


def same(one, other):
    assert one.header == other.header
    for name in NEEDED:
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name


SETTINGS = {"entries": 2, "passes": 2, "first_passes": 3, "noisy": 1, "recalled": 2, "seed": 4, "chains": 2,
            "perturb_every": 8}  # fmt: skip


@pytest.fixture(scope="module")
def whole(problem):
    """Without a folder, in one go."""
    return ddp.build_library(problem, SCENE.x0, 80, **SETTINGS)


def in_another_process(build):
    process = multiprocessing.get_context("fork").Process(target=build)
    process.start()
    return process


@pytest.mark.slow
def test_killed_at_random_moments(problem, whole, planned, tmp_path):
    """A fork has the kernels of this process already."""
    rng, kills, out = random.Random(2), 0, tmp_path / "x"

    def build():
        ddp.build_library(problem, SCENE.x0, 200, out=out, **SETTINGS)

    def parts():
        return len(list((out / "parts").glob("*"))) if out.exists() else 0

    before = 0
    while kills < 10:
        process = in_another_process(build)
        while process.is_alive() and parts() <= before:
            time.sleep(0.001)
        time.sleep(rng.uniform(0.0, 0.01))
        assert process.is_alive(), "it was through before it could be killed ten times"
        os.kill(process.pid, signal.SIGKILL)
        process.join()
        kills, before = kills + 1, parts()
    found = ddp.build_library(problem, SCENE.x0, 200, out=out, **SETTINGS)
    assert len(planned) == 51 - before, "the first plans and 50 shifts, less those that were kept"
    same(found, ddp.build_library(problem, SCENE.x0, 200, **SETTINGS))


@pytest.mark.slow
def test_a_kept_library_is_read_and_goes_on_to_more_entries(problem, whole, planned, tmp_path):
    """It goes on between two kicks of the velocities, which come every other shift."""
    part = ddp.build_library(problem, SCENE.x0, 44, out=tmp_path, **SETTINGS)
    assert len(part) == 44 and len(planned) == 12
    same(ddp.build_library(problem, SCENE.x0, 44, out=tmp_path, **SETTINGS), part)
    assert len(planned) == 12
    same(ddp.build_library(problem, SCENE.x0, 80, out=tmp_path, **SETTINGS), whole)
    assert len(planned) == 21


@pytest.mark.slow
def test_a_damaged_shift_is_planned_again(problem, whole, planned, tmp_path):
    ddp.build_library(problem, SCENE.x0, 80, out=tmp_path, **SETTINGS)
    (tmp_path / "parts" / "000004.parquet").write_bytes(b"PAR1")
    planned.clear()
    same(ddp.build_library(problem, SCENE.x0, 80, out=tmp_path, **SETTINGS), whole)
    assert len(planned) == 1


@pytest.mark.slow
def test_sigterm_ends_it_between_shifts(problem, whole, tmp_path):
    def strike(done, count):
        if done == 20:
            os.kill(os.getpid(), signal.SIGTERM)

    part = ddp.build_library(problem, SCENE.x0, 80, progress=strike, out=tmp_path, **SETTINGS)
    assert len(part) == 24 and len(list((tmp_path / "parts").iterdir())) == 7
    same(ddp.build_library(problem, SCENE.x0, 80, out=tmp_path, **SETTINGS), whole)


@pytest.mark.slow
@pytest.mark.parametrize(
    "change, said",
    [
        ({"seed": 5}, r"options\.seed: 4 there, 5 here"),
        ({"noise": 0.5}, r"options\.noise"),
        ({"cost": COST.with_weights(COST.weights * (2.0 - COST.fixed))}, r"problem\.cost\.weights"),
        ({"horizon": 16}, r"problem\.horizon: 15 there, 16 here"),
        ({"sigma": 0.3}, r"problem\.parameters\.sigma"),
        ({"x0": SCENE.x0 + 0.1}, r"x0: "),
    ],
)
def test_another_library_in_the_folder_is_refused(change, said, problem, tmp_path):
    ddp.build_library(problem, SCENE.x0, 4, out=tmp_path, **SETTINGS)
    params = problem.params.replace(**{k: v for k, v in change.items() if k == "sigma"})
    other = ddp.Problem(problem.dynamics, change.get("cost", problem.cost), change.get("horizon", 15), params)
    settings = SETTINGS | {k: v for k, v in change.items() if k in ("seed", "noise")}
    with pytest.raises(slcp.FileError, match=f"another library: .*{said}"):
        ddp.build_library(other, change.get("x0", SCENE.x0), 4, out=tmp_path, **settings)


@pytest.mark.slow
def test_a_refined_library_goes_on_in_every_round(problem, planned, monkeypatch, tmp_path):
    monkeypatch.setattr(refinement, "WORLDS", 12)
    tried = []
    stuck_states = refinement.stuck_states
    monkeypatch.setattr(
        refinement, "stuck_states", lambda *a, **k: (tried.append(1), stuck_states(*a, **k))[1]
    )

    def build(**more):
        return ddp.build_refined(problem, SCENE.x0, 16, ddp.turning(2), rounds=2, options=OPTIONS, **more)

    whole = build()
    plans, rollouts = len(planned), len(tried)
    for stop in range(0, 16, 2):

        def strike(done, total, stop=stop):
            if done >= stop:
                raise KeyboardInterrupt

        try:
            build(out=tmp_path, progress=strike)
        except KeyboardInterrupt:
            pass
    planned_before, tried_before = len(planned) - plans, len(tried) - rollouts
    same(build(out=tmp_path), whole)
    assert len(planned) - plans == plans and len(tried) - rollouts == rollouts == 2
    assert planned_before > plans // 2 and tried_before > 0
    with pytest.raises(slcp.FileError, match="another refined library: entries: 16 there, 18 here"):
        ddp.build_refined(problem, SCENE.x0, 18, ddp.turning(2), rounds=2, options=OPTIONS, out=tmp_path)
