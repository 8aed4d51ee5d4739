"""Worlds played again: controls as they acted, impulses and gaps of every step."""

from dataclasses import replace

import numpy as np
import pytest
from test_environment import EVERYTHING, SCENE, STEPS, task

import slcp_warp as slcp
from slcp_warp import measures as m
from slcp_warp.ensembles.questions import made_again
from slcp_warp.stepping import kernels

K = -np.array([[9.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0]])
GOAL = np.eye(8)[0] * 0.35
HARD = slcp.Options("hard")


def linear(limits=(-1.0, 4.0)):
    return slcp.policies.Linear(K, GOAL, [0.0], limits=limits)


def host():
    """The same law, on the host."""
    return slcp.policies.Callback(lambda x, time: (x - GOAL) @ K.T)


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
@pytest.mark.parametrize("case", [HARD, slcp.Options()], ids=["hard", "smoothed"])
def test_an_undisturbed_world_has_the_records_of_a_rollout(device, strategy, case):
    given = {"dtype": "float64", "device": device, "strategy": strategy}
    plain = task(slcp.Disturbances(), failure=None, observation=None)
    worlds = slcp.draw_worlds(plain, 3, dtype="float64", device=device)
    run = slcp.replay(plain, linear(), worlds, record=("controls", "impulse", "gap"), case=case, **given)
    sim = slcp.Simulator(SCENE, case, **given)
    own = sim.rollout(plain.start, policy=linear(), steps=STEPS, record=("controls", "impulse", "gap"))
    for name in ("controls", "impulse", "gap"):
        a, b = run.recorded(name), own.recorded(name)
        assert np.isfinite(b).all()
        if name == "impulse" and case is HARD:
            a, b = of_the_block(a), of_the_block(b)
        np.testing.assert_allclose(a, b, rtol=1e-7, atol=1e-9, err_msg=name)
    assert own.recorded("impulse").max() > 0.1


def of_the_block(impulse):
    """What hard contact determines of the four rows' impulses: the pusher's friction acts on the block above
    the corner beside it, so one more of it and one less of that corner's support are the same motion.
    """
    corner, other, upward, downward = np.moveaxis(impulse, -1, 0)
    friction = SCENE.contacts[-1].friction * (upward - downward)
    return np.stack([corner + friction, other, upward + downward], -1)


@pytest.mark.parametrize("policy", [linear(), host()], ids=["kernel", "host"])
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_disturbed_worlds_tell_what_acted(device, policy, dtype):
    """Momentum of the block in every step, with the push and the forces that are told; controls that are
    within limits and dropped for a while.
    """
    quiet = replace(EVERYTHING, torque=0.0, kick_times=(), kick=0.0)
    given = {"dtype": dtype, "device": device, "seed": 5, "case": HARD}
    disturbed = task(quiet, failure=None, observation=None, measures={"x": m.final("block.x")})
    worlds = slcp.draw_worlds(disturbed, 12, seed=5, dtype=dtype, device=device)
    run = slcp.replay(disturbed, policy, worlds, record=("controls", "impulse"), **given)
    assert (run.status == 0).all()
    u, contact = run.recorded("controls")[..., 0], run.contact_impulse
    assert np.isfinite(u).all() and np.isfinite(contact).all()
    assert u.min() == -1.0 and 1.5 < u.max() <= 4.0
    dropped = (run.times[0, :-1] > 0.2 - 1e-9) & (run.times[0, :-1] < 0.3 - 1e-9)
    assert not u[:, dropped].any() and (u[:, ~dropped] == 0.0).mean() < 0.5
    h, time = SCENE.step_size, run.times[0, :-1]
    gained = run.params["mass"][:, 1:] * np.diff(run.states[:, :, 5], axis=1)
    push = h * 2.0 * np.clip(np.minimum(time + h, 0.4) - np.maximum(time, 0.1), 0.0, None) / h
    told = np.tile(push, (len(run), 1))
    for world in range(len(run)):
        rows = run.contacts(world)
        on_b = rows["normal_force"] * rows["normal_x"] - rows["tangential_force"] * rows["normal_y"]
        sign = np.where(rows["pair"] == "face/pusher", -1.0, 1.0)  # the block is shape_a of this pair alone
        np.add.at(told[world], rows["step"], h * sign * on_b)
    assert np.abs(gained).max() > 0.1
    np.testing.assert_allclose(told, gained, rtol=0.0, atol=1e-5 if dtype == "float32" else 1e-6)


def test_a_world_that_ends_has_records_until_then(device, tmp_path):
    disturbed = task(EVERYTHING, observation=None)
    given = {"dtype": "float64", "device": device, "seed": 5}
    report = slcp.sweep(disturbed, linear(), worlds=40, cases=HARD, **given).part("policy")
    ended = np.flatnonzero(np.isfinite(report["failure_time"]))
    worlds = slcp.draw_worlds(disturbed, 40, seed=5, dtype="float64", device=device)[ended]
    run = slcp.replay(disturbed, linear(), worlds, record="impulse", case=HARD, **given)
    steps = np.round(report["failure_time"][ended] / SCENE.step_size).astype(int)
    assert len(ended) > 2 and np.isfinite(run.recorded("impulse")).all()
    acts = [row[: step + 1].any() and not row[step + 1 :].any() for row, step in zip(run.impulse, steps)]
    assert all(acts)
    own = report["push"][ended]
    pushed = run.contact_impulse[..., 0].sum(axis=(1, 2))
    np.testing.assert_allclose(pushed, own, rtol=1e-6)
    np.testing.assert_allclose(run.measure(m.impulse()), own, rtol=1e-6)
    run.save(tmp_path / "ended.npz")
    again = slcp.Trajectory.load(tmp_path / "ended.npz")
    np.testing.assert_array_equal(again.measure(m.final("block.x")), run.measure(m.final("block.x")))


def test_an_impulse_that_is_not_known_is_said(monkeypatch):
    """As of a step that leads elsewhere when it is made alone: here every second one is said to."""
    monkeypatch.setattr(made_again, "_arrives", lambda state, *_: np.arange(len(state)) % 2 == 0)
    plain = task(slcp.Disturbances(velocity=0.1), failure=None, observation=None)
    worlds = slcp.draw_worlds(plain, [7, 9, 4, 12], dtype="float64")
    told = f"impulses of {2 * (STEPS - 1)} steps are NaN, in worlds 9, 12: made alone"
    with pytest.warns(RuntimeWarning, match=told):
        run = slcp.replay(plain, linear(), worlds, record="impulse", case=HARD, dtype="float64")
    known = np.isfinite(run.impulse).all(axis=2)
    assert known[[0, 2]].all() and not known[[1, 3], :-1].any() and known[:, -1].all()
    run = slcp.replay(plain, linear(), worlds, record=("controls", "gap"), case=HARD, dtype="float64")
    assert np.isfinite(run.controls).all() and np.isfinite(run.gap).all()


def test_records_end_where_a_step_is_not_solved(device):
    """Before it all is known; from it on nothing is."""

    def burst(x, time):
        return np.where(np.arange(len(x))[:, None] == 1, 10.0 ** (300.0 * (time > 0.2)), 1.0)

    plain = task(slcp.Disturbances(velocity=0.1), failure=None, observation=None, control_limits=None)
    worlds = slcp.draw_worlds(plain, 3, dtype="float64", device=device)
    given = {"case": HARD, "dtype": "float64", "device": device, "record": ("controls", "impulse", "gap")}
    run = slcp.replay(plain, slcp.policies.Callback(burst), worlds, **given)
    assert run.status.tolist() == [0, slcp.Status.NONFINITE, 0]
    for name in ("controls", "impulse", "gap"):
        known = np.isfinite(run.recorded(name)).all(axis=2)
        assert known[[0, 2]].all()
        last = int(known[1].sum())
        assert 10 < last < STEPS and known[1, :last].all()


def test_where_fast_kernels_step_all_is_told_by_the_others(device, monkeypatch):
    """As on a GPU: fast kernels write nothing of what steps begin from."""
    monkeypatch.setattr(kernels, "takes_fast_path", lambda *_: True)
    disturbed = task(EVERYTHING, failure=None, observation=None)
    worlds = slcp.draw_worlds(disturbed, 5, dtype="float64", device=device)
    given = {"case": HARD, "dtype": "float64", "device": device, "strategy": "specialised"}
    plain = slcp.replay(disturbed, linear(), worlds, **given)
    told = slcp.replay(disturbed, linear(), worlds, record=("controls", "impulse"), **given)
    np.testing.assert_allclose(told.states, plain.states, rtol=1e-6, atol=1e-6)
    assert np.isfinite(told.controls).all() and np.abs(told.controls).max() > 0.5
    assert told.recorded("impulse").max() > 0.01


def test_worlds_are_drawn_by_their_numbers():
    some, many = slcp.draw_worlds(task(), [7, 2, 49], seed=3), slcp.draw_worlds(task(), 50, seed=3)
    for name in ("x0", "params", "kicks", "pushes", "dropouts", "timing", "numbers"):
        np.testing.assert_array_equal(getattr(some, name), getattr(many, name)[[7, 2, 49]])
    for bad in ([], [-1], [0.5], [2**31], [[1]], "x"):
        with pytest.raises(slcp.InputError, match="worlds"):
            slcp.draw_worlds(task(), bad)
    with pytest.raises(slcp.InputError, match="first"):
        slcp.draw_worlds(task(), 5, first=2**31 - 3)


def test_what_can_be_recorded_is_said():
    worlds = slcp.draw_worlds(task(), 1)
    with pytest.raises(slcp.InputError, match="record"):
        slcp.replay(task(), linear(), worlds, record="forces")
