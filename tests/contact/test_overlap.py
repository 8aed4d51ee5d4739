"""Overlaps that leave by no more than a speed, and stay where no velocity takes them apart (M60)."""

from dataclasses import replace

import numpy as np
import pytest
from differences import differences
from parameter_checks import check, check_jacobians, crane, errors, smooth, states
from random_scenes import near_contact, random_tree

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape

LAWS = {
    "smoothed": slcp.Options(),
    "hard": slcp.Options("hard"),
    "coulomb": slcp.Options("hard", friction="coulomb"),
}
ALL = pytest.mark.parametrize("law", LAWS)
RADIUS = 0.1


def simulator(scene, law="hard", speed=None):
    options = replace(LAWS[law], depenetration_speed=speed)
    return slcp.Simulator(scene, options, device="cpu", dtype="float64", strategy="generic")


def disc(*walls, friction=None, sigma=1e-3, **changes):
    """A disc between half-planes: by name their angle and offset."""
    shapes = [Shape("disc", "disc", "disc", RADIUS)]
    shapes += [Shape(name, None, "halfplane", offset=offset, angle=angle) for name, angle, offset in walls]
    contacts = tuple(Contact(name, "disc", friction) for name, _angle, _offset in walls)
    bodies = (Body("disc", 1.0, 0.005, joint="free"),)
    return Scene("disc", bodies, tuple(shapes), contacts, step_size=0.01, sigma=sigma, **changes)


FLOOR, WALL = ("floor", np.pi / 2, (0.0, 0.0)), ("wall", np.pi, (0.0, 0.0))


def corner(depth):
    """States of a disc so deep in the floor and in the wall beside it."""
    x = np.zeros((len(depth), 6))
    x[:, 0], x[:, 1] = depth - RADIUS, RADIUS - depth
    return x


def channel(depth):
    """A disc with no room between two walls that meet the vertical at .4, by so much on either side."""
    axis = np.array([np.cos(0.4), np.sin(0.4)])
    sides = [("left", 0.4, tuple(-(RADIUS - depth) * axis)),
             ("right", 0.4 + np.pi, tuple((RADIUS - depth) * axis))]  # fmt: skip
    return disc(*sides), axis


@ALL
@pytest.mark.parametrize("speed", [0.0, 0.2, 5.0])
def test_an_overlap_leaves_by_no_more_than_the_speed(law, speed):
    """In closed form: v' = min(d/h, speed) under gravity, and what is apart meets the floor as ever."""
    scene = disc(FLOOR, sigma=1e-6)
    height = RADIUS - np.array([0.03, 1e-4, 0.0, -2e-4, -0.01])
    x = np.zeros((5, 6))
    x[:, 1] = height
    step = simulator(scene, law, speed).step(x)
    falls = -9.81 * 0.01
    expected = np.maximum(np.minimum((RADIUS - height) / 0.01, speed), falls)
    np.testing.assert_allclose(step.state[:, 4], expected, atol=2e-5 if law == "smoothed" else 1e-12)
    np.testing.assert_allclose(step.gap[:, 0], height - RADIUS, atol=1e-15)  # whatever the row holds


@ALL
def test_what_finds_its_way_out_moves_as_without(law):
    """Random trees in contact: a speed beyond all of theirs changes nothing, bit for bit."""
    rng = np.random.default_rng(3)
    for _ in range(3):
        scene = random_tree(rng, contacts=True)
        x = near_contact(scene, rng, 100)
        one, other = (simulator(scene, law, speed).step(x) for speed in (None, 1e9))
        good = one.status == 0
        assert good.sum() > 90
        np.testing.assert_array_equal(one.state[good], other.state[good])
        np.testing.assert_allclose(one.gap, other.gap, rtol=1e-14, atol=1e-15)
        solved = other.status == slcp.Status.SOLVED
        assert solved.all()
        np.testing.assert_array_equal(other.state[~good][:, : scene.nv], x[~good][:, : scene.nv])


def test_rows_hold_what_overlaps_leave_by():
    """Random trees without friction, complementarity by differences of the gaps along v'."""
    rng, speed, tried = np.random.default_rng(5), 0.1, 0
    for _ in range(3):
        scene = random_tree(rng, contacts=True)
        scene = replace(scene, contacts=tuple(replace(c, friction=None) for c in scene.contacts))
        x = near_contact(scene, rng, 100, gaps=(0.01, -0.01, -0.03))
        sim = simulator(scene, "hard", speed)
        step = sim.step(x)
        assert not step.status.any()
        moved = [x + np.pad(s * 1e-6 * step.state[:, scene.nv :], ((0, 0), (0, scene.nv))) for s in (1, -1)]
        rises = (sim.step(moved[0]).gap - sim.step(moved[1]).gap) / 2e-6  # J v'
        h = scene.step_size
        w = rises + np.maximum(step.gap / h, -speed)
        size = 1.0 + np.abs(step.gap / h)
        assert (w >= -1e-6 * size).all() and (step.impulse >= 0.0).all()
        pressed = step.impulse > 1e-9
        assert (np.abs(w) <= 1e-6 * size)[pressed].all()
        limited = pressed & (step.gap < -speed * h)
        tried += limited.sum()
    assert tried > 50


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@ALL
def test_a_wheel_jammed_in_a_corner_stays(law, dtype):
    """From mu = 1 on no velocity takes it out, and 1e-12 m of overlap end the world without the option."""
    scene = disc(FLOOR, WALL, friction=1.2)
    deep = corner(np.array([1e-5, 1e-4, 1e-3]) if dtype == "float32" else np.logspace(-12, -3, 10))
    options = LAWS[law]
    sims = (slcp.Simulator(scene, replace(options, depenetration_speed=s), device="cpu", dtype=dtype,
                           strategy="generic") for s in (None, 1.0))  # fmt: skip
    strict, sim = sims
    assert (strict.step(deep).status != slcp.Status.SOLVED).all()
    step = sim.step(deep)
    assert not step.status.any()
    slow = 0.02 * scene.sigma if law == "smoothed" else 1e-9  # by 1e-4 sigma, over mu - 1
    assert np.abs(step.state[:, 3:]).max() < (slow if dtype == "float64" else max(slow, 1e-6))
    np.testing.assert_allclose(step.gap, -np.tile((RADIUS - deep[:, 1:2]) * 1.0, 4), atol=2e-8)
    run = sim.rollout(deep + np.array([0.0, 0.0, 0.0, 2.0, -1.0, 0.0]), steps=50)  # driven further in
    assert not run.status.any()
    moved = np.abs(run.states[:, -1] - run.states[:, 1])[:, :2].max()
    assert moved < (1e-5 if dtype == "float32" else max(1e-9, 25.0 * slow))  # a half second of sigma


def test_a_wheel_is_out_again_where_it_may_leave():
    """Below mu = 1 it is pushed out of the same corner, by the speed, and stands on the floor."""
    sim = simulator(disc(FLOOR, WALL, friction=0.5), "coulomb", 0.5)
    run = sim.rollout(corner(np.array([0.02])), steps=20)
    assert not run.status.any()
    np.testing.assert_allclose(run.states[0, 1, 3:5], [-0.5, 0.5], atol=1e-9)
    assert np.abs(run.states[0, :, 3:5]).max() < 0.5 + 1e-9
    np.testing.assert_allclose(run.states[0, -1, [1, 4]], [RADIUS, 0.0], atol=1e-9)
    assert run.states[0, -1, 0] <= -RADIUS


@ALL
def test_what_has_no_room_slides_along_it(law):
    """Between two walls too close for it a disc falls as on a slope, and moves neither in nor out."""
    scene, axis = channel(2e-3)
    x = np.zeros((1, 6))
    assert simulator(scene, law).step(x).status[0] != slcp.Status.SOLVED
    for speed in (0.0, 10.0):
        run = simulator(scene, law, speed).rollout(x, steps=30, record="gap")
        assert not run.status.any()
        way = np.array([-axis[1], axis[0]])
        speeds = run.states[0, 1:, 3:5]
        np.testing.assert_allclose(speeds @ axis, 0.0, atol=2e-7 if law == "smoothed" else 1e-9)
        np.testing.assert_allclose(speeds @ way, -9.81 * way[1] * 0.01 * np.arange(1, 31), atol=1e-9)
        np.testing.assert_allclose(run.gap, -2e-3, atol=1e-7 if law == "smoothed" else 1e-9)


def test_bounces_and_overlaps_go_together():
    """A ball that is met in overlap bounces; where it has no room for that it stays."""
    scene = disc(FLOOR, gravity=(0.0, 0.0))
    scene = replace(scene, contacts=(replace(scene.contacts[0], restitution=0.5),))
    x = np.array([[0.0, RADIUS - 0.02, 0.0, 0.0, -3.0, 0.0]])
    np.testing.assert_allclose(simulator(scene, "hard", 0.3).step(x).state[:, 4], 1.5, atol=1e-12)
    shut, axis = channel(2e-3)
    shut = replace(shut, contacts=tuple(replace(c, restitution=0.5) for c in shut.contacts))
    x = np.concatenate([np.zeros(3), 2.0 * axis, [0.0]])[None]
    step = simulator(shut, "hard", 0.3).step(x)
    assert not step.status.any()
    np.testing.assert_allclose(step.state[:, 3:5] @ axis, 0.0, atol=1e-12)


def test_a_limit_that_is_passed_is_left_by_the_speed():
    scene = Scene(
        "joint", (Body("arm", 1.0, 0.1, lower=-0.5, upper=0.5),), gravity=(0.0, 0.0), step_size=0.01
    )
    x = np.array([[0.7, 0.0], [-0.6, 1.0], [-0.6, -1.0], [0.6, 0.0], [0.501, 0.0]])
    step = simulator(scene, "hard", 4.0).step(x)
    np.testing.assert_allclose(step.state[:, 1], [-4.0, 4.0, 4.0, -4.0, -0.1], atol=1e-12)
    np.testing.assert_allclose(step.gap[:, 1], 0.5 - x[:, 0], atol=1e-15)


@ALL
def test_derivatives_where_the_speed_limits(law):
    """A and B, adjoints and every parameter's gradient against differences, of overlaps of both kinds."""
    scene = crane()
    sim = simulator(scene, law, 0.3)
    x, u, force = states(scene, 40)
    step = sim.step(x)
    assert not step.status.any()
    limited = (step.gap < -0.3 * scene.step_size).any(1)
    assert 0.1 < limited.mean() < 0.9
    assert np.abs(step.state - simulator(scene, law).step(x).state)[limited].max() > 0.1
    check_jacobians(sim, x, u)
    inside = sim.params.replace(damping=np.maximum(sim.params["damping"], 0.05))
    if law != "coulomb":
        found = errors(sim, x, u, inside, force, lambda run, _: (run.impulse[:, 0] > 0.0).astype(int)
                       if law == "hard" else smooth(run, _))  # fmt: skip
        check({key: error for key, error in found.items() if law != "hard" or key[0] != "sigma"})


@ALL
def test_derivatives_where_overlaps_stay(law):
    """Along the walls as of a free disc; across them nothing changes what stays."""
    scene, axis = channel(2e-3)
    sim = simulator(scene, law, 1.0)
    x = np.array([[0.0, 0.0, 0.3, *(0.4 * np.array([-axis[1], axis[0]])), 0.5]])
    lin = sim.linearize(x)
    assert not lin.status.any()
    across = np.outer(axis, axis)
    expected = np.eye(6)
    expected[3:5, 3:5] -= across
    expected[:3, 3:] = 0.01 * expected[3:, 3:]
    np.testing.assert_allclose(lin.A[0], expected, atol=1e-8)
    weight = np.random.default_rng(0).standard_normal((1, 2, 6))
    weight[:, 0] = 0.0
    back = slcp.vjp(sim, x, np.zeros((1, 1, 0)), weight, parameters=("radius", "shape_offset"))
    np.testing.assert_allclose(back.x0[0], expected.T @ weight[0, 1], atol=1e-8)
    assert np.abs(back.parameters["radius"]).max() < 1e-8
    assert np.abs(back.parameters["shape_offset"][:, 1:]).max() < 1e-8


def test_second_derivatives_know_of_it():
    """The curvature of a step whose overlap leaves by the speed, against differences of A."""
    scene = crane()
    sim = simulator(scene, "smoothed", 0.3)
    x, u, _ = states(scene, 20)
    deep = (sim.step(x).gap < -0.4 * scene.step_size).any(1)
    x, u = x[deep], u[deep]
    assert len(x) > 3
    got = sim.linearize(x, u, second=True).second
    exact = differences(lambda x, u: sim.linearize(x, u).A, x, u)
    miss = np.abs(got[:, :, : sim.nx] - exact[:, scene.nv :])
    error = miss.max(axis=(1, 2, 3)) / np.abs(exact).max(axis=(1, 2, 3))
    assert error.max() < 1e-5, error


def test_what_is_not_offered_is_said():
    scene = disc(FLOOR)
    options = slcp.Options("hard", depenetration_speed=0.5)
    assert slcp.Simulator(scene, options, device="cpu").strategy == "generic"
    with pytest.raises(slcp.StrategyError, match="depenetration_speed 0.5 is offered by the generic kernels"):
        slcp.Simulator(scene, options, device="cpu", strategy="specialised")
    with pytest.raises(slcp.StrategyError, match="alone; these do not offer gap 'end'"):
        slcp.Simulator(scene, replace(options, gap="end"), device="cpu")
    for wrong in (-1.0, np.nan, np.inf, "1", True, [1.0]):
        with pytest.raises(slcp.OptionError, match="depenetration_speed is .*nonnegative and finite number"):
            slcp.Options(depenetration_speed=wrong)


@ALL
def test_what_neither_touches_nor_hangs_together_leaves_beside_what_stays(law):
    """However fast something far away is, by which all that is near is looked at together."""
    walls = [("left", 0.0, (-0.098, 0.0)), ("right", np.pi, (0.098, 0.0))]
    scene = disc(*walls, gravity=(0.0, 0.0))
    shapes = (
        Shape("other", "other", "disc", RADIUS),
        Shape("far", "far", "disc", RADIUS),
        Shape("post", None, "disc", RADIUS, offset=(0.8, 0.0)),
        Shape("floor", None, "halfplane", angle=np.pi / 2, offset=(0.0, -20.11)),
    )
    pairs = (("disc", "other"), ("other", "post"), ("far", "floor"), ("far", "disc"))
    bodies = tuple(Body(name, 1.0, 0.005, joint="free") for name in ("other", "far"))
    scene = replace(scene, bodies=scene.bodies + bodies, shapes=scene.shapes + shapes,
                    contacts=scene.contacts + tuple(Contact(*pair) for pair in pairs))  # fmt: skip
    x = np.zeros((4, 18))
    x[:, 3], x[:, 7] = 0.8 - 0.197, -20.0  # overlaps the post by 3 mm
    x[:, 16] = [0.0, -2.0, -20.0, -200.0]
    step = simulator(scene, law, 0.2).step(x)
    assert not step.status.any()
    np.testing.assert_allclose(step.state[:, 12], -0.2, atol=3e-3 if law == "smoothed" else 1e-9)
    np.testing.assert_allclose(step.state[:, 9], 0.0, atol=1e-6)
    np.testing.assert_allclose(step.gap[:, :2], -2e-3, atol=1e-12)


@ALL
def test_what_bounces_does_so_beside_what_stays(law):
    """A ball that falls on a jammed wheel, met in the step."""
    scene = disc(FLOOR, WALL, friction=1.2, gravity=(0.0, 0.0), sigma=1e-6)
    ball = Body("ball", 0.1, 1e-4, joint="free")
    scene = replace(scene, bodies=(*scene.bodies, ball),
                    shapes=(*scene.shapes, Shape("ball", "ball", "disc", 0.05)),
                    contacts=(*scene.contacts, Contact("disc", "ball", restitution=0.5)))  # fmt: skip
    x = np.zeros((1, 12))
    x[0, :2], x[0, 3:5], x[0, 10] = (-0.099, 0.099), (-0.099, 0.099 + 0.15 + 0.005), -2.0
    step = simulator(scene, law, 0.5).step(x)
    assert not step.status.any()
    assert step.state[0, 10] == pytest.approx(1.0, abs=1e-4)
    assert np.abs(step.state[0, 6:9]).max() < 1e-6


def test_steps_know_nothing_of_those_before():
    """Of noise levels least of all: a room is that of the row, whatever was there before."""
    scene, axis = channel(2e-3)
    sim = simulator(scene, "smoothed", 1.0)
    x = np.concatenate([np.zeros(3), 0.5 * axis, [0.0]])[None]
    first = sim.step(x)
    sim.step(x, None, sim.params.replace(sigma=1e4))
    again = sim.step(x)
    np.testing.assert_array_equal(first.state, again.state)
    assert np.abs(first.state[0, 3:5] @ axis) < 2e-4 * scene.sigma


@ALL
def test_limits_that_cross_stay(law):
    arm = Body("arm", 1.0, 0.1, lower=-0.5, upper=0.5)
    sim = simulator(Scene("joint", (arm,), gravity=(0.0, 0.0), step_size=0.01), law, 1.0)
    step = sim.step(np.array([[0.15, 1.0]]), None, sim.params.replace(lower=0.2, upper=0.1))
    assert not step.status.any()
    assert abs(step.state[0, 1]) < 1e-4


def test_a_bounce_as_fast_as_the_speed_is_a_bounce():
    scene = disc(FLOOR, gravity=(0.0, 0.0))
    scene = replace(scene, contacts=(replace(scene.contacts[0], restitution=0.5),))
    sim = simulator(scene, "hard", 1.0)
    x, weight = np.array([[0.0, RADIUS - 0.02, 0.0, 0.0, -2.0, 0.0]]), np.zeros((1, 2, 6))
    weight[0, 1, 4] = 1.0
    found = slcp.vjp(sim, x, np.zeros((1, 1, 0)), weight, parameters=("restitution",))
    assert found.x0[0, 4] == pytest.approx(-0.5)
    assert found.parameters["restitution"][0, 0] == pytest.approx(2.0)


def test_what_a_box_has_no_room_for_is_solved_where_it_may_leave_too():
    """Four discs of too large a friction: no world ends that does not where nothing is pushed."""
    rng = np.random.default_rng(0)
    sides = [("floor", np.pi / 2, (0.0, 0.0)), ("left", 0.0, (0.0, 0.0)), ("right", np.pi, (0.35, 0.0)),
             ("lid", -np.pi / 2, (0.0, 0.35))]  # fmt: skip
    shapes = [Shape(f"d{i}", f"d{i}", "disc", RADIUS) for i in range(4)]
    shapes += [Shape(name, None, "halfplane", offset=offset, angle=angle) for name, angle, offset in sides]
    bodies = tuple(Body(f"d{i}", 1.0, 0.005, joint="free") for i in range(4))
    scene = Scene("box", bodies, tuple(shapes), "auto", friction=1.2, gravity=(0.0, 0.0), step_size=0.01)
    x = np.zeros((60, 24))
    for i, place in enumerate(((0.1, 0.1), (0.25, 0.1), (0.1, 0.25), (0.25, 0.25))):
        x[:, 3 * i : 3 * i + 2] = place + 0.01 * rng.standard_normal((60, 2))
    x[:, 12:] = rng.standard_normal((60, 12))
    runs = [simulator(scene, "hard", speed).rollout(x, steps=40) for speed in (0.0, 0.5)]
    assert max(int(run.status.astype(bool).sum()) for run in runs) <= 1
