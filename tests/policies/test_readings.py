"""What a filter's sensors show in a run: noise, rates, losses, by world; feedback by a camera."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from test_sensors import ARM, BALL, TIP, H, by_hand, simulator

import slcp_warp as slcp
from slcp_warp import measures as m
from slcp_warp import policies
from slcp_warp.inputs.errors import ArgumentError
from slcp_warp.policies import Estimated, KalmanFilter, Sensor

STILL = replace(ARM, gravity=(0.0, 0.0), name="still arm")
STEPS = 40
READ = {
    "tip": Sensor(m.point(TIP, "x"), 0.02),
    "again": Sensor(m.point(TIP, "x"), 0.02, every=3 * H),
    "far": Sensor("fore.angle", 0.5, lost=0.25),
    "upper.angle": 0.1,
}


def readings(numbers, sensors=READ, noise=0.0, **given):
    """(worlds, questions, sensors) that a filter is given of an arm that does not move."""
    read = []

    class Reader(KalmanFilter):
        def correct(self, belief, measured):
            read.append(np.array(measured))
            return super().correct(belief, measured)

    of = slcp.Task(
        "still", STILL, duration=STEPS * H, start=np.zeros(4), options=slcp.Options("hard"),
        disturbances=slcp.Disturbances(sensor=noise), success=m.final(0) < 9.0,
    )  # fmt: skip
    policy = Estimated(policies.Linear(np.zeros((2, 4))), Reader(simulator(STILL), sensors, 0.1), **given)
    drawn = slcp.draw_worlds(of, numbers, seed=3, dtype="float64", device="cpu")
    slcp.replay(of, policy, drawn, device="cpu", dtype="float64", seed=3)
    return np.stack(read, axis=1)


def test_a_run_is_read_with_noise_now_and_then_and_not_always():
    found = readings(list(range(300)))
    assert found.shape == (300, STEPS, 4)
    np.testing.assert_array_equal(found[:, :, 3], 0.0, "a number's noise is the task's, which has none")
    due = np.arange(STEPS) % 3 == 0
    assert np.isfinite(found[:, due, 1]).all() and np.isnan(found[:, ~due, 1]).all()
    lost = np.isnan(found[:, :, 2])
    assert abs(lost.mean() - 0.25) < 0.02 and np.isfinite(found[:, :, 0]).all()
    off = [
        found[:, :, 0] - by_hand(np.zeros((1, 4)))[0, 0],
        found[:, due, 1] - by_hand(np.zeros((1, 4)))[0, 0],
    ]
    off += [found[:, :, 2][~lost]]
    for own, sd in zip(off, (0.02, 0.02, 0.5)):
        assert abs(own.mean()) < 4.0 * sd / np.sqrt(own.size)
        assert abs(own.std() / sd - 1.0) < 4.0 / np.sqrt(2.0 * own.size)
    assert abs(np.corrcoef(off[0][:, due].ravel(), off[1].ravel())[0, 1]) < 0.06
    assert abs(np.corrcoef(off[0][:, 1:].ravel(), off[0][:, :-1].ravel())[0, 1]) < 0.04


def test_a_world_reads_the_same_whatever_runs_beside_it():
    whole = readings(list(range(20)))
    np.testing.assert_array_equal(readings([17, 5]), whole[[17, 5]])
    np.testing.assert_array_equal(readings(list(range(20)), seed=0), whole)
    assert (readings(list(range(20)), seed=1)[:, :, 0] != whole[:, :, 0]).all()


def test_states_are_read_as_the_run_shows_them():
    """A task's noise on states is in what points show, beside the noise of the sensor."""
    found = readings(list(range(200)), {"turned": Sensor(m.state("fore.angle"), 1e-9)}, noise=0.3)
    assert abs(found.std() / 0.3 - 1.0) < 0.05


def test_runs_of_one_policy_begin_anew():
    """A filter that reads its camera every three questions does so from the first on, in every run."""
    sim = simulator(STILL)
    policy = Estimated(policies.Linear(np.zeros((2, 4))), KalmanFilter(sim, READ, 0.1), keep=True)
    runs = []
    for _ in range(2):
        sim.rollout(np.zeros((3, 4)), policy=policy, steps=10)
        runs.append(np.stack([belief.mean for _, belief in policy.kept]))
    np.testing.assert_array_equal(*runs)


@pytest.mark.parametrize("delay", [0.0, 0.02])
def test_what_comes_late_counts_from_when_it_was_taken(delay):
    """At every time what is believed is that of a log with what has come by then, and no more."""
    sim, exact = simulator(ARM), 1e-9
    of = {"tip": m.point(TIP, "x"), "slow": m.point(TIP, "y")}
    late = {"tip": Sensor(of["tip"], exact, late=3 * H), "slow": Sensor(of["slow"], exact, 0.0, 2 * H, 5 * H)}
    wide = {"start": (0.1, 0.1, 0.3, 0.3), "x0": (0.3, 1.6, 0.0, 0.0), "process": 0.1}
    believed = {name: Sensor(each, 0.01) for name, each in of.items()}
    filter = KalmanFilter(sim, {**believed, "upper.angle": 1e-3}, **wide)
    acting = KalmanFilter(sim, {**late, "upper.angle": 1e-3}, **wide)
    acting.variance = filter.variance  # read exactly, believed less
    policy = Estimated(policies.Linear(np.zeros((2, 4)), np.zeros(4), [1.0, -0.5]), acting, delay, keep=True)
    x0 = np.tile([0.35, 1.5, 0.2, 0.1], (2, 1))
    run = sim.rollout(x0, policy=policy, steps=12, record="controls")
    us = np.tile([1.0, -0.5], (2, 12, 1))
    us[:, : round(delay / H)] = 0.0  # what acts, as it knows
    shown = np.stack([by_hand(run.states[:, k]) for k in range(13)], axis=1)
    places = slcp.costs.position(ARM, TIP, run.states)
    seen = np.stack([places[..., 0], places[..., 1], run.states[..., 0]], axis=2)
    seen[:, 1::2, 1] = np.nan
    np.testing.assert_allclose(seen[..., 0], shown[..., 0], rtol=0, atol=1e-12)
    for k, (_, belief) in enumerate(policy.kept):
        log = seen[:, : k + 1].copy()
        log[:, max(0, k - 2) :, 0] = np.nan
        log[:, max(0, k - 4) :, 1] = np.nan
        expected = filter.estimate(log, us[:, :k])
        np.testing.assert_allclose(belief.mean, expected.mean[:, -1], rtol=0, atol=1e-6)
        np.testing.assert_allclose(belief.covariance, expected.covariance[:, -1], rtol=1e-6, atol=1e-9)


def test_feedback_by_a_marker_alone():
    """A camera of the tip, at a third of the rate and with a fifth of its pictures lost, holds an arm up."""
    task = slcp.Task(
        "up", ARM, duration=1.5, start=[0.3, 1.6, 0.0, 0.0], options=slcp.Options("hard"),
        disturbances=slcp.Disturbances(start=dict.fromkeys(ARM.state_names, 0.05)),
        success=m.largest(abs(m.since_start("fore.angle"))) < 0.5,
        control_limits=(-40.0, 40.0),
    )  # fmt: skip
    hold = holding(task)
    camera = {"every": 3 * H, "lost": 0.2}
    marks = {axis: Sensor(m.point(TIP, axis), 0.002, **camera) for axis in ("x", "y")}
    seeing = Estimated.of_task(task, hold, marks, 0.3)
    blind = Estimated.of_task(task, hold, {"x": Sensor(m.point(TIP, "x"), 50.0, **camera)}, 0.3)
    found = slcp.sweep(task, {"sees": seeing, "blind": blind}, worlds=40, dtype="float64", device="cpu")
    share = {name: found.part(name, arm="disturbed")["success"].mean() for name in ("sees", "blind")}
    assert share["sees"] == 1.0 and share["blind"] < 0.5


def holding(task):
    """Feedback about the start, with the torques that hold it there."""
    x0, sim = np.asarray(task.start)[0], simulator(ARM)
    free = np.asarray(sim.step(x0[None], np.zeros((1, 2))).state)[0, 2:] / H
    B = np.asarray(sim.linearize(x0[None], np.zeros((1, 2))).B)[0, 2:] / H
    gain = -np.concatenate([100.0 * np.eye(2), 20.0 * np.eye(2)], axis=1)
    return policies.Linear(np.linalg.solve(B, gain), x0, -np.linalg.solve(B, free))


def test_a_run_shows_points_of_its_own_scene():
    """A model with another length is told what the plant's tip does, and a run warns of it."""
    longer = replace(STILL, bodies=(STILL.bodies[0], replace(STILL.bodies[1], anchor=(0.6, 0.05))))
    read, sensors = [], {"tip": Sensor(m.point(TIP, "x"), 1e-9)}

    class Reader(KalmanFilter):
        def correct(self, belief, measured):
            read.append(float(measured[0, 0]))
            return super().correct(belief, measured)

    policy = Estimated(policies.Linear(np.zeros((2, 4))), Reader(simulator(STILL), sensors, 0.1))
    with pytest.warns(RuntimeWarning, match="filter has sensors of points, which a run shows by the"):
        simulator(longer).rollout(np.zeros((1, 4)), policy=policy, steps=2)
    heavy = simulator(STILL).params.replace(mass=[3.0, 2.0])
    plain = Estimated(
        policies.Linear(np.zeros((2, 4))), KalmanFilter(simulator(STILL), sensors, 0.1, params=heavy)
    )
    with warnings.catch_warnings(action="error"):  # where its mass puts no point
        plain.begin(simulator(STILL), np.arange(1))
    tip = slcp.costs.position(longer, TIP, np.zeros((1, 4)))[0, 0]
    np.testing.assert_allclose(read, tip, rtol=0, atol=1e-7)


def test_impulses_are_of_steps_of_one_size():
    load = {"hit": Sensor(m.normal_impulse("ball/floor"), 0.1)}
    policy = Estimated(policies.Linear(np.zeros((0, 2))), KalmanFilter(simulator(BALL), load, 0.1, start=0.1))
    finer = simulator(replace(BALL, step_size=0.5 * BALL.step_size))
    with pytest.raises(ArgumentError, match="which grows with steps; the run makes steps of 0.01 s"):
        policy.begin(finer, np.arange(1))
