"""Libraries grown where their own controller stands still."""

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import ddp, scenes
from slcp_warp.ddp.library import refinement

SCENE = scenes.flicking_finger()
OPTIONS = ddp.RecedingOptions(entries=2, passes=2, first_passes=3, noisy=0, recalled=0, seed=4)


@pytest.fixture(scope="module")
def problem():
    sim = slcp.Simulator(SCENE, slcp.Options(scaling="none"), device="cpu")
    return ddp.Problem(sim, slcp.tasks.flicking_finger().cost, horizon=15)


@pytest.fixture(scope="module")
def library(problem):
    return ddp.build_library(problem, SCENE.x0, 8, OPTIONS)


def test_without_rounds_it_is_the_plain_library(problem, library):
    refined = ddp.build_refined(problem, SCENE.x0, 8, ddp.turning(2), rounds=0, options=OPTIONS)
    for name in ("x", "u", "K", "gain"):
        np.testing.assert_array_equal(getattr(refined, name), getattr(library, name))


def test_stuck_states_are_those_of_the_lowest_score(problem, library, monkeypatch):
    monkeypatch.setattr(refinement, "WORLDS", 12)
    seen = []

    def score(states):
        seen.append(states)
        return np.arange(12.0)[::-1]

    x = ddp.stuck_states(library, problem.dynamics, score, 3, seed=1)
    assert seen[0].shape == (12, 101, 6)  # the last 5 s of 15 s at h = .05
    for state, world in zip(x, (11, 10, 9)):
        difference = seen[0][world] - state
        difference[:, 2] -= np.pi * np.round(difference[:, 2] / np.pi)
        assert np.abs(difference).sum(axis=1).min() < 1e-6
    assert (x[:, 2] >= 0.0).all() and (x[:, 2] < np.pi).all()


def test_rounds_add_chains_and_report_progress(problem):
    seen = []
    refined = ddp.build_refined(
        problem, SCENE.x0, 16, ddp.turning(2), rounds=2, options=OPTIONS,
        progress=lambda done, total: seen.append((done, total)),
    )  # fmt: skip
    assert len(refined) == 16 and refined.header["rounds"] == 2
    assert np.unique(refined.chain).tolist() == [0, 1, 2]
    assert seen == sorted(seen) and {total for _, total in seen} == {16}


def test_an_interrupt_keeps_what_there_is(problem):
    def stop(done, total):
        if done >= 10:
            raise KeyboardInterrupt

    part = ddp.build_refined(problem, SCENE.x0, 16, ddp.turning(2), rounds=2, options=OPTIONS, progress=stop)
    assert 8 <= len(part) < 16


def test_negative_rounds_are_refused(problem):
    with pytest.raises(ValueError, match="rounds is -1"):
        ddp.build_refined(problem, SCENE.x0, 4, ddp.turning(2), rounds=-1)
