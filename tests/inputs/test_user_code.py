"""Functions of users: what Warp cannot translate, or indices beyond what they index, are one clear error."""

from typing import Any

import numpy as np
import pytest
import warp as wp

import slcp_warp as slcp
from slcp_warp import costs, ddp, measures, policies
from slcp_warp.inputs.user_code import Known, check_indices

SCENE = slcp.scenes.cart_pole() if hasattr(slcp.scenes, "cart_pole") else slcp.scenes.flicking_finger()
NX, NU = 2 * SCENE.nv, SCENE.nu
BEYOND, LAST = NX, NX - 1
SIM = slcp.Simulator(SCENE, device="cpu")


@wp.func
def measure_beyond(x: Any, u: Any, time: wp.float64):
    return x[BEYOND]


@wp.func
def measure_before(x: Any, u: Any, time: wp.float64):
    return u[-3]


@wp.func
def deeper(x: Any):
    return x[BEYOND] + x[0]


@wp.func
def measure_calls(x: Any, u: Any, time: wp.float64):
    return deeper(x)


@wp.func
def measure_types(x: Any, u: Any, time: wp.float64):
    return wp.float64(x[0]) * 2


@wp.func
def measure_last(x: Any, u: Any, time: wp.float64):
    found = x[LAST] + x[-1]
    for i in range(2):
        found += x[i]
    return found


def swept(signal):
    task = slcp.Task("t", SCENE, duration=0.1, measures={"m": measures.final(signal)})
    idle = policies.Linear(np.zeros((NU, NX)), SCENE.x0, np.zeros(NU))
    return slcp.sweep(task, idle, worlds=2, cases=task.options)


@pytest.mark.parametrize(
    "function, message",
    [
        (measure_beyond, rf"measure_beyond has x\[{NX}\]; x has {NX} numbers"),
        (measure_before, rf"measure_before has u\[-3\]; u has {NU} numbers"),
        (measure_calls, rf"deeper has x\[{NX}\]; x has {NX} numbers"),
    ],
)
def test_measures_beyond_a_state(function, message):
    with pytest.raises(slcp.ArgumentError, match=rf"measures.function: {message}"):
        swept(measures.function(function))


def test_measures_that_warp_cannot_translate():
    for _ in range(2):
        with pytest.raises(
            slcp.ArgumentTypeError, match="'measure_types' is no f.x, u, time. of .*Input types"
        ):
            swept(measures.function(measure_types))


def test_measures_within_a_state_are_taken():
    report = swept(measures.function(measure_last))
    assert np.isfinite(report.table["m"]).all()


def made(body):
    """A policy's function with a body of one line."""

    def make(dtype, VX, VU, Data):
        return body(dtype, VX, VU, Data)

    return make


def of_state(dtype, VX, VU, Data):
    @wp.func
    def control(data: Data, world: int, step: int, x: VX):
        return VU(x[wp.static(3)] + x[BEYOND])

    return control


def of_control(dtype, VX, VU, Data):
    @wp.func
    def control(data: Data, world: int, step: int, x: VX):
        u = VU()
        u[NX] = x[0]
        return u

    return control


def of_array(dtype, VX, VU, Data):
    @wp.func
    def control(data: Data, world: int, step: int, x: VX):
        return VU(data.g[2])

    return control


def of_end(dtype, VX, VU, Data):
    @wp.func
    def control(data: Data, world: int, step: int, x: VX):
        return VU(data.g[-3])

    return control


def of_table(dtype, VX, VU, Data):
    @wp.func
    def control(data: Data, world: int, step: int, x: VX):
        return VU(data.table[0, 5])

    return control


def guarded(dtype, VX, VU, Data):
    @wp.func
    def control(data: Data, world: int, step: int, x: VX):
        u = VU()
        if data.g.shape[0] > 7:
            u[0] = data.g[7]
        if wp.static(NX > 100):
            u[0] = x[100]
        u[0] = u[0] + data.g[-1] + data.g[step % 2]
        x = VX()
        return u

    return control


@pytest.mark.parametrize(
    "make, message",
    [
        (of_state, rf"x\[{NX}\]; x has {NX} numbers"),
        (of_control, rf"u\[{NX}\]; u has {NU} numbers"),
        (of_array, r"data.g\[2\]; data.g has shape \(2,\)"),
        (of_end, r"data.g\[-3\]; data.g has shape \(2,\)"),
        (of_table, r"data.table\[0, 5\]; data.table has shape \(3, 5\)"),
    ],
)
def test_policies_beyond_what_they_index(make, message):
    policy = policies.Function(make, g=[1.0, 2.0], table=np.zeros((3, 5)))
    with pytest.raises(slcp.ArgumentError, match=rf"policies.Function: control has {message}"):
        SIM.rollout(SCENE.x0, policy=policy, steps=2)


def test_what_asks_first_is_the_users():
    run = SIM.rollout(SCENE.x0, policy=policies.Function(guarded, g=[1.0, 2.0]), steps=3, record="controls")
    np.testing.assert_array_equal(run.controls[:, 0], [3.0, 4.0, 3.0])


def test_observations():
    def beyond(dtype, VX, VY):
        @wp.func
        def look(x: VX):
            return VY(x[BEYOND])

        return look

    def types(dtype, VX, VY):
        @wp.func
        def look(x: VX):
            return VY(wp.float16(1.0) * x[0])

        return look

    inner = policies.Linear(np.zeros((NU, 1)))
    with pytest.raises(slcp.ArgumentError, match=rf"Observation.function: look has x\[{NX}\]"):
        SIM.rollout(SCENE.x0, policy=policies.Observed(inner, policies.Observation(beyond, 1)), steps=2)
    with pytest.raises(slcp.ArgumentTypeError, match="Observation.function is no f.x. -> y .*Input types"):
        SIM.rollout(SCENE.x0, policy=policies.Observed(inner, policies.Observation(types, 1)), steps=2)
    with pytest.raises(slcp.ArgumentError, match=rf"look has x\[{NX}\]"):
        policies.Observation(beyond, 1).of(np.zeros((2, NX)))


def test_costs():
    def beyond(dtype, VX, VU):
        @wp.func
        def running(x: VX, u: VU, k: int):
            return x[BEYOND]

        return running, None

    def types(dtype, VX, VU):
        @wp.func
        def running(x: VX, u: VU, k: int):
            return x[0] * 2

        return running, None

    us = np.zeros((4, NU))
    with pytest.raises(
        slcp.ArgumentError, match=rf"costs: running: running has x\[{NX}\]; x has {NX} numbers"
    ):
        ddp.solve(ddp.Problem(SIM, costs.plain(beyond), horizon=4), SCENE.x0, us)
    with pytest.raises(slcp.ArgumentTypeError, match="costs: they are none of .* states .*Input types"):
        ddp.solve(ddp.Problem(SIM, costs.plain(types), horizon=4), SCENE.x0, us)


@wp.func
def longer(v: wp.vec3d):
    return v[2]


@wp.func
def longer(v: wp.vec2d):  # noqa: F811
    return v[1]


@wp.func
def calls_the_shorter(x: Any, u: Any, time: wp.float64):
    v = wp.vec2d(wp.float64(x[0]), wp.float64(2.0))
    return longer(v)


@wp.func
def returns_before(x: Any, u: Any, time: wp.float64):
    if wp.static(BEYOND > 2):
        return wp.float64(x[0])
    return wp.float64(x[BEYOND])


@wp.func
def never_asks(x: Any, u: Any, time: wp.float64):
    found = wp.float64(x[0])
    if BEYOND < 2:
        found = wp.float64(x[BEYOND])
    for _i in range(wp.static(0)):
        found += wp.float64(x[BEYOND])
    return found


@wp.func
def own_number(x: Any, u: Any, time: wp.float64):
    LAST = int(time) % 2
    for BEYOND in range(2):
        LAST += BEYOND
    return wp.float64(x[LAST])


@wp.func
def two():
    return wp.vec4d(wp.float64(1.0)), wp.float64(2.0)


@wp.func
def from_a_tuple(x: Any, u: Any, time: wp.float64):
    v, w = two()
    return v[3] + w


@wp.func
def counts_within(x: Any, u: Any, time: wp.float64):
    found = wp.float64(0.0)
    for i in range(BEYOND):
        found += wp.float64(x[i])
    for i in range(LAST):
        found += wp.float64(x[i + 1]) + wp.float64(x[time_of(i)])
    for i in range(BEYOND + 5):
        if i < BEYOND:
            found += wp.float64(x[i])
    for i in range(2, BEYOND + 5):
        if found > wp.float64(1.0) and i < BEYOND:
            found += wp.float64(x[i])
    for i in range(BEYOND + 5):
        if i == BEYOND:
            break
        found += wp.float64(x[i])
    return found


@wp.func
def time_of(i: int):
    return i % 2


@wp.func
def counts_beyond(x: Any, u: Any, time: wp.float64):
    found = wp.float64(0.0)
    for i in range(BEYOND + 2):
        found += wp.float64(x[i])
    return found


@wp.func
def counts_on(x: Any, u: Any, time: wp.float64):
    found = wp.float64(0.0)
    for i in range(1, BEYOND):
        for j in range(2):
            found += wp.float64(x[i + 1 + j])
    return found


@pytest.mark.parametrize(("function", "at"), [(counts_beyond, NX + 1), (counts_on, NX + 1)])
def test_loops_that_count_beyond(function, at):
    with pytest.raises(slcp.ArgumentError, match=rf"{function.key} has x\[{at}\]; x has {NX} numbers"):
        check_indices("measures.function", function, Known(NX), Known(NU))


def over_what_is_observed(dtype, VX, VU, Data):
    @wp.func
    def control(data: Data, world: int, step: int, x: VX):
        s = dtype(0.0)
        for i in range(6):
            s += data.K[i] * x[i]
        return VU(s)

    return control


def test_a_policy_that_reads_more_than_it_sees():
    law = policies.Function(over_what_is_observed, K=np.zeros(6))
    with pytest.raises(slcp.ArgumentError, match=r"control has x\[5\]; x has 2 numbers"):
        policies.Observed(law, list(SCENE.state_names[:2])).kernel(slcp.Simulator(SCENE, device="cpu"))


@pytest.mark.parametrize(
    "function",
    [calls_the_shorter, returns_before, never_asks, own_number, from_a_tuple, counts_within],
    ids=lambda f: f.key,
)
def test_what_is_right_is_no_alarm(function):
    known = Known(NX), Known(NU)
    check_indices("measures.function", function, *known)
