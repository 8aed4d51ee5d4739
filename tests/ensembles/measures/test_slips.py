"""How fast contacts slide: against mechanics by hand, and against Jacobians that share no code."""

import numpy as np
import pytest
from oracle import Oracle
from random_scenes import near_contact, random_tree

import slcp_warp as slcp
from slcp_warp import measures as m

MU, G, R, H = 0.3, 9.81, 0.1, 0.005
GROUND = slcp.Shape("ground", None, "halfplane", angle=np.pi / 2)


def ball(turned: bool) -> slcp.Scene:
    """A disc on the ground, whose pair has either order."""
    pair = ("ball", "ground") if turned else ("ground", "ball")
    shapes = (GROUND, slcp.Shape("ball", "ball", "disc", R))
    body = slcp.Body("ball", 1.0, 0.5 * R**2, joint="free")
    push = slcp.Actuator("ball", 0, 1.0)
    return slcp.Scene("ball", (body,), shapes, (slcp.Contact(*pair, MU),), actuators=(push,), step_size=H)


def still(scene: slcp.Scene) -> slcp.policies.Linear:
    return slcp.policies.Linear(np.zeros((scene.nu, 2 * scene.nv)), scene.x0, np.zeros(scene.nu))


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("friction", ["anitescu", "coulomb"])
def test_a_ball_slides_until_it_rolls(device, turned, friction):
    """It sets off at v without turning: it slows by mu g, spins up by 2 mu g / r and rolls from v / (3 mu g)
    on. Its lowest point has slid v^2 / (6 mu g) then, back past the ground, which is to the right of the
    normal: the tangent looks to the left.
    """
    v, scene = 0.6, ball(turned)
    measures = {
        "first": m.initial(m.slip("ball/ground")),
        "slid": m.integral(abs(m.slip("ball"))),
        "weight": m.mean(m.normal_force("ball")),
        "drag": m.total(m.tangential_impulse("ground/ball")),
        "dragged": m.largest(abs(m.tangential_force("ground/ball"))),
        "rolls": m.settled(abs(m.slip()) < 1e-9),
        "pace": m.final("ball.vx", where=abs(m.slip("ball")) < 1e-9),
    }
    start = scene.state({"ball.y": R, "ball.vx": v})
    task = slcp.Task("ball", scene, start=start, duration=0.5, measures=measures)
    options = slcp.Options("hard", friction=friction)
    found = {}
    for strategy in ("specialised", "generic"):
        report = slcp.sweep(
            task, still(scene), worlds=1, cases=options, device=device, dtype="float64", strategy=strategy
        )
        assert (report.table["status"] == 0).all()
        found[strategy] = {name: report.table[name][0] for name in measures}
    own, generic = found["specialised"], found["generic"]
    for name in measures:
        assert own[name] == pytest.approx(generic[name], rel=1e-9, abs=1e-9), name
    rolls = v / (3.0 * MU * G)
    if friction == "coulomb":  # the other law lifts what slides, and every other step does not push
        assert own["first"] == pytest.approx(-(v - 3.0 * MU * G * H), rel=1e-9)
        assert own["slid"] == pytest.approx(v**2 / (6.0 * MU * G), abs=v * H)
        assert own["dragged"] == pytest.approx(MU * G, rel=1e-9)
    assert own["rolls"] == pytest.approx(rolls, abs=2.0 * H)
    assert own["weight"] == pytest.approx(G, rel=0.02)
    assert own["drag"] == pytest.approx(v / 3.0, rel=1e-9)  # to the left on the ball
    assert own["pace"] == pytest.approx(2.0 / 3.0 * v, rel=1e-9)


def test_what_is_of_a_body_is_of_all_that_it_touches(device):
    """Of three discs in a row on the ground, pushed against a wall: pairs that do not follow each other."""
    shapes = (GROUND, slcp.Shape("wall", None, "halfplane", angle=np.pi, offset=(0.55, 0.0)),
              *(slcp.Shape(name, name, "disc", R) for name in "abc"))  # fmt: skip
    bodies = tuple(slcp.Body(name, 1.0, 0.5 * R**2, joint="free") for name in "abc")
    pairs = (("ground", "a"), ("ground", "b"), ("a", "b"), ("ground", "c"), ("b", "c"), ("wall", "c"))
    contacts = tuple(slcp.Contact(*pair, MU) for pair in pairs)
    scene = slcp.Scene("row", bodies, shapes, contacts, actuators=(slcp.Actuator("a", 0, 1.0),), step_size=H)
    assert scene.pairs_of("b") == scene.pairs_of(1) + (2, 4)
    asked = {}
    for name in ("a", "b", "c", "a/b"):
        of = {
            "push": m.normal_impulse,
            "touch": m.contact,
            "gap": m.gap,
            "slip": m.slip,
            "drag": m.tangential_force,
        }
        asked |= {f"{what} {name}": m.total(make(name), 0.1) for what, make in of.items()}
    start = scene.state(
        {f"{name}.x": 0.18 * i for i, name in enumerate("abc")} | {f"{name}.y": R for name in "abc"}
    )
    start[scene.nv :: 3] = 1.0, 0.5, 0.2
    task = slcp.Task("row", scene, start=start, duration=0.4, measures=asked)
    push = slcp.policies.Linear(np.zeros((1, 18)), scene.x0, [20.0])
    for strategy in ("specialised", "generic"):
        given = {"device": device, "dtype": "float64", "strategy": strategy}
        found = slcp.sweep(task, push, worlds=1, cases=slcp.Options("hard"), **given).table
        run = slcp.Simulator(scene, slcp.Options("hard"), **given).rollout(
            start, policy=push, steps=80, record=("impulse", "gap")
        )
        assert run.status == 0 and (found["status"] == 0).all()
        for name, measure in asked.items():
            assert found[name][0] == pytest.approx(run.measure(measure), rel=1e-7, abs=1e-9), (strategy, name)
        ends = [found[f"push {name}"][0] for name in "abc"]
        both = found["push a/b"][0], sum(run.contact_impulse[20:, [4], 0].sum(0))
        alone = run.contact_impulse[20:, [0, 1, 3, 5], 0].sum()
        assert sum(ends) == pytest.approx(alone + 2.0 * sum(both), rel=1e-9) and both[0] > 0.1


@pytest.mark.parametrize("seed", range(6))
def test_slips_are_the_tangential_rows_of_the_step(device, seed):
    """Of random trees with ellipses that touch each other and a tilted ground."""
    rng = np.random.default_rng(seed)
    scene = random_tree(rng, 2, ("free", "prismatic"), contacts=True)
    oracle, pairs = Oracle(scene), len(scene.pair_names)
    start = near_contact(scene, rng, 12, gaps=(0.0, 0.005))
    ends = (np.arange(8) + 0.5) * scene.step_size
    asked = {f"{k} {n}": m.final(m.slip(k), end=end) for k in range(pairs) for n, end in enumerate(ends)}
    task = slcp.Task("tree", scene, start=start, duration=8 * scene.step_size, measures=asked)
    options = slcp.Options("hard", friction="coulomb") if seed % 2 else slcp.Options("rem-logistic")
    given = {"device": device, "dtype": "float64", "strategy": "generic"}
    table = slcp.sweep(task, still(scene), worlds=1, cases=options, **given).part("policy", arm="undisturbed")
    run = slcp.Simulator(scene, options, **given).rollout(start, np.zeros((8, scene.nu)), record=("impulse",))
    good = (run.status == 0) & (table["status"] == 0)
    assert good.sum() > 6
    pushed = 0
    for k in range(pairs):
        for n in range(8):
            q, v = run.states[good, n, : scene.nv], run.states[good, n + 1, scene.nv :]
            gap, _, tangent, margin = oracle.contact_jacobian(q, k)
            touching = run.contact_impulse[good, n, k, 0] > 1e-6
            expected = np.where(touching, np.sum(tangent * v, -1), 0.0)
            sure = margin > 1e-3
            np.testing.assert_allclose(table[f"{k} {n}"][good][sure], expected[sure], rtol=1e-6, atol=1e-7)
            pushed += int((touching & sure).sum())
            values = run.measure(asked[f"{k} {n}"])
            np.testing.assert_allclose(values[good], table[f"{k} {n}"][good], rtol=1e-6, atol=1e-7)
    assert pushed > 20
