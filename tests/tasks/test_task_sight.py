"""What policies see of a state, and the periods of angles."""

import math
from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from test_disturbances import ENDS, EVERYTHING, FORCE, GOAL, LOOSE, SCENE, H, N, swept, task

import slcp_warp as slcp
from slcp_warp import policies

SEEN = ("block.x", "pusher.shift", "pusher.vshift")
PLACES = [SCENE.state_index(name) for name in SEEN]
GAIN = np.array([[1.0, -9.0, -2.0]])
WHOLE = np.zeros((1, 8))
WHOLE[0, PLACES] = GAIN[0]
NOISE = slcp.Disturbances(sensor={"block.x": 0.05, "block.vx": 1.0}, velocity=0.02)


def summed(dtype, VX, VY):
    @wp.func
    def observe(x: VX):
        y = VY()
        y[0] = x[0] + x[1]
        y[1] = x[4]
        return y

    return observe


QUIET = slcp.Disturbances(velocity=0.02)
ALL = replace(EVERYTHING, parameters={"mass": 0.1})  # there is no friction where nothing touches


def seeing(disturbances=NOISE, **changes):
    return task(disturbances=disturbances, scene=LOOSE, **changes)


def test_a_policy_sees_what_is_observed(device, tmp_path):
    """Some components, of a noisy sensor; the same as all of them with gains that leave the others out."""
    few = policies.Linear(GAIN, GOAL[PLACES], FORCE)
    found = swept(device, "specialised", seeing(observation=SEEN), few).part("policy")
    whole = swept(device, "specialised", seeing(), policies.Linear(WHOLE, GOAL, FORCE)).part("policy")
    for name in ENDS:
        np.testing.assert_allclose(found[name], whole[name], rtol=0, atol=1e-9, err_msg=name)
    assert np.ptp(found["block.x"]) > 1e-3
    policies.save_policy(policies.Observed(few, SEEN), tmp_path / "few.npz")
    again = swept(device, "specialised", seeing(), policies.load_policy(tmp_path / "few.npz")).part("policy")
    assert all((again[name] == found[name]).all() for name in ENDS)


def test_a_policy_sees_a_users_function_and_remembers(device):
    def remembers(dtype, VX, VU, Data, Memory):
        @wp.func
        def control(data: Data, world: int, step: int, x: VX, memory: Memory):
            after = Memory(memory[0] + x[0])
            return VU(data.force - x[0] - data.gain * after[0] - x[1]), after

        return control

    def by_hand(dtype, VX, VU, Data, Memory):
        @wp.func
        def control(data: Data, world: int, step: int, x: VX, memory: Memory):
            seen = x[0] + x[1]
            after = Memory(memory[0] + seen)
            return VU(data.force - seen - data.gain * after[0] - x[4]), after

        return control

    given = {"memory": 1, "force": 3.0, "gain": 0.1}
    sees = seeing(QUIET, observation=policies.Observation(summed, 2))
    one = swept(device, "specialised", sees, policies.Function(remembers, **given)).part("policy")
    two = swept(device, "specialised", seeing(QUIET), policies.Function(by_hand, **given)).part("policy")
    for name in ENDS:
        np.testing.assert_allclose(one[name], two[name], rtol=0, atol=1e-9, err_msg=name)


def test_what_acts_on_the_host_sees_the_same(device):
    class Host:
        def act(self, x, time, worlds):
            return FORCE + (x - GOAL[PLACES]) @ GAIN.T

    own = seeing(QUIET, observation=SEEN)
    few = policies.Linear(GAIN, GOAL[PLACES], FORCE)
    one, two = (swept(device, "specialised", own, each, worlds=3).part("policy") for each in (few, Host()))
    for name in ENDS:
        np.testing.assert_allclose(one[name], two[name], rtol=0, atol=1e-9, err_msg=name)


def test_what_acts_on_the_host_sees_a_function_of_the_state(device):
    met = []

    class Host:
        def act(self, x, time, worlds):
            met.append(x)
            return np.zeros((len(x), 1))

    swept(device, "specialised", seeing(ALL, observation=policies.Observation(summed, 2)), Host(), worlds=3)
    every, seen = [], met[:]
    met.clear()
    swept(device, "specialised", seeing(ALL), Host(), worlds=3)
    for x, y in zip(met, seen, strict=True):
        assert y.shape == (len(x), 2) and y.dtype == x.dtype
        every.append(np.abs(y - np.stack([x[:, 0] + x[:, 1], x[:, 4]], axis=1)).max())
    assert max(every) < 1e-14


def test_a_function_of_the_state_that_cannot_be_used_is_said_so(device):
    class Host:
        def act(self, x, time, worlds):
            return np.zeros((len(x), 1))

    def broken(dtype, VX, VY):
        raise KeyError("nothing")

    with pytest.raises(slcp.InputError, match="Observation.function is no f.x. -> y of .*nothing"):
        swept(device, "specialised", seeing(observation=policies.Observation(broken, 2)), Host(), worlds=1)


@pytest.mark.parametrize("strategy", ["specialised", pytest.param("generic", marks=pytest.mark.full)])
def test_what_lies_around_a_policy_lies_around_one_on_the_host(device, strategy):
    """A noisy sensor, delay and hold; undisturbed none of them. It is asked when a control is to be held."""
    asked = []

    class Host:
        def begin(self, sim, worlds):
            asked.append([])

        def act(self, x, time, worlds):
            asked[-1].append(time)
            return FORCE + (x - GOAL) @ WHOLE.T

    own = task(disturbances=slcp.Disturbances(sensor={"block.x": 0.05}, delay=0.04, hold=0.06))
    both = [swept(device, strategy, own, each, worlds=5, chunk=3)
            for each in (policies.Linear(WHOLE, GOAL, FORCE), Host())]  # fmt: skip
    for arm in ("disturbed", "undisturbed"):
        one, two = (each.part("policy", arm=arm) for each in both)
        for name in ENDS:
            np.testing.assert_allclose(one[name], two[name], rtol=0, atol=1e-9, err_msg=name)
    assert np.ptp(both[0].part("policy")["block.x"]) > 1e-4
    for times, held in zip(asked, (3, 3, 3), strict=True):  # two chunks, and the undisturbed world
        np.testing.assert_allclose(times, H * np.arange(0, N, held))


def test_periods_are_those_of_the_scene(tmp_path):
    own = task(periods={"block.angle": "turn"})
    assert own.periods == {"block.angle": 2.0 * math.pi} and own.scene.state_period[3] == 2.0 * math.pi
    assert SCENE.state_period[3] == 0.0 and own.replace(options=slcp.Options("hard")).scene == own.scene
    half = own.replace(periods={"block.angle": math.pi}, observation=SEEN)
    assert half.scene.state_period.tolist() == [0, 0, 0, math.pi, 0, 0, 0, 0]
    slcp.save_task(half, tmp_path / "task.json")
    again = slcp.load_task(tmp_path / "task.json")
    assert again.periods == half.periods and again.scene == half.scene and again.observation == SEEN


@pytest.mark.parametrize(
    "changes, text",
    [
        ({"periods": {"box.angle": 1.0}}, "Task.periods: state component is 'box.angle'"),
        ({"periods": {None: 1.0}}, "Task.periods: state component is None"),
        ({"state_limits": {None: (0.0, 1.0)}}, "Task.state_limits: state component is None"),
        ({"periods": {"block.x": 1.0}}, "Task.periods names 'block.x'; angles are block.angle"),
        ({"periods": {"block.vangle": 1.0}}, "Task.periods names 'block.vangle'"),
        ({"periods": {"block.angle": 0.0}}, r"Task.periods\['block.angle'\] is 0.0"),
        ({"periods": [1.0]}, "Task.periods is a list"),
        ({"periods": {"angle": 1.0}}, "'angle'"),
        ({"observation": "block.x"}, "Task.observation is 'block.x'; names of states"),
        ({"observation": ["block.x", "block.x"]}, "Task.observation names a state twice"),
        ({"observation": ["block.z"]}, "Task.observation: .*'block.z'"),
    ],
)
def test_what_cannot_be_seen_or_come_again_is_refused(changes, text):
    with pytest.raises(slcp.InputError, match=text):
        task(**changes)


def test_what_cannot_see_so_says_so():
    with pytest.raises(slcp.InputError, match=r"K has shape \(1, 8\); scene .* needs \(1, 3\)"):
        swept("cpu", "generic", seeing(observation=SEEN), policies.Linear(WHOLE, GOAL, FORCE))
    with pytest.raises(slcp.InputError, match="Observation.size is 0"):
        policies.Observation(summed, 0)
    with pytest.raises(slcp.TaskFileError, match="observation: a function is no data"):
        slcp.save_task(task(observation=policies.Observation(summed, 2)), "task.json")
    inside = policies.Observed(
        policies.Around(policies.Linear(GAIN, GOAL[PLACES], FORCE), noise={"x": 1.0}), SEEN
    )
    with pytest.raises(slcp.InputError, match="observed component is 'x'; there are block.x"):
        swept("cpu", "generic", policy=inside)
