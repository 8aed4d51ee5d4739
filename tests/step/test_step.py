"""The step judged by the oracle: its residual on every solved world, its statuses, its invariances."""

import functools

import numpy as np
import pytest
import warp as wp
from oracle import Oracle, residual
from random_scenes import near_contact
from simulators import numbers, rounded, scene, simulator

import slcp_warp as slcp

FLOAT64, FLOAT32 = "float64", "float32"
LIMIT = {FLOAT64: 1e-12, FLOAT32: 2e-5}
GAPS = (0.0, 0.0, 1e-3, -1e-3, 0.02, -0.02, np.inf, np.inf)


def slow(*values):
    return pytest.param(*values, marks=pytest.mark.slow)


def both(*values):
    """A case in either precision; the block in float32 is long to compile."""
    marks = pytest.mark.full if values[0] == "sliding_block" else ()
    return pytest.param(wp.float32, *values, marks=marks), pytest.param(wp.float64, *values)


SMOOTH = [
    *both("flicking_finger", "none"),
    *both("flicking_finger", "inertia"),
    *both("sliding_block", "inertia"),
    *both("ball_drop", "inertia"),
]
SMOOTH64 = [
    ("grasp", "inertia"),
    ("particle", "inertia"),
    ("rubbing_particle", "inertia"),
    slow("moving_plane", "inertia"),
    slow("touching_tree", "inertia"),
]
HARD = [*both("flicking_finger"), *both("sliding_block")]
HARD64 = ["grasp", slow("ball_drop")]  # the rows are those of the smooth steps above


@functools.cache
def states(name, count=250, seed=0):
    """States and controls of a scene near, at and far from contact, most of them touching."""
    rng = np.random.default_rng(seed)
    sc = scene(name)
    x = near_contact(sc, rng, count, GAPS)
    return x, rng.standard_normal((count, sc.nu))


def judge(name, device, dtype, scaling, hard, sigma=0.1, x=None, u=None, wrong=None, **changes):
    """Step random states; assert small residuals where solved, and solved wherever that is possible.

    `wrong`: numbers that only the oracle is given, to see that it notices.
    """
    sc = scene(name)
    if x is None:
        x, u = states(name)
    sim = simulator(name, device, dtype, scaling, "hard" if hard else "rem-logistic")
    if not hard:
        changes["sigma"] = sigma
    step = sim.step(x, u, sim.params.replace(**changes))
    x64, u64 = rounded(dtype, x, u)
    oracle = Oracle(sc, **{**numbers(sc, dtype, **changes), **(wrong or {})})
    problem = oracle.problem(x64, u64, scaling=scaling)
    v, impulse = step.state[:, sc.nv :].astype(float), step.impulse.astype(float)
    r1, r2 = residual(problem, v, impulse, hard)
    a = problem["D"] * impulse
    scale = 1.0 + sum(np.abs(y).max(axis=1, initial=0.0) for y in (v, problem["vfree"], a))
    weight = 1.0 + np.abs(problem["f"]).max(axis=1)
    solved = (step.status == slcp.Status.SOLVED) & (problem["margin"] > 1e-3)
    limit = LIMIT[dtype.__name__]
    assert (impulse[solved] >= 0.0).all()
    worst = np.argmax(np.where(solved, np.abs(r2).max(axis=1) / scale, 0.0))
    assert (np.abs(r1).max(axis=1) / weight)[solved].max() <= limit
    assert (np.abs(r2).max(axis=1) / scale)[solved].max() <= limit, f"world {worst}: {r2[worst]}, {x[worst]}"
    np.testing.assert_allclose(
        step.state[solved, : sc.nv],
        (x64[:, : sc.nv] + problem["h"][..., None] * v)[solved],
        rtol=0,
        atol=limit * 10,
    )
    unsolved = step.status != slcp.Status.SOLVED
    np.testing.assert_array_equal(step.state[unsolved], x64[unsolved])
    feasible = np.isfinite(oracle.step(x64, u64, hard=True)[1]).all(axis=1)
    assert (step.status[~feasible] != slcp.Status.SOLVED).all()
    assert (step.status[feasible] == slcp.Status.SOLVED).mean() >= 0.99
    return step, problem, solved


@pytest.mark.parametrize("sigma", [0.1, 0.02, 0.002])
@pytest.mark.parametrize("dtype,name,scaling", SMOOTH)
def test_smoothed_residual(device, dtype, name, scaling, sigma):
    step, problem, _ = judge(name, device, dtype, scaling, False, sigma)
    touching = np.abs(step.contact_impulse[:, :, 0]).max(axis=1) > 1e-3
    assert 0.3 < touching.mean() < 0.95


@pytest.mark.parametrize("sigma", [0.1, 0.005])
@pytest.mark.parametrize("name,scaling", SMOOTH64)
def test_smoothed_residual_of_more_scenes(device, name, scaling, sigma):
    step, _, solved = judge(name, device, wp.float64, scaling, False, sigma)
    assert (step.impulse[solved] > 1e-3).any()  # contact was in it


NUMBERS = ("step_size", "gravity", "sigma", "mass", "inertia", "com", "anchor", "angle", "damping", "gear")
NUMBERS += ("friction", "radius", "shape_offset", "lower", "upper")


@pytest.mark.parametrize("number", NUMBERS)
def test_judge_notices_wrong_numbers(device, number):
    """The same test fails if any number of the scene is off by 1e-6: every number matters."""
    sc = scene("flicking_finger")
    wrong = sc.default_parameters()[number] * (1 + 1e-6) + (1e-6 if number in ("angle", "upper") else 0.0)
    if number in ("com", "shape_offset"):
        wrong = wrong + 1e-6
    with pytest.raises(AssertionError):
        judge("flicking_finger", device, wp.float64, "none", False, wrong={number: wrong})


@pytest.mark.parametrize("dtype,name", HARD)
def test_hard_residual(device, dtype, name):
    step, _, solved = judge(name, device, dtype, "inertia", True)
    assert (step.impulse[solved] > 1e-3).any()  # contact was in it


@pytest.mark.parametrize("name", HARD64)
def test_hard_residual_of_more_scenes(device, name):
    step, _, solved = judge(name, device, wp.float64, "inertia", True)
    assert (step.impulse[solved] > 1e-3).any()  # contact was in it


@pytest.mark.parametrize(
    "name,scaling,hard",
    [
        ("flicking_finger", "none", False),
        ("sliding_block", "inertia", False),
        ("flicking_finger", "inertia", True),
    ],
)
def test_solution_is_the_oracles(device, name, scaling, hard):
    """Not only a small residual: the velocity is the one that an unrelated solver finds."""
    sc, (x, u) = scene(name), states(name)
    x, u = x[:60], u[:60]
    step = simulator(name, device, wp.float64, scaling, "hard" if hard else "rem-logistic").step(x, u)
    exact, _ = Oracle(sc).step(x, u, scaling=scaling, hard=hard)
    good = step.status == 0
    assert good.mean() > 0.9
    np.testing.assert_allclose(step.state[good], exact[good], atol=1e-8)


@pytest.mark.parametrize("dtype", [pytest.param(wp.float32, marks=pytest.mark.full), wp.float64])
@pytest.mark.parametrize("residual", ["rem-logistic", "hard"])
def test_friction_stays_inside_its_cone(device, dtype, residual):
    x, u = states("sliding_block")
    sim = simulator("sliding_block", device, dtype, "inertia", residual)
    for friction in (0.0, 0.3, np.array([0.1, 0.5, 0.9, 1.3])):
        step = sim.step(x, u, sim.params.replace(friction=friction))
        normal, tangential = np.moveaxis(step.contact_impulse.astype(float), -1, 0)
        assert (normal >= 0.0).all() and normal.max() > 1.0
        assert (np.abs(tangential) <= friction * normal * (1 + 1e-6) + 1e-30).all()
        if np.ndim(friction):
            assert (np.abs(tangential) > 0.9 * friction * normal)[normal > 0.1].any()


def test_contact_impulse_moves_the_body_along_normal_and_tangent(device, dtype):
    """On a level plane a particle's momentum changes by (-tangential, normal): t is n turned by +90."""
    x = np.array([[0.0, 0.0, 0.0, 0.4, -1.0, 0.0], [0.0, 0.0, 0.0, -0.4, -1.0, 0.0]])
    step = simulator("rubbing_particle", device, dtype).step(x)
    change = step.state[:, 3:5] - x[:, 3:5] + 0.01 * np.array([0.0, 9.81])
    normal, tangential = step.contact_impulse[:, 0].T
    np.testing.assert_allclose(change, np.stack([-tangential, normal], -1), atol=1e-5)
    assert (normal > 1.0).all() and (np.sign(tangential) == [1, -1]).all()


@pytest.mark.parametrize(
    "dtype,name,residual",
    [*both("flicking_finger", "rem-logistic"), *both("sliding_block", "rem-logistic"),
     *both("flicking_finger", "hard")],
)  # fmt: skip
def test_batch_equals_singles_bit_for_bit(device, dtype, name, residual):
    x, u = states(name)
    sim = simulator(name, device, dtype, "inertia", residual)
    step = sim.step(x, u)
    for i in range(0, len(x), 9):
        single = sim.step(x[i], u[i])
        for field in ("state", "impulse", "gap", "status", "contact_impulse", "multiplier"):
            one, among = getattr(single, field), getattr(step, field)[i]
            np.testing.assert_array_equal(one, among, err_msg=f"{field}, world {i}")
    if name != "flicking_finger" or residual == "hard":
        return
    controls = np.repeat(u[:, None], 8, axis=1)
    traj = sim.rollout(x, controls)
    for i in range(0, len(x), 49):
        single = sim.rollout(x[i], controls[i])
        np.testing.assert_array_equal(single.states, traj.states[i])
        np.testing.assert_array_equal(single.status, traj.status[i])
    # another kernel, in which the compiler may fuse other products
    rounding = 1e-12 if dtype is wp.float64 else 2e-5
    np.testing.assert_allclose(traj.states[:, 1], step.state, rtol=rounding, atol=rounding)


def test_worlds_with_their_own_numbers_are_their_own_scene(device, dtype):
    """A table of parameters per world gives what each row gives alone."""
    name, rng = "flicking_finger", np.random.default_rng(6)
    x, u = states(name)
    x, u = x[:30], u[:30]
    sim = simulator(name, device, dtype)
    changes = {
        "mass": sim.params["mass"] * rng.uniform(0.5, 2, (30, 3)),
        "friction": rng.uniform(0, 1, (30, 1)),
        "radius": sim.params["radius"] * rng.uniform(0.8, 1.2, (30, 3, 1)),
        "sigma": rng.uniform(0.02, 0.2, (30, 6)),
        "step_size": rng.uniform(0.01, 0.05, 30),
        "lower": sim.params["lower"] + rng.uniform(-0.1, 0.1, (30, 3)) * sim.scene.structure.lower,
    }
    step = sim.step(x, u, sim.params.replace(**changes))
    for i in range(30):
        own = sim.step(x[i], u[i], sim.params.replace(**{k: v[i] for k, v in changes.items()}))
        np.testing.assert_array_equal(own.state, step.state[i])
        np.testing.assert_array_equal(own.contact_impulse, step.contact_impulse[i])


def test_oracle_agrees_where_every_world_has_its_own_numbers(device, dtype):
    rng = np.random.default_rng(7)
    x, u = states("flicking_finger")
    changes = {
        "friction": rng.uniform(0, 1, (len(x), 1)),
        "step_size": rng.uniform(0.02, 0.05, len(x)),
        "damping": rng.uniform(0, 1, (len(x), 3)),
        "gear": rng.uniform(-2, 2, (len(x), 2)),
    }
    step, _, solved = judge("flicking_finger", device, dtype, "none", False, 0.1, x, u, **changes)
    assert solved.mean() > 0.9 and (step.impulse[solved] > 1e-3).any()  # contact was in it
    for number in ("friction", "damping", "gear"):  # another world's number is noticed
        with pytest.raises(AssertionError):
            wrong = {number: rounded(dtype, changes[number][::-1])[0]}
            judge("flicking_finger", device, dtype, "none", False, 0.1, x, u, wrong, **changes)


def test_external_force_in_contact(device, dtype):
    x, u = states("flicking_finger", 60)
    wrench = np.random.default_rng(8).standard_normal((len(x), 3, 3)).astype(np.float32).astype(float)
    sim = simulator("flicking_finger", device, dtype)
    step = sim.step(x, u, external_force=wrench)
    x64, u64 = rounded(dtype, x, u)
    oracle = Oracle(scene("flicking_finger"), **numbers(scene("flicking_finger"), dtype))
    exact, _ = oracle.step(x64, u64, external=wrench)
    scale = 1.0 + np.abs(exact).max(axis=1, keepdims=True)
    error = (np.abs(step.state - exact) / scale)[step.status == 0].max()
    assert error < {FLOAT64: 1e-9, FLOAT32: 1e-3}[dtype.__name__]
    without = sim.step(x, u).state
    assert np.median(np.abs(without - step.state)[:, 3:].max(axis=1)) > 1e-2


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_unit_of_mass_does_not_matter_under_inertia_scaling(device, dtype, factor):
    x, u = states("flicking_finger")
    sim = simulator("flicking_finger", device, dtype)
    heavy = {k: sim.params[k] * factor for k in ("mass", "inertia", "damping", "gear")}
    first, second = sim.step(x, u), sim.step(x, u, sim.params.replace(**heavy))
    tolerance = {FLOAT64: 1e-11, FLOAT32: 1e-4}[dtype.__name__]
    np.testing.assert_allclose(second.state, first.state, rtol=tolerance, atol=10 * tolerance)
    np.testing.assert_allclose(second.contact_impulse, factor * first.contact_impulse,
                               rtol=100 * tolerance, atol=10 * tolerance * factor)  # fmt: skip
    if dtype.__name__ == FLOAT64:  # and the paper's own scaling does depend on it
        sim = simulator("flicking_finger", device, dtype, "none")
        difference = sim.step(x, u).state - sim.step(x, u, sim.params.replace(**heavy)).state
        assert np.abs(difference).max() > 1e-2


@pytest.mark.parametrize("residual", ["rem-logistic", "hard"])
def test_jam_is_reported_infeasible_and_keeps_its_state(device, dtype, residual):
    """Opposing limits that no velocity satisfies, next to worlds that are well."""
    x, u = states("flicking_finger")
    x, u = x[:40].copy(), u[:40]
    sim = simulator("flicking_finger", device, dtype, "inertia", residual)
    lower, upper = (np.repeat(sim.params[k][None], 40, 0) for k in ("lower", "upper"))
    jammed = np.arange(40) % 4 == 0
    for overlap in (0.2, 1e-2):
        lower[jammed, 0], upper[jammed, 0] = x[jammed, 0] + overlap / 2, x[jammed, 0] - overlap / 2
        step = sim.step(x, u, sim.params.replace(lower=lower, upper=upper))
        assert (step.status[jammed] == slcp.Status.INFEASIBLE).all()
        assert (step.status[~jammed] == slcp.Status.SOLVED).mean() > 0.95
        np.testing.assert_array_equal(step.state[jammed], x.astype(step.state.dtype)[jammed])
    lower[jammed, 0], upper[jammed, 0] = x[jammed, 0] - 0.01, x[jammed, 0] + 0.01  # tight, but it opens
    tight = sim.step(x, u, sim.params.replace(lower=lower, upper=upper))
    assert (tight.status == slcp.Status.SOLVED).mean() > 0.95


@pytest.mark.parametrize("residual", ["rem-logistic", "hard"])
@pytest.mark.parametrize("poison", [np.nan, np.inf, -np.inf])
def test_nonfinite_world_is_reported_and_alone(device, dtype, residual, poison):
    x, u = states("flicking_finger")
    sim = simulator("flicking_finger", device, dtype, "inertia", residual)
    clean = sim.step(x[:50], u[:50])
    for j in range(6):
        bad = x[:50].copy()
        bad[7, j] = poison
        step = sim.step(bad, u[:50])
        assert step.status[7] == slcp.Status.NONFINITE
        np.testing.assert_array_equal(step.state[7], bad[7].astype(step.state.dtype))
        others = np.arange(50) != 7
        np.testing.assert_array_equal(step.state[others], clean.state[others])
        np.testing.assert_array_equal(step.status[others], clean.status[others])


@pytest.mark.parametrize("poison", [np.nan, np.inf])
def test_failed_world_of_a_rollout_keeps_its_last_valid_state(device, dtype, poison):
    sim = simulator("flicking_finger", device, dtype)
    controls = np.random.default_rng(9).standard_normal((20, 12, 2))
    x0 = np.tile(scene("flicking_finger").x0, (20, 1))
    clean = sim.rollout(x0, controls)
    controls[3, 5] = poison
    traj = sim.rollout(x0, controls)
    assert traj.status[3] == slcp.Status.NONFINITE
    np.testing.assert_array_equal(traj.states[3, :6], clean.states[3, :6])
    np.testing.assert_array_equal(traj.states[3, 6], traj.states[3, 5])
    assert np.isfinite(traj.states).all()
    others = np.arange(20) != 3
    np.testing.assert_array_equal(traj.states[others], clean.states[others])


def test_warm_start_changes_nothing_but_the_work(device, dtype):
    sim = simulator("flicking_finger", device, dtype)
    x, u = states("flicking_finger")
    first = sim.step(x, u)
    good = first.status == 0
    for warm in (
        first.multiplier,
        1.7 * first.multiplier,
        0 * first.multiplier,
        np.roll(first.multiplier, 1, 0),
    ):
        again = sim.step(x, u, warm_start=warm)
        assert (again.status[good] == 0).mean() > 0.99
        both = good & (again.status == 0)
        tolerance = {FLOAT64: 1e-9, FLOAT32: 3e-4}[dtype.__name__]
        np.testing.assert_allclose(again.state[both], first.state[both], atol=tolerance, rtol=tolerance)
