"""Rings hold in what is in them: bowls, hubs, ropes."""

import dataclasses

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape
from slcp_warp.results.pictures.contacts import contact_points
from slcp_warp.results.pictures.mechanism import Mechanism, outline
from slcp_warp.scripts.watch.pull import catch

LAWS = {
    "smoothed": slcp.Options(),
    "hard": slcp.Options("hard"),
    "coulomb": slcp.Options("hard", friction="coulomb"),
}
G = 9.81


def simulator(scene, law="hard", strategy="generic", dtype="float64"):
    return slcp.Simulator(scene, LAWS[law], device="cpu", strategy=strategy, dtype=dtype)


def bowl(friction=None, radius=0.1, step_size=0.002, sigma=1e-3):
    """A disc in a ring of 1 m."""
    body = Body("ball", 1.0, 0.5 * radius**2, joint="free")
    shapes = (Shape("bowl", None, "ring", 1.0), Shape("ball", "ball", "disc", radius))
    return Scene(
        "bowl", (body,), shapes, (Contact("bowl", "ball", friction),), step_size=step_size, sigma=sigma
    )


def swing(states):
    """The angle of the way from the ring's centre down."""
    return np.arctan2(states[:, 0], -states[:, 1])


def period(angle, step_size):
    """From the first to the last time that it falls through zero, by linear interpolation."""
    at = np.flatnonzero((angle[:-1] > 0.0) & (angle[1:] <= 0.0))
    times = at + angle[at] / (angle[at] - angle[at + 1])
    return (times[-1] - times[0]) * step_size / (len(at) - 1)


@pytest.mark.parametrize("strategy", ["generic", "specialised"])
@pytest.mark.parametrize("law", LAWS)
def test_what_slides_in_a_bowl_is_a_pendulum(law, strategy):
    """Its period is that of one by the arithmetic-geometric mean, and it comes back to where it was."""
    scene, a = bowl(), 0.7
    x0 = np.array([0.9 * np.sin(a), -0.9 * np.cos(a), 0.0, 0.0, 0.0, 0.0])
    traj = simulator(scene, law, strategy).rollout(x0, steps=3000)
    assert not np.any(traj.status)
    one, other = 1.0, np.cos(a / 2.0)
    for _ in range(5):
        one, other = (one + other) / 2.0, np.sqrt(one * other)
    exact = 2.0 * np.pi * np.sqrt(0.9 / G) / one
    assert period(swing(traj.states), 0.002) == pytest.approx(exact, rel=2e-3)
    away = np.hypot(*traj.states[:, :2].T)
    assert 0.899 < away.min() and away.max() < 0.9003
    assert -0.7001 < swing(traj.states).min() < -0.69


def test_what_rolls_in_a_bowl_takes_longer():
    """A disc has half as much inertia again: sqrt(3/2) of the period, small swings; it rolls, with -8 times
    the rate of its way round.
    """
    a = 0.05
    x0 = np.array([0.9 * np.sin(a), -0.9 * np.cos(a), 0.0, 0.0, 0.0, 0.0])
    traj = simulator(bowl(friction=0.5), "coulomb").rollout(x0, steps=4000)
    assert not np.any(traj.status)
    assert period(swing(traj.states), 0.002) == pytest.approx(2.0 * np.pi * np.sqrt(1.5 * 0.9 / G), rel=2e-3)
    moved = swing(traj.states) - a
    np.testing.assert_allclose(traj.states[:, 2], -9.0 * moved, atol=2e-3)


def test_a_box_and_a_rod_lie_in_it_by_their_ends():
    """At rest on two corners, and on both ends: chords of the ring."""
    shapes = (
        Shape("bowl", None, "ring", 1.0),
        Shape("box", "box", "rectangle", (0.3, 0.1)),
        Shape("rod", "rod", "capsule", (0.05, 0.4)),
    )
    bodies = (Body("box", 1.0, 0.03, joint="free"), Body("rod", 0.5, 0.02, joint="free"))
    contacts = (Contact("bowl", "box", 0.3), Contact("bowl", "rod", 0.3))
    scene = Scene("bowl", bodies, shapes, contacts, step_size=0.01, sigma=1e-3)
    height = np.sqrt(0.95**2 - 0.4**2)
    x0 = scene.state({"box.y": -np.sqrt(1.0 - 0.3**2) + 0.11, "rod.y": -height + 0.01})
    end = simulator(scene, "coulomb").rollout(x0, steps=300).states[-1]
    np.testing.assert_allclose(end[6:], 0.0, atol=1e-9)
    assert end[1] == pytest.approx(0.1 - np.sqrt(1.0 - 0.3**2), abs=2e-4)
    assert end[4] == pytest.approx(-height, abs=2e-4)


@pytest.mark.parametrize("law", LAWS)
def test_a_wheel_with_a_rim_carries_what_is_in_it(law):
    """A ring on a body: a hoop is driven, and what lies in it stays at its lowest point, on a moving ring."""
    bodies = (Body("cart", 2.0, 0.1, joint="prismatic"), Body("ball", 0.5, 1e-3, joint="free"))
    shapes = (Shape("hoop", "cart", "ring", 0.5), Shape("ball", "ball", "disc", 0.1))
    scene = Scene("hoop", bodies, shapes, (Contact("hoop", "ball", None),), step_size=0.005, sigma=1e-3,
                  actuators=(slcp.Actuator("cart"),))  # fmt: skip
    acceleration = 3.0  # the ball hangs behind by the angle of a / g
    angle = np.arctan2(acceleration, G)
    x0 = scene.state({"ball.x": -0.4 * np.sin(angle), "ball.y": -0.4 * np.cos(angle)})
    traj = simulator(scene, law).rollout(x0, np.full((200, 1), 2.5 * acceleration))
    assert not np.any(traj.status)
    end = traj.states[-1]
    assert end[scene.state_index("cart.vshift")] == pytest.approx(acceleration, rel=1e-2)
    np.testing.assert_allclose(end[1:3] - [end[0], 0.0], x0[1:3], atol=5e-3)


def hung(length=0.5, **changes):
    """A bob on a rope from the world."""
    shapes, contact = slcp.rope("rope", None, "bob", length, point_a=(0.0, 1.0))
    body = Body("bob", 2.0, 0.01, joint="free")
    return Scene("hung", (body,), shapes, (contact,), **{"step_size": 0.002, "sigma": 1e-3} | changes)


@pytest.mark.parametrize("law", LAWS)
def test_a_rope_lets_fall_until_it_is_straight_and_then_holds(law):
    """It neither pushes nor gives back; at rest it pulls with the weight, upwards."""
    scene = hung()
    sim = simulator(scene, law)
    traj = sim.rollout(scene.state({"bob.y": 0.9}), steps=500, record="impulse")
    assert not np.any(traj.status)
    height, speed = traj.states[:, 1], traj.states[:, 4]
    falls = height > 0.51
    t = 0.002 * np.arange(501)
    np.testing.assert_allclose(speed[falls], -G * t[falls], atol=2e-2 if law == "smoothed" else 1e-9)
    assert height.min() > 0.4999 and abs(height[-1] - 0.5) < (1e-3 if law == "smoothed" else 1e-9)
    np.testing.assert_allclose(traj.contact_impulse[-1, 0], [2.0 * G * 0.002, 0.0], atol=1e-9)
    assert (traj.contact_impulse[:, 0, 0] >= 0.0).all()


def test_a_rope_of_two_bodies_keeps_their_momenta():
    """Two discs on one rope, thrown apart without gravity, swing about each other; momentum and its moment
    are kept.
    """
    bodies = (Body("a", 1.0, 0.01, joint="free"), Body("b", 3.0, 0.02, joint="free"))
    shapes, contact = slcp.rope("rope", "a", "b", 0.8, (0.05, 0.0), (0.0, -0.1))
    scene = Scene("two", bodies, shapes, (contact,), gravity=(0.0, 0.0), step_size=0.001)
    x0 = scene.state({"b.x": 0.3, "a.vx": -1.0, "b.vx": 0.5, "b.vy": 1.0})
    traj = simulator(scene).rollout(x0, steps=2000, record="gap")
    q, v = traj.states[:, :6], traj.states[:, 6:]
    np.testing.assert_allclose(1.0 * v[:, :2] + 3.0 * v[:, 3:5], np.tile([0.5, 3.0], (2001, 1)), atol=1e-9)

    def moment(q, v):
        parts = [(1.0, 0.01, 0), (3.0, 0.02, 3)]
        return sum(m * (q[i] * v[i + 1] - q[i + 1] * v[i]) + j * v[i + 2] for m, j, i in parts)

    first, last = moment(q[0], v[0]), moment(q[-1], v[-1])
    assert last == pytest.approx(first, rel=2e-3)
    assert traj.gap.min() > -1e-3 and (np.abs(traj.gap) < 1e-4).any()


def test_what_a_light_mass_between_loaded_ropes_bears():
    """As docs/do/scene.md says: a bead of 10 g swings across as fast as 2/h with 2.04 kg below, h = .01."""
    bodies = (Body("bead", 0.01, 1e-6, joint="free"), Body("load", 1.0, 0.01, joint="free"))
    (upper, one), (lower, two) = (
        slcp.rope(name, *ends, 0.1) for name, ends in (("up", (None, "bead")), ("low", ("bead", "load")))
    )
    scene = Scene("plumb", bodies, (*upper, *lower), (one, two))
    sim = simulator(scene)
    x0 = np.tile(scene.state({"bead.y": -0.1, "load.y": -0.2, "bead.x": 1e-6}), (2, 1))
    traj = sim.rollout(x0, np.zeros((2, 300, 0)), sim.params.replace(**{"load.mass": np.array([2.0, 2.5])}))
    aside = np.abs(traj.states[:, :, 0]).max(axis=1)
    assert aside[0] < 1e-4 and aside[1] > 0.1


@pytest.mark.parametrize("strategy", ["generic", "specialised"])
def test_steps_from_the_centre_are_finite(strategy):
    """There is no direction from a ring's centre, nor derivatives of one; far from the rim none counts."""
    scene = hung()
    sim = simulator(scene, "smoothed", strategy)
    x = scene.state({"bob.y": 1.0, "bob.vx": 0.3})
    step, lin = sim.step(x), sim.linearize(x, second=True)
    assert step.status == 0 and lin.status == 0 and np.isfinite(lin.second).all()
    assert step.gap[0] == pytest.approx(0.5) and step.impulse[0] < 1e-12
    free = np.eye(6)
    free[:3, 3:] = 0.002 * np.eye(3)
    np.testing.assert_allclose(lin.A, free, atol=1e-9)


@pytest.mark.parametrize("strategy", ["generic", "specialised"])
@pytest.mark.parametrize("length", [0.01, 0.02, 0.03])
def test_a_short_rope_does_not_turn_at_its_other_end(strategy, length):
    """Slack by 10 to 30 times what smoothing feels, its force there is 1e-5 N s and less; by the floor of a
    curvature it turned 1e6 rad a metre, and A was off by 4e6.
    """
    scene = hung(step_size=0.01, sigma=0.1, gravity=(0.0, 0.0))
    sim = simulator(scene, "smoothed", strategy)
    params = sim.params.replace(**{"rope.radius": length})
    lin = sim.linearize(scene.state({"bob.y": 1.0}), None, params, second=True)
    free = np.eye(6)
    free[:3, 3:] = 0.01 * np.eye(3)
    assert lin.status == 0
    np.testing.assert_allclose(lin.A, free, atol=2e-2)
    if length > 0.01 or strategy == "specialised":  # generic ones are differences across the centre
        assert np.abs(lin.second).max() < 10.0


def test_a_longer_rope_lets_lower():
    """The derivative of where it hangs by its length."""
    scene = hung()
    sim = simulator(scene)
    x0 = scene.state({"bob.y": 0.5})[None]
    weight = np.zeros((1, 101, 6))
    weight[0, -1, 1] = 1.0
    back = slcp.vjp(sim, x0, np.zeros((1, 100, 0)), weight, parameters=("rope.radius",))
    assert sum(np.ravel(back.parameters["rope.radius"])) == pytest.approx(-1.0, abs=1e-9)


def test_many_in_one_ring_are_found_by_the_broad_phase():
    """Twelve discs fall in a ring on a body that moves: the pairs that count are those of all pairs."""
    rng = np.random.default_rng(2)
    bodies = [Body("drum", 50.0, 5.0, joint="prismatic", stiffness=400.0)]
    shapes = [Shape("drum", "drum", "ring", 1.0)]
    x0 = np.zeros(37)
    for i in range(12):
        bodies.append(Body(f"b{i}", 1.0, 5e-3, joint="free"))
        shapes.append(Shape(f"b{i}", f"b{i}", "disc", 0.1))
        x0[3 * i + 1 : 3 * i + 3] = 0.45 * (i % 3 - 1), 0.3 * (i // 3) - 0.5
    scene = Scene("drum", tuple(bodies), tuple(shapes), "auto", friction=0.4, step_size=0.005, sigma=0.01)
    assert len(scene.pair_names) == 78
    x0 = np.concatenate([x0, np.zeros(37)])
    x0[37:] = 0.5 * rng.standard_normal(37)
    traj = simulator(scene).rollout(x0, steps=300, record="gap")
    assert not np.any(traj.status)
    assert traj.gap.min() > -5e-3
    away = np.hypot(traj.states[:, 1:37:3] - traj.states[:, :1], traj.states[:, 2:37:3])
    assert away.max() < 0.905 and (away[-1] > 0.89).sum() >= 2


def test_files_pictures_and_the_page(tmp_path):
    scene = dataclasses.replace(bowl(0.4), name="cup")
    path = tmp_path / "cup.json"
    slcp.save_scene(scene, path)
    assert slcp.load_scene(path) == scene
    mechanism = Mechanism(scene, scene.default_parameters())
    left, right, bottom, top = mechanism.bounds(scene.x0[None, :3], margin=0.0)
    assert right >= 1.0 and top >= 1.0 and left <= -1.0 and bottom <= -1.0
    size = np.hypot(*outline("ring", mechanism.size(0), 1.0).T)
    assert size.min() == pytest.approx(1.0) and size.max() == pytest.approx(1.06)
    q = np.array([0.3, -0.4, 0.0])
    points, normals = contact_points(mechanism, q, [0])
    np.testing.assert_allclose(normals[0], [-0.6, 0.8], atol=1e-12)
    np.testing.assert_allclose(points[0], q[:2] + [0.06, -0.08], atol=1e-9)
    held = dataclasses.replace(scene, shapes=(Shape("bowl", "ball", "ring", 1.0),), contacts=())
    mechanism = Mechanism(held, held.default_parameters())
    assert catch(mechanism, np.zeros(3), np.array([1.01, 0.0]), 0.2) is not None
    assert catch(mechanism, np.zeros(3), np.array([0.5, 0.2]), 0.2) is None


def egg(**other):
    bodies = (Body("a", 1.0, 0.1, joint="free"), Body("b", 1.0, 0.1, joint="free"))
    ring, shape = Shape("ring", "a", "ring", 1.0), Shape("other", "b", **other)
    return [lambda c=c: Scene("egg", bodies, (ring, shape), c) for c in ((Contact("other", "ring"),), "auto")]


@pytest.mark.parametrize("make, message", [
    (lambda: Shape("r", "a", "ring", 0.0), "radius is 0.0; a ring's must be positive"),
    (lambda: Shape("r", "a", "ring", (1.0, 2.0)), "a ring has one radius"),
    (egg(kind="halfplane")[0], "both are a halfplane and a ring; at least one shape must be round"),
    (egg(kind="ring", radius=2.0)[0], "both are a ring and a ring; at least one shape must be round"),
    (egg(kind="ellipse", radius=(0.2, 0.1))[0], "a ring and an ellipse cannot touch"),
    (egg(kind="ellipse", radius=(0.2, 0.1))[1], "ellipse 'other' cannot touch; a ring touches d"),
    (lambda: slcp.rope("r", None, "a", 0.0), "length is 0.0; a positive"),
    (lambda: slcp.rope("r", None, "a", 1.0, bit=-1), "bit is -1; a whole number"),
])  # fmt: skip
def test_what_cannot_be_is_named(make, message):
    with pytest.raises(slcp.SceneError, match=message):
        make()


def test_walls_and_ropes_where_everything_may_touch():
    """Two walls never meet; a rope's ring finds its own end alone, by its bit."""
    assert egg(kind="ring", radius=2.0)[1]().all_contacts == ()
    bodies = tuple(Body(name, 1.0, 0.01, joint="free") for name in "ab")
    ends, _ = slcp.rope("rope", "a", "b", 1.0, bit=4)
    balls = tuple(Shape(f"ball_{name}", name, "disc", 0.1) for name in "ab")
    scene = Scene("tied", bodies, (*ends, *balls), "auto", friction=0.3)
    assert scene.pair_names == ("rope/rope_end", "ball_a/ball_b")
    assert scene.all_contacts[0].friction == 0.0
    bouncing = dataclasses.replace(scene, restitution=0.8)
    assert [contact.restitution for contact in bouncing.all_contacts] == [None, 0.8]


def test_a_rope_that_finds_nothing_is_named():
    """A joint ties both bodies: under "auto" they do not touch, unless they are told to."""
    bodies = Body("arm", 1.0, 0.1), Body("tip", 0.5, 0.01, parent="arm", joint="prismatic")
    ends, _ = slcp.rope("rope", "arm", "tip", 0.3, bit=4)
    with pytest.raises(slcp.SceneError, match="ring 'rope' holds in nothing: .* touches_parent=True"):
        Scene("slide", bodies, ends, "auto")
    told = bodies[0], dataclasses.replace(bodies[1], touches_parent=True)
    assert Scene("slide", told, ends, "auto").pair_names == ("rope/rope_end",)


def test_what_is_in_a_ring_is_smaller():
    scene = bowl()
    with pytest.raises(slcp.SceneError, match="'ball' has a radius of 1.2, and ring 'bowl' of 1.0"):
        bowl(radius=1.2)
    params = slcp.Parameters(scene)
    for change in ({"ball.radius": 1.0}, {"bowl.radius": np.array([1.0, 0.05])}):
        with pytest.raises(slcp.ParameterError, match="of ring 'bowl' .*; what is in a ring is smaller"):
            params.replace(**change)
    wide = {"ball.radius": np.array([0.2, 0.3]), "bowl.radius": 0.5}
    assert (params.replace(**wide)["bowl.radius"] == 0.5).all()


def test_ropes_are_drawn_as_lines_and_not_taken_for_bodies():
    scene = hung()
    mechanism = Mechanism(scene, scene.default_parameters())
    assert mechanism.ropes == {0: 1}
    q = np.array([[0.1, 0.6, 0.0]])
    np.testing.assert_allclose(mechanism.links(q)[-1], [[[0.0, 1.0], [0.1, 0.6]]])
    left, right, bottom, top = mechanism.bounds(q, margin=0.0)
    assert -0.1 < left and right < 0.2 and bottom > 0.5 and top < 1.1
    ends, contact = slcp.rope("rope", "bob", None, 0.5)
    tether = dataclasses.replace(scene, shapes=ends, contacts=(contact,))
    mechanism = Mechanism(tether, tether.default_parameters())
    assert catch(mechanism, np.zeros(3), np.array([0.5, 0.0]), 0.2) is None
