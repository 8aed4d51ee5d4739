"""Contacts that bounce: Newton's law of impact on what closes, nothing on what rests, and its derivatives."""

from dataclasses import replace

import numpy as np
import pytest
from parameter_checks import check, check_jacobians, errors, smooth, states, trampoline

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape

LAWS = {
    "smoothed": slcp.Options(),
    "hard": slcp.Options("hard"),
    "coulomb": slcp.Options("hard", friction="coulomb"),
}
RADIUS, MASS = 0.1, 2.0
INERTIA = 0.4 * MASS * RADIUS**2


def ball(e, friction=None, step_size=1e-3, gravity=(0.0, -9.81)):
    shapes = (Shape("ground", None, "halfplane", angle=np.pi / 2), Shape("ball", "ball", "disc", RADIUS))
    return Scene(
        "ball", (Body("ball", MASS, INERTIA, joint="free"),), shapes,
        (Contact("ground", "ball", friction, restitution=e),),
        gravity=gravity, step_size=step_size, sigma=1e-3,
    )  # fmt: skip


def simulator(scene, law="hard"):
    return slcp.Simulator(scene, LAWS[law], device="cpu", dtype="float64")


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("e", [1.0, 0.8, 0.3])
def test_a_dropped_ball_rises_to_the_square(law, e):
    traj = simulator(ball(e), law).rollout(np.array([0.0, 1.0 + RADIUS, 0, 0, 0, 0]), steps=2500)
    height, speed = traj.states[:, 1] - RADIUS, traj.states[:, 4]
    assert not traj.status and height.min() > -1e-6
    hits = np.flatnonzero((speed[1:] > 0.0) & (speed[:-1] < -0.05)) + 1  # slower ones may rest
    np.testing.assert_allclose(speed[hits], -e * speed[hits - 1], atol=1e-9 + 2e-3 * (law == "smoothed"))
    tops = [height[a:b].max() for a, b in zip(hits[:-1], hits[1:])][:3]
    assert len(tops) == (2 if e == 1.0 else 3)
    np.testing.assert_allclose(tops, e ** (2.0 * np.arange(1, len(tops) + 1)), rtol=0.03, atol=2e-3)
    assert max(tops) < 1.001
    if e == 0.3:
        np.testing.assert_allclose(traj.states[-1, [1, 4]], [RADIUS, 0.0], atol=2e-3)


@pytest.mark.parametrize("law", LAWS)
def test_what_rests_does_not_bounce(law):
    """A stack stands as without restitution, bit for bit; none at all is no other contact, either."""
    plain = slcp.scenes.stack(3)
    boxes = replace(plain, contacts=tuple(replace(c, restitution=0.9) for c in plain.contacts))
    x0 = plain.x0
    one, other = (simulator(scene, law).rollout(x0, steps=100).states for scene in (plain, boxes))
    np.testing.assert_array_equal(one, other)
    sim = simulator(boxes, law)
    x0 = x0 + np.r_[np.zeros(9), np.random.default_rng(0).standard_normal(9)]
    generic = slcp.Simulator(plain, LAWS[law], device="cpu", dtype="float64", strategy="generic")
    none = sim.rollout(x0, params=sim.params.replace(restitution=0.0), steps=50).states
    np.testing.assert_array_equal(none, generic.rollout(x0, steps=50).states)
    assert np.abs(none - sim.rollout(x0, steps=50).states).max() > 0.1


def test_two_discs_part_as_newton_says():
    """Any masses and directions, no friction: momentum, and the speed at which they part."""
    rng = np.random.default_rng(1)
    bodies = (Body("a", 1.0, 0.01, joint="free"), Body("b", 1.0, 0.02, joint="free"))
    shapes = (Shape("a", "a", "disc", 0.1), Shape("b", "b", "disc", 0.2))
    scene = Scene("two", bodies, shapes, (Contact("a", "b", restitution=0.6),), gravity=(0.0, 0.0))
    sim = simulator(scene)
    n = rng.standard_normal((50, 2))
    n /= np.linalg.norm(n, axis=1)[:, None]
    mass = np.exp(rng.standard_normal((50, 2)))
    e = rng.uniform(0.1, 1.0, 50)
    v = rng.standard_normal((50, 2, 3))
    v[:, 0, :2] += 5.0 * n
    x = np.zeros((50, 12))
    x[:, 3:5] = 0.305 * n
    x[:, 6:9], x[:, 9:] = v[:, 0], v[:, 1]
    step = sim.step(x, None, sim.params.replace(mass=mass, restitution=e[:, None]))
    after = step.state[:, 6:].reshape(50, 2, 3)
    momentum = np.einsum("bi,bij->bj", mass, after[..., :2] - v[..., :2])
    np.testing.assert_allclose(momentum, 0.0, atol=1e-9)
    meets = np.sum(n * (v[:, 1, :2] - v[:, 0, :2]), axis=1)
    parts = np.sum(n * (after[:, 1, :2] - after[:, 0, :2]), axis=1)
    assert (meets < -1.0).all()
    np.testing.assert_allclose(parts, -e * meets, atol=1e-9)
    np.testing.assert_allclose(step.gap[:, 0], 0.005, atol=1e-12)  # of the start, whatever the row holds


def test_a_spinning_ball_with_coulombs_friction():
    """Sticks or slides by the closed form of one impact (Routh): mu (1 + e) |v_n| at most."""
    rng = np.random.default_rng(2)
    sim = simulator(ball(0.7, 0.25, gravity=(0.0, 0.0)), "coulomb")
    x = np.zeros((60, 6))
    x[:, 1] = RADIUS + 5e-4
    x[:, 3:] = rng.standard_normal((60, 3)) * [2.0, 1.0, 20.0]
    x[:, 4] = -1.0 - np.abs(x[:, 4])
    after = sim.step(x).state[:, 3:]
    normal = 1.7 * MASS * -x[:, 4]
    slip = x[:, 3] + RADIUS * x[:, 5]
    sticks = -slip / (1.0 / MASS + RADIUS**2 / INERTIA)
    along = np.clip(sticks, -0.25 * normal, 0.25 * normal)
    assert 0.2 < (along == sticks).mean() < 0.8
    np.testing.assert_allclose(after[:, 1], -0.7 * x[:, 4], atol=1e-9)
    np.testing.assert_allclose(after[:, 0], x[:, 3] + along / MASS, atol=1e-9)
    np.testing.assert_allclose(after[:, 2], x[:, 5] + along * RADIUS / INERTIA, atol=1e-9)


@pytest.mark.parametrize("law", LAWS)
def test_derivatives_through_a_bounce(law):
    scene = trampoline()
    plain = replace(scene, contacts=tuple(replace(c, restitution=None) for c in scene.contacts))
    sim = slcp.Simulator(scene, LAWS[law], device="cpu", dtype="float64")
    x, u, force = states(scene, 40, speed=3.0)
    other = slcp.Simulator(plain, LAWS[law], device="cpu", dtype="float64", strategy="generic")
    bounced = np.abs(sim.step(x).state - other.step(x).state).max(axis=1) > 1e-3
    assert 0.1 < bounced.mean() < 0.9
    check_jacobians(sim, x, u)

    def rows(traj, params):
        return (traj.impulse[:, 0] > 0.0).astype(int)

    if law != "coulomb":
        inside = sim.params.replace(damping=np.maximum(sim.params["damping"], 0.05))
        found = errors(sim, x, u, inside, force, rows if law == "hard" else smooth)
        check({key: error for key, error in found.items() if law != "hard" or key[0] != "sigma"})


@pytest.mark.parametrize("law", LAWS)
def test_gradients_back_through_a_bounce_have_both_levers(law):
    """Of shapes whose touched points have one: two ellipses, a rectangle and a disc."""
    bodies = (Body("a", 1.0, 0.05, joint="free", com=(0.02, 0.0)), Body("b", 0.5, 0.01, joint="free"))
    shapes = (Shape("A", "a", "ellipse", (0.2, 0.1)), Shape("C", "b", "ellipse", (0.15, 0.08), angle=0.3),
              Shape("D", "a", "rectangle", (0.1, 0.15), corner_radius=0.03),
              Shape("B", "b", "disc", 0.1))  # fmt: skip
    contacts = (Contact("A", "C", 0.3, restitution=0.7), Contact("D", "B", 0.3, restitution=0.7))
    scene = Scene("two", bodies, shapes, contacts, gravity=(0.0, 0.0), step_size=0.01, sigma=0.05)
    sim = simulator(scene, law)
    x, u, _ = states(scene, 60, speed=3.0)
    done, lin = sim.step(x), sim.linearize(x)
    good = (done.status == 0) & (lin.status == 0)
    assert (good & (np.abs(done.state - x)[:, 6:].max(axis=1) > 0.5)).sum() > 10
    weight = np.zeros((len(x), 2, sim.nx))
    weight[:, 1] = np.random.default_rng(0).standard_normal((len(x), sim.nx))
    back = slcp.vjp(sim, x, u[:, None], weight).x0
    through = np.einsum("bij,bi->bj", lin.A, weight[:, 1])
    size = np.abs(through).max(axis=1, keepdims=True)
    assert np.abs((back - through) / size)[good].max() < 1e-8


def test_a_coefficient_is_found_by_its_gradient():
    """Of a ball thrown obliquely, by its way to the top after it has bounced; secants of the slope."""
    sim, steps = simulator(ball(0.5, 0.3, step_size=0.005), "coulomb"), 110
    x0, us = np.array([[0.0, 0.6, 0.0, 1.0, 0.0, 0.0]]), np.zeros((1, steps, 0))

    def states(e):
        return sim.rollout(x0, params=sim.params.replace(restitution=e), steps=steps).states

    def slope(e):
        miss = states(e) - states(0.83)
        found = slcp.vjp(sim, x0, us, miss, sim.params.replace(restitution=e), parameters=("restitution",))
        return float(np.sum(found.parameters["restitution"]))

    e = [0.6, 0.7]
    g = [slope(each) for each in e]
    for _ in range(4):
        e.append(e[-1] - g[-1] * (e[-1] - e[-2]) / (g[-1] - g[-2]))
        g.append(slope(e[-1]))
        if abs(e[-1] - e[-2]) < 1e-9:
            break
    assert e[-1] == pytest.approx(0.83, abs=1e-6)


def test_what_is_not_offered_is_said():
    scene = ball(0.5)
    assert slcp.Simulator(scene, device="cpu").strategy == "generic"
    with pytest.raises(slcp.StrategyError, match="restitution is offered by the generic kernels alone"):
        slcp.Simulator(scene, device="cpu", strategy="specialised")
    with pytest.raises(slcp.StrategyError, match="alone; these do not offer integrator 'trapezoidal'"):
        slcp.Simulator(scene, slcp.Options(integrator="trapezoidal"), device="cpu")
    sim = simulator(scene)
    with pytest.raises(slcp.ParameterError, match="restitution is 1.2; at most 1 is needed"):
        sim.params.replace(restitution=1.2)
    with pytest.raises(slcp.SceneError, match="contact 'ground' - 'ball': restitution is -0.1"):
        Contact("ground", "ball", restitution=-0.1)
    with pytest.raises(slcp.SceneError, match="restitution is for contacts='auto'"):
        replace(scene, restitution=0.5)


def test_everything_may_bounce_off_everything(tmp_path):
    """The larger coefficient of two shapes, their own or the scene's; files keep it."""
    shapes = (
        Shape("ground", None, "halfplane", angle=np.pi / 2),
        Shape("a", "a", "disc", 0.1, restitution=0.9),
        Shape("b", "b", "disc", 0.1),
    )
    bodies = (Body("a", 1.0, 0.01, joint="free"), Body("b", 1.0, 0.01, joint="free"))
    scene = Scene("auto", bodies, shapes, "auto", friction=0.3, restitution=0.5)
    assert [c.restitution for c in scene.all_contacts] == [0.9, 0.5, 0.9]
    slcp.save_scene(scene, tmp_path / "auto.json")
    assert slcp.load_scene(tmp_path / "auto.json") == scene
    listed = scene.with_listed_contacts()
    assert listed.all_contacts == scene.all_contacts and listed.structure == scene.structure
    sim = slcp.Simulator(scene, device="cpu")
    own = sim.params.replace(**{"ground/b.restitution": 0.2})
    np.testing.assert_array_equal(own["restitution"], [0.9, 0.2, 0.9])


def test_it_is_drawn_as_other_numbers():
    task = slcp.Task(
        "drop", ball(0.5, step_size=0.01), duration=0.9, start=np.array([[0.0, 0.6, 0, 0, 0, 0.0]]),
        disturbances=slcp.Disturbances(parameters={"restitution": slcp.Uniform(0.2, 0.9)}),
        measures={"top": slcp.measures.largest(slcp.measures.state("ball.vy"))},
    )  # fmt: skip
    report = slcp.sweep(
        task,
        {"none": slcp.policies.Linear(np.zeros((0, 6)))},
        worlds=64,
        cases=LAWS["hard"],
        dtype="float64",
        device="cpu",
    )
    part = report.part("none")
    e, top = part["drawn_ground/ball.restitution"], part["top"]
    np.testing.assert_allclose(top / e, (top / e)[0], rtol=1e-6)
    assert np.ptp(e) > 0.5


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("room", [1e-3, 0.02])
def test_where_there_is_no_room_nothing_bounces(law, room):
    """A disc in a slot that it would cross more than once a step: INFEASIBLE from the first one on."""
    shapes = (
        Shape("left", None, "halfplane", offset=(-RADIUS - room, 0.0)),
        Shape("right", None, "halfplane", offset=(RADIUS + room, 0.0), angle=np.pi),
        Shape("ball", "ball", "disc", RADIUS),
        Shape("far", "far", "disc", RADIUS),
        Shape("ground", None, "halfplane", offset=(0.0, -5.0), angle=np.pi / 2),
    )
    bodies = (Body("ball", MASS, INERTIA, joint="free"), Body("far", MASS, INERTIA, joint="free"))
    walls = tuple(Contact(side, "ball", 0.3, restitution=0.9) for side in ("left", "right"))
    contacts = (*walls, Contact("ground", "far", restitution=0.8))
    scene = Scene("slot", bodies, shapes, contacts, gravity=(0.0, 0.0), step_size=0.01, sigma=1e-3)
    x0 = np.zeros((8, 12))
    x0[:, 4] = -5.0 + RADIUS + 1e-3
    x0[:, 6], x0[:, 7] = np.linspace(-3.0, 3.0, 8), 0.5
    x0[:, 10] = -1.0
    traj = simulator(scene, law).rollout(x0, steps=60, record="gap")
    assert not traj.status.any()
    assert np.nanmin(traj.gap) > -1e-9 - 0.02 * (law == "smoothed")
    assert np.abs(traj.states[:, -1, 6]).max() <= 3.0
    np.testing.assert_allclose(traj.states[:, 1, 10], 0.8, atol=2e-3)  # another island's bounce stays


def test_coefficients_are_drawn_within_their_bounds():
    for given in (0.2, slcp.LogNormal(0.2), slcp.Uniform(0.5, 1.5)):
        with pytest.raises(slcp.ArgumentError, match="restitution takes uniform|at most 1 are needed"):
            slcp.Disturbances(parameters={"restitution": given})
    with pytest.raises(slcp.ArgumentError, match="numbers of at most 1"):
        slcp.Disturbances(parameters={"ground/ball.restitution": slcp.Uniform(0.5, 1.5)})
