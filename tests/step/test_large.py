"""The generic kernels: the same steps as the specialised ones, and residuals of scenes only they can
do.
"""

import functools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from oracle import Oracle, residual
from random_scenes import near_contact, random_tree
from simulators import WIDTH, numbers, rounded, scene, simulator

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape, scenes
from slcp_warp.kernels.generic import topology as large_topology
from slcp_warp.scripts.benchmarks.shared.scenes import beam_on_supports, chain_on_ground
from slcp_warp.stepping.strategy import joined_trees

LIMIT = {wp.float64: 1e-12, wp.float32: 1e-5}
slow = pytest.mark.slow


def boxes(masses, friction=0.5):
    """A stack of boxes of 10 cm."""
    return scenes.stack(len(masses), [float(m) for m in masses], friction, size=0.1)


def beam(supports):
    """A beam on frictionless point supports, more than it needs."""
    at = np.linspace(-1.0, 1.0, supports)
    points = [Shape(f"support{i}", None, "disc", 0.0, offset=(x, 0.0)) for i, x in enumerate(at)]
    side = Shape("underside", "beam", "halfplane", offset=(0.0, -0.05), angle=-np.pi / 2)
    contacts = tuple(Contact("underside", p.name) for p in points)
    return Scene("beam", (Body("beam", 2.0, 0.5, joint="free"),), (side, *points), contacts,
                 initial_state=(0.0, 0.05, 0.0, 0.0, 0.0, 0.0))  # fmt: skip


@functools.cache
def large(name, dtype=wp.float64, scaling="inertia", hard=False):
    options = slcp.Options(residual="hard" if hard else "rem-logistic", scaling=scaling)
    return slcp.Simulator(scene(name), options, device="cpu", dtype=WIDTH[dtype], strategy="generic")


def judge(sc, x, dtype, hard, **changes):
    """Step states of a scene; assert that all are solved and the oracle's residuals small."""
    options = slcp.Options(residual="hard" if hard else "rem-logistic")
    sim = slcp.Simulator(sc, options, device="cpu", dtype=WIDTH[dtype], strategy="generic")
    step = sim.step(x, params=sim.params.replace(**changes))
    assert (step.status == slcp.Status.SOLVED).all(), step.status
    (x64,) = rounded(dtype, x)
    problem = Oracle(sc, **numbers(sc, dtype, **changes)).problem(x64)
    v, impulse = step.state[:, sc.nv :].astype(float), step.impulse.astype(float)
    # the oracle's gaps are exact, the kernel's of the dtype: judge the solve by the kernel's own
    problem["rate"] = step.gap.astype(float) / problem["h"][..., None]
    assert np.abs(step.gap - problem["d"]).max() <= LIMIT[dtype]
    r1, r2 = residual(problem, v, impulse, hard)
    forces = np.einsum("...ij,...i->...j", np.abs(problem["J"]), impulse)
    inertia = np.einsum("...ii->...i", problem["M"])
    size = 1.0 + np.abs(problem["vfree"]).max(axis=1, keepdims=True)
    assert (np.abs(r1) <= LIMIT[dtype] * (forces + inertia * size)).all()
    assert (np.abs(r2) <= LIMIT[dtype] * size).all()
    return step


@pytest.mark.parametrize(
    "name,scaling,hard",
    [
        ("flicking_finger", "none", False),
        ("flicking_finger", "inertia", True),
        ("grasp", "inertia", False),
        ("grasp", "inertia", True),
    ],
)
def test_same_step_as_specialised(name, scaling, hard):
    sc = scene(name)
    rng = np.random.default_rng(0)
    x = near_contact(sc, rng, 200, (0.0, 1e-3, -1e-3, 0.02, np.inf))
    u, force = rng.standard_normal((200, sc.nu)), rng.standard_normal((200, sc.structure.nb, 3))
    residual_name = "hard" if hard else "rem-logistic"
    ours = large(name, scaling=scaling, hard=hard).step(x, u, external_force=force)
    theirs = simulator(name, "cpu", wp.float64, scaling, residual_name).step(x, u, external_force=force)
    np.testing.assert_array_equal(ours.status, theirs.status)
    np.testing.assert_allclose(ours.state, theirs.state, rtol=0, atol=1e-9)
    np.testing.assert_allclose(ours.gap, theirs.gap, rtol=0, atol=1e-12)
    total = np.abs(ours.contact_impulse).sum(axis=(1, 2))
    np.testing.assert_allclose(total, np.abs(theirs.contact_impulse).sum(axis=(1, 2)), rtol=1e-6, atol=1e-9)


@slow
@pytest.mark.parametrize("name", ["menagerie", "moving_plane", "touching_tree", "sprung", "capsules"])
def test_same_step_as_specialised_of_more_scenes(name):
    sc = scene(name)
    rng = np.random.default_rng(1)
    x = near_contact(sc, rng, 200) if sc.structure.pairs else rng.standard_normal((200, 2 * sc.nv))
    u = rng.standard_normal((200, sc.nu)) if sc.nu else None
    ours, theirs = large(name).step(x, u), simulator(name, "cpu").step(x, u)
    np.testing.assert_array_equal(ours.status == slcp.Status.SOLVED, theirs.status == slcp.Status.SOLVED)
    np.testing.assert_allclose(ours.state, theirs.state, rtol=0, atol=1e-9)
    np.testing.assert_allclose(ours.gap, theirs.gap, rtol=0, atol=1e-11)


@pytest.mark.parametrize("hard", [False, True])
@pytest.mark.parametrize("count", [3, 30])
def test_stack(dtype, count, hard):
    """At rest, and thrown together with corners in and out of contact."""
    sc = boxes(np.ones(count))
    rng = np.random.default_rng(2)
    x = np.tile(sc.x0, (12, 1))
    x[4:, : sc.nv] += 1e-4 * rng.standard_normal((8, sc.nv))
    x[4:, sc.nv :] += 0.5 * rng.standard_normal((8, sc.nv))
    step = judge(sc, x, dtype, hard)
    if hard and dtype is wp.float64:  # at rest the ground carries all
        np.testing.assert_allclose(step.contact_impulse[0, :2, 0].sum(), count * 9.81 * 0.01, rtol=1e-6)


@pytest.mark.parametrize("hard", [False, True])
@pytest.mark.parametrize("ratio", [1e3, 1e6])
def test_heavy_on_light(dtype, ratio, hard):
    """At rest and thrown together."""
    sc = boxes([1.0, ratio, 1.0, ratio, ratio])
    x = np.tile(sc.x0, (4, 1))
    x[1:, sc.nv :] += 0.1 * np.random.default_rng(3).standard_normal((3, sc.nv))
    step = judge(sc, x, dtype, hard)
    assert (step.contact_impulse[:, :, 0] >= 0.0).all()
    if hard and dtype is wp.float64:  # at rest the ground carries all
        weight = (2.0 + 3.0 * ratio) * 9.81 * 0.01
        np.testing.assert_allclose(step.contact_impulse[0, :2, 0].sum(), weight, rtol=1e-6)


@slow
@pytest.mark.parametrize("seed", [3, 15, 21])
def test_momentum_is_conserved_on_the_scale_that_is_exchanged(seed):
    """Trees whose masses span 1e14, without scaling: M dv = J' lambda up to what rounding of the outputs is.

    Judged relative to M_ii times the largest speed, a heavy body that a light one hits may take up anything.
    """
    rng = np.random.default_rng(seed)
    sc = random_tree(rng, int(rng.integers(2, 6)), contacts=True)
    factors = 10.0 ** rng.uniform(-7.0, 7.0, len(sc.bodies))
    bodies = tuple(replace(b, mass=b.mass * f, inertia=b.inertia * f, damping=0.0)
                   for b, f in zip(sc.bodies, factors))  # fmt: skip
    sc = replace(sc, bodies=bodies)
    (x,) = rounded(wp.float32, near_contact(sc, np.random.default_rng(seed), 50))
    options = slcp.Options(residual="hard", scaling="none")
    step = slcp.Simulator(sc, options, device="cpu", dtype="float32", strategy="generic").step(x)
    problem = Oracle(sc, **numbers(sc, wp.float32)).problem(x)
    solved, v = step.status == slcp.Status.SOLVED, step.state[:, sc.nv :].astype(float)
    r1, _ = residual(problem, v, step.impulse.astype(float), True)
    mass = np.abs(problem["M"])
    forces = np.einsum("bij,bi->bj", np.abs(problem["J"]), step.impulse.astype(float))
    stored = np.einsum("bij,bj->bi", mass, np.abs(v) + np.abs(problem["vfree"])) + forces
    exchanged = np.einsum("bij,bj->bi", mass, np.abs(v - problem["vfree"])) + forces
    bound = 4.0 * np.finfo(np.float32).eps * stored + 1e-7 * exchanged
    assert solved.mean() > 0.8
    assert (np.abs(r1) <= bound)[solved].all()


@pytest.mark.parametrize("hard", [False, True])
def test_rows_that_all_but_repeat_others(hard):
    """Frictions of a box's corners that differ in the fifth digit."""
    sc, worlds = boxes(np.ones(30)), 60
    rng = np.random.default_rng(3)
    x = np.tile(sc.x0, (worlds, 1))
    x[:, : sc.nv] += 1e-4 * rng.standard_normal((worlds, sc.nv))
    x[:, sc.nv :] += 0.5 * rng.standard_normal((worlds, sc.nv))
    options = slcp.Options(residual="hard" if hard else "rem-logistic")
    sim = slcp.Simulator(sc, options, device="cpu", strategy="generic")
    friction = sim.params["friction"] + 1e-5 * rng.standard_normal((worlds, len(sc.contacts)))
    rolled = sim.rollout(x, np.zeros((worlds, 5, 0)), sim.params.replace(friction=friction))
    assert (rolled.status == slcp.Status.SOLVED).all()


@pytest.mark.parametrize("hard", [False, True])
def test_redundant_supports(dtype, hard):
    sc = beam(64)
    x = np.tile(sc.x0, (3, 1))
    x[1, 2], x[2, 3:] = 1e-3, (0.3, -2.0, 1.0)
    step = judge(sc, x, dtype, hard)
    if hard:
        np.testing.assert_allclose(step.impulse[0].sum(), 2.0 * 9.81 * 0.01, rtol=1e-5)


def coulomb():
    """Options of the hard problem with Coulomb friction."""
    return slcp.Options(residual="hard", friction="coulomb")


@pytest.mark.parametrize("count", [1, 6, 25])
def test_coulomb_friction_in_a_thrown_stack(count):
    """Impulses in the cone, on its edge against the slip where a contact slips; contacts neither pull nor
    sink.
    """
    sc = boxes(np.ones(count))
    rng = np.random.default_rng(6)
    x = np.tile(sc.x0, (40, 1))
    x[:, : sc.nv] += 1e-4 * rng.standard_normal((40, sc.nv))
    x[:, sc.nv :] += 0.5 * rng.standard_normal((40, sc.nv))
    step = slcp.Simulator(sc, coulomb(), device="cpu", strategy="generic").step(x)
    assert (step.status == slcp.Status.SOLVED).all()
    problem = Oracle(sc).problem(x)
    push, rub = step.contact_impulse[:, :, 0], step.contact_impulse[:, :, 1]
    rows = np.stack([push + 2 * rub, push - 2 * rub], -1).reshape(40, -1) / 2  # as lambda of J_n +- mu J_t
    r1, _ = residual(problem, step.state[:, sc.nv :], rows)
    assert np.abs(r1).max() <= 1e-11
    w = problem["rate"] + np.einsum("bij,bj->bi", problem["J"], step.state[:, sc.nv :])
    normal, slip = 0.5 * (w[:, 0::2] + w[:, 1::2]), (w[:, 0::2] - w[:, 1::2])  # slip: 2 mu v_t
    assert np.abs(np.minimum(normal, push)).max() <= 1e-10
    assert (np.abs(rub) <= 0.5 * push + 1e-10).all()
    slips = np.abs(slip) > 1e-8
    assert slips.any() and (~slips & (push > 1e-3)).any()
    np.testing.assert_allclose(rub[slips], (-0.5 * np.sign(slip) * push)[slips], rtol=0, atol=1e-9)


@slow
@pytest.mark.parametrize(
    "name,options", [("sliding_block", coulomb()), ("flicking_finger", slcp.Options(residual="rem-normal"))]
)
def test_same_step_as_specialised_for_other_methods(name, options):
    sc = scene(name)
    rng = np.random.default_rng(0)
    x, u = near_contact(sc, rng, 200, (0.0, 1e-3, -1e-3, 0.02, np.inf)), rng.standard_normal((200, sc.nu))
    ours, theirs = (
        slcp.Simulator(sc, options, device="cpu", strategy=strategy).step(x, u)
        for strategy in ("generic", "specialised")
    )
    assert (ours.status == slcp.Status.SOLVED).all() and (theirs.status == slcp.Status.SOLVED).all()
    np.testing.assert_allclose(ours.state, theirs.state, rtol=0, atol=1e-9)
    np.testing.assert_allclose(ours.contact_impulse, theirs.contact_impulse, rtol=0, atol=1e-8)


def test_sliding_stack_stops_where_coulomb_says():
    """The stack slides on the edge of tipping, where rounding grows by a fifth each step, to 1e-8 m/s.
    Standing, it keeps impulses whose residual is at most 1e-12 of the lowest contact's: its spin gains most.
    """
    sc = boxes(np.ones(2))
    x = sc.x0.copy()
    x[[6, 9]] = 3.0
    end = (
        slcp.Simulator(sc, coulomb(), device="cpu", strategy="generic")
        .rollout(x, np.zeros((100, 0)))
        .states[-1]
    )
    weight, arm, inertia = (
        2 * 9.81 * 0.01,
        0.05,
        sc.bodies[0].inertia,
    )  # of both boxes in a step; of one of 1 kg
    np.testing.assert_allclose(end[6:], 0.0, atol=1e-12 * weight * max(1.0, arm / inertia))
    stop = 3.0**2 / (2 * 0.5 * 9.81) - 3.0 * 0.01 / 2  # implicit Euler; the last step stops it a little early
    np.testing.assert_allclose(end[[0, 3]], stop, atol=0.5 * 0.5 * 9.81 * 0.01**2)
    np.testing.assert_allclose(end[[1, 4]], [0.05, 0.15], atol=1e-9)  # and it does not rise meanwhile


@pytest.mark.parametrize(
    "options", [slcp.Options(), slcp.Options(residual="rem-normal"), slcp.Options(residual="hard"), coulomb()]
)
def test_tumbling_stacks_are_always_solved(options):
    sc = boxes(np.ones(5))
    rng = np.random.default_rng(7)
    x = np.tile(sc.x0, (20, 1))
    x[:, : sc.nv] += 1e-3 * rng.standard_normal((20, sc.nv))
    x[:, sc.nv :] += rng.standard_normal((20, sc.nv))
    sim = slcp.Simulator(sc, options, device="cpu", strategy="generic")
    rolled = sim.rollout(x, np.zeros((20, 60, 0)), sim.params.replace(sigma=0.02))
    assert (rolled.status == slcp.Status.SOLVED).all()


def test_rollout_is_its_steps():
    """A stack thrown about; chunks of worlds; a world that cannot be solved keeps its state."""
    sc = boxes(np.ones(4))
    sim = slcp.Simulator(sc, device="cpu", strategy="generic")
    assert sim.strategy == "generic"
    sim.kernels.stepping.chunk = 2
    rng = np.random.default_rng(4)
    x = np.tile(sc.x0, (5, 1)) + 0.01 * rng.standard_normal((5, sc.nv * 2))
    x[3, 0] = np.nan
    rolled = sim.rollout(x, np.zeros((5, 6, 0)), record=("impulse", "gap"))
    step, warm = None, None
    for k in range(6):
        step = sim.step(x if k == 0 else step.state, warm_start=warm)
        warm = step.multiplier
        np.testing.assert_allclose(rolled.states[:, k + 1], step.state, rtol=0, atol=1e-10)
        np.testing.assert_allclose(rolled.gap[:3, k], step.gap[:3], rtol=0, atol=1e-12)
    assert list(rolled.status) == [0, 0, 0, slcp.Status.NONFINITE, 0]
    np.testing.assert_array_equal(rolled.states[3, -1], x[3])


def test_jam_is_infeasible():
    """A disc in a wedge of two moving half-planes that is too narrow by any velocity."""
    shapes = (
        Shape("left", None, "halfplane", offset=(-0.1, 0.0), angle=0.0),
        Shape("right", None, "halfplane", offset=(0.1, 0.0), angle=np.pi),
        Shape("disc", "disc", "disc", 0.2),
    )
    sc = Scene("jam", (Body("disc", 1.0, 0.1, joint="free"),), shapes,
               (Contact("left", "disc", 0.3), Contact("right", "disc", 0.3)))  # fmt: skip
    for hard in (True, False):
        options = slcp.Options(residual="hard" if hard else "rem-logistic")
        step = slcp.Simulator(sc, options, device="cpu", strategy="generic").step(np.zeros((1, 6)))
        assert step.status[0] == slcp.Status.INFEASIBLE


def test_envelope_of_a_stack_is_narrow():
    s = boxes(np.ones(30)).structure
    lists, sizes = large_topology.tables(s)
    assert sorted(j for j in lists["block_dof"] if j >= 0) == list(range(90))
    assert sizes.blocks == 30 and sizes.matrix == 30 + 29  # every box couples to the one before it alone


def test_strategy_is_chosen_and_refused():
    assert slcp.Simulator(scene("flicking_finger"), device="cpu").strategy == "specialised"
    sc = boxes(np.ones(30))
    sim = slcp.Simulator(sc, device="cpu")
    assert sim.strategy == "generic"
    with pytest.raises(slcp.StrategyError, match="120 rows"):
        slcp.Simulator(sc, device="cpu", strategy="specialised")
    with pytest.raises(ValueError, match="strategy is 'fast'"):
        slcp.Simulator(sc, device="cpu", strategy="fast")


HARD_LAWS = ({"residual": "hard"}, {"residual": "hard", "friction": "coulomb"})


def test_strategy_is_the_faster_one_on_a_cpu():
    """Trees that touch each other, and rows that act at once under Coulomb's friction. What else hangs
    together, or touches the world alone, has kernels of its own, as has all that generic kernels lack.
    """
    own = ("flicking_finger", "sliding_block", "grasp", "walker", "hopper", "ball_drop", "push_block")
    for options in ({}, *HARD_LAWS):
        chosen = {
            name: slcp.Simulator(scene(name), slcp.Options(**options), device="cpu").strategy for name in own
        }
        assert set(chosen.values()) == {"specialised"}, chosen
        for count in (2, 3, 5):
            sim = slcp.Simulator(scenes.stack(count), slcp.Options(**options), device="cpu")
            assert sim.strategy == "generic", (count, options)
        six = slcp.Simulator(scenes.beam(6, friction=0.5), slcp.Options(**options), device="cpu")
        assert six.strategy == ("generic" if options.get("friction") == "coulomb" else "specialised")
    lacking = slcp.Options(residual="erm-logistic", scaling="inertia")
    assert slcp.Simulator(scenes.stack(3), lacking, device="cpu").strategy == "specialised"


def test_trees_that_pairs_join():
    """The world joins none; a tree counts once, however many of its bodies touch."""
    count = {"flicking_finger": 2, "walker": 1, "sliding_block": 1, "grasp": 3, "two_balls": 2}
    assert {name: joined_trees(scene(name).structure) for name in count} == count
    assert joined_trees(scenes.stack(7).structure) == 7
    apart = replace(scenes.stack(4), contacts=scenes.stack(4).contacts[:4])
    assert joined_trees(apart.structure) == 2


@pytest.mark.parametrize("old, new", [("registers", "specialised"), ("memory", "generic")])
def test_strategies_of_old_name_warn_where_they_are_asked_for(old, new):
    finger, spec = scene("flicking_finger"), slcp.SweepSpec(worlds=1)
    with pytest.warns(DeprecationWarning, match=f"strategy {old!r} is called {new!r} now") as warned:
        assert slcp.Simulator(finger, device="cpu", strategy=old).strategy == new
        with pytest.raises(ValueError, match="policy is None"):
            slcp.sweep(finger, None, spec, device="cpu", strategy=old)
    names = [Path(warning.filename).name for warning in warned if "strategy" in str(warning.message)]
    assert names == ["test_large.py"] * 2


@pytest.mark.parametrize("nv,nc", [(1, 1), (3, 0), (3, 5), (6, 12)])
def test_benchmarked_chain_has_its_size(nv, nc):
    s = chain_on_ground(nv, nc).structure
    assert (s.nv, s.nr) == (nv, nc)


def test_supports_out_of_reach_stay_out():
    sim = slcp.Simulator(beam_on_supports(8, 2), device="cpu", strategy="generic")
    step = sim.step(sim.scene.x0)
    assert (step.multiplier[: sim.nr] < 1e29).sum() == 4
