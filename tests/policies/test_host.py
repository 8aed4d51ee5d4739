"""Policies on the host, and gains of every world's own, in sweeps: the bits of policies in kernels."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from simulators import scene

import slcp_warp as slcp
from slcp_warp import ddp, policies
from slcp_warp import measures as m

SCENE = replace(scene("push_on_ice"), step_size=0.02, sigma=0.05)
STEPS, WORLDS = 75, 40
GOAL = np.eye(8)[0] * 0.3  # the pusher's place
GAIN = -9.0 * np.eye(8)[:1] - 0.25 * np.eye(8)[4:5]  # place and speed; a quarter of it has no rounding
MEASURES = {
    "x": m.final("block.x"),
    "rate": m.rate("pusher.shift", start=0.3),
    "push": m.impulse(),
    "gap": m.lowest_gap(),
    "force": m.integral(m.control(0)),
    "first": m.first_time(m.state("block.x") > 0.05),
    "touches": m.count(m.contact() > 0.5),
}
DISTURBANCES = slcp.Disturbances(
    velocity=0.1, torque=0.3, parameters={"mass": 0.1}, kick_times=(0.0, 0.4, 0.403, 0.41, 0.9), kick=0.2
)
OPTIONS = {"specialised": slcp.Options(), "generic": slcp.Options(residual="hard")}


def task(**changes):
    cost = slcp.costs.terms(SCENE, [slcp.costs.effort(1.0)])
    fields = {
        "name": "push", "scene": SCENE, "horizon": STEPS, "cost": cost, "control_limits": (-1.0, 2.0),
        "start": SCENE.x0 + np.outer([0.0, 0.05], np.eye(8)[0]), "measures": MEASURES,
        "disturbances": DISTURBANCES, "success": m.final("block.x") > 0.1,
    }  # fmt: skip
    return slcp.Task(**{**fields, **changes})


def sweep(policy, device="cpu", strategy="specialised", **given):
    given = {"worlds": WORLDS, "seed": 2, "dtype": "float64", "cases": OPTIONS[strategy]} | given
    return slcp.sweep(given.pop("task", task()), policy, device=device, strategy=strategy, **given)


def same(report, first, second):
    """The tables of two policies, which kernels of their own make: what is exact by its bits, numbers to
    rounding in all but a few worlds, in which hard contact parts a rounding; worlds differ.
    """
    for arm in ("disturbed", "undisturbed"):
        a, b = report.part(first, arm=arm), report.part(second, arm=arm)
        assert a.keys() == b.keys() and not a["status"].any()
        for name in a:
            if a[name].dtype.kind == "f" and np.isfinite(a[name]).all():
                parted = np.abs(a[name] - b[name]) > 1e-7 * np.abs(a[name]).max() + 1e-12
                assert parted.mean() <= 0.2, f"{arm} {name}: {a[name]} and {b[name]}"
            else:
                np.testing.assert_array_equal(a[name], b[name], err_msg=f"{arm} {name}")
    assert len(np.unique(report.part(first)["x"])) == WORLDS


def law(x, time):
    return -9.0 * (x[:, :1] - 0.3) - 0.25 * x[:, 4:5]


@pytest.mark.parametrize("strategy", OPTIONS)
@pytest.mark.parametrize("chunk", [None, 17])
def test_a_callback_of_the_linear_law_gives_its_table(device, strategy, chunk):
    """Measures, warm starts, kicks, noise and statuses go on from launch to launch."""
    named = {"linear": policies.Linear(GAIN, GOAL, [0.0]), "callback": policies.Callback(law)}
    same(sweep(named, device, strategy, chunk=chunk), "linear", "callback")


@pytest.mark.parametrize("strategy", ["specialised", pytest.param("generic", marks=pytest.mark.full)])
def test_a_launch_makes_the_steps_of_a_period(device, strategy):
    """Controls by time, held over 7 steps of a run of 75, whose last period is shorter."""
    force = np.sin(np.arange(STEPS // 7 + 1))
    us = np.repeat(force, 7)[:STEPS, None]
    plan = SimpleNamespace(us=us, xs=np.zeros((STEPS + 1, 8)), K=np.zeros((STEPS, 1, 8)))
    times = []

    def f(x, time):
        times.append(time)
        return [force[round(time / 0.14)]]

    named = {"plan": ddp.TrackingPolicy(plan), "callback": policies.Callback(f, period=0.14)}
    same(sweep(named, device, strategy), "plan", "callback")
    np.testing.assert_allclose(times[:11], 0.14 * np.arange(11), rtol=1e-12)


class Remembering:
    """A policy on the host with a gain and an integrator of every world."""

    period = None

    def __init__(self, gains):
        self.gains, self.chunks = gains, []

    def begin(self, sim, worlds):
        assert isinstance(sim, slcp.Simulator)
        self.chunks.append(worlds)
        self.sum = np.zeros(len(worlds))

    def act(self, x, time, worlds):
        assert x.shape == (len(self.sum), 8) and len(worlds) == len(x)
        error = 0.3 - x[:, 0]
        self.sum = self.sum + error
        return (self.gains[worlds] * (error + 0.1 * self.sum))[:, None]


def test_a_policy_on_the_host_knows_its_worlds_and_begins_with_every_chunk(device):
    gains = np.linspace(1.0, 9.0, WORLDS)
    whole, split = Remembering(gains), Remembering(gains)
    one = sweep(whole, device).part("policy")
    two = sweep(split, device, chunk=15).part("policy")
    for name in one:
        np.testing.assert_array_equal(one[name], two[name], err_msg=name)
    assert [len(worlds) for worlds in split.chunks] == [15, 15, 10, 2]
    np.testing.assert_array_equal(np.concatenate(split.chunks[:3]), np.arange(WORLDS))
    run = slcp.Simulator(SCENE, device=device).rollout(np.tile(SCENE.x0, (3, 1)), policy=whole, steps=5)
    assert not run.status.any() and whole.chunks[-1].tolist() == [0, 1, 2]


def test_every_world_has_its_own_gains(device):
    """World i of a sweep, in whatever chunk, is the one that these gains alone would give."""
    gains = GAIN * np.linspace(0.2, 2.0, WORLDS)[:, None, None]
    report = sweep({"own": policies.Linear(gains, GOAL, [0.0])}, device, chunk=15)
    own, still = report.part("own"), report.part("own", arm="undisturbed")
    assert len(still["world"]) == WORLDS and len(np.unique(own["force"])) == WORLDS
    for world in (0, 16, WORLDS - 1):
        alone = sweep({"one": policies.Linear(gains[world], GOAL, [0.0])}, device)
        for name in own:
            assert own[name][world] == alone.part("one")[name][world], name
            if name not in ("world", *(n for n in own if n.startswith("drawn"))):
                assert still[name][world] == alone.part("one", arm="undisturbed")[name][world % 2], name
    drawn = slcp.draw_worlds(task(), WORLDS, seed=2, dtype="float64")
    some = [3, 16, 30]
    few = slcp.Worlds(drawn.x0[some], drawn.params[some], drawn.kicks[some], numbers=drawn.numbers[some])
    again = sweep({"own": policies.Linear(gains, GOAL, [0.0])}, device, worlds=few).part("own")
    for name in MEASURES:
        np.testing.assert_array_equal(again[name], own[name][some], err_msg=name)


@pytest.mark.parametrize(
    "policy, given, text",
    [
        (lambda: policies.Linear(np.zeros((3, 1, 8)), GOAL, [0.0]), {}, "holds 3 trajectories; 1 or 40"),
        (
            lambda: policies.Callback(law),
            {"task": task(disturbances=slcp.Disturbances(parameters={"step_size": 0.1}))},
            "Callback, which acts on the host at times of all worlds; their step sizes are",
        ),
        (lambda: policies.Around(policies.Callback(law), delay=1), {}, "one that runs in a kernel"),
        (lambda: policies.Callback(lambda x, t: np.zeros(3)), {}, r"shape \(3,\) at 0 s; \(40, 1\) or"),
        (lambda: SimpleNamespace(act=lambda x, t, w: 0, begin=3), {}, "policy.begin is 3"),
        (lambda: SimpleNamespace(act=lambda x, t, w: 0, period="often"), {}, "policy.period is 'often'"),
    ],
)
def test_what_cannot_be_asked_says_so(policy, given, text):
    with pytest.raises(slcp.InputError, match=text):
        sweep(policy(), **given)


def test_worlds_of_other_step_sizes_have_no_time_in_common():
    sim = slcp.Simulator(SCENE, device="cpu")
    own = sim.params.replace(step_size=[0.02, 0.01])
    with pytest.raises(slcp.InputError, match="step sizes are 0.01 to 0.02 s, and one is needed"):
        sim.rollout(np.tile(SCENE.x0, (2, 1)), params=own, policy=policies.Callback(law), steps=2)
