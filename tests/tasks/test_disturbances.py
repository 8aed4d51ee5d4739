"""Disturbed worlds against a loop over `sim.step` in NumPy that draws, delays and pushes on its own."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from draws_oracle import even, normals, overlap
from simulators import scene

import slcp_warp as slcp
from slcp_warp import ddp, policies
from slcp_warp import measures as m
from slcp_warp.policies.saved import content_of, policy_of
from slcp_warp.tasks.disturbances import laws

SCENE = replace(scene("push_on_ice"), step_size=0.02, sigma=0.05)
LOOSE = replace(SCENE, contacts=())  # for what is said of no contact, in kernels that compile soon
H, N, SEED, B, NX = 0.02, 60, 7, 9, 8
COST = slcp.costs.terms(SCENE, [slcp.costs.effort(1.0)])
K = np.array([[-9.0, 0.0, 0.0, 1.0, -2.0, 0.0, 0.0, 0.3]])
GOAL, FORCE, LIMITS = SCENE.x0 + 0.1, np.array([3.0]), (-5.0, 6.0)
NAMES = SCENE.state_names
ENDS = {name: m.final(name) for name in NAMES} | {"force": m.integral(m.control(0))}
EVERYTHING = slcp.Disturbances(
    velocity=0.02,
    start={"pusher.shift": slcp.Uniform(-0.02, 0.02), "block.x": 0.01},
    parameters={"mass": 0.1, "block.mass": slcp.Uniform(0.9, 1.4), "block.com": slcp.Normal(0.005),
                "friction": slcp.LogNormal(0.2, shared=True), "damping": slcp.Uniform(0.5, 1.5)},
    torque=0.3, sensor={"pusher.shift": 0.01, "block.vx": 0.02}, delay=slcp.Uniform(0.0, 0.08),
    hold=slcp.Uniform(0.02, 0.1), dropped=0.1,
    dropouts=(slcp.Dropout(slcp.Uniform(0.5, 0.7), 0.1),),
    kick_times=(0.3, 0.62), kick=0.02, kicks={"block.vx": slcp.Uniform(0.05, 0.1)},
    pushes=(slcp.Push("block", slcp.Uniform(0.2, 0.4), 0.15, (slcp.Normal(2.0), -1.0), at=(0.05, 0.1)),
            slcp.Push("pusher", 0.505, slcp.LogNormal(0.3, median=0.1), (1.5, 0.0)),
            slcp.Push("block", 0.8, 0.1, torque=slcp.Normal(0.1, mean=0.2))),
)  # fmt: skip


def task(**changes) -> slcp.Task:
    fields = {"name": "push", "scene": SCENE, "cost": COST, "horizon": N, "measures": ENDS,
              "control_limits": LIMITS, "disturbances": EVERYTHING}  # fmt: skip
    return slcp.Task(**{**fields, **changes})


def swept(device, strategy, what=None, policy=None, **given):
    options = slcp.Options(residual={"specialised": "rem-logistic", "generic": "hard"}[strategy])
    policy = policies.Linear(K, GOAL, FORCE) if policy is None else policy
    given = {"worlds": B, "seed": SEED, **given}
    return slcp.sweep(task() if what is None else what, policy, cases=options, dtype="float64", device=device,
                      strategy=strategy, **given)  # fmt: skip


def drawn_parameters():
    """By hand what EVERYTHING says of parameters."""
    base, worlds = SCENE.default_parameters(), range(B)
    columns = {name: start for name, start, _ in slcp.Simulator(SCENE, device="cpu").params.layout.columns}

    def z(name, *places):
        return np.concatenate([normals(SEED, worlds, columns[name] + i, [200]) for i in places], axis=1)

    def u(name, i):
        return np.array([even(SEED, world, columns[name] + i, 200) for world in worlds])

    mass = base["mass"] * np.exp(0.1 * z("mass", 0, 1))
    mass[:, 1] = 0.9 + 0.5 * u("mass", 1)
    friction = base["friction"] * np.exp(0.2 * z("friction", 0))
    com = np.repeat(base["com"][None], B, 0)
    com[:, 1] += 0.005 * z("com", 2, 3)
    damping = 0.5 + np.stack([u("damping", j) for j in range(NX // 2)], 1)
    return {"mass": mass, "friction": friction, "com": com, "damping": damping}


def forces(time, x, com):
    """(B, bodies, 3) of the pushes of EVERYTHING."""
    out, worlds, stream = np.zeros((B, 2, 3)), range(B), 1 << 22
    start = np.array([0.2 + 0.2 * even(SEED, world, 0, stream) for world in worlds])
    share = overlap(start, 0.15, time, H)
    fx, fy = share * 2.0 * normals(SEED, worlds, 0, [stream + 2])[:, 0], -share
    rx, ry = (np.array([0.05, 0.1]) - com[:, 1]).T
    cos, sin = np.cos(x[:, 3]), np.sin(x[:, 3])
    out[:, 1] += np.stack([fx, fy, (cos * rx - sin * ry) * fy - (sin * rx + cos * ry) * fx], 1)
    long = 0.1 * np.exp(0.3 * normals(SEED, worlds, 1, [stream + 1])[:, 0])
    out[:, 0, 0] += 1.5 * overlap(0.505, long, time, H)
    out[:, 1, 2] += overlap(0.8, 0.1, time, H) * (0.2 + 0.1 * normals(SEED, worlds, 2, [stream + 4])[:, 0])
    return out


def by_hand(sim):
    """Last states (B, nx) and the controls that acted (B, N) of the disturbed worlds."""
    worlds, numbers = range(B), drawn_parameters()
    params = sim.params.replace(**numbers)
    x = SCENE.x0 + np.where(np.arange(NX) < NX // 2, 0.0, 0.02) * normals(SEED, worlds, 0, [0])
    for j in range(NX):
        x[:, j] = SCENE.x0[j] + (0.02 if j >= NX // 2 else 0.0) * normals(SEED, worlds, j, [0])[:, 0]
    x[:, 0] = [-0.02 + 0.04 * even(SEED, world, 0, 0) for world in worlds]
    x[:, 1] = SCENE.x0[1] + 0.01 * normals(SEED, worlds, 1, [0])[:, 0]
    noise = np.zeros(NX)
    noise[0], noise[NAMES.index("block.vx")] = 0.01, 0.02
    away = np.array([0.5 + 0.2 * even(SEED, world, 0, (1 << 22) + 10) for world in worlds])
    timing = np.array([[even(SEED, world, 0, (1 << 22) + 30 + i) for i in range(2)] for world in worlds])
    delay, hold = np.floor([0.5, 1.5] + timing * 4.0).astype(int).T
    asked, held, warm, acted = [], np.zeros((B, 1)), None, []
    for k in range(N):
        time = k * H
        for n, when in enumerate((0.3, 0.62)):
            if k == round(when / H):
                kick = 0.02 * normals(SEED, worlds, n, [400, 401, 402, 403])
                kick[:, 1] = [0.05 + 0.05 * even(SEED, world, n, 401) for world in worlds]
                x = np.concatenate([x[:, :4], x[:, 4:] + kick], 1)
        seen = x + noise * normals(SEED, worlds, k, (1 << 23) + np.arange(NX))
        held = np.where((k % hold == 0)[:, None], FORCE + (seen - GOAL) @ K.T, held)
        asked.append(held)
        way = [asked[k - delay[i]][i] if k >= delay[i] else np.zeros(1) for i in worlds]
        u = np.clip(np.array(way), *LIMITS) + 0.3 * normals(SEED, worlds, k, [300])
        lost = [even(SEED, world, k, (1 << 22) + 20) < 0.1 for world in worlds]
        u[lost | ((time >= away - 1e-9) & (time < away + 0.1 - 1e-9))] = 0.0
        step = sim.step(x, u, params, external_force=forces(time, x, numbers["com"]), warm_start=warm)
        assert not step.status.any()
        x, warm = step.state, step.multiplier
        acted.append(u[:, 0])
    return x, np.stack(acted, 1)


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
def test_disturbed_worlds_are_those_of_a_loop(device, strategy):
    report = swept(device, strategy)
    found = report.part("policy")
    options = slcp.Options(residual=report.parts[0]["case"])
    sim = slcp.Simulator(SCENE, options, dtype="float64", device=device, strategy=strategy)
    states, controls = by_hand(sim)
    assert not found["status"].any() and np.ptp(states[:, :2], axis=0).min() > 0.05
    for j, name in enumerate(NAMES):
        np.testing.assert_allclose(found[name], states[:, j], rtol=0, atol=1e-9, err_msg=name)
    np.testing.assert_allclose(found["force"], H * controls.sum(1), rtol=0, atol=1e-9)
    assert 0.05 < (controls == 0.0).mean() < 0.35
    np.testing.assert_allclose(found["drawn_block.mass"], drawn_parameters()["mass"][:, 1], rtol=1e-6)
    assert len(np.unique(np.round(found["drawn_delay"] / H))) > 2 and found["drawn_hold"].max() <= 0.1
    quiet = swept(device, strategy, task(disturbances=slcp.Disturbances()), worlds=1).part("policy")
    still = report.part("policy", arm="undisturbed")
    for name in ENDS:  # of another kernel
        np.testing.assert_allclose(still[name], quiet[name], rtol=0.0, atol=1e-9, err_msg=name)


TABLES = ("x0", "params", "kicks", "pushes", "dropouts", "timing")


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
def test_given_worlds_are_as_good_as_drawn_ones(device, strategy):
    """All of them, some of them in another order, in chunks; each keeps the noise of its number."""
    drawn, split = (swept(device, strategy, chunk=chunk).part("policy") for chunk in (None, 4))
    assert all(np.array_equal(split[name], drawn[name]) for name in drawn)
    worlds = slcp.draw_worlds(task(), B, SEED, dtype="float64", device=device)
    picked = np.array([5, 2, 2, 8])
    for given, places, chunk in ((worlds, np.arange(B), None), (worlds[picked], picked, 3)):
        found = swept(device, strategy, worlds=given, chunk=chunk).part("policy")
        for name in (*ENDS, *(name for name in drawn if name.startswith("drawn_"))):
            if len(np.unique(drawn[name][places])) > 1:
                np.testing.assert_array_equal(found[name], drawn[name][places], err_msg=name)
    later = slcp.draw_worlds(task(), 3, SEED, 4, dtype="float64", device=device)
    for name in TABLES:
        np.testing.assert_array_equal(getattr(later, name), getattr(worlds, name)[4:7])


def test_what_is_not_given_is_undisturbed(device):
    """Noise of single steps stays: it follows from the seed and the world's number."""
    still = slcp.Disturbances(kick_times=(0.3,), pushes=(slcp.Push("block", 0.2, 0.1),))
    alone = slcp.Worlds(np.repeat(SCENE.x0[None], 3, 0))
    found = swept(device, "specialised", task(scene=LOOSE, disturbances=still), worlds=alone)
    for name in ENDS:
        assert np.ptp(found.part("policy")[name]) == 0.0
        assert found.part("policy")[name][0] == found.part("policy", arm="undisturbed")[name][0]
    pushed = np.zeros((3, 1, 5))
    pushed[:, 0] = [0.2, 0.1, 0.0, 0.0, 0.0]
    pushed[1, 0, 2] = 5.0
    given = replace(alone, pushes=pushed)
    found = swept(device, "specialised", task(scene=LOOSE, disturbances=still), worlds=given).part("policy")
    assert found["block.x"][1] > found["block.x"][0] + 0.01 and found["block.x"][0] == found["block.x"][2]
    np.testing.assert_array_equal(found["drawn_push_0_fx"], [0.0, 5.0, 0.0])


@pytest.mark.parametrize(
    "changes, text",
    [
        ({"kicks": np.zeros((2, 1, 4))}, r"Worlds.kicks has shape \(2, 1, 4\); \(2, 2, 4\) is needed"),
        ({"pushes": np.zeros((2, 3, 4))}, r"Worlds.pushes has shape"),
        ({"params": np.zeros((2, 3))}, r"Worlds.params has shape \(2, 3\)"),
        (
            {"timing": np.full((2, 1, 2), 0.09)},
            r"Worlds.timing: delay is from 0.09 to 0.09 s; from 0 to .* 0.08",
        ),
        ({"x0": np.zeros((2, 6))}, r"Worlds.x0 has shape \(2, 6\)"),
        ({"x0": np.zeros((3, 8))}, "2 worlds|3 worlds"),
        ({"x0": np.full((2, 8), np.nan)}, "Worlds.x0 holds nan"),
        ({"numbers": [0, -1]}, "Worlds.numbers holds -1; whole numbers"),
        ({"numbers": [0, 0.5]}, "Worlds.numbers holds 0.5"),
        ({"numbers": [0, 2**31]}, "Worlds.numbers holds 2.14748e[+]09; whole numbers"),
        ({"params": np.zeros((2, 76))}, "Worlds.params: step_size is 0.0; it must be positive"),
        ({"x0": 1.0}, r"Worlds.x0 has shape \(\); 2 axes are needed"),
        ({"dropouts": "none"}, "Worlds.dropouts is 'none'"),
    ],
)
def test_worlds_that_cannot_be(changes, text):
    given = {"x0": np.zeros((2, 8)), "kicks": np.zeros((2, 2, 4))} | changes
    with pytest.raises(slcp.InputError, match=text):
        swept("cpu", "generic", worlds=slcp.Worlds(**given))


@pytest.mark.parametrize("shared", [False, True, "bodies"])
def test_friction_is_drawn_by_pairs_of_shapes_once_or_by_pairs_of_bodies(shared):
    """The corners of a box on one ground, and the ends of a bar: one draw of one surface, or one of each."""
    scene = replace(
        SCENE, contacts=tuple(replace(c, friction=0.1 * (i + 2)) for i, c in enumerate(SCENE.contacts))
    )
    law = {"friction": slcp.LogNormal(0.3, shared=shared), "damping": slcp.Uniform(0.1, 1.0, shared)}
    own = task(scene=scene, disturbances=slcp.Disturbances(parameters=law))
    table = slcp.draw_worlds(own, 400, dtype="float64", device="cpu").params
    columns = {name: start for name, start, _ in slcp.Simulator(scene, device="cpu").params.layout.columns}
    start = columns["friction"]
    draws = np.log(table[:, start : start + len(scene.pair_names)] / scene.default_parameters()["friction"])
    assert scene.pair_names == ("ground/corner0", "ground/corner1", "face/pusher")
    same = np.isclose(draws[:, 0], draws[:, 1:].T, rtol=1e-9).all(1).tolist()
    assert same == {False: [False, False], True: [True, True], "bodies": [True, False]}[shared]
    assert np.allclose(draws.std(0), 0.3, atol=0.04)
    distinct = len(np.unique(np.corrcoef(table[:, columns["damping"] :][:, : scene.nv].T).round(6), axis=0))
    assert distinct == {False: 4, True: 1, "bodies": 2}[shared]  # the pusher, and the block's three


@pytest.mark.parametrize(
    "make, text",
    [
        (
            lambda: slcp.Disturbances(parameters={"gravity": slcp.LogNormal(0.1, shared="bodies")}),
            "gravity is of no body: shared True or False",
        ),
        (lambda: slcp.Uniform(1.0, 0.0), r"Uniform.high is 0.0; a finite number of at least 1"),
        (lambda: slcp.Uniform(np.nan, 1.0), "Uniform.low is nan"),
        (lambda: slcp.Normal(-1.0), "Normal.sd is -1.0"),
        (lambda: slcp.Normal("wide"), "Normal.sd is 'wide'"),
        (lambda: slcp.LogNormal(2.5), r"LogNormal.sd is 2.5; a number in \[0, 2.0\)"),
        (lambda: slcp.LogNormal(0.1, median=0.0), "LogNormal.median is 0.0"),
        (lambda: slcp.LogNormal(0.1, shared=1), "LogNormal.shared is 1; True, False or 'bodies'"),
        (lambda: slcp.Push("block", 0.1, slcp.Normal(0.1)), "Push.duration is Normal.*may fall below 0"),
        (lambda: slcp.Push("block", 0.1, slcp.Uniform(-0.1, 0.1)), "Push.duration is Uniform.* at least 0"),
        (lambda: slcp.Push("block", 0.1, 0.1, force=3.0), r"Push.force is 3.0; two numbers \(x, y\)"),
        (lambda: slcp.Push("block", 0.1, 0.1, at=(slcp.Normal(1.0), 0.0)), "Push.at is .*not drawn"),
        (lambda: slcp.Push(1, 0.1, 0.1), "Push.body is 1"),
        (lambda: slcp.Dropout("soon", 0.1), "Dropout.start is 'soon'"),
        (lambda: slcp.Disturbances(dropped=1.5), r"Disturbances.dropped is 1.5; .*\[0, 1\]"),
        (lambda: slcp.Disturbances(sensor={"block.x": -1.0}), r"Disturbances.sensor\['block.x'\] is -1.0"),
        (lambda: slcp.Disturbances(sensor="bad"), "Disturbances.sensor is 'bad'"),
        (lambda: slcp.Disturbances(delay=-0.1), "Disturbances.delay is -0.1"),
        (lambda: slcp.Disturbances(pushes=slcp.Dropout(0.1, 0.1)), "Disturbances.pushes is"),
        (lambda: slcp.Disturbances(dropouts=[slcp.Push("a", 0.1, 0.1)]), "slcp_warp.Dropout, in a tuple"),
        (
            lambda: slcp.Disturbances(parameters={"mass": slcp.Normal(0.1)}),
            "mass takes log-normal or uniform",
        ),
        (lambda: slcp.Disturbances(parameters={"gravity": slcp.Uniform(1, 2)}), "gravity takes log-normal"),
        (
            lambda: disturbed(parameters={"radius": slcp.Uniform(0.1, 0.2)}),
            "whose size is not one|is a point",
        ),
        (lambda: slcp.Disturbances(parameters={"pusher.radius": slcp.Uniform(0, 1)}), "positive numbers are"),
        (lambda: slcp.Disturbances(parameters={"com": 0.1}), "com takes normal or uniform"),
        (lambda: slcp.Disturbances(parameters={"mass": slcp.Uniform(0, 1)}), "positive numbers are needed"),
        (lambda: slcp.Disturbances(parameters={"friction": slcp.Uniform(-1, 1)}), "no negative numbers"),
        (lambda: disturbed(parameters={"cart.mass": 0.1}), "'cart.mass'; there are pusher.mass, block.mass"),
        (lambda: disturbed(parameters={"rest": slcp.Normal(0.1)}), "'rest'; scene 'push_block' has no rest"),
        (
            lambda: disturbed(kicks={"block.x": 0.1}, kick_times=(0.1,)),
            "kicks names 'block.x'; velocities are kicked: pusher",
        ),
        (lambda: disturbed(sensor={"block.z": 0.1}), "'block.z'"),
        (lambda: disturbed(pushes=(slcp.Push("cart", 0.1, 0.1),)), r"pushes\[0\].body is 'cart'; there are"),
        (
            lambda: disturbed(pushes=(slcp.Push("block", 1.3, 0.1),)),
            r"pushes\[0\].start holds 1.3; times before",
        ),
        (
            lambda: disturbed(pushes=(slcp.Push("block", 0.1, 0.0),)),
            r"pushes\[0\].duration is 0; a positive one",
        ),
        (
            lambda: disturbed(dropouts=(slcp.Dropout(slcp.Uniform(-2, -1), 0.5),)),
            r"dropouts\[0\] ends before a run begins, at -0.5 s",
        ),
        (
            lambda: disturbed(dropouts=(slcp.Dropout(slcp.Uniform(2, 3), 0.1),)),
            r"dropouts\[0\].start holds 2",
        ),
        (lambda: swept("cpu", "generic", disturbed(delay=0.004)), "delay is 0.004 s, less than half a step"),
        (lambda: disturbed(delay=9.0), "delay holds 9.0; times before the end of a run"),
        (
            lambda: swept(
                "cpu",
                "generic",
                disturbed().replace(duration=20.0, disturbances=slcp.Disturbances(delay=9.0)),
            ),
            "delay is 9.0 s, .* at most 256 steps",
        ),
    ],
)
def test_what_cannot_be_drawn_is_refused(make, text):
    with pytest.raises(slcp.InputError, match=text):
        make()


def disturbed(**given):
    return task(disturbances=slcp.Disturbances(**given))


def test_every_number_has_its_own_address():
    """Of a task's draws no two share a stream and a step, but those that are one draw."""
    scene = task().scene
    d, base = EVERYTHING, slcp.Simulator(scene, device="cpu").params.table()[0]
    columns = [d.start_laws(scene, scene.x0), d.kick_laws(scene), d.push_laws(), d.dropout_laws()]
    columns.append(d.timing_laws())
    columns.append(laws.parameter_laws(scene, base, d.parameters))
    found = [pair for each in columns for pair in set(zip(each.step.tolist(), each.stream.tolist()))]
    assert len(found) == len(set(found))
    singles = {300, (1 << 22) + 20, *((1 << 21) + np.arange(99)), *((1 << 23) + np.arange(99))}
    assert not singles & {stream for _, stream in found}


def test_springs_may_be_drawn_and_columns_have_parts():
    scene = slcp.tasks.catch().scene
    d = slcp.Disturbances(
        parameters={"paddle.stiffness": 0.3, "ball/left.friction": 0.1, "ball.com": slcp.Normal(0.01)}
    )
    found = laws.parameter_laws(scene, slcp.Parameters(scene).table()[0], d.parameters)
    names = [found.names[c] for c in found.varied]
    assert names == ["ball.com_x", "ball.com_y", "left/ball.friction", "paddle.angle.stiffness"]
    assert len(set(found.names)) == len(found.names) and "left/ball.friction" in found.names


def test_a_push_turns_with_all_that_its_body_hangs_on(device):
    """Of a chain of two bodies that are built at an angle, at a point off the centre of mass."""
    base = slcp.scenes.flicking_finger()
    first, second, ellipse = base.bodies
    free = {"lower": None, "upper": None}
    bodies = (replace(first, angle=0.3, **free), replace(second, angle=-0.5, com=(0.7, 0.1), **free), ellipse)
    scene = replace(base, bodies=bodies, contacts=())
    push = slcp.Push(second.name, 0.0, 1.0, (0.7, -0.4), torque=0.1, at=(1.1, 0.2))
    own = slcp.Task("pushed", scene, slcp.costs.terms(scene, [slcp.costs.effort(1.0)]), 20,
                    measures={name: m.final(name) for name in scene.state_names},
                    disturbances=slcp.Disturbances(pushes=(push,)))  # fmt: skip
    idle = policies.Linear(np.zeros((2, 6)), np.zeros(6), np.zeros(2))
    found = swept(device, "specialised", own, idle, worlds=1).part("policy")
    sim = slcp.Simulator(scene, dtype="float64", device=device)
    x, warm = scene.x0[None], None
    for _ in range(20):
        angle = 0.3 - 0.5 + x[0, 0] + x[0, 1]
        cos, sin = np.cos(angle), np.sin(angle)
        rx, ry = cos * 0.4 - sin * 0.1, sin * 0.4 + cos * 0.1
        force = np.zeros((1, 3, 3))
        force[0, 1] = 0.7, -0.4, 0.1 + rx * -0.4 - ry * 0.7
        step = sim.step(x, np.zeros((1, 2)), external_force=force, warm_start=warm)
        x, warm = step.state, step.multiplier
    np.testing.assert_allclose([found[name][0] for name in scene.state_names], x[0], rtol=0, atol=1e-9)
    assert abs(x[0] - scene.x0).max() > 0.1


def test_a_policy_of_every_worlds_own_has_none_for_other_numbers():
    own = policies.Linear(np.repeat(K[None], 3, axis=0), GOAL, FORCE)
    drawn = slcp.draw_worlds(task(), 3, SEED, 1)
    with pytest.raises(slcp.InputError, match="policy 'policy' is for worlds 0 to 2; Worlds.numbers holds 3"):
        swept("cpu", "generic", policy=own, worlds=drawn)


@pytest.mark.parametrize("strategy", ["generic", "specialised"])
def test_a_tasks_periods_are_those_of_policies_that_have_none(strategy):
    """A turn further on feedback is the same; a policy of its own periods keeps them."""
    scene = slcp.scenes.cart_pole()
    gain, straight = np.array([[0.0, 1.0, 0.0, 0.0]]), np.zeros(4)
    whole = slcp.Task(
        "turn", scene, horizon=1, options=slcp.Options("hard"), periods={"pole.angle": "turn"},
        start={"pole.angle": 2.0 * np.pi + 0.1}, measures={"u": m.final(m.control(0))},
    )  # fmt: skip
    plan = SimpleNamespace(us=np.zeros((1, 1)), xs=np.zeros((2, 4)), K=gain[None])
    given = {
        "linear": policies.Linear(gain, straight), "plan": ddp.TrackingPolicy(plan),
        "around": policies.Around(policies.Linear(gain, straight)),
        "none": policies.Linear(gain, straight, period=straight),
        "saved": policy_of(content_of(policies.Linear(gain, straight))),
        "seen": policies.Observed(policies.Linear(gain[:, 1:2]), ("pole.angle",)),
    }  # fmt: skip
    report = slcp.sweep(whole, given, worlds=1, cases={"h": whole.options}, dtype="float64", device="cpu",
                        strategy=strategy)  # fmt: skip
    found = {name: float(report.part(name)["u"][0]) for name in given}
    expected = dict.fromkeys(given, 0.1) | {"none": 2.0 * np.pi + 0.1}
    assert found == pytest.approx(expected, abs=1e-12)
