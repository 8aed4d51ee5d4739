"""Policies that act by the world's number: rows that they look up, noise of their own in `failure_share`."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from simulators import driven_cart

import slcp_warp as slcp
from slcp_warp import measures, policies
from slcp_warp.costs import Term, terms
from slcp_warp.inputs.errors import ArgumentError
from slcp_warp.stepping.by_world import alike

H = slcp.Options("hard", "none")
B = 16
CART = driven_cart(1.0)


def task(**disturbances):
    shift = measures.final("cart.shift")
    return slcp.Task(
        "drift", CART, terms(CART, [Term("square", 1.0, state="cart.shift")]), horizon=20,
        disturbances=slcp.Disturbances(velocity=0.05, **disturbances),
        measures={"shift": shift}, success=shift.between(-0.5, 0.5),
    )  # fmt: skip


@wp.func
def own_gain(data: Any, world: int, step: int, x: Any):
    return wp.vector(data.gain[world], length=1)


@wp.func
def own_row(data: Any, world: int, step: int, x: Any):
    table = data.table
    return wp.vector(table[world, step % 2], length=1)


@wp.func
def in_turn(data: Any, world: int, step: int, x: Any):
    return wp.vector(data.gain[world % 4], length=1)


@wp.func
def by_another_name(data: Any, world: int, step: int, x: Any):
    who = world
    return wp.vector(data.gain[who], length=1)


@wp.func
def asked_before(data: Any, world: int, step: int, x: Any):
    u = data.gain[0]
    if world < 16:
        u = data.gain[world]
    return wp.vector(u, length=1)


@wp.func
def in_a_question(data: Any, world: int, step: int, x: Any):
    u = data.gain[0]
    if data.gain[world] > data.gain[0]:
        u = data.gain[world]
    return wp.vector(u, length=1)


@wp.func
def taken_in_turn(data: Any, world: int, step: int, x: Any):
    world = world % 16
    return wp.vector(data.gain[world], length=1)


@wp.func
def remembered(data: Any, world: int, step: int, x: Any, memory: Any):
    return wp.vector(memory[0], length=1), memory


@wp.func
def own_start(data: Any, world: int, x: Any):
    return wp.vector(data.gain[world], length=1)


GAIN = np.linspace(-1.0, 1.0, B)
LOOKS_UP = {
    "gain": policies.Function(own_gain, gain=GAIN),
    "table": policies.Function(own_row, table=np.stack([GAIN, -GAIN], axis=1)),
    "another name": policies.Function(by_another_name, gain=GAIN),
    "in a question": policies.Function(in_a_question, gain=GAIN),
    "start": policies.Function(remembered, memory=1, start=own_start, gain=GAIN),
    "behind": policies.Around(policies.Function(own_gain, gain=GAIN), delay=1),
}


@pytest.mark.parametrize("name", LOOKS_UP)
def test_rows_that_are_not_there_are_never_looked_up(name):
    """Memory beyond an array's end was read."""
    policy, sim = LOOKS_UP[name], slcp.Simulator(CART, H, device="cpu", dtype="float64")
    found = slcp.sweep(task(), policy, worlds=B, cases=H).part("policy")
    assert np.isfinite(found["shift"]).all() and np.ptp(found["shift"]) > 0.01
    many = np.zeros((B + 1, 2))
    for run in (
        lambda: slcp.sweep(task(), policy, worlds=B + 1, cases=H),
        lambda: sim.rollout(many, policy=policy, steps=2),
        lambda: slcp.sweep(task(), policy, worlds=slcp.draw_worlds(task(), B + 3)[B:], cases=H),
    ):
        with pytest.raises(ArgumentError, match=rf"by the world's number, and has {B} rows; it is asked for"):
            run()
    assert not sim.rollout(many[:B], policy=policy, steps=2).status.any()


@pytest.mark.parametrize("policy", [LOOKS_UP["gain"], policies.Linear(np.zeros((B, 1, 2)))])
def test_questions_about_any_world_refuse_policies_of_some(policy):
    for ask in (
        lambda: slcp.failure_share(task(torque=0.01), policy, case=H),
        lambda: slcp.sensitivity(task(torque=0.01), policy, measure="shift", case=H, samples=16),
    ):
        with pytest.raises(ArgumentError, match="any world's number|one for all worlds is needed"):
            ask()


def test_questions_about_known_worlds_take_policies_of_as_many():
    """Maps run worlds 0, 1, ... and `falsify` world 0 alone."""
    policy, axes = LOOKS_UP["gain"], (("mass", (1.0, 2.0)), ("cart.vshift", (0.0,)))
    found = slcp.robustness_map(task(), policy, *axes, worlds=B, case=H)
    assert (found.successes > 0).all()
    with pytest.raises(ArgumentError, match=f"numbers up to {B}"):
        slcp.robustness_map(task(), policy, *axes, worlds=B + 1, case=H)
    one = slcp.falsify(task(), policies.Function(own_gain, gain=[0.1]), "start", case=H, worlds=64)
    same = slcp.falsify(task(), policies.Linear(np.zeros((1, 2)), u_ref=[0.1]), "start", case=H, worlds=64)
    assert one.size == same.size < np.inf
    with pytest.raises(ArgumentError, match="one for all worlds is needed"):
        slcp.falsify(task(), policies.Linear(np.zeros((B, 1, 2))), "start", case=H, worlds=64)


@pytest.mark.parametrize("control", [in_turn, asked_before, taken_in_turn])
def test_rows_in_turn_are_for_any_world(control):
    policy = policies.Function(control, gain=0.05 * GAIN)
    found = slcp.sweep(task(), policy, worlds=100, cases=H).part("policy")["shift"]
    assert np.isfinite(found).all()
    assert slcp.failure_share(task(), policy, case=H, islands=2, particles=40, length=10).worlds > 0


class Dither:
    """On the host, by the world's number and the time."""

    def act(self, x, time, worlds):
        return np.array(
            [np.random.default_rng((int(w), round(time / 0.1))).standard_normal() for w in worlds]
        )[:, None]


NOISY = policies.Around(policies.Linear([[-1.0, -1.0]]), noise={"cart.shift": 1.0}, seed=3)


@pytest.mark.parametrize("policy", [NOISY, Dither()], ids=["around", "host"])
def test_a_policys_own_noise_is_that_of_many_worlds(policy):
    """Share of failures by splitting and by a sweep: world 0's noise, of all worlds, is no answer."""
    plain = 1.0 - slcp.sweep(task(), policy, worlds=2000, cases=H).summary[0]["success"][0]
    found = slcp.failure_share(task(), policy, case=H, islands=8, particles=100, length=10)
    assert 0.005 < plain < 0.7
    assert found.low / 2.0 < plain < 2.0 * found.high and found.share > 0.2 * plain


def test_what_acts_alike_says_so():
    linear = policies.Linear([[-1.0, -1.0]])
    assert (
        alike(linear) and alike(policies.Around(linear, delay=2)) and alike(policies.Callback(lambda x, t: x))
    )
    assert alike(policies.Around(linear, noise=0.0)) and not alike(NOISY)
    assert not alike(policies.Around(NOISY)) and not alike(LOOKS_UP["gain"]) and not alike(Dither())
    assert not alike(policies.Linear(np.zeros((B, 1, 2)))) and alike(
        policies.Observed(linear, ("cart.shift",))
    )
