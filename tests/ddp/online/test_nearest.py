"""The nearest-neighbour policy of a library, against brute force; entries that belong to steps of a run."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from ddp_examples import FINGER
from ddp_examples import made_library as made
from simulators import NUMPY, simulator

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.library.entries import scene_digest
from slcp_warp.ddp.library.nearest import whitening
from slcp_warp.kernels.policies import tree


def chosen(lib, x, device, dtype=wp.float64, **options):
    """The entries that the kernel chooses in states x (B, nx); -1 where the step is not solved."""
    sim = simulator("flicking_finger", device, dtype, "none")
    x = x.astype(NUMPY[dtype])
    traj = sim.rollout(x, policy=lib.policy(**options), steps=1, record=("controls",))
    np.testing.assert_array_equal(traj.controls[:, 0, 0], -traj.controls[:, 0, 1])
    return np.where(traj.status == 0, np.nan_to_num(traj.controls[:, 0, 0]).astype(int), -1)


def brute_force(lib, x, white):
    """Squared distances (B, L) by (M37): |W dx|^2, periodic components of dx within half a period."""
    dx = x[:, None] - lib.x[None]
    for j in np.flatnonzero(lib.period):
        dx[..., j] = (dx[..., j] + 0.5 * lib.period[j]) % lib.period[j] - 0.5 * lib.period[j]
    return ((dx @ white.T) ** 2).sum(axis=2)


def random_library(seed, count, correlated):
    rng = np.random.default_rng(seed)
    mix = rng.standard_normal((6, 6)) if correlated else np.diag([0.5, 0.5, 1.0, 2.0, 2.0, 2.0])
    x = rng.standard_normal((count, 6)) @ mix
    x[:, 2] = rng.uniform(-3.0 * np.pi, 3.0 * np.pi, count)  # many turns
    return made(x), rng


@pytest.mark.parametrize("metric", ["covariance", "variance"])
@pytest.mark.parametrize("count", [1, 2, 3, 17, 400])
def test_nearest_neighbour_is_the_one_of_brute_force(device, count, metric):
    lib, rng = random_library(count, count, correlated=True)
    white = whitening(lib, metric)
    x = np.concatenate([lib.x[rng.integers(count, size=300)] + 0.3 * rng.standard_normal((300, 6)),
                        rng.standard_normal((300, 6)) * 3.0])  # fmt: skip
    x[:, 2] += np.pi * rng.integers(-3, 4, len(x))
    got, distance = chosen(lib, x, device, metric=metric), brute_force(lib, x, white)
    solved, least = got >= 0, distance.min(axis=1)
    assert solved.mean() > 0.6
    excess = (distance[np.arange(len(x)), got] - least)[solved]
    assert (excess <= 1e-9 * (1.0 + least[solved])).all(), excess.max()


def timed(count, seed):
    """Entries at random steps of a run of 30, two of them a plan."""
    lib, rng = random_library(seed, count, correlated=True)
    of_run = {"end": 30, "offset": 2, "step_size": 0.05}
    plan, age = rng.integers(0, 15, count), rng.integers(0, 2, count)
    return replace(lib, plan=plan, age=age, header=lib.header | of_run), rng


@pytest.mark.parametrize("dtype", [wp.float64, wp.float32])
@pytest.mark.parametrize("h", [0.05, 0.025])
def test_entries_of_a_run_answer_at_their_step(device, dtype, h):
    """Along a rollout the entry is the nearest of those of the same time, of the last step after the end."""
    lib, rng = timed(200, 23)
    assert (np.bincount(lib.step, minlength=30) > 0).all()
    sim = simulator("flicking_finger", device, dtype, "none")
    x = lib.x[rng.integers(len(lib), size=40)].astype(NUMPY[dtype])
    policy = lib.policy(metric="variance")
    params = sim.params.replace(step_size=h)
    run = sim.rollout(x, params=params, policy=policy, steps=70, record=("controls",))
    white, seen = whitening(lib, "variance"), 0
    for k in (0, 1, 7, 29, 31, 69):
        alive = run.status == 0
        step = min(int(k * h / 0.05 + 1e-6), int(lib.step.max()))
        there = np.flatnonzero(lib.step == step)
        distance = brute_force(lib.select(there), run.states[alive, k].astype(float), white)
        got = run.controls[alive, k, 0].astype(int)
        assert np.isin(got, there).all()
        place = np.searchsorted(there, got)
        excess = distance[np.arange(len(got)), place] - distance.min(axis=1)
        assert (excess <= 1e-3 * (0.01 + distance.min(axis=1))).all()
        seen += len(got)
    assert seen > 60


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ({"end": "soon"}, "header: end is 'soon'; a positive number"),
        ({"offset": 0}, "header: offset is 0"),
        ({"step_size": None}, "header: step_size is None"),
    ],
)
def test_a_header_that_names_no_steps_is_refused(header, message):
    lib, _ = timed(5, 1)
    with pytest.raises(ddp.LibraryError, match=message):
        replace(lib, header=lib.header | header)


def test_a_saved_library_of_a_run_keeps_its_steps(tmp_path):
    lib, _ = timed(20, 3)
    again = ddp.Library.load(lib.save(tmp_path / "runs.npz"))
    np.testing.assert_array_equal(again.step, lib.step)
    half = slcp.policies.load_policy(
        slcp.policies.save_policy(again.policy().at(0.025), tmp_path / "half.npz")
    )
    assert half.rate == 0.5 and half.step_size == 0.025 and again.policy().step_size == 0.05
    assert made(np.zeros((2, 6))).step is None and made(np.zeros((2, 6))).policy().step_size is None


@pytest.mark.parametrize("dtype", [wp.float32, wp.float64])
def test_of_entries_as_near_the_first_is_taken(device, dtype):
    """Places on a grid, whose distances are exact, in any order and some of them often."""
    rng = np.random.default_rng(17)
    x = FINGER.x0 + 0.25 * rng.integers(0, 3, (700, 6)) * [1, 1, 0, 1, 1, 0]
    at = FINGER.x0 + 0.125 * rng.integers(0, 5, (400, 6)) * [1, 1, 0, 1, 1, 0]
    placed, where = (np.round(16.0 * each) / 16.0 for each in (x, at))
    got = chosen(made(placed), where, device, dtype, whiten=np.eye(6))
    distance = ((where[:, None] - placed[None]) ** 2).sum(axis=2)
    solved = got >= 0
    assert solved.mean() > 0.6 and ((distance == distance.min(axis=1, keepdims=True)).sum(axis=1) > 1).all()
    np.testing.assert_array_equal(got[solved], distance.argmin(axis=1)[solved])


def test_entries_at_one_place_fill_the_stack_and_no_more(device):
    """No box is farther than another: as many children wait as ever may."""
    for count in (1, 8, 9, 64, 300, 1200):
        lib = made(np.tile(FINGER.x0, (count, 1)))
        assert chosen(lib, FINGER.x0[None], device, whiten=np.eye(6)).tolist() == [0]


@pytest.mark.parametrize("points", [1, 8, 9, 64, 65, 300, 4000])
def test_the_stack_has_room_for_all_that_may_wait(points):
    """Down a tree whose boxes are all as near, all children but the one that is entered wait."""
    groups, node, wait = tree.groups_of(-(-points // tree.WIDTH)), 0, 0
    while node < groups:
        node, wait = tree.WIDTH * node + 1, wait + tree.WIDTH - 1
    assert tree.waiting(points) == wait


def test_nearest_neighbour_in_single_precision(device):
    lib, rng = random_library(7, 300, correlated=False)
    x = lib.x[rng.integers(300, size=500)] + 0.2 * rng.standard_normal((500, 6))
    got, distance = chosen(lib, x, device, wp.float32), brute_force(lib, x, whitening(lib, "covariance"))
    excess = (distance[np.arange(len(x)), got] - distance.min(axis=1))[got >= 0]
    assert len(excess) > 300 and (excess <= 1e-3 * (0.01 + distance.min(axis=1))[got >= 0]).all()


def test_an_entry_answers_for_itself_on_every_turn(device):
    lib, rng = random_library(9, 50, correlated=True)
    for turns in (-7, 0, 1, 30):
        got = chosen(lib, lib.x + turns * lib.period, device)
        assert (got >= 0).mean() > 0.6
        np.testing.assert_array_equal(got[got >= 0], np.arange(50)[got >= 0])


def test_entries_of_little_gain_are_left_out(device):
    lib, _ = random_library(11, 30, correlated=False)
    assert chosen(lib, lib.x, device, min_gain=20.0).min() == 20
    with pytest.raises(ValueError, match="min_gain 40.0 leaves no entry; the largest gain is 29"):
        lib.policy(min_gain=40.0)


def test_feedback_acts_on_the_wrapped_difference_and_is_clamped(device):
    rng = np.random.default_rng(13)
    x = FINGER.x0 + np.arange(4)[:, None] * [0.0, 0.0, 0.5, 0.0, 0.0, 0.0]
    K = rng.standard_normal((4, 2, 6))
    lib = made(x, u=rng.standard_normal((4, 2)), K=K)
    sim = simulator("flicking_finger", device, wp.float64, "none")
    dx = 0.05 * rng.standard_normal((4, 6))
    dx[:, 5] = [0.0, 1.0, -1.0, 2.0]
    at = x + dx + [0.0, 0.0, 3.0 * np.pi, 0.0, 0.0, 0.0]
    white = np.diag([1.0, 1.0, 10.0, 1e-3, 1e-3, 1e-3])
    for limit in (np.inf, 0.5):
        policy = lib.policy(feedback_limit=limit, whiten=white)
        u = sim.rollout(at, policy=policy, steps=1, record=("controls",)).controls[:, 0]
        feedback = np.clip(np.einsum("bij,bj->bi", K, dx), -limit, limit)
        np.testing.assert_allclose(u, lib.u + feedback, atol=1e-12)


def chain_library(x):
    """Entries of a chain of three links, whose angles are the same after a turn; u_i = i."""
    scene = replace(slcp.scenes.pendulum_chain(), period=(2.0 * np.pi,) * 3)
    count = len(x)
    order = np.arange(count, dtype=float)
    return scene, ddp.Library(
        x=x, u=np.tile(order[:, None], 3), K=np.zeros((count, 3, 6)), cost=0 * order, gain=order,
        age=0 * order, chain=0 * order, plan=order, period=scene.state_period,
        header={"scene": scene.name, "digest": scene_digest(scene)},
    )  # fmt: skip


@pytest.mark.parametrize("dtype", [wp.float32, wp.float64])
def test_of_several_angles_the_images_within_half_a_turn_count(device, dtype):
    """Also where the metric would prefer others, and where it sees nothing of an angle."""
    rng = np.random.default_rng(11)
    x = rng.standard_normal((60, 6)) * [3.0, 3.0, 3.0, 1.0, 1.0, 1.0]
    scene, lib = chain_library(x)
    sim = slcp.Simulator(scene, slcp.Options(), device=device, dtype=NUMPY[dtype].__name__)
    at = rng.standard_normal((400, 6)) * [3.0, 3.0, 3.0, 1.0, 1.0, 1.0]
    at[:40, 0], at[40:80, 1] = 2.0 * np.pi * rng.integers(-2, 3, 40), -1e-9
    blind = np.diag([1.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    for white in (whitening(lib, "covariance"), rng.standard_normal((6, 6)), blind):
        run = sim.rollout(
            at.astype(NUMPY[dtype]), policy=lib.policy(whiten=white), steps=1, record="controls"
        )
        got = run.controls[:, 0, 0].astype(int)
        distance = brute_force(lib, at, white)
        excess = distance[np.arange(len(at)), got] - distance.min(axis=1)
        least = 1e-3 if dtype is wp.float32 else 1e-9
        assert (excess <= least * (0.01 + distance.min(axis=1))).mean() > (
            0.99 if dtype is wp.float32 else 0.999
        )


@pytest.mark.parametrize("steps", [False, True])
def test_the_norm_does_not_depend_on_where_a_period_begins(steps):
    rng = np.random.default_rng(5)
    x = 0.3 * rng.standard_normal((80, 6)) @ rng.standard_normal((6, 6))
    x[:, 2] = 0.2 * rng.standard_normal(80) + 0.1 * x[:, 5]
    lib, of_run = made(x), {}
    if steps:
        of_run = {"end": 30, "offset": 2, "step_size": 0.05}
        lib = replace(lib, plan=rng.integers(0, 4, 80), age=np.zeros(80, int), header=lib.header | of_run)
    expected = whitening(lib, "covariance")
    for turn in (0.5, 1.0, np.pi / 2.0, 3.0):
        moved = replace(lib, x=lib.x + turn * np.eye(6)[2])
        np.testing.assert_allclose(whitening(moved, "covariance"), expected, rtol=1e-9, atol=1e-9)
