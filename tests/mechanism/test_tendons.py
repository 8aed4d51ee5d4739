"""Tendons: as the springs that they stand for where there are such, in random scenes, and in files."""

from dataclasses import replace

import numpy as np
import pytest
from oracle import Oracle
from parameter_checks import check, errors, smooth, states
from random_scenes import random_tree

import slcp_warp as slcp
from slcp_warp import Actuator, Body, SceneError, Spring, Tendon, ddp
from slcp_warp.costs import Term, terms

STRATEGIES = ("specialised", "generic")
RULES = [(True, True), (True, False), (False, True), (False, False)]  # implicit damping, implicit stiffness


def simulator(sc, strategy, device, **options):
    return slcp.Simulator(
        sc, slcp.Options("hard", **options), device=device, dtype="float64", strategy=strategy
    )


def tied(rules, bodies=3, joints=None, seed=0):
    """A random tree with two tendons, the second one pulled by a control."""
    rng = np.random.default_rng(seed)
    sc = random_tree(rng, bodies, joints)
    names = sc.state_names[: sc.nv]
    tendons = (
        Tendon("rope", (names[-1], names[0], names[1]), (0.8, -0.5, 0.4), 40.0, 1.5, 0.2),
        Tendon("belt", (names[1], names[-1]), (1.0, -1.2), 9.0, 0.4, -0.1),
    )
    damping, stiffness = rules
    actuators = (*sc.actuators, Actuator(tendon="belt", gear=1.7))
    return replace(
        sc, tendons=tendons, actuators=actuators, implicit_damping=damping, implicit_stiffness=stiffness
    )


@pytest.mark.parametrize("rules", RULES)
@pytest.mark.parametrize("strategy", STRATEGIES)
def test_a_step_is_the_oracles(device, strategy, rules):
    """(N) (v' - v) = h (r + u), N = M + h C + h^2/2 K (M22), (M50), (M57), of trees that a tendon joins."""
    sc = tied(rules)
    oracle, h = Oracle(sc), sc.step_size
    x, u, _ = states(sc, 20)
    q, v = np.split(x, 2, axis=1)
    n = oracle.mass_matrix(q)
    n = n + h * oracle.damping_matrix(q) if rules[0] else n
    n = n + 0.5 * h**2 * oracle.stiffness_matrix(q) if rules[1] else n
    after = v + np.linalg.solve(n, h * oracle.force(q, v, u)[..., None])[..., 0]
    step = simulator(sc, strategy, device).step(x, u)
    assert not step.status.any()
    np.testing.assert_allclose(step.state[:, sc.nv :], after, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("integrator", ["euler", "trapezoidal"])
@pytest.mark.parametrize("rules", RULES)
def test_of_one_coordinate_it_is_a_joint_spring(device, rules, integrator):
    """k c^2, c^2 times the damping, resting at L/c, in A, B and second derivatives; a control of it is one of
    the joint with c times the gear.
    """
    damping, stiffness = rules
    base = replace(random_tree(np.random.default_rng(3), 2, ("prismatic", "revolute")), springs=())
    c, k, d, length = -1.4, 300.0, 2.0, 0.3
    last = base.bodies[1]
    sprung = replace(last, stiffness=k * c**2, rest=length / c, damping=d * c**2)
    pulled = replace(last, damping=0.0)
    rule = {"implicit_damping": damping, "implicit_stiffness": stiffness}
    one = replace(base, bodies=(base.bodies[0], sprung), actuators=(Actuator("body1", gear=c * 1.7),), **rule)
    tendon = Tendon("tendon", ("body1.angle",), (c,), k, d, length)
    pull = (Actuator(tendon="tendon", gear=1.7),)
    two = replace(base, bodies=(base.bodies[0], pulled), tendons=(tendon,), actuators=pull, **rule)
    x, u, _ = states(one, 12)
    for strategy in STRATEGIES if integrator == "euler" else STRATEGIES[:1]:
        a, b = (
            simulator(sc, strategy, device, integrator=integrator).linearize(x, u, second=True)
            for sc in (one, two)
        )
        assert not a.status.any() and not b.status.any()
        for name in ("A", "B", "second"):
            left, right = getattr(a, name), getattr(b, name)
            np.testing.assert_allclose(
                right, left, rtol=1e-7, atol=1e-8 * (1 + np.abs(left).max()), err_msg=name
            )


def test_of_two_sliders_it_is_a_spring_between_points(device):
    """On one line, as long as their order stays: l = x_2 - x_1 is the distance but for its rounding at 0."""
    bodies = tuple(Body(name, 1.0 + i, 0.1, joint="prismatic") for i, name in enumerate("ab"))
    common = {"gravity": (0.0, 0.0), "step_size": 0.02, "initial_state": (0.0, 1.5, 1.0, -2.0)}
    one = slcp.Scene(
        "points", bodies, springs=(Spring("a", "b", stiffness=900.0, damping=3.0, length=1.0),), **common
    )
    tendon = Tendon("tendon", ("b.shift", "a.shift"), (1.0, -1.0), 900.0, 3.0, 1.0)
    two = slcp.Scene("tendon", bodies, tendons=(tendon,), **common)
    runs = []
    for sc in (one, two):
        for strategy in STRATEGIES:
            runs.append(simulator(sc, strategy, device).rollout(sc.x0, np.zeros((100, 0))).states)
    for other in runs[1:]:
        np.testing.assert_allclose(other, runs[0], rtol=1e-4, atol=1e-4)
    assert np.ptp(runs[0][:, 1] - runs[0][:, 0]) > 0.05


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_a_stiff_one_ties_coordinates(device, strategy):
    """Fingers that close together, h omega of 1e3: v_left + v_right follows within what friction of the two
    lets them slip, and momentum goes where the tendon says: both move as one of mass m_l + m_r.
    """
    fingers = (
        Body("left", 0.5, 0.1, joint="prismatic", damping=0.0),
        Body("right", 1.5, 0.1, joint="prismatic", axis=(-1.0, 0.0)),
    )
    tendon = Tendon("close", ("left.shift", "right.shift"), (1.0, -1.0), 1e10, 1e6)
    sc = slcp.Scene("grip", fingers, tendons=(tendon,), actuators=(Actuator("left"),), gravity=(0.0, 0.0))
    run = simulator(sc, strategy, device).rollout(sc.x0, np.full((200, 1), 4.0))
    assert not run.status.any()
    q = run.states[:, :2]
    assert np.abs(q[:, 0] - q[:, 1]).max() < 1e-8
    np.testing.assert_allclose(run.states[-1, 2:], 4.0 * 200 * sc.step_size / 2.0, rtol=1e-7)


@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.parametrize("what", ["stiffness", "damping"])
def test_what_has_no_digits_left_has_a_status(device, strategy, what):
    """Two sliders tied by more and more, one pushed: v' is that of both, or there is none. Of 1e22 generic
    kernels gave a 50th of it, or twice as much of 1e20, SOLVED.
    """
    bodies = tuple(Body(name, 1.0, 0.1, joint="prismatic") for name in "ab")
    tendon = Tendon("tie", ("a.shift", "b.shift"), (1.0, -1.0), stiffness=1.0, damping=1.0)
    sc = slcp.Scene("tied", bodies, tendons=(tendon,), actuators=(Actuator("a"),), gravity=(0.0, 0.0))
    sim, size = simulator(sc, strategy, device), 10.0 ** np.array([9.0, 12.0, 14.0, 20.0, 22.0, 100.0, 300.0])
    of = {f"tendon_{name}": size[:, None] if name == what else 0.0 for name in ("stiffness", "damping")}
    step = sim.step(np.zeros((7, 4)), np.full((7, 1), 4.0), sim.params.replace(**of))
    assert step.status.tolist() == [0, 0, 0] + [slcp.Status.NONFINITE] * 4
    np.testing.assert_allclose(step.state[:3, 2:], 0.5 * 4.0 * 0.01, rtol=2e-5)


@pytest.mark.parametrize("rules", [(True, True), (False, False)])
@pytest.mark.parametrize("strategy", STRATEGIES)
def test_gradients_by_every_number(strategy, rules):
    """Coefficients, too, and those of a tendon that a control pulls."""
    sc = tied(rules, 3, ("prismatic", "revolute", "revolute"), 5)
    contact = (
        slcp.Shape("ball", "body1", "disc", 0.2),
        slcp.Shape("wall", None, "halfplane", offset=(0.0, -0.5), angle=1.2),
    )
    sc = replace(sc, shapes=contact, contacts=(slcp.Contact("wall", "ball", 0.4),))
    sim = slcp.Simulator(
        sc, slcp.Options(scaling="inertia"), device="cpu", dtype="float64", strategy=strategy
    )
    x, u, force = states(sc, 10)
    params = sim.params.replace(damping=np.maximum(sim.params["damping"], 0.05))
    check(errors(sim, x, u, params, force, smooth))


def test_a_negative_stiffness_stays_explicit(device):
    body = Body("slider", 1.0, 0.1, joint="prismatic")
    tendon = Tendon("tendon", ("slider.shift",), (2.0,), -1e6)
    sc = slcp.Scene("pushed", (body,), tendons=(tendon,), gravity=(0.0, 0.0), step_size=0.01)
    for strategy in STRATEGIES:
        sim = simulator(sc, strategy, device)
        step, lin = sim.step([[0.3, -0.1]]), sim.linearize([[0.3, -0.1]])
        np.testing.assert_allclose(step.state[:, 1], -0.1 + 0.01 * 4e6 * 0.3, rtol=1e-12)
        np.testing.assert_allclose(lin.A[0, 1], [0.01 * 4e6, 1.0], rtol=1e-9)


def test_ddp_pulls_at_a_tendon():
    """Newton's step is the minimum where all is linear: a quadratic cost of a slider on a tendon."""
    bodies = tuple(Body(name, 1.0, 0.1, joint="prismatic", damping=0.3) for name in "ab")
    tendon = Tendon("tendon", ("a.shift", "b.shift"), (1.0, 0.5), 3.0, 0.1)
    pull = (Actuator(tendon="tendon"),)
    sc = slcp.Scene("pulled", bodies, tendons=(tendon,), actuators=pull, gravity=(0.0, 0.0), step_size=0.05)
    cost = terms(sc, [Term("square", 4.0, state="a.shift", target=0.3),
                      Term("square", 0.01, control="tendon")])  # fmt: skip
    for strategy in STRATEGIES:
        sim = simulator(sc, strategy, "cpu")
        found = ddp.solve(ddp.Problem(sim, cost, horizon=20), sc.x0, np.zeros((20, 1)))
        assert found.status == ddp.Status.CONVERGED and found.iterations <= 3
        assert abs(found.xs[-1, 0] - 0.3) < 0.1 and found.cost < 20 * 4.0 * 0.3**2 / 2


def test_names_files_and_tables(tmp_path):
    sc = tied((True, True))
    assert sc.control_names[-1] == "belt" and sc.control_index("belt") == sc.nu - 1 == 3
    slcp.save_scene(sc, tmp_path / "scene.json")
    again = slcp.load_scene(tmp_path / "scene.json")
    assert again == sc and again.structure == sc.structure
    for name, value in sc.default_parameters().items():
        np.testing.assert_array_equal(again.default_parameters()[name], value)
    assert "rope" in str(sc) and "belt" in str(sc)
    params = slcp.Parameters(sc).replace(**{"rope.tendon_stiffness": 7.0, "belt.tendon_length": -2.0})
    assert params["tendon_stiffness"].tolist() == [7.0, 9.0] and params["tendon_length"].tolist() == [
        0.2,
        -2.0,
    ]
    more = replace(sc, tendons=(*sc.tendons, replace(sc.tendons[0], name="rope 2")))  # begins like another
    params = slcp.Parameters(more).replace(**{"rope.tendon_stiffness": 7.0, "rope 2.tendon_length": 5.0})
    assert params["tendon_stiffness"].tolist() == [7.0, 9.0, 40.0]
    assert params["tendon_length"].tolist() == [0.2, -0.1, 5.0]
    first = sc.state_names[0]
    params = slcp.Parameters(sc).replace(**{f"rope {first}.tendon_coefficient": 3.0})
    assert params["tendon_coefficient"][0] == 3.0
    laws = {"belt.tendon_stiffness": 0.2, "tendon_damping": 0.1, "rope.tendon_length": slcp.Normal(0.01)}
    task = slcp.Task("pull", sc, duration=0.1, disturbances=slcp.Disturbances(parameters=laws))
    drawn = slcp.Parameters(sc).from_table(slcp.draw_worlds(task, 50).params)
    assert len(set(drawn["tendon_stiffness"][:, 1])) == 50 and (drawn["tendon_stiffness"][:, 0] == 40.0).all()
    assert len(set(drawn["tendon_damping"].ravel())) == 100 and np.ptp(drawn["tendon_length"][:, 0]) > 0.01


def test_a_toml_file(tmp_path):
    (tmp_path / "s.toml").write_text("""
format = "slcp-scene"
version = 3
name = "grip"
[[bodies]]
name = "left"
mass = 1.0
inertia = 0.1
joint = "prismatic"
[[bodies]]
name = "right"
mass = 1.0
inertia = 0.1
joint = "prismatic"
[[tendons]]
name = "close"
coordinates = ["right.shift", "left.shift"]
coefficients = [-2, 1]
stiffness = 100
[[actuators]]
tendon = "close"
gear = 2
""")
    sc = slcp.load_scene(tmp_path / "s.toml")
    assert sc.control_names == ("close",) and sc.structure.tendons == ((0, 1),)
    assert sc.default_parameters()["tendon_coefficient"].tolist() == [1.0, -2.0]


BODY = Body("a", 1.0, 0.1)
BAD = {
    "no name": (lambda: Tendon("", ("a.angle",), (1.0,)), "tendon, name is ''"),
    "no coordinates": (lambda: Tendon("t", (), ()), "coordinates is .*names of coordinates are needed"),
    "a text": (lambda: Tendon("t", "a.angle", (1.0,)), "coordinates is 'a.angle'; names"),
    "twice": (lambda: Tendon("t", ("a.angle", "a.angle"), (1.0, 1.0)), "each of them once"),
    "too few": (lambda: Tendon("t", ("a.angle",), ()), "coefficients has 0 entries; 1 are needed"),
    "not a number": (lambda: Tendon("t", ("a.angle",), (np.nan,)), "coefficients.*is nan"),
    "damping": (lambda: Tendon("t", ("a.angle",), (1.0,), damping=-1.0), "damping is -1.0; it must not be"),
    "unknown": (
        lambda: slcp.Scene("s", (BODY,), tendons=(Tendon("t", ("b.angle",), (1.0,)),)),
        "tendon 't', coordinates: no coordinate named 'b.angle'; there are .*a.angle",
    ),
    "velocity": (
        lambda: slcp.Scene("s", (BODY,), tendons=(Tendon("t", ("a.vangle",), (1.0,)),)),
        "no coordinate named 'a.vangle'",
    ),
    "same name": (
        lambda: slcp.Scene("s", (BODY,), tendons=(Tendon("t", ("a.angle",), (1.0,)),) * 2),
        r"tendons\[0\] and tendons\[1\] are both named 't'",
    ),
    "a coordinate's name": (
        lambda: slcp.Scene("s", (BODY,), tendons=(Tendon("a.angle", ("a.angle",), (1.0,)),)),
        "'a.angle' is the name of a coordinate",
    ),
    "a body's name": (
        lambda: slcp.Scene("s", (BODY,), tendons=(Tendon("a", ("a.angle",), (1.0,)),)),
        "'a' is the name of a body",
    ),
    "a count": (
        lambda: slcp.Scene("s", (BODY,), tendons=(Tendon("t#2", ("a.angle",), (1.0,)),)),
        "name is 't#2'; # counts controls",
    ),
    "actuator of nothing": (lambda: Actuator(), "body is None and tendon is None; one of them is needed"),
    "actuator of both": (lambda: Actuator("a", tendon="t"), "one of them is needed"),
    "dof of a tendon": (lambda: Actuator(dof=1, tendon="t"), "dof is 1; a tendon has none"),
    "unknown tendon": (
        lambda: slcp.Scene("s", (BODY,), actuators=(Actuator(tendon="t"),)),
        r"actuators\[0\], tendon: no tendon named 't'",
    ),
    "no tendon": (lambda: slcp.Scene("s", (BODY,), tendons=(BODY,)), r"tendons\[0\] is .*a Tendon is needed"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_none_is_refused(name):
    make, message = BAD[name]
    with pytest.raises(SceneError, match=message):
        make()
