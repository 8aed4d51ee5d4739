"""Loops of bodies that pins close: against mechanisms whose motion is known otherwise."""

import dataclasses
import math

import numpy as np
import pytest
from oracle import Oracle

import slcp_warp as slcp

LAWS = {
    "smoothed": slcp.Options(),
    "hard": slcp.Options("hard"),
    "coulomb": slcp.Options("hard", friction="coulomb"),
}
RIGID = 100.0


def rod(name, length, mass, parent=None, anchor=(0.0, 0.0), **more):
    return slcp.Body(
        name, mass, mass * length**2 / 12.0, parent, anchor=anchor, com=(length / 2.0, 0.0), **more
    )


def stiff(mass, h, rigid=RIGID):
    """Stiffness and damping of a pin, by the rule of its docstring."""
    stiffness = rigid * mass / h**2
    return stiffness, 2.0 * stiffness * h


CRANK, COUPLER, ROCKER, GROUND = 0.2, 0.35, 0.3, 0.4  # lengths of a linkage [m]


def four_bar(h=1e-3, lengths=(CRANK, COUPLER, ROCKER, GROUND), rigid=RIGID, arm=0.1, **more):
    crank, coupler, rocker, ground = lengths
    bodies = (
        rod("crank", crank, 0.3),
        rod("coupler", coupler, 0.5, "crank", (crank, 0.0)),
        rod("rocker", rocker, 0.4, None, (ground, 0.0)),
    )
    closing = slcp.pin("coupler", "rocker", (coupler, 0.0), (rocker, 0.0), *stiff(0.1, h, rigid), arm)
    return slcp.Scene("four_bar", bodies, springs=closing, step_size=h, **more)


def direction(angle):
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def gap(q, lengths=(CRANK, COUPLER, ROCKER, GROUND)):
    """From the rocker's end to the coupler's, (..., 2)."""
    crank, coupler, rocker, ground = lengths
    reach = crank * direction(q[..., 0]) + coupler * direction(q[..., 0] + q[..., 1])
    return reach - [ground, 0.0] - rocker * direction(q[..., 2])


def closed(angle):
    """Coordinates (3,) of the closed linkage at a crank's angle, the rocker's end above."""
    elbow = CRANK * direction(angle) - [GROUND, 0.0]
    far = np.hypot(*elbow)
    inner = math.acos((far**2 + ROCKER**2 - COUPLER**2) / (2.0 * far * ROCKER))
    rocker = math.atan2(elbow[1], elbow[0]) - inner
    tip = ROCKER * direction(rocker) - elbow
    return np.array([angle, math.atan2(tip[1], tip[0]) - angle, rocker])


def slopes(q, v):
    """d gap/dq (2, 3), and what d^2 gap/dt^2 is without accelerations (2,)."""
    angles, lengths = np.array([q[0], q[0] + q[1], q[2]]), np.array([CRANK, COUPLER, -ROCKER])
    rates = np.array([v[0], v[0] + v[1], v[2]])
    each = lengths * direction(angles + np.pi / 2).T
    jacobian = np.stack([each[:, 0] + each[:, 1], each[:, 1], each[:, 2]], axis=-1)
    return jacobian, -(lengths * rates**2) @ direction(angles)


def true_motion(tree, q, v, time, step=2e-4):
    """The tree with its loop closed by Lagrange's multipliers, by Runge-Kutta."""

    def slope(z):
        q, v = z[:3], z[3:]
        jacobian, rest = slopes(q, v)
        saddle = np.block([[tree.mass_matrix(q), jacobian.T], [jacobian, np.zeros((2, 2))]])
        return np.concatenate([v, np.linalg.solve(saddle, [*tree.force(q, v), *(-rest)])[:3]])

    z = np.concatenate([q, v])
    for _ in range(round(time / step)):
        k1 = slope(z)
        k2 = slope(z + step / 2 * k1)
        k3 = slope(z + step / 2 * k2)
        z = z + step / 6 * (k1 + 2 * k2 + 2 * k3 + slope(z + step * k3))
    assert np.abs(gap(z[:3])).max() < 1e-9
    return z


@pytest.mark.parametrize("arm", [1e-3, 0.05, 1.0, 30.0])
def test_nothing_is_pulled_where_the_points_meet(arm):
    """The springs' rest length makes up for the rounding of (M26); off it they pull back by k, any way."""
    bodies = (slcp.Body("a", 1.0, 1.0, joint="free"), slcp.Body("b", 1.0, 1.0, joint="free"))
    springs = slcp.pin("a", "b", (0.3, 0.1), (-0.2, 0.4), 1000.0, 5.0, arm)
    oracle = Oracle(slcp.Scene("two", bodies, springs=springs, gravity=(0.0, 0.0)))
    a = np.array([0.2, -0.1, 0.7])
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    place = a[:2] + turn @ [0.3, 0.1]
    other = np.array([[np.cos(-1.1), -np.sin(-1.1)], [np.sin(-1.1), np.cos(-1.1)]]) @ [-0.2, 0.4]
    still = np.zeros(6)
    assert np.abs(oracle.force(np.array([*a, *(place - other), -1.1]), still)).max() < 1e-10
    for x in (turn[:, 0], turn[:, 1], turn @ [0.6, 0.8]):
        off = 1e-6 * arm
        push = oracle.force(np.array([*a, *(place - other + off * x), -1.1]), still)
        assert push[3:5] == pytest.approx(-1000.0 * off * x, rel=2e-4, abs=1e-5 * off * 1000.0)
        moving = np.array([0.0, 0.0, 0.0, *x, 0.0])
        drag = oracle.force(np.array([*a, *(place - other), -1.1]), moving)
        assert drag[3:5] == pytest.approx(-5.0 * x, abs=2e-3)


def moving(angle=1.0, rate=2.0):
    """A state of the closed linkage (6,), its crank at an angle and a rate."""
    q = closed(angle)
    jacobian, _ = slopes(q, np.zeros(3))
    return np.array([*q, rate, *np.linalg.solve(jacobian[:, 1:], -jacobian[:, 0] * rate)])


def test_four_bar_linkage_moves_as_one():
    """Half a second, to the first order in h: the error halves with h. What turns in a step parts the points,
    to the second order.
    """
    x = moving()
    there = true_motion(Oracle(dataclasses.replace(four_bar(), springs=())), x[:3], x[3:], 0.5)
    errors, gaps = [], []
    for h in (1e-3, 5e-4):
        sim = slcp.Simulator(four_bar(h), slcp.Options("hard"), dtype="float64", device="cpu")
        states = np.asarray(sim.rollout(x, steps=round(0.5 / h)).states).reshape(-1, 6)
        errors.append(np.abs(states[-1] - there).max() / np.abs(states).max())
        gaps.append(np.abs(gap(states[:, :3])).max())
        turned = np.abs(states[:, 3:]).max() * h
        assert gaps[-1] < (CRANK + COUPLER + ROCKER) * turned**2
    assert errors[0] < 0.01 and 0.4 < errors[1] / errors[0] < 0.6
    assert 0.2 < gaps[1] / gaps[0] < 0.3


def parallelogram(h, length=0.3, base=0.4):
    """Two cranks that hang from the world, and a bar between them that stays level, pinned to the world's."""
    down = -math.pi / 2
    bodies = (
        rod("left", length, 0.2, angle=down),
        rod("bar", base, 0.5, "left", (length, 0.0), angle=-down),
        rod("right", length, 0.2, "bar", (base, 0.0), angle=math.pi / 2),
    )
    closing = slcp.pin(None, "right", (base, 0.0), (length, 0.0), *stiff(0.05, h), arm=0.3)
    return slcp.Scene("parallelogram", bodies, springs=closing, step_size=h)


def test_parallelogram_is_a_pendulum():
    """Its period at 1 rad by the arithmetic-geometric mean, with the inertia of what shifts and turns."""
    length, cranks, bar = 0.3, 0.4, 0.5
    inertia = cranks * length**2 / 3.0 + bar * length**2
    torque = 9.81 * length * (cranks / 2.0 + bar)
    a, g = 1.0, math.cos(0.5)
    for _ in range(6):
        a, g = (a + g) / 2.0, math.sqrt(a * g)
    period = 2.0 * math.pi / math.sqrt(torque / inertia) / a
    errors = []
    for h in (2e-3, 1e-3):
        sim = slcp.Simulator(parallelogram(h), slcp.Options("hard"), dtype="float64", device="cpu")
        run = sim.rollout([1.0, -1.0, 1.0, 0.0, 0.0, 0.0], steps=round(1.2 * period / h))
        angle = np.asarray(run.states).reshape(-1, 6)[:, 0]
        rises = np.flatnonzero((angle[:-1] < 0.0) & (angle[1:] >= 0.0))[0]
        upward = (rises + angle[rises] / (angle[rises] - angle[rises + 1])) * h
        errors.append(abs(upward - 0.75 * period))  # from rest at 1 rad: up through zero after 3/4
    assert errors[0] < 0.01 * period and errors[1] < 0.6 * errors[0]


@pytest.mark.parametrize("law", LAWS)
def test_own_kernels_and_generic_ones_agree(law):
    """A linkage that hits the ground, in both precisions: solved, closed, and one motion."""
    ground = slcp.Shape("ground", None, "halfplane", offset=(0.0, 0.16), angle=math.pi / 2)
    tip = slcp.Shape("tip", "coupler", "disc", 0.02, offset=(COUPLER + 0.1, 0.0))
    scene = four_bar(2e-3, shapes=(ground, tip), contacts=(slcp.Contact("ground", "tip", 0.5),))
    x = np.stack([moving(angle, -1.0) for angle in np.linspace(0.8, 1.6, 16)])
    ends = {}
    for precision in ("float32", "float64"):
        for strategy in ("specialised", "generic"):
            sim = slcp.Simulator(scene, LAWS[law], dtype=precision, device="cpu", strategy=strategy)
            run = sim.rollout(x, steps=200, record="gap")
            assert np.all(np.asarray(run.status) == slcp.Status.SOLVED)
            states = np.asarray(run.states, float)
            assert np.abs(gap(states[..., :3])).max() < 3e-3
            assert law == "smoothed" or np.asarray(run.gap).min() < 1e-4
            ends[precision, strategy] = states[:, 60]
    truth = ends["float64", "generic"]
    assert np.abs(ends["float64", "specialised"] - truth).max() < 1e-7
    for strategy in ("specialised", "generic"):
        assert np.median(np.abs(ends["float32", strategy] - truth).max(axis=1)) < 1e-3


def test_what_a_load_parts_is_force_over_stiffness(dtype):
    """A weight that hangs on a pin, at rest: it sags by m g/k, along the body that holds it or across."""
    for angle in (0.0, 0.7):
        base = slcp.Body("base", 1.0, 1.0, angle=angle, stiffness=1e9, damping=1e3)
        weight = slcp.Body("weight", 0.5, 0.01, joint="free")
        springs = slcp.pin("base", "weight", (0.3, 0.1), (0.0, 0.2), 1e4, 100.0, arm=0.2)
        c, s = math.cos(angle), math.sin(angle)
        held = np.array([0.3 * c - 0.1 * s, 0.3 * s + 0.1 * c])
        scene = slcp.Scene("hung", (base, weight), springs=springs, step_size=1e-3)
        sim = slcp.Simulator(scene, slcp.Options("hard"), dtype=dtype.__name__, device="cpu")
        run = sim.rollout([0.0, *(held - [0.0, 0.2]), 0.0, 0.0, 0.0, 0.0, 0.0], steps=2000)
        end = np.asarray(run.states, float).reshape(-1, 8)[-1]
        sag = end[1:3] + [0.0, 0.2] - held
        assert np.abs(end[4:]).max() < 1e-3
        assert sag == pytest.approx([0.0, -0.5 * 9.81 / 1e4], abs=3e-6)


def gripper(h=2e-3):
    """Two fingers, each a parallelogram that a palm carries, which close on a box and lift it."""
    palm = slcp.Body("palm", 0.5, 1e-3, joint="prismatic", axis=(0.0, 1.0), damping=5.0)
    bodies, shapes, springs, actuators = [palm], [], [], [slcp.Actuator("palm")]
    for name, side in (("left", -1.0), ("right", 1.0)):
        crank, pad, follower = (f"{name}_{part}" for part in ("crank", "pad", "follower"))
        bodies += [
            rod(crank, 0.1, 0.05, "palm", (0.06 * side, 0.5), angle=-math.pi / 2),
            slcp.Body(
                pad, 0.05, 2e-5, crank, anchor=(0.1, 0.0), angle=math.pi / 2, com=(0.015 * side, -0.02)
            ),
            rod(follower, 0.1, 0.05, pad, (0.03 * side, 0.0), angle=math.pi / 2),
        ]
        shapes.append(slcp.Shape(pad, pad, "capsule", (0.008, 0.02), (0.0, -0.03), math.pi / 2))
        top = (0.09 * side, 0.5)
        springs += slcp.pin("palm", follower, top, (0.1, 0.0), *stiff(0.01, h), arm=0.1)
        actuators.append(slcp.Actuator(crank, gear=-side))
    bodies.append(slcp.Body("box", 0.3, 5e-4, joint="free"))
    shapes.append(slcp.Shape("box", "box", "rectangle", (0.03, 0.05), corner_radius=2e-3))
    shapes.append(slcp.Shape("floor", None, "halfplane", offset=(0.0, 0.31), angle=math.pi / 2))
    pairs = (("floor", "box"), ("left_pad", "box"), ("right_pad", "box"))
    start = np.zeros(2 * 10)
    start[8] = 0.36
    return slcp.Scene(
        "gripper", tuple(bodies), tuple(shapes), tuple(slcp.Contact(*pair, 0.8) for pair in pairs),
        tuple(actuators), springs=tuple(springs), initial_state=tuple(start), step_size=h, sigma=2e-3,
    )  # fmt: skip


@pytest.mark.parametrize("law", LAWS)
def test_parallel_gripper_lifts(law, dtype):
    """Solved in every step, loops closed, pads level while they press, and the box comes along."""
    scene = gripper()
    weight = 9.81 * (0.5 + 6 * 0.05)
    close, lift = [weight, 0.5, 0.5], [weight + 9.81 * 0.3 + 1.0, 0.5, 0.5]
    u = np.array([close] * 100 + [lift] * 200)[None]
    sim = slcp.Simulator(scene, LAWS[law], dtype=dtype.__name__, device="cpu", strategy="generic")
    run = sim.rollout(scene.x0, u)
    assert np.all(np.asarray(run.status) == slcp.Status.SOLVED)
    states, oracle = np.asarray(run.states, float).reshape(-1, 20), Oracle(scene)
    q = states[:, :10]
    for name, side in (("left", -1.0), ("right", 1.0)):
        crank, pad = (scene.state_index(f"{name}_{part}.angle") for part in ("crank", "pad"))
        follower = [body.name for body in scene.bodies].index(f"{name}_follower")
        top = np.stack([0.0 * q[:, 0] + 0.09 * side, 0.5 + q[:, 0]], axis=-1)
        apart = oracle.point(q, follower, np.array([0.1, 0.0])) - top
        assert np.abs(apart).max() < 1e-4
        assert np.abs(q[:, crank] + q[:, pad]).max() < 3e-3 and np.abs(q[-1, crank]) > 0.2
    assert states[-1, 8] - 0.36 > 0.03 and abs(q[-1, 9]) < 0.05


@pytest.mark.parametrize("change, message", [
    ({"body_b": "a"}, "body_a and body_b are 'a'; a pin needs two bodies"),
    ({"body_a": None, "body_b": None}, "body_a and body_b are None; a pin needs two bodies"),
    ({"body_a": 3}, "body_a is 3; a name, or None for the world, is needed"),
    ({"point_a": (0.0,)}, "point_a"),
    ({"point_b": (0.0, math.nan)}, "point_b holds nan; finite numbers are needed"),
    ({"stiffness": 0.0}, "stiffness is 0.0; a positive and finite number is needed"),
    ({"stiffness": "soft"}, "stiffness is 'soft'"),
    ({"damping": -1.0}, "damping is -1.0"),
    ({"arm": 0.0}, "arm is 0.0"),
    ({"arm": math.inf}, "arm is inf"),
])  # fmt: skip
def test_what_cannot_be_a_pin_is_named(change, message):
    given = {"body_a": "a", "body_b": "b", "point_a": (0.0, 0.0), "point_b": (0.1, 0.0),
             "stiffness": 1.0, "damping": 0.0, "arm": 1.0}  # fmt: skip
    assert len(slcp.pin(**given)) == 2
    with pytest.raises(slcp.SceneError, match=message):
        slcp.pin(**{**given, **change})
