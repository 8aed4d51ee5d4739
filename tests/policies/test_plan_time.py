"""Plans that were made with steps of one size, followed with steps of another."""

import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

import slcp_warp as slcp
from slcp_warp import ddp, policies
from slcp_warp import measures as m

SCENE = replace(slcp.scenes.push_block(), step_size=0.02, sigma=0.05)
STEPS = 30
RNG = np.random.default_rng(0)
PLAN = SimpleNamespace(
    us=RNG.standard_normal((STEPS, 1)),
    xs=np.cumsum(0.01 * RNG.standard_normal((STEPS + 1, 8)), axis=0),
    K=RNG.standard_normal((STEPS, 1, 8)),
)


def expected(h, times, states):
    """u = us(t) + K(t) (x - xs(t)): controls and gains held over the plan's steps, its states between."""
    out = []
    for t, x in zip(times, states):
        j = min(int(np.floor(t / 0.02 + 1e-9)), STEPS - 1)
        if t > 0.02 * STEPS - 1e-9:  # held after the end, as at its last step
            t = h * (np.ceil(0.02 * STEPS / h - 1e-9) - 1.0)
            j = min(int(np.floor(t / 0.02 + 1e-9)), STEPS - 1)
        place = t / 0.02 - j
        xs = (1.0 - place) * PLAN.xs[j] + place * PLAN.xs[j + 1]
        out.append(PLAN.us[j] + PLAN.K[j] @ (x - xs))
    return np.array(out)


@pytest.mark.parametrize("h", [0.02, 0.01, 0.015, 0.05])
def test_a_plan_is_followed_in_time(device, h):
    sim = slcp.Simulator(SCENE, device=device)
    policy = ddp.TrackingPolicy(PLAN, step_size=0.02)
    steps = round(0.7 / h)
    params = sim.params.replace(step_size=h)
    run = sim.rollout(SCENE.x0, policy=policy, steps=steps, params=params, record="controls")
    wanted = expected(h, h * np.arange(steps), run.states[:-1])
    assert not run.status.any()
    np.testing.assert_allclose(run.controls, wanted, rtol=0, atol=1e-9)


def test_gains_of_no_minimum_are_told(device):
    """Of a plan, and of a batch how many; a minimum is none to speak of."""
    sim, plan = slcp.Simulator(SCENE, device=device), SimpleNamespace(**vars(PLAN))
    for min_pivot, told in (
        (np.array(-0.5), "it ended at no minimum"),
        (np.array([1.0, -1.0]), "1 of 2 plans"),
    ):
        plan.positive_definite = np.asarray(min_pivot > 0.0)
        with pytest.warns(RuntimeWarning, match=told):
            ddp.TrackingPolicy(plan)
    plan.positive_definite = np.asarray(np.array(1.0) > 0.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ddp.TrackingPolicy(plan).kernel(sim)


def test_without_another_step_no_bit_changes(device):
    sim = slcp.Simulator(SCENE, device=device)
    known, unknown = ddp.TrackingPolicy(PLAN, step_size=0.02), ddp.TrackingPolicy(PLAN)
    one, two = (sim.rollout(SCENE.x0, policy=p, steps=40).states for p in (known, unknown))
    np.testing.assert_array_equal(one, two)
    params = sim.params.replace(step_size=0.01)
    rows = sim.rollout(SCENE.x0, policy=unknown, steps=3, params=params, record="controls")
    assert rows.controls[0] == pytest.approx(PLAN.us[0] + PLAN.K[0] @ (SCENE.x0 - PLAN.xs[0]))


def test_results_know_their_step_size_and_sweeps_keep_to_it(device):
    cost = slcp.costs.terms(SCENE, [slcp.costs.effort(1.0)])
    sim = slcp.Simulator(SCENE, device=device)
    problem = ddp.Problem(sim, cost, 5, params=sim.params.replace(step_size=0.03))
    solved = ddp.solve(problem, SCENE.x0, np.ones((5, 1)), ddp.Options(max_iterations=1))
    assert ddp.TrackingPolicy(solved).step_size == 0.03
    still = {"duration": 0.6, "measures": {"force": m.integral(m.control(0))}}
    task = slcp.Task("push", SCENE, cost, STEPS, **still)
    flat = SimpleNamespace(us=1.0 + 0.0 * PLAN.us, xs=PLAN.xs, K=0.0 * PLAN.K)
    flat.us[15:] = -1.0  # turns at .3 s
    policy = ddp.TrackingPolicy(flat, step_size=0.02)
    given = {
        "worlds": 2,
        "cases": task.options,
        "dtype": "float64",
        "device": device,
        "step_sizes": (0.02, 0.01),
    }
    for each in (policy, policies.Around(policy)):
        report = slcp.sweep(task, each, **given)
        for h in (0.02, 0.01):
            assert report.part("policy", step_size=h)["force"] == pytest.approx([0.0, 0.0], abs=1e-12)
    drawn = task.replace(disturbances=slcp.Disturbances(parameters={"step_size": 0.1}))
    with pytest.raises(slcp.InputError, match="plan of steps of 0.02 s; the worlds' are"):
        slcp.sweep(drawn, policy, worlds=5, cases=task.options, device=device)


def test_what_cannot_be_followed_says_so():
    arrays = {name: wp.array(a[None], dtype=wp.float64, device="cpu") for name, a in vars(PLAN).items()}
    sim = slcp.Simulator(SCENE, device="cpu")
    policy = ddp.TrackingPolicy(SimpleNamespace(**arrays), step_size=0.02)
    with pytest.raises(
        slcp.InputError, match="the plan is of Warp arrays; it is followed with its own steps"
    ):
        sim.rollout(SCENE.x0, policy=policy, steps=2, params=sim.params.replace(step_size=0.01))
    with pytest.raises(slcp.InputError, match="step_size is -1"):
        ddp.TrackingPolicy(PLAN, step_size=-1)
