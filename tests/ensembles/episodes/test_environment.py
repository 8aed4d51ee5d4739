"""Tasks as environments of reinforcement learning: the worlds of a sweep, to the last bit."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from simulators import scene

import slcp_warp as slcp
from slcp_warp import measures as m
from slcp_warp.costs import Term
from slcp_warp.ensembles.episodes.rows import scatter
from slcp_warp.kernels.device.tables import make_table

SCENE = replace(scene("push_on_ice"), step_size=0.02, sigma=0.05)
WORLDS, STEPS, SEED = 24, 40, 5
COST = slcp.costs.terms(
    SCENE,
    [Term("square", 0.5, state="block.x", target=0.3), Term("square", 0.01, control=0)],
    [Term("square", 20.0, state="block.x", target=0.3)],
)
EVERYTHING = slcp.Disturbances(
    velocity=0.1, torque=0.3, sensor={"pusher.shift": 0.02, "block.x": 0.01}, delay=slcp.Uniform(0.0, 0.08),
    hold=0.04, before=0.5, dropped=0.1, dropouts=(slcp.Dropout(0.2, 0.1),), kick_times=(0.0, 0.3, 0.5),
    kick=0.2, parameters={"mass": 0.2, "friction": 0.3}, pushes=(slcp.Push("block", 0.1, 0.3, (2.0, 0.0)),),
)  # fmt: skip
SEEN = ("pusher.shift", "block.x", "pusher.vshift")


def task(disturbances=EVERYTHING, **changes):
    fields = {
        "name": "push", "scene": SCENE, "horizon": STEPS, "cost": COST, "control_limits": (-1.0, 4.0),
        "start": SCENE.x0 + np.outer([0.0, 0.05, 0.1], np.eye(8)[0]), "disturbances": disturbances,
        "measures": {"x": m.final("block.x"), "push": m.impulse(), "cost": m.cost()},
        "success": (m.final("block.x") > 0.75) & (m.cost() < 9.0), "failure": m.state("block.x") > 1.1,
        "observation": SEEN,
    }  # fmt: skip
    return slcp.Task(**{**fields, **changes})


def control(y):
    """Controls (B, 1) of an observation (B, 3)."""
    return 9.0 * (0.35 - y[:, :1]) - 0.5 * y[:, 2:3]


def played(env, y, count, control=control):
    """The columns of the first `count` episodes, by world, and the moments."""
    moments = []
    while sum(len(moment.ended["world"]) for moment in moments) < count:
        moments.append(env.step(control(y)))
        y = moments[-1].observation
    columns = {name: np.concatenate([each.ended[name] for each in moments]) for name in moments[0].ended}
    order = np.argsort(columns["world"])
    return {name: values[order] for name, values in columns.items()}, moments


@pytest.mark.parametrize("disturbances", [EVERYTHING, slcp.Disturbances()], ids=["everything", "nothing"])
@pytest.mark.parametrize("strategy", ["specialised", "generic"])
def test_episodes_are_the_worlds_of_a_sweep(device, strategy, disturbances):
    given = {"dtype": "float64", "device": device, "strategy": strategy, "seed": SEED}
    options = slcp.Options(residual="hard")
    own = task(disturbances)
    policy = slcp.policies.Callback(lambda y, time: control(y))
    report = slcp.sweep(own, policy, worlds=2 * WORLDS, cases=options, **given)
    expected = report.part("policy")
    env = slcp.Environment(own, WORLDS, case=options, **given)
    found, moments = played(env, env.reset(), 3 * WORLDS)
    for name in ("x", "push", "cost", "success", "status", "failure_time", "start_overlap", "unsolved_time"):
        values = found[name][found["world"] < 2 * WORLDS]
        np.testing.assert_array_equal(values, expected[name], err_msg=name)
    if disturbances.any():
        assert 0.1 < expected["success"].mean() < 0.9 and np.isfinite(expected["failure_time"]).any()
        assert len({len(each.ended["slot"]) for each in moments}) > 2  # slots are in different episodes


def test_rewards_add_up_to_the_cost_and_come_when_it_does(device):
    env = slcp.Environment(task(), WORLDS, seed=SEED, device=device, dtype="float64")
    y, paid, returns = env.reset(), np.zeros(WORLDS), {}
    for _ in range(90):
        moment = env.step(control(y))
        y, paid = moment.observation, paid + moment.reward
        over = moment.terminated | moment.truncated
        assert not (moment.terminated & moment.truncated).any()
        np.testing.assert_array_equal(np.flatnonzero(over), moment.ended["slot"])
        failed = np.isfinite(moment.ended["failure_time"])
        np.testing.assert_array_equal(moment.terminated[moment.ended["slot"]], failed)
        for slot, world, of_run in zip(moment.ended["slot"], moment.ended["world"], moment.ended["return"]):
            returns[world] = paid[slot], of_run
        np.testing.assert_array_equal(moment.last[~over], moment.observation[~over])
        assert (moment.last[over] != moment.observation[over]).any(axis=1).all()
        paid[over] = 0.0
    summed, told = np.array(list(returns.values())).T
    np.testing.assert_allclose(summed, told, rtol=1e-12)
    assert len(told) > WORLDS


def test_a_reward_is_what_a_step_adds_to_a_measure(device):
    """Of a state, times the step size: what is observed before each step."""
    plain = task(slcp.Disturbances(velocity=0.1), failure=None)
    env = slcp.Environment(plain, 8, reward=m.integral("block.x"), device=device, dtype="float64")
    y = env.reset()
    for _ in range(STEPS - 1):
        before = y
        moment = env.step(control(y))
        y = moment.observation
        np.testing.assert_allclose(moment.reward, before[:, 1] * SCENE.step_size, rtol=1e-9, atol=1e-15)


def test_several_steps_pass_between_controls(device):
    plain = task(slcp.Disturbances(velocity=0.1), failure=None)
    given = {"device": device, "dtype": "float64"}
    slow, quick = slcp.Environment(plain, 4, period=0.1, **given), slcp.Environment(plain, 4, **given)
    y, z = slow.reset(), quick.reset()
    assert (slow.period, quick.period) == (0.1, SCENE.step_size)
    for _ in range(STEPS // 5 - 1):
        u, paid = control(y), 0.0
        moment = slow.step(u)
        for _ in range(5):
            one = quick.step(u)
            paid += one.reward
        y, z = moment.observation, one.observation
        np.testing.assert_array_equal(y, z)
        np.testing.assert_allclose(moment.reward, paid, rtol=1e-9, atol=1e-15)


def test_the_next_episode_begins_one_step_later_where_that_is_asked_for(device):
    """The same worlds; the step in which one begins pays nothing, whatever its control is."""
    given = {"seed": SEED, "device": device, "dtype": "float64"}
    late, own = (
        slcp.Environment(task(), 6, autoreset="next_step", **given),
        slcp.Environment(task(), 6, **given),
    )
    expected, _ = played(own, own.reset(), 18)
    y, over, found = late.reset(), np.zeros(6, bool), []
    for _ in range(150):
        u = control(y)
        u[over] = 99.0
        moment = late.step(u)
        assert not moment.reward[over].any() and not (moment.terminated | moment.truncated)[over].any()
        np.testing.assert_array_equal(moment.last, moment.observation)
        y, over = moment.observation, moment.terminated | moment.truncated
        found += zip(moment.ended["world"], moment.ended["return"], moment.ended["steps"])
    told = {world: (paid, steps) for world, paid, steps in found}
    for world in expected["world"][:18]:
        own = expected["world"] == world
        assert told[world] == (expected["return"][own], expected["steps"][own])


def test_other_slots_change_nothing_of_an_episode(device):
    """Episode e of slot i is world i + e B, under the same controls the same to the last bit."""
    env = slcp.Environment(task(), 6, seed=SEED, device=device)
    first = played(env, env.reset(), 18)[0]
    again = played(env, env.reset(seed=SEED), 18, lambda y: control(y) * (np.arange(6) % 2 == 0)[:, None])[0]
    same = [world for world in first["world"] if world % 2 == 0 and world in again["world"]]
    assert len(same) > 6
    for world in same:
        for name in ("cost", "return", "steps", "push"):
            assert first[name][first["world"] == world] == again[name][again["world"] == world]
    assert not np.array_equal(first["cost"][1:6:2], again["cost"][1:6:2])


def test_a_reset_without_a_seed_goes_on_to_the_next_episodes(device):
    env = slcp.Environment(task(), 5, seed=SEED, device=device)
    first = env.reset()
    second = env.reset()
    assert (first != second).any(axis=1).all()
    np.testing.assert_array_equal(env.reset(seed=SEED), first)
    np.testing.assert_array_equal(env.reset(), second)
    fresh = slcp.Environment(task(), 5, seed=SEED, device=device)
    np.testing.assert_array_equal(
        fresh.reset(seed=SEED + 1), slcp.Environment(task(), 5, seed=SEED + 1).reset()
    )


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
def test_a_world_that_is_not_solved_ends_its_episode_alone(device, strategy):
    plain = task(slcp.Disturbances(velocity=0.1), failure=None, control_limits=None)
    given = {
        "device": device,
        "dtype": "float64",
        "strategy": strategy,
        "case": slcp.Options(residual="hard"),
    }
    env, calm = slcp.Environment(plain, 4, **given), slcp.Environment(plain, 4, **given)
    y, z = env.reset(), calm.reset()
    for k in range(20):
        u = control(y)
        other = calm.step(control(z))
        u[2] = 1e150 * 10.0 ** (10 * (k - 6)) if k > 5 else u[2]  # of which at last no speed has a square
        before, moment = y, env.step(u)
        y, z = moment.observation, other.observation
        if len(moment.ended["slot"]):
            break
    (slot,), (world,) = moment.ended["slot"], moment.ended["world"]
    assert (slot, world) == (2, 2) and moment.truncated.tolist() == [False, False, True, False]
    assert moment.ended["status"] == slcp.Status.NONFINITE and not moment.ended["success"]
    assert moment.ended["unsolved_time"] == pytest.approx(k * SCENE.step_size)
    np.testing.assert_array_equal(moment.last[2], before[2])  # its last valid state
    np.testing.assert_array_equal(y[[0, 1, 3]], z[[0, 1, 3]])
    np.testing.assert_array_equal(calm.reset()[2], y[2])  # the next world of the slot
    assert np.isfinite(moment.reward).all()


def test_what_is_observed_may_be_a_function(device):
    def make(dtype, VX, VY):
        @wp.func
        def seen(x: VX):
            return VY(x[0] - x[1], wp.sin(x[4]))

        return seen

    plain = task(slcp.Disturbances(velocity=0.1), observation=slcp.policies.Observation(make, 2))
    env = slcp.Environment(plain, 4, device=device, dtype="float64")
    states = slcp.Environment(task(slcp.Disturbances(velocity=0.1), observation=None), 4, dtype="float64")
    y, x = env.reset(), states.reset()
    np.testing.assert_allclose(y, np.stack([x[:, 0] - x[:, 1], np.sin(x[:, 4])], axis=1), rtol=1e-15)
    assert env.observations == 2 and states.observations == 8


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
def test_what_is_felt_is_observed_behind_the_states(device, strategy):
    """By it a learner meets the worlds of a sweep whose policy feels the same."""
    touch = {"touch": m.normal_force(), "pushed": m.contact()}
    given = {"dtype": "float64", "device": device, "strategy": strategy, "seed": SEED}
    options, own = slcp.Options(residual="hard"), task()

    def feeling(y, time, felt):
        return (
            control(y) - 0.3 * np.nan_to_num(felt["touch"])[:, None] + np.nan_to_num(felt["pushed"])[:, None]
        )

    report = slcp.sweep(
        own, slcp.policies.Callback(feeling, senses=touch), worlds=WORLDS, cases=options, **given
    )
    env = slcp.Environment(own, WORLDS, case=options, senses=touch, **given)
    assert env.observations == 5
    first = env.reset()
    np.testing.assert_array_equal(first[:, 3:], 0.0)
    found, moments = played(env, first, WORLDS, lambda y: control(y[:, :3]) - 0.3 * y[:, 3:4] + y[:, 4:])
    seen = np.concatenate([each.last for each in moments])
    assert set(np.unique(seen[:, 4])) == {0.0, 1.0} and np.ptp(seen[:, 3]) > 0.1
    expected = report.part("policy")
    for name in ("x", "push", "success"):
        np.testing.assert_array_equal(found[name][:WORLDS], expected[name])


@pytest.mark.parametrize("period", [0.8, 1e9, 1e15])
def test_a_period_longer_than_an_episode_is_all_of_it(device, period):
    plain = task(slcp.Disturbances(velocity=0.1), failure=None)
    env = slcp.Environment(plain, 2, period=period, device=device, dtype="float64")
    y = env.reset()
    for _ in range(2):
        moment = env.step(control(y))
        y = moment.observation
        assert moment.truncated.all() and moment.ended["steps"].tolist() == [STEPS, STEPS]
        np.testing.assert_array_equal(moment.reward, -moment.ended["cost"])


def test_what_is_refused_changes_nothing(device):
    env = slcp.Environment(task(), 6, autoreset="next_step", seed=SEED, device=device)
    y = env.reset()
    while not (moment := env.step(control(y))).truncated.any():
        y = moment.observation
    with pytest.raises(slcp.InputError, match="seed is -1"):
        env.reset(seed=-1)
    after = env.step(control(moment.observation))
    assert not set(after.ended["world"]) & set(moment.ended["world"])


def test_a_huge_reward_is_forgotten_in_the_next_step(device):
    env = slcp.Environment(task(slcp.Disturbances(), control_limits=None, failure=None), 2, device=device)
    calm = slcp.Environment(env.task, 2, device=device)
    y, z = env.reset(), calm.reset()
    u = control(y)
    u[1] = 1e15
    env.step(u)
    calm.step(control(z))
    second, own = env.step(0.0 * u), calm.step(0.0 * u)
    assert second.reward[0] == own.reward[0] and np.isfinite(second.reward).all()
    with pytest.raises(slcp.InputError, match="controls holds 1e\\+39, beyond float32"):
        env.step(np.full((2, 1), 1e39))


def test_an_environment_is_its_own(device):
    env = slcp.Environment(task(), 2, device=device)
    for copied in (copy.copy, copy.deepcopy, pickle.dumps):
        with pytest.raises(TypeError, match="cannot be copied or pickled"):
            copied(env)
    with pytest.raises(ValueError, match="read-only"):
        env.limits[0][0] = 1.0
    y = env.reset()
    env.step(control(y)).ended["mine"] = 1
    assert "mine" not in env.step(control(y)).ended


@pytest.mark.parametrize("shape", [(7,), (7, 3), (7, 2, 4)])
def test_rows_are_copied_on_a_device_as_on_a_host(device, shape):
    """`scatter` is what `put_rows` does where there is no view of the array, strided ones among them."""
    rows, before = np.array([5, 0, 3]), np.arange(np.prod(shape), dtype=float).reshape(shape)
    values = -1.0 - np.arange(np.prod((3, *shape[1:])), dtype=float).reshape(3, *shape[1:])
    plain = wp.array(before, dtype=wp.float64, device=device)
    table = make_table(before, wp.float64, device) if len(shape) == 2 else plain
    for given in (wp.array(values, dtype=wp.float64, device=device), None):
        expected = before.copy()
        expected[rows] = 0.0 if given is None else values
        for into in (plain, table):
            into.assign(before)
            scatter(into, rows, given)
            np.testing.assert_array_equal(into.numpy(), expected)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: slcp.Environment(3), "task is a int"),
        (lambda: slcp.Environment(slcp.Task("fall", slcp.scenes.stack(2), duration=0.5)), "controls"),
        (lambda: slcp.Environment(task(), 0), "worlds is 0"),
        (lambda: slcp.Environment(task(), seed=-1), "seed is -1"),
        (lambda: slcp.Environment(task(), case="hard"), "case is a str"),
        (lambda: slcp.Environment(task(), reward="x"), "reward is a str"),
        (lambda: slcp.Environment(task(), reward=m.final("block.x")), "which does not add up"),
        (lambda: slcp.Environment(task(), reward=m.total("nobody.x")), "nobody.x"),
        (
            lambda: slcp.Environment(task(cost=slcp.costs.NO_COST, measures={}, success=None)),
            "reward is None",
        ),
        (lambda: slcp.Environment(task(), period=1e-3), "period is 0.001"),
        (lambda: slcp.Environment(task(), autoreset="never"), "autoreset is 'never'"),
        (lambda: slcp.Environment(task(), step_size=0.0), "step_size is 0"),
        (lambda: slcp.Environment(task(slcp.Disturbances(parameters={"step_size": 0.1}))), "step_size"),
        (lambda: slcp.Environment(task()).step([[0.0]]), "reset"),
    ],
)
def test_what_cannot_be_is_said(call, message):
    with pytest.raises(slcp.InputError, match=message):
        call()


@pytest.mark.parametrize("given", [[[np.nan]] * 4, np.zeros(4), np.zeros((3, 1)), "u", None])
def test_controls_are_looked_at(given):
    env = slcp.Environment(task(), 4)
    first = env.reset()
    with pytest.raises(slcp.InputError, match="controls"):
        env.step(given)
    np.testing.assert_array_equal(env.reset(seed=0), first)
