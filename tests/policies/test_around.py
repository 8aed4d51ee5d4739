"""What lies between a policy and its world: limits, delays, holds and noise of sensors, against NumPy."""

import numpy as np
import pytest
import warp as wp
from scipy import stats
from test_own import (
    FORCE,
    GOAL,
    STARTS,
    STEPS,
    Integrator,
    K,
    loose,
    same_as_by_hand,
    simulator,
    smoothed,
    task,
)

import slcp_warp as slcp
from slcp_warp import policies
from slcp_warp.ensembles.worlds.nominal import nominal
from slcp_warp.kernels.ensembles import disturbances
from slcp_warp.kernels.policies import around


def in_between(control, delay, hold, limits):
    """The same in NumPy."""
    way, held = [np.zeros((len(STARTS), 1))] * delay, None

    def f(k, x):
        nonlocal held
        held = control(k, x) if k % hold == 0 else held
        way.append(held)
        return np.clip(way.pop(0), *limits)

    return f


@pytest.mark.parametrize(
    "strategy, delay, hold",
    [("specialised", 2, 3), pytest.param("generic", 1, 4, marks=pytest.mark.full), ("specialised", 3, 1)],
)
def test_delay_hold_and_limits_around_a_policy_that_remembers(device, strategy, delay, hold):
    between = {"limits": (-1.0, 5.5), "delay": delay, "hold": hold}
    policy = policies.Around(Integrator().policy(), **between)
    run = same_as_by_hand(loose(device, strategy), policy, in_between(Integrator(), delay, hold, (-1.0, 5.5)))
    assert (run.controls[:, :delay] == 0.0).all() and (run.controls == 5.5).any()


@pytest.mark.parametrize("inside, around", [((1, 1), (0, 4)), ((6, 1), (0, 4)), ((2, 2), (1, 3))])
def test_one_around_another(device, inside, around):
    """Delay and hold are steps, also where what is around them asks in some only: what was sent acts in the
    first of these that is not before its time.
    """
    between = [dict(zip(("delay", "hold"), numbers)) for numbers in (inside, around)]
    policy = policies.Around(policies.Around(policies.Linear(K, GOAL, FORCE), **between[0]), **between[1])
    sent = [(-1, np.zeros((len(STARTS), 1)))]  # by the inner one, and when it acts

    def inner(k, x):
        last = sent[-1][0] - inside[0]
        if len(sent) == 1 or k // inside[1] > last // inside[1]:
            u = FORCE + (x - GOAL) @ K.T
            sent.append((k + inside[0], u))
        return [u for when, u in sent if when <= k][-1]

    same_as_by_hand(loose(device), policy, in_between(inner, *around, (-np.inf, np.inf)))


def seen(noise, hold=1, seed=0, device="cpu", worlds=100):
    """What a policy that shows the first velocity sees of states, less these."""
    shows = policies.Linear(np.eye(8)[4:5], np.zeros(8), np.zeros(1))
    policy = policies.Around(shows, hold=hold, noise=noise, seed=seed)
    x0 = np.tile(STARTS[0], (worlds, 1))
    run = loose(device).rollout(x0, policy=policy, steps=STEPS, record="controls")
    return run.controls[:, :, 0] - run.states[:, :-1, 4]


def test_delays_of_a_few_steps_share_their_code():
    sim, inner = simulator("cpu"), policies.Linear(K)
    keys = [policies.Around(inner, delay=steps).kernel(sim)[0].key for steps in (0, 1, 2, 4, 5, 16, 256)]
    assert keys[1] == keys[2] == keys[3] and keys[4] == keys[5] and len(set(keys)) == 4


def test_noise_is_white_normal_and_of_its_size(device):
    noise = seen({"pusher.vshift": 0.3}, device=device)
    assert stats.kstest(noise.ravel() / 0.3, "norm").pvalue > 1e-3
    assert abs(np.corrcoef(noise[:, :-1].ravel(), noise[:, 1:].ravel())[0, 1]) < 0.05
    assert abs(np.corrcoef(noise[:-1].ravel(), noise[1:].ravel())[0, 1]) < 0.05
    np.testing.assert_array_equal(noise[:7], seen(0.3 * np.eye(8)[4], device=device, worlds=7))
    assert not np.isclose(noise[:7], seen(0.3, seed=1, device=device, worlds=7)).any()
    np.testing.assert_allclose(seen({"pusher.shift": 0.3}, worlds=7), 0.0, atol=1e-12)


def test_streams_of_sensors_meet_no_others():
    assert around.SENSOR > disturbances.FAR + 10000 and disturbances.KICK + 10000 < disturbances.FAR


def test_a_sweep_draws_noise_by_the_worlds_number(device):
    policy = policies.Around(policies.Linear(K, GOAL, FORCE), noise=0.05)
    given = {"worlds": 30, "cases": slcp.Options(residual="hard"), "dtype": "float64", "device": device}
    measures = {
        "x": slcp.measures.final("pusher.shift"),
        "most": slcp.measures.largest(slcp.measures.control(0)),
    }
    own = task(scene=loose(device).scene, start=None, measures=measures)
    one, split = (slcp.sweep(own, policy, chunk=chunk, **given).part("policy") for chunk in (None, 7))
    np.testing.assert_array_equal(one["x"], split["x"])
    assert len(np.unique(one["x"])) == 30


def test_no_number_within_limits_is_no_control(device):
    """It ends the world: a clamp would make it the lower limit."""
    nan = policies.Function(smoothed, memory=1, share=0.0, gain=[[0.0]],
                            force=wp.array([np.nan], dtype=wp.float64, device=device))  # fmt: skip
    sim = loose(device)
    run = sim.rollout(STARTS[:1], policy=policies.Around(nan, (-1.0, 1.0)), steps=2)
    assert (run.status == slcp.Status.NONFINITE).all()
    own = task(scene=sim.scene, start=STARTS[:1], control_limits=(-1.0, 1.0))
    report = slcp.sweep(own, nan, worlds=1, cases=sim.options, dtype="float64", device=device)
    assert (report.table["status"] == slcp.Status.NONFINITE).all()


def around_linear(policy=None, **given):
    return policies.Around(policies.Linear(K, GOAL, FORCE) if policy is None else policy, **given)


BAD = {
    "a delay of half a step": (lambda: around_linear(delay=0.5), "delay is 0.5; a whole number"),
    "too long a delay": (lambda: around_linear(delay=1000), "delay is 1000"),
    "no hold": (lambda: around_linear(hold=0), "hold is 0"),
    "negative noise": (lambda: around_linear(noise=-0.1), "noise is -0.1; standard deviations"),
    "NaN noise": (lambda: around_linear(noise=np.nan), "noise holds nan"),
    "noise of another size": (lambda: around_linear(noise=np.ones(6)), r"noise has shape \(6,\); scene"),
    "noise on an unknown state": (lambda: around_linear(noise={"cart.x": 0.1}), "'cart.x'"),
    "negative noise on a state": (
        lambda: around_linear(noise={"block.x": -0.1}), r"noise\['block.x'\] is -0.1"),
    "limits the wrong way": (lambda: around_linear(limits=(1.0, -1.0)), "a lower limit is above"),
    "limits of worlds": (lambda: around_linear(limits=(np.zeros((3, 1)), 1.0)), "limits are for 3 worlds"),
    "no policy": (lambda: around_linear(policy="push"), "policy is a str; a policy is needed"),
    "a callback": (
        lambda: around_linear(policy=policies.Callback(lambda x, t: x)), "acts on the host: it runs"),
    "gains of other worlds": (
        lambda: around_linear(policy=policies.Linear(np.zeros((3, 1, 8)), GOAL, FORCE)), "3 trajectories"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_around_a_policy_says_so(case):
    make, text = BAD[case]
    with pytest.raises(slcp.InputError, match=text):
        simulator("cpu", "generic").rollout(STARTS, policy=make(), steps=2)


def test_noise_inside_noise_is_other_noise(device):
    """Of the same seed both were the same numbers: .204 in place of .1 times the root of two."""
    sim = loose(device)
    noisy = policies.Linear(-np.eye(1, sim.nx), np.zeros(sim.nx))
    for depth in range(1, 4):
        noisy = policies.Around(noisy, noise=0.1)
        run = sim.rollout(np.zeros((4000, sim.nx)), policy=noisy, steps=1, record="controls")
        assert run.controls[:, 0, 0].std() == pytest.approx(0.1 * np.sqrt(depth), rel=0.05)


def test_what_acts_before_the_first_control_that_is_late(device):
    """In every kind of step: within limits, in kernels and in sweeps."""
    between = {"limits": (-1.0, 5.5), "delay": 3, "hold": 2}
    policy = policies.Around(Integrator().policy(), **between, before=[0.7])
    run = loose(device, "specialised").rollout(STARTS, policy=policy, steps=STEPS, record="controls")
    zero = policies.Around(Integrator().policy(), **between)
    other = loose(device, "specialised").rollout(STARTS, policy=zero, steps=STEPS, record="controls")
    np.testing.assert_allclose(np.asarray(run.controls)[:, :3], 0.7, rtol=1e-6)
    assert (np.asarray(other.controls)[:, :3] == 0.0).all()
    beyond = policies.Around(Integrator().policy(), **between, before=9.0)
    run = loose(device, "specialised").rollout(STARTS, policy=beyond, steps=STEPS, record="controls")
    assert (np.asarray(run.controls)[:, :3] == 5.5).all()
    with pytest.raises(slcp.ArgumentError, match=r"before has shape \(2,\); a number, or \(1,\), is needed"):
        wrong = policies.Around(Integrator().policy(), delay=1, before=[1.0, 2.0])
        loose(device, "specialised").rollout(STARTS, policy=wrong, steps=2)


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
def test_what_acts_before_is_of_the_task_in_sweeps_and_rollouts(device, strategy):
    """Nothing is sent, and what acts before does for as long as the delay, in both arms and on the host."""
    own = task(
        disturbances=slcp.Disturbances(delay=0.06, before=(2.0,), torque=1e-9), control_limits=(-1.0, 1.5)
    )
    steps = round(0.06 / own.scene.step_size)
    named = {"still": policies.Linear(np.zeros((1, 2 * own.scene.nv))), "host": StillOnTheHost()}
    own = own.replace(measures={"push": slcp.measures.mean(slcp.measures.control(0))})
    report = slcp.sweep(own, named, worlds=2, cases=own.options, device=device, strategy=strategy)
    for name in named:
        for arm in ("undisturbed", "disturbed"):
            found = report.part(name, arm=arm)["push"]
            np.testing.assert_allclose(found, 1.5 * steps / STEPS, rtol=1e-4)
        run = simulator(device, strategy).rollout(
            STARTS, policy=nominal(named[name], own, own.scene.step_size), steps=STEPS, record="controls"
        )
        assert (run.controls[:, :steps] == 1.5).all() and (run.controls[:, steps:] == 0.0).all()


class StillOnTheHost:
    period = None

    def act(self, x, time, worlds):
        return np.zeros((len(x), 1))


def test_what_acts_before_needs_a_delay_and_fits_the_controls():
    with pytest.raises(slcp.ArgumentError, match="before is 1.0, but there is no delay"):
        slcp.Disturbances(before=1.0)
    with pytest.raises(slcp.InputError, match="before has 2 controls; scene .* has 1"):
        task(disturbances=slcp.Disturbances(delay=0.1, before=(1.0, 2.0)))
    with pytest.raises(slcp.InputError, match="Disturbances.before"):
        slcp.Disturbances(delay=0.1, before="much")
