"""The leapfrog: half of its Coriolis forces are those at the velocities that Euler's step ends at."""

from dataclasses import replace

import numpy as np
import pytest
from oracle import Oracle
from random_scenes import near_contact, random_tree

import slcp_warp as slcp
from slcp_warp import Actuator, Body, Contact, Scene, Shape, scenes

LEAP = slcp.Options("hard", integrator="leapfrog")


def flyer(**changes):
    """Three links in the air, whose joints are driven."""
    bodies = (
        Body("torso", 12.0, 0.4, joint="free", com=(0.0, 0.1)),
        Body("thigh", 2.5, 0.03, parent="torso", com=(0.0, -0.2), armature=0.02),
        Body("shin", 1.5, 0.02, parent="thigh", anchor=(0.0, -0.4), com=(0.0, -0.2), armature=0.02),
    )
    of = {"name": "flyer", "bodies": bodies, "actuators": (Actuator("thigh"), Actuator("shin"))}
    return Scene(**(of | changes))


def rolled(scene, h, x0, us, residual="hard", **options):
    sim = slcp.Simulator(
        replace(scene, step_size=h), slcp.Options(residual, **options), dtype="float64", device="cpu",
        strategy="generic",
    )  # fmt: skip
    run = sim.rollout(x0, us)
    assert not run.status
    return run


def coriolis(oracle, q, v):
    """C(q, v) v of Lagrange's equations, dM/dt v - d(v' M v/2)/dq, by differences of M that are exact to the
    fifth order.
    """

    def mass(at):
        return oracle.mass_matrix(at[None])[0]

    def along(way):
        shares = {1: 0.75, 2: -0.15, 3: 1.0 / 60.0}
        step = 2e-3
        sides = {k: mass(q + k * step * way) - mass(q - k * step * way) for k in shares}
        return sum(weight * sides[k] / step for k, weight in shares.items())

    slopes = np.array([v @ along(unit) @ v for unit in np.eye(len(q))])
    return along(v) @ v - 0.5 * slopes


@pytest.mark.parametrize(
    "joints",
    [
        ("revolute", "prismatic"),
        ("free", "revolute", "prismatic"),
        ("revolute",) * 4,
        ("prismatic", "free", "revolute", "revolute", "prismatic"),
    ],
)
def test_a_step_of_random_trees_is_its_equation(joints):
    """v' = p - h/2 M^-1 (C(p) p - C(v) v), p where Euler's step leads, with Lagrange's C from M alone."""
    rng = np.random.default_rng(len(joints))
    scene = random_tree(rng, len(joints), joints)
    nv, oracle = scene.nv, Oracle(scene)
    x = rng.standard_normal((5, 2 * nv)) * np.r_[np.ones(nv), 4.0 * np.ones(nv)]
    u = rng.standard_normal((5, len(scene.actuators)))
    found, euler = (
        slcp.Simulator(scene, options, dtype="float64", device="cpu", strategy="generic").step(x, u).state
        for options in (LEAP, slcp.Options("hard"))
    )
    for i in range(5):
        q, v, p = x[i, :nv], x[i, nv:], euler[i, nv:]
        late = coriolis(oracle, q, p) - coriolis(oracle, q, v)
        mass = oracle.mass_matrix(q[None])[0] + scene.step_size * oracle.damping_matrix(q[None])[0]
        expected = p - 0.5 * scene.step_size * np.linalg.solve(mass, late)
        assert np.abs(expected - p).max() > 1e-4
        np.testing.assert_allclose(found[i, nv:], expected, atol=1e-8 * np.abs(p).max())
        np.testing.assert_allclose(found[i, :nv], q + scene.step_size * found[i, nv:], atol=1e-14)


def strokes(t):
    """A fast stroke and a slow return, 2.5 times a second [N m]."""
    part = t % 0.4
    push = 120.0 * (1 if part < 0.05 else -1 if part < 0.1 else -1 / 9 if part < 0.25 else 1 / 9)
    return np.array([push, 0.3 * push])


def test_strokes_in_the_air_do_not_carry():
    """Where the centre of mass is after .8 s of strokes, beside the parabola that it is on."""
    off = {}
    for integrator in ("euler", "leapfrog"):
        for h in (0.01, 0.005, 0.0025):
            us = np.array([strokes(h * n) for n in range(round(0.8 / h))])
            run = rolled(flyer(), h, np.zeros(10), us, integrator=integrator)
            t = run.times[:, None]
            off[integrator, h] = np.abs(run.momentum.place - 0.5 * t * (t + h) * [[0.0, -9.81]]
                                        - run.momentum.place[0]).max()  # fmt: skip
    assert off["euler", 0.01] > 0.04 and off["leapfrog", 0.01] < 0.002
    for h in (0.01, 0.005):
        assert off["euler", h] / off["euler", h / 2] < 2.5
        assert off["leapfrog", h] / off["leapfrog", h / 2] > 3.5


def test_momenta_and_energies_are_of_the_time_of_the_velocities():
    """In flight both momenta, and with nothing that drives it the energy, stay by the square of the step."""
    x0 = flyer().state({"thigh.angle": 0.5, "shin.angle": -1.0, "shin.vangle": 20.0, "thigh.vangle": -5.0})
    lost = []
    for h in (0.01, 0.005, 0.0025):
        run = rolled(flyer(), h, x0, np.zeros((round(0.1 / h), 2)), integrator="leapfrog")
        momentum, total = run.momentum, run.energies.total
        fallen = momentum.linear[-1] - momentum.linear[0] + [0.0, 9.81 * 0.1 * 16.0]
        spun = momentum.angular[-1] - momentum.angular[0]
        lost.append([np.abs(fallen).max(), abs(spun), abs(total[-1] - total[0])])
    fell = np.log2(np.array(lost[:-1]) / np.array(lost[1:]))
    assert (fell > 1.6).all(), (lost, fell)
    apart = slcp.momentum(run.states, run.params)  # at the places of the states
    assert np.abs(apart.linear - momentum.linear).max() > 10.0 * lost[-1][0]
    np.testing.assert_array_equal(apart.place, momentum.place)


@pytest.mark.parametrize("residual", ["hard", "rem-logistic"])
def test_motors_that_press_on_what_holds_make_nothing(residual):
    """A joint's motor at its limit, a finger's on a wall: predicted without them, joints turn at 50 rad/s."""
    bodies = (
        Body("arm", 1.0, 0.02, com=(0.15, 0.0)),
        Body("fore", 0.1, 1e-3, parent="arm", anchor=(0.3, 0.0), com=(0.1, 0.0), upper=0.5),
    )
    limit = Scene("limit", bodies, actuators=(Actuator("fore"),), gravity=(0.0, 0.0), step_size=0.01,
                  initial_state={"fore.angle": 0.5}, sigma=1e-9)  # fmt: skip
    run = rolled(limit, 0.01, limit.x0, np.full((50, 1), 5.0), residual=residual, integrator="leapfrog")
    np.testing.assert_allclose(run.states, np.tile(limit.x0, (51, 1)), atol=1e-7)
    tip = slcp.costs.position(limit, slcp.costs.Point("fore", (0.2, 0.0)), np.array([1.1, -1.7, 0.0, 0.0]))
    shapes = (Shape("wall", None, "halfplane", (0.0, 0.0), offset=(tip[0] + 0.02, 0.0), angle=np.pi),
              Shape("tip", "fore", "disc", 0.02, offset=(0.2, 0.0)))  # fmt: skip
    free = (bodies[0], replace(bodies[1], upper=None))
    wall = replace(limit, bodies=free, shapes=shapes, contacts=(Contact("wall", "tip", 0.5),),
                   actuators=(Actuator("arm"), Actuator("fore")),
                   initial_state={"arm.angle": 1.1, "fore.angle": -1.7})  # fmt: skip
    elbow = np.array([0.3 * np.cos(1.1), 0.3 * np.sin(1.1)])
    push = 100.0 * np.array([-tip[1], -(tip - elbow)[1]])  # J' of 100 N to the right
    run = rolled(wall, 0.01, wall.x0, np.tile(push, (50, 1)), residual=residual, integrator="leapfrog")
    np.testing.assert_allclose(run.states, np.tile(wall.x0, (51, 1)), atol=1e-6)
    late = replace(wall, step_size=0.01)
    sim = slcp.Simulator(late, slcp.Options(residual, integrator="leapfrog"), dtype="float64", device="cpu")
    forces = sim.step(late.x0, push).impulse / 0.01
    np.testing.assert_allclose(forces.sum(), 100.0, rtol=1e-4)


def flown(acceleration, start, duration, steps=4000):
    """(angle, rate) after a duration, by Runge-Kutta."""
    y, h = np.array(start), duration / steps

    def slope(y):
        return np.array([y[1], acceleration(y[0])])

    for _ in range(steps):
        a = slope(y)
        b = slope(y + 0.5 * h * a)
        c = slope(y + 0.5 * h * b)
        y = y + h / 6.0 * (a + 2.0 * b + 2.0 * c + slope(y + h * c))
    return y


def test_places_are_of_second_order_on_what_curves():
    """A ball that rolls down a disc, from velocities half a step before: contact that holds all the while."""
    hill, ball = 1.0, 0.2
    shapes = (Shape("hill", None, "disc", hill), Shape("ball", "ball", "disc", ball))
    body = Body("ball", 1.0, 0.5 * ball**2, joint="free")
    scene = Scene("hill", (body,), shapes, (Contact("hill", "ball", 2.0),))

    def acceleration(angle):
        return 2.0 / 3.0 * 9.81 / (hill + ball) * np.sin(angle)

    def state(angle, rate):
        far = hill + ball
        place = [far * np.sin(angle), far * np.cos(angle), -(angle - 0.1) * far / ball]
        return np.array([*place, far * rate * np.cos(angle), -far * rate * np.sin(angle), -rate * far / ball])

    end, errors = state(*flown(acceleration, (0.1, 0.3), 0.4)), []
    for h in (0.02, 0.01, 0.005):
        before = state(*flown(acceleration, (0.1, 0.3), -0.5 * h))
        run = rolled(scene, h, np.r_[state(0.1, 0.3)[:3], before[3:]], np.zeros((round(0.4 / h), 0)),
                     integrator="leapfrog")  # fmt: skip
        errors.append(np.abs(run.states[-1] - end)[:3].max())
    assert errors[0] < 3e-4
    assert errors[0] / errors[1] > 3.6 and errors[1] / errors[2] > 3.6, errors


def test_of_bodies_with_no_joints_between_them_it_is_eulers():
    scene = scenes.heap(6)
    x = np.tile(scene.x0, (8, 1))
    x[:, scene.nv :] = np.random.default_rng(0).standard_normal((8, scene.nv))
    hard = {"residual": "hard"}
    for law in ({"residual": "rem-logistic"}, hard, hard | {"friction": "coulomb"}):
        ends = [
            slcp.Simulator(
                scene, slcp.Options(**law, integrator=rule), dtype="float64", device="cpu", strategy="generic"
            ).rollout(x, steps=20)
            for rule in ("euler", "leapfrog")
        ]
        assert not ends[0].status.any()
        np.testing.assert_array_equal(ends[0].states, ends[1].states)


@pytest.mark.parametrize("law", [{"residual": "rem-logistic"}, {"residual": "hard", "friction": "coulomb"}])
def test_single_precision_is_the_double_one_rounded(law):
    scene = random_tree(np.random.default_rng(4), 3, contacts=True)
    rng = np.random.default_rng(5)
    x, u = near_contact(scene, rng, 40), rng.standard_normal((40, len(scene.actuators)))
    x[:, scene.nv :] *= 3.0
    one, two = (
        slcp.Simulator(scene, slcp.Options(**law, integrator="leapfrog"), dtype=dtype, device="cpu").step(
            x.astype(dtype), u.astype(dtype)
        )
        for dtype in ("float32", "float64")
    )
    assert not one.status.any() and not two.status.any()
    assert np.abs(two.impulse).max() > 0.1
    np.testing.assert_allclose(one.state, two.state, atol=2e-4 * np.abs(two.state).max())


def test_it_is_of_the_generic_kernels():
    scene = flyer()
    assert slcp.Simulator(scene, LEAP, device="cpu").strategy == "generic"
    with pytest.raises(slcp.StrategyError, match="'leapfrog' is offered by the generic kernels alone"):
        slcp.Simulator(scene, LEAP, device="cpu", strategy="specialised")
    erm = slcp.Options("erm-logistic", integrator="leapfrog")
    with pytest.raises(slcp.StrategyError, match="these do not offer residual 'erm-logistic'"):
        slcp.Simulator(scene, erm, device="cpu")
    with pytest.raises(TypeError, match="staggered is 'yes'; True or False is needed"):
        slcp.energies(np.zeros(10), slcp.Parameters(scene), staggered="yes")
