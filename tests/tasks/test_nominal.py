"""A delay and a hold that are numbers belong to what is controlled: they act where nothing is disturbed."""

from types import SimpleNamespace

import numpy as np
import pytest
from test_disturbances import FORCE, GOAL, LIMITS, LOOSE, H, K, N, swept, task

import slcp_warp as slcp
from slcp_warp import ddp, policies
from slcp_warp.ensembles.worlds.nominal import nominal

NX = 8
LAW = policies.Linear(K, GOAL, FORCE)


def called(period=None):
    return policies.Callback(lambda x, time: FORCE + (x - GOAL) @ K.T, period)


def late(delay=0.08, hold=0.06, **changes):
    return task(scene=LOOSE, disturbances=slcp.Disturbances(delay=delay, hold=hold, sensor=0.5), **changes)


def by_hand(own, delay, hold, lower=-np.inf, upper=np.inf):
    """Final state of a loop over `sim.step`: steps of delay and hold."""
    sim = own.simulator(device="cpu")
    x, way, held = own.start[0], [np.zeros(1)] * delay, None
    for k in range(N):
        held = FORCE + K @ (x - GOAL) if k % hold == 0 else held
        way.append(held)
        x = sim.step(x, np.clip(way.pop(0), lower, upper)).state
    return x


@pytest.mark.parametrize("policy", [LAW, called(), called(2 * H), called(3 * H)], ids=["law", "1", "2", "3"])
def test_undisturbed_worlds_and_rollouts_have_a_fixed_delay_and_hold(device, policy):
    """Not the sensor's noise. What is asked every second step and held for three says what it said."""
    own = late()
    found = swept(device, "specialised", own, policy, worlds=1).part("policy", arm="undisturbed")
    sim = own.simulator(device=device)
    run = sim.rollout(own.start, policy=nominal(policy, own, H), steps=N, record="controls")
    ends = [found[name][0] for name in own.scene.state_names]
    np.testing.assert_allclose(run.states[0, -1], ends, rtol=0, atol=1e-9)
    if getattr(policy, "f", None) is None or policy.period != 2 * H:
        np.testing.assert_allclose(run.states[0, -1], by_hand(own, 4, 3, *LIMITS), rtol=0, atol=1e-9)
    assert (run.controls[0, :4] == 0.0).all() and run.controls[0, 4:].min() != 0.0


def test_what_is_drawn_does_not_act_in_them(device):
    drawn = task(scene=LOOSE, disturbances=slcp.Disturbances(delay=slcp.Uniform(0.04, 0.08), hold=0.06))
    found = swept(device, "specialised", drawn, LAW, worlds=1).part("policy", arm="undisturbed")
    ends = [found[name][0] for name in drawn.scene.state_names]
    np.testing.assert_allclose(ends, by_hand(drawn, 0, 3, *LIMITS), rtol=0, atol=1e-9)


def test_limits_and_what_is_seen_are_the_tasks(device):
    """Of policies with limits of their own, without any, and on the host; a plan keeps its kernel."""
    own = late(0.0, 0.0, control_limits=(-1.0, 2.5))
    places = [own.scene.state_index(name) for name in ("block.x", "block.vx")]
    few = policies.Linear(np.array([[-9.0, 0.25]]), GOAL[places], FORCE)
    blind = own.replace(observation=("block.x", "block.vx"))
    sim = own.simulator(device=device)
    plan = SimpleNamespace(us=np.full((N, 1), 9.0), xs=np.zeros((N + 1, NX)), K=np.zeros((N, 1, NX)))
    tracked = ddp.TrackingPolicy(plan)
    for what, policy in ((own, LAW), (own, called()), (own, tracked), (blind, few)):
        run = sim.rollout(own.start, policy=nominal(policy, what, H), steps=N, record="controls")
        assert run.controls.min() >= -1.0 and run.controls.max() == 2.5 and not run.status.any()
    assert nominal(tracked, own, H).kernel(sim)[0] == tracked.kernel(sim)[0]
    again = ddp.TrackingPolicy(plan, control_limits=(-1.0, 2.0))
    assert nominal(again, own, H) is again
    assert np.isinf(tracked.limits[1]).all()  # it is another one that has them


class Reusing:
    """A law on the host that gives the same array every time, as buffers do."""

    def __init__(self):
        self.out = np.zeros(1)

    def act(self, x, time, worlds):
        self.out[:] = FORCE + K @ (x[0] - GOAL)
        return self.out


def test_what_a_policy_on_the_host_says_is_its_own_to_change(device):
    """A delayed control is the one that was given, not the one that the array holds later."""
    own = late(0.08, 0.0)
    sim = own.simulator(device=device)
    run = sim.rollout(own.start, policy=nominal(Reusing(), own, H), steps=N)
    np.testing.assert_allclose(run.states[0, -1], by_hand(own, 4, 1, *LIMITS), rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "given, text", [([1.0, 2.0, 3.0], r"policy gave shape \(3,\) at 0 s"), ("x", "policy gave 'x'"),
                    ([np.nan], "policy gave nan at 0 s")]
)  # fmt: skip
def test_what_is_no_control_is_refused_as_without_a_delay(device, given, text):
    own = late(0.08, 0.0)
    policy = nominal(policies.Callback(lambda x, time: given), own, H)
    with pytest.raises(slcp.InputError, match=text):
        own.simulator(device=device).rollout(own.start, policy=policy, steps=6)
    bad = called()
    bad.period = "often"
    with pytest.raises(slcp.InputError, match="policy.period"):
        nominal(bad, own, H)
