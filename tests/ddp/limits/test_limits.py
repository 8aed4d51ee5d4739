"""The limits of a plan's controls hold wherever the plan is followed, and travel with it through files."""

import functools
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from simulators import simulator

import slcp_warp as slcp
from slcp_warp import ddp, scenes
from slcp_warp.ddp.planning import Late
from slcp_warp.kernels.policies.tracking import TRACKING
from slcp_warp.scripts.stages.plan import optimise
from slcp_warp.scripts.stages.trajectory import simulate
from slcp_warp.scripts.support.records import load_policy

pytestmark = pytest.mark.slow
FINGER = scenes.flicking_finger()
BOUND, N = 1.5, 30
LIMITS = (-BOUND, [BOUND, 1.0])


@functools.cache
def problem(device="cpu", limits=True):
    sim = simulator("flicking_finger", device, wp.float64, "none")
    params = sim.params.replace(step_size=0.05, sigma=0.1)
    return ddp.Problem(sim, slcp.tasks.flicking_finger().cost, N, params, LIMITS if limits else None)


@functools.cache
def plan(device="cpu", limits=True):
    return ddp.solve(problem(device, limits), FINGER.x0, np.zeros((N, 2)), ddp.Options(max_iterations=15))


@functools.cache
def library(device="cpu"):
    options = {"offset": 4, "entries": 2, "passes": 3, "first_passes": 10}
    return ddp.build_library(problem(device), FINGER.x0, 12, **options)


def pushed(worlds=20):
    """States off the plan, where its feedback asks for more than the limits."""
    return FINGER.x0 + 0.3 * np.random.default_rng(2).standard_normal((worlds, 6))


def asked(result, traj):
    """What u = us + K (x - xs) asks for along a rollout, (B, N, nu)."""
    dx = traj.states[:, :N] - result.xs[:N]
    return result.us + np.einsum("kij,bkj->bki", result.K, dx)


def test_a_tracked_plan_keeps_its_limits(device):
    result = plan(device)
    sim, params = problem(device).dynamics, problem(device).params
    traj = sim.rollout(pushed(), policy=ddp.TrackingPolicy(result), steps=N, params=params, record="controls")
    want = np.clip(asked(result, traj), result.lower, result.upper)
    assert (np.abs(asked(result, traj)) > 2.0 * BOUND).any(), "feedback asks for more"
    np.testing.assert_allclose(traj.controls, want, atol=1e-12)
    assert (traj.controls >= -BOUND).all() and (traj.controls <= [BOUND, 1.0]).all()


def test_without_limits_nothing_is_held(device):
    result = plan(device, limits=False)
    assert np.isinf(result.lower).all() and np.isinf(result.upper).all()
    kernel, struct = ddp.TrackingPolicy(result).kernel(problem(device).dynamics)
    assert kernel == TRACKING and struct.lower is None
    traj = problem(device).dynamics.rollout(
        pushed(), policy=ddp.TrackingPolicy(result), steps=N, params=problem(device).params, record="controls"
    )
    np.testing.assert_allclose(traj.controls, asked(result, traj), atol=1e-12)


def test_limits_of_every_problem_of_a_batch(device):
    """One row a world, also after `select`."""
    bounds = np.array([[0.5, 1.0], [2.0, 0.25], [np.inf, 1.0]])
    base = plan(device, limits=False)
    batch = SimpleNamespace(
        us=np.tile(base.us, (3, 1, 1)), xs=np.tile(base.xs, (3, 1, 1)), K=np.tile(base.K, (3, 1, 1, 1)),
        lower=-bounds, upper=bounds,
    )  # fmt: skip
    sim, params = problem(device).dynamics, problem(device).params
    traj = sim.rollout(pushed(3), policy=ddp.TrackingPolicy(batch), steps=N, params=params, record="controls")
    np.testing.assert_allclose(traj.controls, np.clip(asked(base, traj), -bounds[:, None], bounds[:, None]))
    three = ddp.Problem(sim, problem(device).cost, N, params, (-bounds, bounds))
    found = ddp.solve(three, np.tile(FINGER.x0, (3, 1)), np.zeros((3, N, 2)), ddp.Options(max_iterations=3))
    np.testing.assert_array_equal(found.upper, bounds)
    np.testing.assert_array_equal(found.select(1).lower, -bounds[1])
    with pytest.raises(ValueError, match="control_limits are for 3 trajectories; there are 1"):
        ddp.TrackingPolicy(base, control_limits=(-bounds, bounds)).kernel(sim)


def test_a_sweep_keeps_the_limits(device):
    """Its worlds go where rollouts with the limits go."""
    result = plan(device)
    start = pushed(1)[0]
    spec = slcp.SweepSpec(worlds=2, duration=1.0, sample_every=0.25, window=0.5, residuals=("rem-logistic",),
                          start=start, observe=0)  # fmt: skip
    sim = problem(device).dynamics
    options = {"scaling": "none", "dtype": "float64", "device": device}

    def rates(policy):
        report = slcp.sweep(FINGER, policy, spec, **options)
        states = sim.rollout(start, policy=policy, steps=20).states
        np.testing.assert_allclose(report.samples[0][0], (states[::5, 0] - states[0, 0]), atol=1e-6)
        return report.samples[0][0]

    held = rates(ddp.TrackingPolicy(result))
    free = rates(ddp.TrackingPolicy(result, control_limits=(-np.inf, np.inf)))
    assert np.abs(held - free).max() > 1e-3


def test_a_library_keeps_the_limits(device, tmp_path):
    """Built, saved, loaded, joined with another, in the nearest-neighbour policy and in a plan file's."""
    lib = library(device)
    np.testing.assert_array_equal(lib.upper, np.tile([BOUND, 1.0], (12, 1)))
    free = replace(lib, lower=None, upper=None)
    joined = ddp.concatenate([ddp.Library.load(lib.save(tmp_path / "library.npz")), free])
    np.testing.assert_array_equal(joined.upper, np.concatenate([lib.upper, np.full((12, 2), np.inf)]))
    sim, params = problem(device).dynamics, problem(device).params
    states = lib.x[np.arange(200) % 12] + 0.2 * np.random.default_rng(4).standard_normal((200, 6))

    def controls(policy):
        traj = sim.rollout(states, policy=policy, steps=1, params=params, record="controls")
        return traj.controls[traj.status == 0, 0], traj

    held, without = (controls(one.policy())[0] for one in (lib, free))
    assert (np.abs(without) > BOUND).any()
    np.testing.assert_array_equal(held, np.clip(without, -BOUND, [BOUND, 1.0]))
    loaded, _ = load_policy(tmp_path / "library.npz", FINGER)
    np.testing.assert_array_equal(controls(loaded)[0], held)
    stated = free.policy(control_limits=LIMITS)
    np.testing.assert_array_equal(controls(stated)[0], held)
    record = simulate(sim, params, states, 1, tmp_path / "library.npz")
    assert np.abs(record.controls).max() <= BOUND


def test_a_library_file_of_version_1_states_no_limits(tmp_path):
    path = library().save(tmp_path / "library.npz")
    with np.load(path) as archive:
        data = {name: archive[name] for name in archive.files if name not in ("lower", "upper")}
    data["header"] = np.array(json.dumps({**json.loads(str(data["header"])), "version": 1}))
    np.savez(path, **data)
    old = ddp.Library.load(path)
    assert np.isinf(old.lower).all() and np.isinf(old.upper).all()
    old.save(path)
    assert ddp.Library.load(path).header["version"] == 2


def plan_file(path, *without):
    """What `slcp optimise` saves, without some of the arrays."""
    options = ddp.Options(max_iterations=15)
    record, _ = optimise(Late.of(problem(), 0), FINGER.x0, np.zeros((1, N, 2)), options)
    kept = {name: array for name, array in record.arrays.items() if name not in without}
    return replace(record, arrays=kept).save(path)


def test_plans_are_saved_and_loaded(tmp_path):
    """Of one problem and of a batch of them with step sizes of their own, whichever wrote the file."""
    params = problem().params.replace(step_size=[0.05, 0.04])
    many = ddp.solve(
        replace(problem(), params=params), np.tile(FINGER.x0, (2, 1)), np.zeros((2, N, 2)), passes(2)
    )
    for result in (plan(), many, many.select(1)):
        again = ddp.Result.load(result.save(tmp_path / "plan.npz"))
        for name in (*result_names(), "status", "iterations"):
            np.testing.assert_array_equal(getattr(again, name), getattr(result, name))
        np.testing.assert_array_equal(again.trace.cost, result.trace.cost)
        assert again.simulated.scene == FINGER and again.simulated.options == problem().dynamics.options
        found, expected = (each.simulated.parameters["step_size"] for each in (again, result))
        np.testing.assert_array_equal(found, expected)
    assert float(many.select(1).simulated.step_size) == 0.04
    plan_file(tmp_path / "plan.npz")
    assert ddp.Result.load(tmp_path / "plan.npz").header["method"] == ddp.Options().method
    with pytest.raises(slcp.FileError, match="holds a trajectory; a plan is needed"):
        simulate(problem().dynamics, problem().params, pushed(1), 2).save(tmp_path / "run.npz")
        ddp.Result.load(tmp_path / "run.npz")
    with pytest.raises(slcp.ArgumentError, match="dynamics of one's own"):
        replace(plan(), simulated=None).save(tmp_path / "own.npz")


def passes(most):
    return ddp.Options(max_iterations=most)


def result_names():
    return ("xs", "us", "K", "k", "Vx", "Vxx", "cost", "gradient", "min_pivot", "lower", "upper")


def test_simulate_under_a_plan_file_keeps_its_limits(tmp_path):
    path = plan_file(tmp_path / "plan.npz")
    np.testing.assert_array_equal(ddp.Result.load(path).upper, [BOUND, 1.0])
    record = simulate(problem().dynamics, problem().params, pushed(), N, path)
    assert np.abs(record.controls).max() == BOUND
    old = plan_file(tmp_path / "old.npz", "lower", "upper")
    assert np.isinf(ddp.Result.load(old).upper).all()
    assert np.abs(simulate(problem().dynamics, problem().params, pushed(), N, old).controls).max() > BOUND


def test_particles_keep_the_limits():
    result = plan()
    hard = slcp.Simulator(FINGER, slcp.Options(residual="hard"), device="cpu")
    spread = np.diag([0.0] * 3 + [0.5] * 3)
    run = slcp.particle_rollout(
        hard, FINGER.x0, result.us, covariance=spread, count=20, xs=result.xs, K=result.K,
        control_limits=(result.lower, result.upper),
    )  # fmt: skip
    assert np.abs(run.controls).max() == BOUND and (run.controls[..., 1] <= 1.0).all()
    with pytest.raises(slcp.ParameterError, match="for 2 problems; one for all"):
        slcp.particle_rollout(
            hard, FINGER.x0, result.us, covariance=spread, control_limits=(-np.ones((2, 2)), 1)
        )


@pytest.mark.parametrize(
    "limits, message",
    [
        (3.0, "must be"),
        ((1.0, -1.0), "above the upper"),
        ((-1.0, [1.0] * 3), "upper limit must be a number"),
        (("a", 1.0), "lower limit must be numbers"),
        ((np.nan, 1.0), "nan"),
    ],
)
def test_bad_limits_are_refused(limits, message):
    with pytest.raises(ValueError, match=message):
        ddp.TrackingPolicy(plan(), control_limits=limits)
