"""Worlds that were drawn from another design keep its numbers, which is said."""

import warnings

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import measures as m


def task_of(limit: float, **changes) -> slcp.Task:
    """A slider that a limited servo moves, of uncertain mass."""
    body = slcp.Body("slider", 1.0, 0.01, joint="prismatic")
    drive, motor = slcp.limited_servo(body, 100.0, limit)
    scene = slcp.Scene("slider", (body,), actuators=(motor,), tendons=(drive,), step_size=0.01)
    drawn = {"parameters": {"slider.mass": slcp.Uniform(0.5, 2.0)}} | changes
    most = {"most": m.largest(abs(m.tendon_force(0)))}
    return slcp.Task("slide", scene, duration=0.2, measures=most, disturbances=slcp.Disturbances(**drawn))


def test_sweeps_and_replays_say_whose_numbers_they_have(device):
    told = slcp.policies.Linear(np.zeros((1, 2)), np.zeros(2), [1.0])
    given = {"device": device, "dtype": "float64"}
    worlds, task = slcp.draw_worlds(task_of(50.0), 4), task_of(5.0)
    match = "slider_servo.tendon_force_limit 50 in place of 5, which the task's scene has and nothing draws"
    with pytest.warns(RuntimeWarning, match=match):
        report = slcp.sweep(task, told, worlds=worlds, cases=slcp.Options("hard"), **given)
    assert (report.part("policy")["most"] > 40.0).all()  # as they are given
    with pytest.warns(RuntimeWarning, match=match):
        slcp.replay(task, told, worlds, case=slcp.Options("hard"), **given)


@pytest.mark.parametrize(
    "changes", [{}, {"parameters": {"slider_servo.tendon_force_limit": slcp.UniformFactor(0.9, 1.1)}}]
)
def test_ones_own_worlds_are_not_told_of(device, changes):
    """Nor of a number that all of one world have, where the task draws it."""
    told = slcp.policies.Linear(np.zeros((1, 2)), np.zeros(2), [1.0])
    task = task_of(5.0, **changes)
    drawn = slcp.draw_worlds(task, 4)
    for worlds in (drawn, drawn[2:3], slcp.Worlds(np.zeros((2, 2)))):
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            run = slcp.replay(task, told, worlds, case=slcp.Options("hard"), device=device)
        assert [str(each.message) for each in said] == [] and (run.status == 0).all()
