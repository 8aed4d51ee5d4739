"""Bodies stuck by more rows than they have degrees of freedom (docs: gradients, at a kink)."""

import dataclasses
import math

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape
from slcp_warp.scripts.benchmarks.fuzz.differences import jacobian_errors
from slcp_warp.scripts.benchmarks.fuzz.judged import parameters
from slcp_warp.scripts.benchmarks.fuzz.tasks import Task

LEAN = 1.1  # of the ladder against the floor [rad]
LADDER = Scene(
    "ladder",
    (Body("ladder", 1.0, 1.0 / 12.0, joint="free"),),
    (
        Shape("floor", None, "halfplane", angle=math.pi / 2),
        Shape("wall", None, "halfplane", angle=0.0),
        Shape("foot", "ladder", "disc", offset=(0.5, 0.0)),
        Shape("top", "ladder", "disc", offset=(-0.5, 0.0)),
    ),
    (Contact("floor", "foot", 0.8), Contact("wall", "top", 0.8)),
    sigma=0.01,
    initial_state=(0.5 * math.cos(LEAN), 0.5 * math.sin(LEAN), -LEAN, 0.0, 0.0, 0.0),
)


def derivative_and_sides(strategy, spacing, **options):
    """A at rest, and the differences of v' by q to either side, (3, 3) each."""
    sim = slcp.Simulator(LADDER, slcp.Options(**options), device="cpu", strategy=strategy)
    x = sim.rollout(LADDER.x0[None], steps=300).states[:, -1]
    at = np.concatenate([x, x + spacing * np.eye(6)[:3], x - spacing * np.eye(6)[:3]])
    after = sim.step(at)
    assert (after.status == 0).all()
    v = after.state[:, 3:]
    return sim.linearize(x).A[0, 3:, :3], (v[1:4] - v[0]).T / spacing, (v[0] - v[4:]).T / spacing


def test_smoothed_contact_has_its_derivative():
    A, ahead, behind = derivative_and_sides("generic", 3e-9)
    np.testing.assert_allclose(A, 0.5 * (ahead + behind), atol=1e-3 * np.abs(A).max())


@pytest.mark.parametrize(
    ("strategy", "friction"),
    [
        pytest.param("specialised", "coulomb", marks=pytest.mark.full),
        ("generic", "coulomb"),
        ("generic", "anitescu"),
    ],
)
def test_hard_contact_has_a_derivative_between_both_sides(strategy, friction):
    A, ahead, behind = derivative_and_sides(strategy, 1e-6, residual="hard", friction=friction)
    slack = 1e-4 * np.abs(A).max()
    assert (A > np.minimum(ahead, behind) - slack).all()
    assert (A < np.maximum(ahead, behind) + slack).all()


def plane_and_point(body, k, centre, turn, at, lean):
    """A plane of the world under a point of a body."""
    c, s = math.cos(turn), math.sin(turn)
    own = (c * at[0] + s * at[1], c * at[1] - s * at[0])
    return (
        Shape(f"plane{body}{k}", None, "halfplane", offset=tuple(centre + at), angle=0.5 * math.pi + lean),
        Shape(f"point{body}{k}", f"body{body}", "disc", offset=own),
    )


def stuck_bodies(rng, count):
    """Bodies at rest, each on two or three points of planes of their own, and each against the next."""
    bodies, shapes, contacts, x0, last = [], [], [], [], None
    for i in range(count):
        name, centre, turn = f"body{i}", np.array([2.0 * i, 1.0]), rng.uniform(-math.pi, math.pi)
        bodies.append(Body(name, rng.uniform(0.5, 2.0), rng.uniform(0.05, 0.3), joint="free"))
        x0 += [*centre, turn]
        for k, side in enumerate((-1, 1, 0)[: rng.integers(2, 4)]):
            across = side * rng.uniform(0.3, 0.6) if side else rng.uniform(-0.2, 0.2)
            at = np.array([across, -rng.uniform(0.1, 0.6)])
            shapes += plane_and_point(i, k, centre, turn, at, side * rng.uniform(-0.2, 0.6))
            contacts.append(Contact(f"plane{i}{k}", f"point{i}{k}", rng.uniform(0.7, 1.2)))
        if last is not None:
            y = rng.uniform(-0.3, 0.3)
            for end, body, x, angle in (("left", last[0], 0.8, last[1]), ("right", name, -0.8, turn)):
                own = (
                    x * math.cos(angle) + y * math.sin(angle),
                    y * math.cos(angle) - x * math.sin(angle),
                )
                shapes.append(Shape(f"{end}{i}", body, "disc", 0.2, own))
            contacts.append(Contact(f"left{i}", f"right{i}", rng.uniform(0.3, 1.0)))
        last = name, turn
    speeds = [0.0] * len(x0)
    return Scene("stuck", tuple(bodies), tuple(shapes), tuple(contacts), initial_state=(*x0, *speeds))


def at_rest(scene, friction):
    sim = slcp.Simulator(scene, slcp.Options("hard", friction=friction), device="cpu", strategy="generic")
    x = sim.rollout(scene.x0[None], steps=20).states[:, -1]
    after = sim.step(x)
    assert after.status[0] == 0
    assert np.abs(after.state[0, sim.scene.nv :]).max() < 1e-6
    return sim, x, after.state[0, sim.scene.nv :]


@pytest.mark.parametrize("count", [1, 2, 4])
def test_the_derivative_is_that_of_a_step_beside(count):
    """Coordinates moved the way that `vertex.py` moves them: A has the difference to there."""
    for seed in range(10):
        sim, x, v = at_rest(stuck_bodies(np.random.default_rng([count, seed]), count), "anitescu")
        way = np.zeros(sim.nx)
        way[: sim.scene.nv] = (0.6180339887498949 * np.arange(1, sim.scene.nv + 1)) % 1.0 - 0.5
        there = sim.step(x + 1e-7 * way)
        assert there.status[0] == 0
        change = sim.linearize(x).A[0, sim.scene.nv :] @ way
        np.testing.assert_allclose(
            change,
            (there.state[0, sim.scene.nv :] - v) / 1e-7,
            atol=1e-4 * np.abs(change).max(),
            err_msg=str(seed),
        )


def of_random_mechanism(scene, world, **options):
    """Error of A and B of a world of `slcp bench fuzz --seed 601`, by the common kernels."""
    task = Task(601, scene, "generic", per_chunk=40)
    worlds = task.worlds(0, own := task.make_scene()).part(world)
    sim = slcp.Simulator(own, slcp.Options(**options), device="cpu", strategy="generic")
    error, trusted = jacobian_errors(sim, worlds.x, worlds.u, parameters(sim, worlds.numbers))
    assert trusted.all()
    return error[0]


@pytest.mark.parametrize(("scene", "world"), [(140, 34), (332, 12), (470, 24)])
def test_dependent_rows_that_moving_bodies_can_follow_have_no_kink(scene, world):
    """Contacts that stick, twice in one place or beside a limit that moves with others."""
    assert of_random_mechanism(scene, world, residual="hard", friction="coulomb") < 1e-4


def test_rows_that_are_nearly_one_are_refined_to_the_end():
    """Impulses of 2e10 N s: what is left of an error falls by little at a time."""
    assert of_random_mechanism(325, 16, residual="hard", scaling="none") < 1e-4


def test_a_factor_without_digits_is_made_firmer():
    """A mass matrix of condition 1e7: refinement diverged, and A was 1e5 times too large."""
    task = Task(601, 301, "generic", per_chunk=40)
    worlds = task.worlds(0, own := task.make_scene()).part(2)
    sim = slcp.Simulator(
        own, slcp.Options("hard", scaling="none"), dtype="float64", device="cpu", strategy="generic"
    )
    params, spacing = parameters(sim, worlds.numbers), 1e-4
    found = sim.linearize(worlds.x, worlds.u, params)
    assert found.status[0] == 0
    ends = [
        sim.step(worlds.x + e * unit, worlds.u, params)
        for unit in np.eye(sim.nx)
        for e in (spacing, -spacing)
    ]
    assert all(end.status[0] == 0 for end in ends)
    states = np.stack([end.state[0] for end in ends], axis=1)
    slope = (states[:, ::2] - states[:, 1::2]) / (2.0 * spacing)
    np.testing.assert_allclose(found.A[0], slope, atol=1e-3 * np.abs(slope).max())
    weights = np.random.default_rng(0).normal(size=(1, 2, sim.nx))
    weights[:, 0] = 0.0
    pulled = slcp.vjp(sim, worlds.x, worlds.u[:, None], weights, params).x0[0]
    expected = slope.T @ weights[0, 1]
    np.testing.assert_allclose(pulled, expected, atol=1e-3 * np.abs(expected).max())


def test_bodies_that_rows_hold_whole_have_gradients():
    """By velocities it is 0: what refinement begins with is taken back."""
    task = Task(801, 38, "generic", per_chunk=40)
    worlds = task.worlds(0, own := task.make_scene()).part(np.full(64, 35))
    sim = slcp.Simulator(own, slcp.Options("hard", friction="coulomb"), device="cpu", strategy="generic")
    params = parameters(sim, worlds.numbers)
    weights = np.random.default_rng(0).normal(size=(64, 2, sim.nx))
    weights[:, 0] = 0.0
    pulled = slcp.vjp(sim, worlds.x, worlds.u[:, None], weights, params).x0
    expected = np.einsum("bij,bi->bj", sim.linearize(worlds.x, worlds.u, params).A, weights[:, 1])
    np.testing.assert_allclose(pulled, expected, atol=1e-6 * np.abs(expected).max())


def pulled_and_expected(seed, scene, world, **options):
    """Eight weights of a random mechanism's velocities pulled back, beside A' times them."""
    task = Task(seed, scene, "generic", per_chunk=40)
    worlds = task.worlds(0, own := task.make_scene()).part(np.full(8, world))
    sim = slcp.Simulator(own, slcp.Options(**options), dtype="float64", device="cpu", strategy="generic")
    params = parameters(sim, worlds.numbers)
    weights = np.random.default_rng(0).normal(size=(8, 2, sim.nx))
    weights[:, 0] = 0.0
    pulled = slcp.vjp(sim, worlds.x, worlds.u[:, None], weights, params).x0
    return pulled, np.einsum("bij,bi->bj", sim.linearize(worlds.x, worlds.u, params).A, weights[:, 1])


def test_columns_that_impulses_make_large_are_refined_to_the_end():
    """Of 5e11 N s: what was left beside the response without rows was 1e-3 of A."""
    assert of_random_mechanism(78, 8, residual="hard") < 1e-4


@pytest.mark.parametrize(
    ("seed", "scene", "world", "residual", "scaling"),
    [(601, 78, 8, "hard", "inertia"), (801, 313, 13, "hard", "none"), (801, 130, 11, "rem-logistic", "none")],
)
def test_gradients_that_impulses_make_large_are_refined_to_the_end(seed, scene, world, residual, scaling):
    """What eight corrections left was 1e-9 of the weights and .002 to .06 of the gradient."""
    pulled, expected = pulled_and_expected(seed, scene, world, residual=residual, scaling=scaling)
    np.testing.assert_array_less(np.abs(pulled - expected).max(1) / np.abs(expected).max(1), 1e-3)


def test_gradients_without_digits_beside_the_impulses_are_none():
    """Of 2e13 N s: the last correction was 1e-13 of the weights, and the gradient off by .02 to 1.4."""
    pulled, _ = pulled_and_expected(801, 91, 6, residual="hard", scaling="none")
    assert np.isnan(pulled).any(1).mean() > 0.5


@pytest.mark.parametrize("friction", ["anitescu", "coulomb"])
def test_the_adjoint_is_the_transpose(friction):
    sim, x, _ = at_rest(stuck_bodies(np.random.default_rng(3), 2), friction)
    weights = np.random.default_rng(0).normal(size=(1, 2, sim.nx))
    weights[:, 0] = 0.0
    pulled = slcp.vjp(sim, x, np.zeros((1, 1, 0)), weights).x0[0]
    expected = sim.linearize(x).A[0].T @ weights[0, 1]
    np.testing.assert_allclose(pulled, expected, atol=1e-9 * np.abs(expected).max())


def leg():
    """A leg of a torso, two links and a foot, whose two ends are on the floor."""
    link = {"armature": 0.02, "damping": 0.5}
    bodies = (
        Body("torso", 12.0, 0.4, joint="free", com=(0.0, 0.1)),
        Body("thigh", 2.5, 0.03, parent="torso", com=(0.0, -0.2), **link),
        Body("shin", 1.5, 0.02, parent="thigh", anchor=(0.0, -0.4), com=(0.0, -0.2), upper=0.0, **link),
        Body("foot", 0.8, 0.01, parent="shin", anchor=(0.0, -0.4), com=(0.03, -0.03), **link),
    )
    shapes = (
        Shape("ground", None, "halfplane", angle=math.pi / 2),
        Shape("foot", "foot", "capsule", (0.03, 0.1), offset=(0.04, -0.03)),
    )
    motors = tuple(slcp.Actuator(name) for name in ("thigh", "shin", "foot"))
    return Scene("leg", bodies, shapes, (Contact("ground", "foot", 0.8),), motors, step_size=0.01, sigma=0.01)


def test_a_foot_that_stands_on_both_ends_has_derivatives_in_all_kernels():
    """Four rows in a plane of three, of which one all but repeats the others, 1e-8 m apart: own kernels
    refined against a row that yields nothing, and said that there is none (a user's plan ended so).
    """
    x = np.array([[
        0.028984906660065504, 0.7375042720597949, 0.25374476133301366, 0.2510347135448367, -1.117177662615504,
        0.6123980950908301, 0.8176699989536117, -0.46326923557726496, 7.057976723229003, -7.283148415319162,
        -2.00431199481719, 2.2635121205984126,
    ]])  # fmt: skip
    u = np.array([[-21.115632286022695, 66.16102194866616, -16.487640999340073]])
    rng = np.random.default_rng(0)
    x, u, weight = np.repeat(x, 64, 0), np.repeat(u, 64, 0), rng.standard_normal((64, 2, 12))
    x[1:, :6] += 10.0 ** rng.uniform(-11.0, -7.0, (63, 1)) * rng.standard_normal((63, 6))
    own, common = [], []
    for strategy, found in (("specialised", own), ("generic", common)):
        sim = slcp.Simulator(leg(), device="cpu", dtype="float64", strategy=strategy)
        assert not sim.step(x, u).status.any()
        lin = sim.linearize(x, u)
        assert not lin.status.any()
        back = slcp.vjp(sim, x, u[:, None], weight, parameters=("mass", "inertia", "com"))
        found += [lin.A, lin.B, back.x0, back.controls, *back.parameters.values()]
    for one, other in zip(own, common, strict=True):
        assert np.abs(other).max() > 1e-3
        np.testing.assert_allclose(one[:1], other[:1], rtol=0.0, atol=1e-8 * np.abs(other[:1]).max())
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-6 * np.abs(other).max())


SLED = Scene(  # a pusher with a smooth tip behind a box that can rise: the tip's vertical rubs on nothing
    "sled",
    (
        Body("pusher", 1.0, 0.001, joint="prismatic"),
        Body("lift", 0.01, 0.001, joint="prismatic", axis=(0.0, 1.0)),
        Body("box", 1.4, 0.01, parent="lift", joint="prismatic"),
    ),
    (
        Shape("tip", "pusher", "disc", 0.02),
        Shape("box", "box", "rectangle", (0.1, 0.1)),
        Shape("ground", None, "halfplane", offset=(0.0, -0.1), angle=math.pi / 2),
    ),
    (Contact("tip", "box", friction=0.0), Contact("box", "ground", friction=0.3)),
    actuators=(slcp.Actuator("pusher"),),
    step_size=0.005,
)


@pytest.mark.parametrize("afloat", [True, False])
def test_friction_that_is_none_holds_nothing(afloat):
    """A smooth tip does not hold the box at its height, nor against the ground that pushes it out."""
    options = slcp.Options("hard", friction="coulomb")
    scene = dataclasses.replace(SLED, gravity=(0.0, 0.0)) if afloat else SLED
    sim = slcp.Simulator(scene, options, device="cpu", dtype="float64", strategy="specialised")
    height = 0.05 if afloat else -2e-5
    x, u = np.array([-0.115, height, 0.005 - 1e-5, 0.35, 0.0, 0.35]), np.array([11.5])
    linear = sim.linearize(x, u)
    assert linear.status == 0
    moved = 1e-8 * np.eye(6)
    ahead, behind = (sim.step(x + sign * moved, np.tile(u, (6, 1))) for sign in (1.0, -1.0))
    assert not ahead.status.any() and not behind.status.any()
    columns = (ahead.state - behind.state).T / 2e-8
    np.testing.assert_allclose(linear.A, columns, atol=2e-5 * np.abs(columns).max())
