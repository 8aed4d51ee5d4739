"""Policies of users against loops over `sim.step` in NumPy that hand on multipliers: the same to 1e-9."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import warp as wp

import slcp_warp as slcp
from slcp_warp import measures as m
from slcp_warp import policies

SCENE = replace(slcp.scenes.push_block(), step_size=0.02, sigma=0.05)
STEPS = 75
K = np.array([[-9.0, 0.0, 0.0, 1.0, -2.0, 0.0, 0.0, 0.3]])
GOAL, FORCE = SCENE.x0 + 0.1, np.array([2.0])
STARTS = SCENE.x0 + np.outer(np.linspace(-0.05, 0.05, 5), np.eye(8)[0])


def simulator(device, strategy="specialised", residual=None):
    """Smoothed where kernels are specialised, hard where they are generic, as the tests of tasks have it."""
    residual = residual or {"specialised": "rem-logistic", "generic": "hard"}[strategy]
    return slcp.Simulator(SCENE, slcp.Options(residual=residual), device=device, strategy=strategy)


def loose(device, strategy="specialised"):
    """Without contacts: for what policies say, in kernels that compile soon."""
    scene = replace(SCENE, contacts=())
    return slcp.Simulator(scene, slcp.Options(residual="hard"), device=device, strategy=strategy)


def by_hand(sim, control, steps=STEPS):
    """States (B, N+1, nx) and controls (B, N, nu) of a loop; control(k, x) gives (B, nu)."""
    x, warm = STARTS, None
    states, controls = [x], []
    for k in range(steps):
        controls.append(control(k, x))
        step = sim.step(x, controls[-1], warm_start=warm)
        assert not step.status.any()
        x, warm = step.state, step.multiplier
        states.append(x)
    return np.stack(states, 1), np.stack(controls, 1)


def same_as_by_hand(sim, policy, control):
    run = sim.rollout(STARTS, policy=policy, steps=STEPS, record=("controls", "impulse", "gap"))
    states, controls = by_hand(sim, control)
    assert not run.status.any() and np.ptp(states[:, -1], axis=0).max() > 1e-3
    np.testing.assert_allclose(run.states, states, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.controls, controls, rtol=0, atol=1e-7)
    return run


class Integrator:
    """PI control of the pusher, as a Warp function of any simulator and in NumPy."""

    gain = np.array([20.0, 0.5])
    target = 0.3

    def __init__(self):
        self.sum = 0.0

    @staticmethod
    def make(dtype, VX, VU, Data, Memory):
        @wp.func
        def control(data: Data, world: int, step: int, x: VX, memory: Memory):
            error = data.target - x[0]
            after = Memory(memory[0] + error)
            return VU(data.gain[0] * error + data.gain[1] * after[0]), after

        return control

    def policy(self):
        return policies.Function(self.make, memory=1, gain=self.gain, target=self.target)

    def __call__(self, k, x):
        error = self.target - x[:, :1]
        self.sum = self.sum + error
        return self.gain[0] * error + self.gain[1] * self.sum


@wp.func
def smoothed(data: Any, world: int, step: int, x: Any, memory: Any):
    """A force by a low-pass filter of the position, another one in every world."""
    after = memory
    after[0] = memory[0] + data.share * (x[0] - memory[0])
    return wp.vector(data.force[world] - data.gain[0, 0] * after[0], length=1), after


@wp.func
def first_position(data: Any, world: int, x: Any):
    return wp.vector(x[0], length=1)


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
def test_linear_feedback_within_limits(device, strategy):
    sim = simulator(device, strategy)
    policy = policies.Linear(K, GOAL, FORCE, limits=(-1.0, 2.6))
    run = same_as_by_hand(sim, policy, lambda k, x: np.clip(FORCE + (x - GOAL) @ K.T, -1.0, 2.6))
    assert (run.controls == 2.6).any() and (run.controls < 2.5).any()


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
def test_a_function_that_remembers(device, strategy):
    same_as_by_hand(simulator(device, strategy), Integrator().policy(), Integrator())


def test_a_filter_starts_where_it_is_told_and_knows_its_world(device):
    force = np.linspace(2.0, 4.0, len(STARTS))
    policy = policies.Function(smoothed, memory=1, start=first_position, share=0.2, force=force, gain=[[5.0]])
    kept = STARTS[:, 0]

    def control(k, x):
        nonlocal kept
        kept = kept + 0.2 * (x[:, 0] - kept)
        return (force - 5.0 * kept)[:, None]

    same_as_by_hand(loose(device), policy, control)


def task(**changes):
    fields = {
        "name": "push", "scene": SCENE, "horizon": STEPS,
        "cost": slcp.costs.terms(SCENE, [slcp.costs.effort(1.0)]),
        "start": STARTS, "measures": {"x": m.final("block.x"), "most": m.largest(m.control(0))},
    }  # fmt: skip
    return slcp.Task(**{**fields, **changes})


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
def test_sweeps_ask_the_same_policies(device, strategy):
    """Its measures are those of the loop; a task's limits hold for all policies."""
    sim = simulator(device, strategy)
    named = {"integrator": Integrator().policy(), "linear": policies.Linear(K, GOAL, FORCE)}
    given = {"worlds": 1, "cases": sim.options, "dtype": "float64", "device": device, "strategy": strategy}
    report = slcp.sweep(task(control_limits=(-1.0, 7.0)), named, **given)
    pi = Integrator()
    for name, control in (("integrator", pi), ("linear", lambda k, x: FORCE + (x - GOAL) @ K.T)):
        states, controls = by_hand(sim, lambda k, x, c=control: np.clip(c(k, x), -1.0, 7.0))
        found = report.part(name, arm="undisturbed")
        assert not found["status"].any()
        np.testing.assert_allclose(found["x"], states[:, -1, 1], rtol=0, atol=1e-9)
        np.testing.assert_allclose(found["most"], controls.max((1, 2)), rtol=0, atol=1e-7)


def test_a_sweep_counts_the_worlds_of_a_policy_through_its_chunks(device):
    """World by world another force: the same whatever the chunks."""
    force = np.linspace(0.0, 5.0, 30)
    policy = policies.Function(smoothed, memory=1, start=first_position, share=0.2, force=force, gain=[[5.0]])
    given = {"worlds": 30, "cases": slcp.Options(residual="hard"), "dtype": "float64", "device": device}
    measures = {"x": m.final("pusher.shift"), "most": m.largest(m.control(0))}
    own = task(scene=loose(device).scene, start=None, measures=measures)
    one, split = (slcp.sweep(own, policy, chunk=chunk, **given).part("policy") for chunk in (None, 7))
    np.testing.assert_array_equal(one["x"], split["x"])
    assert len(np.unique(one["most"])) > 10


def test_policies_of_other_numbers_share_their_kernels():
    one, two = Integrator().policy(), policies.Function(Integrator.make, memory=1, gain=[1.0, 3.0], target=2)
    assert one.kernel(simulator("cpu"))[0] == two.kernel(simulator("cpu"))[0]
    other = policies.Function(Integrator.make, memory=2, gain=[1.0], target=2)
    assert other._kernel != one._kernel
    assert one._kernel.in_words == "function make"


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
@pytest.mark.parametrize("period", [None, 0.06])
def test_callbacks_in_python(device, strategy, period):
    every = 1 if period is None else 3
    times, held = [], np.zeros((len(STARTS), 1))

    def f(x, time):
        times.append(time)
        return FORCE + (x - GOAL) @ K.T

    def control(k, x):
        nonlocal held
        held = FORCE + (x - GOAL) @ K.T if k % every == 0 else held
        return held

    same_as_by_hand(simulator(device, strategy), policies.Callback(f, period), control)
    np.testing.assert_allclose(times, 0.02 * every * np.arange(STEPS // every))


# Warp functions that are no policies


@wp.func
def too_few(data: Any, x: Any):
    return wp.vector(x[0], length=1)


@wp.func
def the_state(data: Any, world: int, step: int, x: Any):
    return x


@wp.func
def no_such_array(data: Any, world: int, step: int, x: Any):
    return wp.vector(data.gain[0] * x[0], length=1)


@wp.func
def only_controls(data: Any, world: int, step: int, x: Any, memory: Any):
    return wp.vector(x[0], length=1)


def roll(policy):
    return lambda: simulator("cpu").rollout(STARTS, policy=policy(), steps=3)


F = policies.Function
BAD = {
    "another number of arguments": (
        lambda: F(too_few), r"control takes \(data, x\); \(data, world, step, x\) is"),
    "memory that it does not take": (lambda: F(the_state, memory=1), "step, x, memory. is needed"),
    "a maker of too few": (lambda: F(lambda dtype: 1), "it must take 4 arguments"),
    "a maker of something else": (
        roll(lambda: F(lambda dtype, VX, VU, Data: 1)), "control made a int; a Warp function"),
    "no controls": (
        roll(lambda: F(the_state)), "is no control.data, world, step, x. -> u for 8 states, 1 controls"),
    "an array that is not there": (roll(lambda: F(no_such_array)), "'gain'|\"gain\"|gain"),
    "an array by another name": (
        roll(lambda: F(no_such_array, gains=np.zeros((1, 2)), k=2.0)), r"with data.gains\[i, j\], data.k: "),
    "no memory given back": (roll(lambda: F(only_controls, memory=1)), r"is no control.*\(u, memory\)"),
    "no function": (lambda: F(3), "control is 3; a function is needed"),
    "a start without memory": (lambda: F(the_state, start=first_position), "start is given, but memory is 0"),
    "memory of half a number": (lambda: F(the_state, memory=0.5), "memory is 0.5; a whole number"),
    "a text for an array": (lambda: F(the_state, gain="high"), "gain is 'high'; an array of numbers"),
    "NaN": (lambda: F(the_state, gain=[1.0, np.nan]), "gain holds nan; finite numbers"),
    "five axes": (lambda: F(the_state, gain=np.zeros((1,) * 5)), r"gain has shape .*at most 4 axes"),
    "another precision": (
        roll(lambda: F(no_such_array, gain=wp.zeros(1, dtype=wp.float32, device="cpu"))),
        "is a Warp array of float32 on cpu; a contiguous one of float64"),
    "gains of another scene": (
        roll(lambda: policies.Linear(np.zeros((1, 6)), np.zeros(6), FORCE)), r"K has shape \(1, 6\); scene"),
    "gains of other worlds": (
        roll(lambda: policies.Linear(np.zeros((3, 1, 8)), GOAL, FORCE)), "holds 3 trajectories; 1 or 5 is"),
    "a point of another size": (lambda: policies.Linear(K, np.zeros(6), FORCE), "x_ref has 6 components"),
    "a force of another size": (lambda: policies.Linear(K, GOAL, np.zeros(2)), "u_ref has 2 components"),
    "worlds that disagree": (
        lambda: policies.Linear(np.zeros((3, 1, 8)), np.zeros((2, 8)), FORCE), "are for 3, 2 and 1 worlds"),
    "NaN gains": (lambda: policies.Linear(K * np.nan, GOAL, FORCE), "K holds nan; finite numbers"),
    "a gain without axes": (lambda: policies.Linear(3.0, GOAL, FORCE), r"K has shape \(\); \(nu, nx\)"),
    "gains on a tape": (
        lambda: policies.Linear(wp.zeros((1, 8), device="cpu"), GOAL, FORCE), "K is a Warp array"),
    "limits of other worlds": (
        lambda: policies.Linear(K, GOAL, FORCE, (np.zeros((2, 1)), 1.0)), "limits are for 2 worlds"),
    "a callback of other size": (
        roll(lambda: policies.Callback(lambda x, time: np.zeros(3))), r"policy gave shape \(3,\) at 0 s"),
    "a callback that gives text": (
        roll(lambda: policies.Callback(lambda x, time: "push")), "policy gave 'push' at 0 s"),
    "a callback that gives NaN": (
        roll(lambda: policies.Callback(lambda x, time: np.array([np.nan]))), "policy gave nan at 0 s"),
    "a callback of no arguments": (lambda: policies.Callback(lambda: 0.0), "it must take 2 arguments"),
    "a callback never asked": (lambda: policies.Callback(lambda x, t: x, 0.0), "period is 0.0"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_what_is_no_policy_says_so(case):
    call, text = BAD[case]
    with pytest.raises(slcp.InputError, match=text) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_no_gradient_flows_through_them():
    sim = simulator("cpu")
    x0 = wp.array(STARTS, dtype=wp.float64, device="cpu", requires_grad=True)
    for policy in (Integrator().policy(), policies.Callback(lambda x, time: FORCE)):
        with wp.Tape(), pytest.raises(slcp.InputError, match="gradient"):
            sim.rollout(x0, policy=policy, steps=3)
