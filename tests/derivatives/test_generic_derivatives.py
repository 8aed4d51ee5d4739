"""A, B and second derivatives of the generic step: those of the specialised kernels, and differences of steps
that only generic kernels take.
"""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from differences import WEIGHTS, states_near_contact
from oracle import Oracle
from random_scenes import near_contact, random_tree
from simulators import WIDTH, scene, simulator

import slcp_warp as slcp
from slcp_warp import scenes

STEP = 3e-5  # of velocities; of positions h times that
COULOMB = slcp.Options(residual="hard", friction="coulomb")


def slow(*values):
    return pytest.param(*values, marks=pytest.mark.slow)


def generic(sc, dtype=wp.float64, **options):
    return slcp.Simulator(sc, slcp.Options(**options), device="cpu", dtype=WIDTH[dtype], strategy="generic")


def agree(got, exact, bound):
    """Entries of A and B relative to each world's largest."""
    scale = np.abs(exact.A).max(axis=(1, 2), keepdims=True)
    scale = np.where(scale > 0.0, scale, 1.0)  # of what was not solved both have zeros
    assert (np.abs(got.A - exact.A) / scale).max() <= bound
    if exact.B.size:
        assert (np.abs(got.B - exact.B) / scale).max() <= bound


@pytest.mark.parametrize(
    "name,options",
    [
        ("flicking_finger", {"scaling": "none"}),
        ("flicking_finger", {"residual": "hard"}),
        ("moving_plane", {}),
        ("touching_tree", {}),
        slow("capsules", {}),
        slow("pill", {}),
        slow("slab", {}),
        slow("hoop", {}),
        slow("slab", {"residual": "hard", "friction": "coulomb"}),
        pytest.param("blocks", {}, marks=pytest.mark.full),
        slow("sprung_plane", {}),
        slow("flicking_finger", {"residual": "rem-normal"}),
        slow("sliding_block", {"residual": "hard", "friction": "coulomb"}),
        slow("grasp", {"residual": "hard", "friction": "coulomb"}),
    ],
)
def test_same_derivatives_as_specialised(name, options):
    """All shapes, trees, limits, springs; smoothed, hard and sliding contact."""
    sc = scene(name)
    x, u = states_near_contact(name, 60)
    theirs = slcp.Simulator(sc, slcp.Options(**options), device="cpu", strategy="specialised")
    ours = generic(sc, **options).linearize(x, u)
    exact = theirs.linearize(x, u)
    assert (ours.status == exact.status).all() and (ours.status == slcp.Status.SOLVED).mean() > 0.9
    agree(ours, exact, 2e-9 if name == "capsules" else 1e-9)  # there one world has rows that all but repeat


def test_same_derivatives_as_specialised_without_contact():
    sim, ours = simulator("sprung", "cpu"), generic(scene("sprung"))
    rng = np.random.default_rng(5)
    x, u = 1.5 * rng.standard_normal((20, sim.nx)), rng.standard_normal((20, sim.nu))
    force = rng.standard_normal((20, sim.scene.structure.nb, 3))
    got, exact = (s.linearize(x, u, second=True, external_force=force) for s in (ours, sim))
    agree(got, exact, 1e-12)
    size = np.abs(exact.second).max()
    np.testing.assert_allclose(got.second, exact.second, rtol=0, atol=1e-8 * size)


def test_second_derivatives_are_those_of_the_specialised_kernels():
    sim, ours = simulator("flicking_finger", "cpu"), generic(scene("flicking_finger"))
    x, u = states_near_contact("flicking_finger", 20)
    got, exact = ours.linearize(x, u, second=True), sim.linearize(x, u, second=True)
    agree(got, exact, 1e-9)
    size = 1.0 + np.abs(exact.second).max(axis=(1, 2, 3), keepdims=True)
    assert (np.abs(got.second - exact.second) / size).max() < 1e-6


def tumbling(count, worlds, seed=2):
    """A stack of boxes and states of it: thrown together, corners in and out of contact."""
    sc = scenes.stack(count, [1.0] * count, 0.5, size=0.1)
    rng = np.random.default_rng(seed)
    x = np.tile(sc.x0, (worlds, 1))
    x[:, : sc.nv] += 1e-4 * rng.standard_normal((worlds, sc.nv))
    x[:, sc.nv :] += 0.5 * rng.standard_normal((worlds, sc.nv))
    return sc, x


def along(sim, x, directions, params, step=STEP):
    """Differences of the step along directions (D, nx), of sixth order, and whether all steps were solved."""
    kinds = np.array([-3, -2, -1, 1, 2, 3])
    directions[:, : sim.scene.nv] *= sim.scene.step_size
    moved = x + (step * kinds[:, None, None]) * directions
    after = sim.step(moved.reshape(-1, sim.nx), params=params)
    weights = np.sign(kinds) * [WEIGHTS[abs(k)] for k in kinds]
    values = after.state.reshape(*moved.shape)
    return np.einsum("k,kdi->di", weights, values) / step, (after.status == 0).reshape(6, -1).all(0)


@pytest.mark.parametrize(
    "count,options", [(30, {}), (3, {"residual": "hard"}), slow(5, {"residual": "rem-normal"})]
)
def test_derivatives_of_stacks_are_differences(count, options):
    """A stack of 30 has 90 degrees of freedom and 120 rows; hard ones where no row is near a switch."""
    sc, x = tumbling(count, 4 if count > 5 else 40)
    sim = generic(sc, **options)
    hard = sim.options.hard
    params = sim.params if hard else sim.params.replace(sigma=0.1)
    lin, step = sim.linearize(x, params=params), sim.step(x, params=params)
    assert (lin.status == slcp.Status.SOLVED).all()
    keep = np.ones(len(x), bool)
    if hard:
        problem = Oracle(sc).problem(x)
        w = problem["rate"] + np.einsum("bij,bj->bi", problem["J"], step.state[:, sc.nv :])
        keep = (np.abs(problem["D"] * step.impulse - w) > 2e-3).all(axis=1)
        assert keep.sum() >= 3
    rng = np.random.default_rng(3)
    for world in np.flatnonzero(keep)[:4]:
        directions = rng.standard_normal((12, sim.nx))
        exact, solved = along(sim, x[world], directions, params, 1e-6 if hard else STEP)
        assert solved.all()
        got = directions @ lin.A[world].T
        assert np.abs(got - exact).max() <= 1e-6 * np.abs(exact).max()


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_derivatives_of_random_trees_are_differences(seed):
    """Branches, prismatic joints, dampers that act late and early, ellipses and tilted ground."""
    rng = np.random.default_rng(100 + seed)
    sc = replace(random_tree(rng, 6, contacts=True), implicit_damping=bool(seed % 2))
    sim = generic(sc)
    params = sim.params.replace(sigma=0.1)
    x = near_contact(sc, rng, 30)
    lin = sim.linearize(x, params=params)
    keep = np.flatnonzero((lin.status == 0) & (Oracle(sc).problem(x)["margin"] > 0.05))
    assert len(keep) >= 10
    for world in keep[:10]:
        directions = rng.standard_normal((12, sim.nx))
        exact, solved = along(sim, x[world], directions, params)
        assert solved.all()
        assert np.abs(directions @ lin.A[world].T - exact).max() <= 1e-6 * np.abs(exact).max()


def test_float32_follows_float64():
    sc, x = tumbling(5, 8)
    x = x.astype(np.float32)
    params = generic(sc).params.replace(sigma=0.1)
    exact = generic(sc).linearize(x, params=params)
    got = generic(sc, wp.float32).linearize(x, params=params)
    agree(got, exact, 1e-3)


GRIPPED = (  # q and v of a box that two fingers lift, flat but for 1e-14 rad
    *(0.00011053888420371641, 0.3999556748919722, 0.24848234103378775, -0.24848771190091745),
    *(-4.828202811927718e-06, 0.040175931519524775, 1.0792341106095058e-14),
    *(-0.00012875183409114964, 1.3499699505450207, 0.5577964164111996, -0.5576882016325106),
    *(2.743843578153542e-12, -1.4088384305916234e-16, -6.347141642851485e-13),
)


def gripper():
    """Two fingers on a cart and a lift at its end, and a box on the floor whose corners and sides touch."""
    box = slcp.box("box", "box", width=0.08, height=0.08, corner_radius=0.005, sides=True)
    floor = slcp.Shape("floor", None, "halfplane", angle=np.pi / 2)
    finger = {"mass": 0.15, "inertia": 3e-4, "parent": "lift", "com": (0.0, -0.06), "damping": 0.05}
    bodies = (
        slcp.Body("cart", 1.0, 0.01, joint="prismatic", damping=2.0),
        slcp.Body(
            "lift", 1.0, 0.01, "cart", joint="prismatic", anchor=(0.0, 0.17), axis=(0.0, 1.0), damping=2.0,
            upper=0.4,
        ),
        slcp.Body("finger0", anchor=(-0.07, 0.0), armature=1e-3, lower=-0.6, upper=0.8, **finger),
        slcp.Body("finger1", anchor=(0.07, 0.0), armature=1e-3, lower=-0.8, upper=0.6, **finger),
        slcp.Body("box", 0.45, 3.2e-4, joint="free"),
    )  # fmt: skip
    tips = tuple(slcp.Shape(f"tip{i}", f"finger{i}", "disc", 0.012, offset=(0.0, -0.12)) for i in range(2))
    return slcp.Scene(
        "gripper", bodies, (floor, *box, *tips),
        (*slcp.touching(box[:4], (floor,), friction=0.4), *slcp.touching(tips, (floor,), friction=0.4),
         slcp.Contact("box30", "tip0", 0.4), slcp.Contact("box12", "tip1", 0.4)),
        actuators=tuple(slcp.Actuator(body.name) for body in bodies[:4]), step_size=0.01, sigma=0.05,
    )  # fmt: skip


def test_corrections_as_small_as_rounding_end():
    """Refinement that goes round in what numbers round by has found them: second derivatives, and DDP, ended
    there for one such state of a hundred.
    """
    sim = generic(gripper())
    x = np.array(GRIPPED) + 1e-15 * np.random.default_rng(0).standard_normal((1000, 14))
    u = np.tile(
        [-0.005261020229882367, 12.752999997940947, -0.37814815805683266, 0.3781100119444919], (1000, 1)
    )
    first, both = sim.linearize(x, u), sim.linearize(x, u, second=True)
    assert (sim.step(x, u).status == 0).all() and (first.status == 0).all() and (both.status == 0).all()
    np.testing.assert_allclose(both.A, first.A, rtol=0, atol=1e-9 * np.abs(first.A).max())
    bent = np.abs(both.second).max(axis=(1, 2, 3))
    assert (bent > 0.1 * np.median(bent)).all()  # and all have second ones


def test_unsolved_worlds_have_a_status_and_no_derivatives():
    sc, x = tumbling(5, 5)
    sim = generic(sc)
    clean = sim.linearize(x)
    x[2, 3] = np.nan
    lin = sim.linearize(x)
    assert lin.status[2] == slcp.Status.NONFINITE and (np.delete(lin.status, 2) == 0).all()
    np.testing.assert_array_equal(lin.A[2], 0.0)
    np.testing.assert_array_equal(np.delete(lin.A, 2, 0), np.delete(clean.A, 2, 0))


def test_worlds_in_chunks_and_along_trajectories():
    """`jvp` pushes forward along all steps, in as many launches as the workspaces ask for."""
    sc, x = tumbling(5, 3)
    sim = generic(sc)
    sim.kernels.stepping.chunk = 2
    dx = np.random.default_rng(4).standard_normal(x.shape)
    run = slcp.jvp(sim, x, np.zeros((3, 4, 0)), dx)
    assert (run.status == 0).all()
    for k in range(4):
        lin = sim.linearize(run.states[:, k])
        np.testing.assert_allclose(
            run.tangent[:, k + 1], np.einsum("bij,bj->bi", lin.A, run.tangent[:, k]), rtol=1e-6, atol=1e-9
        )
