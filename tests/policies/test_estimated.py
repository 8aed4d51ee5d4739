"""Policies behind a Kalman filter, in sweeps and rollouts: what they see, and when their controls act."""

import copy
import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import ddp, policies
from slcp_warp import measures as m
from slcp_warp.inputs.errors import ArgumentError, ArgumentTypeError
from slcp_warp.policies import Estimated, KalmanFilter

H, STEPS = 0.05, 40
CART = slcp.Scene(
    "cart",
    bodies=(slcp.Body("cart", 2.0, 0.01, joint="prismatic"),),
    actuators=(slcp.Actuator("cart"),),
    step_size=H,
)
GAIN = np.array([[-3.0, -2.5]])
LINEAR = policies.Linear(GAIN)
NOISE = {"cart.shift": 0.01, "cart.vshift": 3.0}  # a speed that is worth nothing


def task(**changes):
    fields = {
        "name": "cart", "scene": CART, "duration": STEPS * H, "start": [0.5, 0.0],
        "options": slcp.Options(residual="hard"), "measures": {"place": m.final("cart.shift")},
        "success": m.largest("cart.shift") < 0.6,
        "disturbances": slcp.Disturbances(start={"cart.vshift": 0.3}, sensor=NOISE),
    }  # fmt: skip
    return slcp.Task(**{**fields, **changes})


def estimated(policy=LINEAR, of=None, sensors=("cart.shift",), process=0.05, **given):
    return Estimated.of_task(of or task(), policy, list(sensors), process, **given)


def runs(policy, of=None, worlds=5, **given):
    of = of or task()
    drawn = slcp.draw_worlds(of, list(range(worlds)), seed=3, dtype="float64", device="cpu")
    given = {"record": ("controls",), "device": "cpu", "dtype": "float64", "seed": 3} | given
    return slcp.replay(of, policy, drawn, **given)


def test_the_speed_is_found_from_places():
    run, policy = runs(made := estimated(keep=True)), made
    for k, (time, belief) in enumerate(policy.kept):
        assert time == pytest.approx(k * H)
        np.testing.assert_allclose(run.controls[:, k], belief.mean @ GAIN.T, rtol=0, atol=1e-12)
    assert len(policy.kept) == STEPS and policy.kept[-1][1] is policy.belief
    off = np.abs(policy.belief.mean - run.states[:, STEPS - 1])
    sd = np.sqrt(np.diagonal(policy.belief.covariance, axis1=1, axis2=2))
    assert (off < 4.5 * sd).all() and sd.max() < 0.1, "of a sensor of 3 m/s"


def test_a_sweep_says_what_it_is_worth():
    found = slcp.sweep(
        task(), {"raw": LINEAR, "filtered": estimated()}, worlds=200, seed=1, dtype="float64", device="cpu"
    )
    places = {name: found.part(name, arm="disturbed")["place"] for name in ("raw", "filtered")}
    assert np.std(places["filtered"]) < 0.2 * np.std(places["raw"])


def test_chunks_of_a_sweep_change_nothing():
    asked = {"worlds": 24, "seed": 1, "dtype": "float64", "device": "cpu"}
    whole, parts = (
        slcp.sweep(task(), estimated(policy), chunk=chunk, **asked).part("policy", arm="disturbed")["place"]
        for chunk, policy in ((None, by_world()), (7, by_world()))
    )
    np.testing.assert_allclose(whole, parts, rtol=0, atol=1e-12)
    assert np.ptp(whole) > 0.5, "each world has a goal of its own"


def by_world():
    def follow(dtype, VX, VU, Data):
        import warp as wp

        @wp.func
        def control(data: Data, world: int, step: int, x: VX):
            u = VU()
            u[0] = dtype(3.0) * (data.goal[world] - x[0]) - dtype(2.5) * x[1]
            return u

        return control

    return policies.Function(follow, goal=np.linspace(-1.0, 1.0, 24))


@pytest.mark.parametrize("lag", [1, 3])
def test_what_acts_late_is_made_for_when_it_acts(lag):
    """Where the model is right and the sensors are good a control is the policy's for the state it meets."""
    late = task(
        disturbances=slcp.Disturbances(sensor={"cart.shift": 1e-9, "cart.vshift": 1e-9}, delay=lag * H,
                                       start={"cart.vshift": 0.3}, before=0.7)
    )  # fmt: skip
    sensors = ("cart.shift", "cart.vshift")
    run = runs(estimated(of=late, sensors=sensors), late)
    np.testing.assert_array_equal(run.controls[:, :lag], 0.7)
    met = run.states[:, lag:STEPS] @ GAIN.T
    np.testing.assert_allclose(run.controls[:, lag:], met, rtol=0, atol=1e-6)
    now = runs(estimated(of=late, sensors=sensors, foresee=False), late)
    np.testing.assert_allclose(now.controls[:, lag:], now.states[:, : STEPS - lag] @ GAIN.T, atol=1e-6)


def test_a_plan_is_followed_in_the_steps_in_which_its_controls_act():
    cost = slcp.costs.terms(CART, [slcp.costs.effort(0.1), slcp.costs.Term("square", 1.0, "cart.shift")])
    late = task(
        cost=cost, horizon=STEPS, start=[0.5, 0.2],
        disturbances=slcp.Disturbances(sensor={"cart.shift": 1e-9, "cart.vshift": 1e-9}, delay=2 * H),
    )  # fmt: skip
    problem = ddp.Problem(late.simulator(device="cpu"), cost, STEPS)
    plan = ddp.solve(problem, [0.5, 0.2], np.zeros((STEPS, 1)))
    run = runs(estimated(ddp.TrackingPolicy(plan), late, ("cart.shift", "cart.vshift")), late, 1)
    x, xs = run.states[0], plan.xs
    u = plan.us[2:] + np.einsum("kux,kx->ku", plan.K[2:], x[2:STEPS] - xs[2:STEPS])
    np.testing.assert_allclose(run.controls[0, 2:], u, rtol=0, atol=1e-6)


@pytest.mark.parametrize("around", [False, True])
def test_a_plan_that_knows_its_delay_is_asked_about_the_steps_in_which_it_acts(around):
    """Where all goes as planned, the plan's own controls act, each in its step; feedback is of that step."""
    cost = slcp.costs.terms(CART, [slcp.costs.effort(0.1), slcp.costs.Term("square", 1.0, "cart.shift")])
    exact = {"cart.shift": 1e-9, "cart.vshift": 1e-9}
    late = task(cost=cost, horizon=STEPS, start=[0.5, 0.2],
                disturbances=slcp.Disturbances(sensor=exact, delay=3 * H))  # fmt: skip
    plan = ddp.plan(late, starts=1).best
    assert plan.delay == 3
    policy = ddp.TrackingPolicy(plan)
    policy = policies.Around(policy, limits=(-50.0, 50.0)) if around else policy
    met = replace(late, disturbances=replace(late.disturbances, start={"cart.vshift": 0.3}))
    run = runs(estimated(policy, met, tuple(exact)), met)
    off = np.einsum("kux,bkx->bku", plan.K[3:], run.states[:, 3:STEPS] - plan.xs[3:STEPS])
    np.testing.assert_allclose(run.controls[:, 3:], plan.us[3:] + off, rtol=0, atol=1e-5)
    with pytest.raises(
        ArgumentError, match=r"delay is 0.1 s, 2 steps of the plan, whose controls .* act 3 st"
    ):
        Estimated.of_task(met, policy, list(exact), 0.1, delay=2 * H)


def test_a_word_of_a_users_policy_is_his_own():
    class Early(policies.Linear):
        early = 2

    late = task(disturbances=slcp.Disturbances(sensor=NOISE, delay=3 * H))
    np.testing.assert_array_equal(
        runs(estimated(Early(GAIN), late), late).controls, runs(estimated(LINEAR, late), late).controls
    )


def test_who_looks_ahead_by_himself_sees_the_estimate_of_now():
    class Ahead(policies.Linear):
        lag = 2

    late = task(disturbances=slcp.Disturbances(sensor=NOISE, delay=2 * H))
    assert not estimated(Ahead(GAIN), late).foresee and estimated(LINEAR, late).foresee
    with pytest.raises(ArgumentError, match="foresee is True, and policy is a Ahead with a lag of 2"):
        estimated(Ahead(GAIN), late, foresee=True)


def test_limits_and_holds_are_known_to_the_model():
    """A model that thought that more acts, or at other times, would be off by far more than this."""
    held = task(
        control_limits=(-0.4, 0.4),
        disturbances=slcp.Disturbances(
            sensor={"cart.shift": 0.001, "cart.vshift": 1.0}, hold=3 * H, start={"cart.vshift": 0.3}
        ),
    )
    policy = estimated(of=held, process=1e-4, keep=True)
    run = runs(policy, held)
    assert np.abs(run.controls).max() == 0.4
    np.testing.assert_allclose([t for t, _ in policy.kept], 3 * H * np.arange(len(policy.kept)), atol=1e-12)
    off = policy.belief.mean - run.states[:, 3 * (len(policy.kept) - 1)]
    assert np.abs(off[:, 0]).max() < 0.003 and np.abs(off[:, 1]).max() < 0.01


@pytest.mark.parametrize("step_size", [H / 5, 0.7 * H, 0.9 * H, 1.5 * H])
@pytest.mark.parametrize("delay", [0.0, 1.5 * H, 2.0 * H])
def test_steps_of_the_plant_are_of_any_size(step_size, delay):
    """A cart's step at a held force is the same motion whatever its size, but for half a step of velocity;
    what is believed of a delay is what the plant's steps make of it.
    """
    late = task(
        duration=60 * H,
        disturbances=slcp.Disturbances(
            sensor={"cart.shift": 1e-3, "cart.vshift": 1.0}, delay=delay, start={"cart.vshift": 0.3}
        ),
    )
    policy = estimated(of=late, process=1e-2, keep=True)
    run = runs(policy, late, step_size=step_size)
    for time, belief in policy.kept[10:]:
        off = belief.mean - run.states[:, round(time / step_size)]
        assert np.abs(off[:, 0]).max() < 0.01 and np.abs(off[:, 1]).max() < 0.05
    assert np.abs(run.states[:, -1]).max() < 0.1, "it stops where it is to"


@pytest.mark.parametrize("step_size", [H / 5, 0.7 * H, 0.9 * H, H, 1.5 * H])
@pytest.mark.parametrize("hold", [0.0, 2.1 * H])
@pytest.mark.parametrize("delay", [0.0, 1.5 * H, 2.0 * H])
def test_what_acts_is_known_whatever_the_steps(step_size, delay, hold):
    """Without a word from the sensors velocities are right, which are sums of what has acted."""
    deaf = task(
        start=[0.5, 0.2],
        disturbances=slcp.Disturbances(delay=delay, hold=hold, before=0.7 if delay else None),
    )
    policy = Estimated.of_task(deaf, LINEAR, {"cart.shift": 1e6}, 1e-9, keep=True)
    run = runs(policy, deaf, 1, step_size=step_size)
    assert len(policy.kept) > 10 and np.ptp(run.controls) > 0.5
    for time, belief in policy.kept:
        met = run.states[0, round(time / step_size)]
        np.testing.assert_allclose(belief.mean[0, 1], met[1], rtol=0, atol=1e-6)


def test_a_row_of_a_policy_for_each_world():
    gains = GAIN * np.linspace(0.5, 2.0, 12)[:, None, None]
    asked = {"worlds": 12, "seed": 1, "dtype": "float64", "device": "cpu"}
    tables = [
        slcp.sweep(task(), estimated(policies.Linear(gains)), chunk=chunk, **asked).part(
            "policy", arm="disturbed"
        )
        for chunk in (None, 5)
    ]
    np.testing.assert_array_equal(tables[0]["place"], tables[1]["place"])
    weak = slcp.sweep(task(), estimated(policies.Linear(gains[0])), **asked).part("policy", arm="disturbed")
    same = tables[0]["place"] == weak["place"]
    assert same[0] and not same[1:].any()
    with pytest.raises(slcp.InputError, match="12 trajectories"):
        slcp.sweep(task(), estimated(policies.Linear(gains)), **asked | {"worlds": 13})


def test_memory_inside_begins_with_the_first_question():
    def counting(dtype, VX, VU, Data, Memory):
        import warp as wp

        @wp.func
        def control(data: Data, world: int, step: int, x: VX, memory: Memory):
            return VU(memory[0]), memory

        return control

    def begun(dtype, VX, VU, Data, Memory):
        import warp as wp

        @wp.func
        def start(data: Data, world: int, x: VX):
            memory = Memory()
            memory[0] = data.first
            return memory

        return start

    late = task(disturbances=slcp.Disturbances(sensor=0.1, delay=2 * H))
    law = policies.Function(counting, memory=1, start=begun, first=5.0)
    np.testing.assert_array_equal(runs(estimated(law, late), late).controls[:, :5, 0], [[0, 0, 5, 5, 5]] * 5)
    later = policies.Around(LINEAR, delay=2, before=0.7)
    run = runs(estimated(later, late), late)
    np.testing.assert_allclose(run.controls[:, :4, 0], [[0.0, 0.0, 0.7, 0.7]] * 5, atol=1e-7)


def test_what_foresees_is_the_filter():
    """A filter of one's own foretells, not the model that it was made with."""

    class Still(KalmanFilter):
        def predict(self, belief, u, seconds=None):
            return belief._replace(mean=belief.mean + [0.0, seconds])

    seen = []

    def act(x, time):
        seen.append(x.copy())
        return np.zeros((len(x), 1))

    sim = slcp.Simulator(CART, slcp.Options(residual="hard"), device="cpu")
    policy = Estimated(policies.Callback(act), Still(sim, {"cart.shift": 0.1}, 0.1), delay=3 * H)
    sim.rollout([0.0, 0.0], policy=policy, steps=2)
    np.testing.assert_allclose([x[0, 1] for x in seen], [3 * H, 4 * H], atol=1e-12)


def test_another_thread_is_told():
    policy = estimated()
    policy.begin(slcp.Simulator(CART, slcp.Options(residual="hard"), device="cpu"), np.arange(1))
    with ThreadPoolExecutor(1) as pool, pytest.raises(ArgumentError, match="in a run of another thread"):
        pool.submit(policy.act, np.zeros((1, 2)), 0.0, np.arange(1)).result()


def test_memory_inside_is_kept():
    def adding(dtype, VX, VU, Data, Memory):
        import warp as wp

        @wp.func
        def control(data: Data, world: int, step: int, x: VX, memory: Memory):
            after = Memory()
            after[0] = memory[0] + dtype(1.0)
            u = VU()
            u[0] = after[0] * data.each
            return u, after

        return control

    run = runs(estimated(policies.Function(adding, memory=1, each=0.25)), worlds=2)
    np.testing.assert_allclose(run.controls[:, :, 0], np.tile(0.25 * np.arange(1, STEPS + 1), (2, 1)))


def test_host_policies_inside_see_the_mean_and_the_time():
    asked = []

    def act(x, time):
        asked.append((time, x.copy()))
        return x @ GAIN.T

    policy = estimated(policies.Callback(act), keep=True)
    run = runs(policy)
    assert len(asked) == STEPS
    for (time, seen), (kept, belief) in zip(asked, policy.kept):
        assert time == pytest.approx(kept)
        np.testing.assert_array_equal(seen, belief.mean)
    np.testing.assert_allclose(run.controls, runs(estimated()).controls, atol=1e-9)


def test_every_run_begins_anew():
    policy = estimated()
    first = runs(policy).states
    for other in (policy, copy.deepcopy(policy), pickle.loads(pickle.dumps(policy))):
        np.testing.assert_array_equal(runs(other).states, first)
    assert pickle.loads(pickle.dumps(policy)).belief is None


def test_a_rollout_takes_it():
    sim = slcp.Simulator(CART, slcp.Options(residual="hard"), device="cpu")
    policy = Estimated(LINEAR, KalmanFilter(sim, {"cart.shift": 0.01}, 0.05, start=0.2), limits=(-1.0, 1.0))
    run = sim.rollout([0.3, -0.1], policy=policy, steps=60, record="controls")
    assert np.abs(run.states[-1]).max() < 0.1 and np.abs(run.controls).max() <= 1.0
    assert "Estimated" in repr(policy) and "cart.shift" in repr(policy)


def test_a_task_says_what_it_needs():
    drawn = slcp.Disturbances(
        start={"cart.shift": slcp.Uniform(0.2, 0.8), "cart.vshift": slcp.Normal(0.3, mean=0.1)},
        sensor=0.02, delay=2 * H, before=0.5,
    )  # fmt: skip
    found = estimated(of=task(disturbances=drawn, start=[[0.0, 0.0], [0.0, 2.0]], control_limits=(-3, 4)))
    np.testing.assert_allclose(found.filter.x0, [0.5, 1.1])
    first = found.filter.begin(1).covariance[0]
    np.testing.assert_allclose(first, np.diag([0.6**2 / 12.0, 0.3**2 + 1.0]))
    assert (found.delay, found.before.tolist(), found.limits) == (2 * H, [0.5], (-3, 4))
    assert found.filter.sensors == ("cart.shift",)
    given = estimated(of=task(disturbances=replace(drawn, hold=0.15)), delay=H, limits=None, start=0.2)
    assert (given.delay, given.before.tolist(), given.limits, given.period) == (H, [0.5], None, 0.15)
    np.testing.assert_allclose(given.filter.begin(1).covariance[0], 0.04 * np.eye(2))


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda: estimated(of=task(disturbances=slcp.Disturbances())), ArgumentError,
         "sensors names cart.shift, on which Disturbances.sensor has no noise"),
        (lambda: estimated(of=task(disturbances=slcp.Disturbances(sensor=0.1, delay=slcp.Uniform(0.0, 0.2)))),
         ArgumentError, "delay is not given, and Disturbances.delay is Uniform.*, drawn"),
        (lambda: estimated(of=task(disturbances=slcp.Disturbances(sensor=0.1, hold=slcp.Uniform(0.0, 0.2)))),
         ArgumentError, "period is not given, and Disturbances.hold is Uniform.*, drawn"),
        (lambda: estimated(of=task(disturbances=slcp.Disturbances(sensor=0.1, parameters={"cart.mass": 0.1},
            follow={"cart.shift": "cart.mass"}))), ArgumentError,
         "start is not given, and Disturbances.follow, .*cart.mass"),
        (lambda: Estimated(LINEAR, estimated().filter, limits=(np.zeros((3, 1)), 1.0)), ArgumentError,
         "limits are for 3 worlds"),
        (lambda: Estimated(LINEAR, estimated().filter, limits=(np.zeros(2), 1.0)), ArgumentError,
         "limits: lower limit"),
        (lambda: estimated(sensors=[3]), ArgumentTypeError, r"sensors is \[3\]; names of states"),
        (lambda: Estimated(LINEAR, LINEAR), ArgumentTypeError, "filter is a Linear; a policies.KalmanFilter"),
        (lambda: estimated(foresee=1), ArgumentTypeError, "foresee is 1; True or False"),
        (lambda: Estimated.of_task(CART, LINEAR, ["cart.shift"], 0.1), ArgumentTypeError, "task is a Scene"),
        (lambda: estimated().act(np.zeros((1, 2)), 0.0, np.arange(1)), ArgumentError, "in no run yet"),
        (lambda: runs(estimated(), task(scene=replace(CART, bodies=(replace(CART.bodies[0], name="car"),),
            actuators=(slcp.Actuator("car"),)), measures={}, success=None,
            disturbances=slcp.Disturbances(sensor=0.1))), ArgumentError, "the same mechanism is needed"),
    ],
)  # fmt: skip
def test_errors_say_what_is_needed(call, error, text):
    with pytest.raises(error, match=text):
        call()
