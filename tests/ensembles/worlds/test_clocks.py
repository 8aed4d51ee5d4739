"""Functions that count steps where a sweep makes steps of other sizes."""

import warnings
from typing import Any

import numpy as np
import pytest
import warp as wp

import slcp_warp as slcp
from slcp_warp import policies


def push(dtype, VX, VU, Data):
    @wp.func
    def control(data: Data, world: int, step: int, x: VX):
        u = VU()
        if dtype(step) * data.h < dtype(0.5):
            u[0] = data.force
        return u

    return control


@wp.func
def hold(data: Any, world: int, step: int, x: Any):
    u = wp.vector(dtype=x.dtype, length=1)
    u[0] = -data.gain * x[0]
    return u


def task():
    scene = slcp.Scene(
        "cart",
        (slcp.Body("cart", 1.0, 0.01, joint="prismatic"),),
        actuators=(slcp.Actuator("cart"),),
        step_size=0.01,
    )
    return slcp.Task("push", scene, duration=1.0, measures={"v": slcp.measures.final("cart.vshift")})


def test_a_sweep_says_whose_time_is_another_one():
    """A push of half a second, by a count of steps of .01 s, is an eighth of one at steps of .0025 s."""
    timed = policies.Function(push, force=1.0, h=0.01)
    with pytest.warns(RuntimeWarning, match=r"policy 'timed' reads the number of the step.* 0.0025 s"):
        report = slcp.sweep(task(), {"timed": timed}, worlds=1, step_sizes=(0.01, 0.0025))
    np.testing.assert_allclose(np.unique(report.table["v"].round(5)), [0.125, 0.5], rtol=1e-4)
    with pytest.warns(RuntimeWarning, match="policy 'late' reads the number"):
        slcp.sweep(task(), {"late": policies.Around(timed, delay=1)}, worlds=1, step_sizes=(0.0025,))


def test_nothing_is_said_of_what_knows_its_time_or_needs_none():
    timed, held = policies.Function(push, force=1.0, h=0.01), policies.Function(hold, gain=1.0)
    plan = policies.OpenLoop(np.ones((100, 1)), 0.01)
    cases = ((timed, (0.01,)), (held, (0.01, 0.0025)), (plan, (0.01, 0.0025)))
    for policy, sizes in cases:
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            slcp.sweep(task(), policy, worlds=1, step_sizes=sizes)
        assert [str(one.message) for one in told] == []
