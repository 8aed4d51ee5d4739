"""Tendons whose force has a limit, against their law at the step's end, differences and closed forms."""

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp.scripts.benchmarks.fuzz.draws import Worlds
from slcp_warp.scripts.benchmarks.fuzz.judge import Outcome
from slcp_warp.scripts.benchmarks.fuzz.judged import judged
from slcp_warp.scripts.benchmarks.fuzz.rolled import roll
from slcp_warp.scripts.benchmarks.fuzz.run import run_task
from slcp_warp.scripts.benchmarks.fuzz.tasks import Task
from slcp_warp.scripts.benchmarks.fuzz.verdicts import HOLDS
from slcp_warp.scripts.benchmarks.mechanics.yielding import asked

K, C, LIMIT, H = 200.0, 20.0, 5.0, 0.01


def slider(limit=LIMIT, h=H, gravity=(0.0, 0.0), **rules):
    """A mass of 1 kg on a rail that a servo drives."""
    tendon = slcp.Tendon("servo", ("slide.shift",), (1.0,), K, C, force_limit=limit)
    return slcp.Scene(
        "slider",
        (slcp.Body("slide", 1.0, 0.01, joint="prismatic"),),
        actuators=(slcp.Actuator(tendon="servo", gear=K),),
        tendons=(tendon,),
        gravity=gravity,
        step_size=h,
        **rules,
    )


def rolled(scene, u, steps):
    sim = slcp.Simulator(scene, slcp.Options("hard"), dtype="float64")
    return sim.rollout(scene.x0, np.full((steps, scene.nu), u))


def test_a_far_target_is_met_with_the_limit_and_no_more():
    run = rolled(slider(), 1.0, 600)
    q, v = run.states.T
    force = np.diff(v) / H
    assert np.abs(force).max() == pytest.approx(LIMIT, rel=1e-12)
    early = np.arange(40)
    np.testing.assert_allclose(v[early], LIMIT * H * early, rtol=1e-12)
    assert q[-1] == pytest.approx(1.0, abs=1e-6) and abs(v[-1]) < 1e-6
    assert force.min() < -0.99 * LIMIT  # it brakes with the limit, too


@pytest.mark.parametrize("implicit", [True, False])
def test_every_step_is_the_law_of_its_end(implicit):
    """M (v' - v)/h = clip(k (u - q - h/2 (v' - v)) - c v'), found by bisection of a monotone function."""
    scene = slider(implicit_damping=implicit, implicit_stiffness=implicit, gravity=(1.3, 0.0))
    run = rolled(scene, 0.7, 200)
    late = 1.0 if implicit else 0.0
    for q, v, new in zip(run.states[:-1, 0], run.states[:-1, 1], run.states[1:, 1]):

        def excess(w, q=q, v=v):
            asked = K * (0.7 - q - 0.5 * H * late * (w - v)) - C * (v + late * (w - v))
            return w - v - H * (1.3 + np.clip(asked, -LIMIT, LIMIT))

        low, high = v - 1.0, v + 1.0
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if excess(middle) < 0.0 else (low, middle)
        assert new == pytest.approx(low, abs=1e-12)


def test_a_limit_that_is_never_reached_changes_nothing():
    free = slcp.Simulator(slider(None), slcp.Options("hard"), dtype="float64", strategy="generic")
    us = np.random.default_rng(5).uniform(-0.02, 0.02, (300, 1))
    there = slcp.Simulator(slider(50.0), slcp.Options("hard"), dtype="float64").rollout(np.zeros(2), us)
    np.testing.assert_array_equal(free.rollout(np.zeros(2), us).states, there.states)


def test_a_stalled_motor_holds_up_to_its_limit():
    """A weight of 1 kg on a servo: up to 9.81 N it hangs lower by that over k, beyond it falls."""
    body = slcp.Body("lift", 1.0, 0.01, joint="prismatic", axis=(0.0, 1.0))
    for limit, falls in ((9.9, 0.0), (9.0, 9.81 - 9.0)):
        tendon = slcp.Tendon("servo", ("lift.shift",), (1.0,), 1e4, 1e2, force_limit=limit)
        scene = slcp.Scene("lift", (body,), tendons=(tendon,), step_size=H)
        q = rolled(scene, 0.0, 400).states[:, 0]
        if falls:
            assert np.diff(q, 2)[-1] / H**2 == pytest.approx(-falls, rel=1e-9)
        else:
            assert q[-1] == pytest.approx(-9.81 / 1e4, rel=1e-9)


@pytest.mark.parametrize("stiffness", [1e6, 1e9, 1e12])
def test_a_stiff_motor_holds_no_more_than_its_limit(stiffness):
    """1 kg at 1 m, told 1 m, by 9 N: it falls by the .81 N that are missing, however stiff. By a rounding of
    a billionth of k q, in place of some 1e-16, one of 1e9 N/m held it.
    """
    body = slcp.Body("lift", 1.0, 0.01, joint="prismatic", axis=(0.0, 1.0))
    tendon, motor = slcp.limited_servo(body, stiffness, 9.0)
    scene = slcp.Scene("lift", (body,), actuators=(motor,), tendons=(tendon,), step_size=H,
                       initial_state=(1.0, 0.0))  # fmt: skip
    assert rolled(scene, 1.0, 100).states[-1, 1] == pytest.approx(-0.81, rel=1e-6)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_limits_that_act_on_each_other_are_found(dtype):
    """A chain of five links with a stiff servo at each joint: of the 3^5 that yield to one side, the other or
    not, those that do by the law are one, in 2,000 random states with far targets.
    """
    names = [f"link{i}" for i in range(5)]
    links = tuple(
        slcp.Body(n, 1.0, 0.01, names[i - 1] if i else None, anchor=(0.3 * (i > 0), 0.0), com=(0.15, 0.0))
        for i, n in enumerate(names)
    )
    tendons, motors = zip(*(slcp.limited_servo(b, 200.0, f) for b, f in zip(links, (30, 8, 4, 2, 1))))
    scene = slcp.Scene("chain", links, actuators=motors, tendons=tendons, step_size=H)
    sim, rng = slcp.Simulator(scene, dtype=dtype), np.random.default_rng(2)
    x = rng.normal(size=(2000, 10)) * np.repeat([1.0, 3.0], 5)
    u = rng.normal(size=(2000, 5)) * 0.3 + x[:, :5] * rng.integers(0, 2, (2000, 1))
    x, u = (a.astype(sim.dtype.__name__) for a in (x, u))
    step = sim.step(x, u)
    assert (step.status == slcp.Status.SOLVED).all()
    numbers = {n: np.broadcast_to(v, (2000, *np.shape(v))) for n, v in scene.default_parameters().items()}
    worlds = Worlds(numbers, x.astype(float), u.astype(float), np.zeros(2000, int))
    pulls = asked(scene, worlds, np.asarray(step.state, float))
    assert 0.1 < (np.abs(pulls) > numbers["tendon_force_limit"]).mean() < 0.9
    verdicts, _ = judged(worlds, sim, out=Outcome.of(step))
    assert (verdicts.verdict == HOLDS).all()


def gripper(options, sigma=0.0):
    """Two fingers that limited servos press on a box, one joined over both, above a ground."""
    up = np.pi / 2
    fingers = tuple(slcp.Body(n, 0.5, 0.01, joint="prismatic") for n in ("left", "right"))
    box = slcp.Body("box", 1.0, 0.01, joint="free")
    shapes = (
        slcp.Shape("ground", None, "halfplane", angle=up),
        slcp.Shape("left", "left", "disc", 0.05),
        slcp.Shape("right", "right", "disc", 0.05),
        slcp.Shape("box", "box", "rectangle", (0.1, 0.1), corner_radius=0.01),
    )
    pairs = (("ground", "box"), ("left", "box"), ("right", "box"))
    names = ("left.shift", "right.shift")
    tendons = (
        slcp.Tendon("a", names[:1], (1.0,), 300.0, 5.0, 0.0, 20.0, 3.0 * sigma),
        slcp.Tendon("b", names[1:], (1.0,), 300.0, 5.0, 0.1, 6.0, sigma),
        slcp.Tendon("c", names, (1.0, -0.7), 100.0, 2.0, 0.0, 3.0, 0.4 * sigma),
        slcp.Tendon("d", names, (0.5, 0.5), 50.0, 1.0),
    )
    scene = slcp.Scene(
        "gripper",
        (*fingers, box),
        shapes,
        tuple(slcp.Contact(a, b, 0.6) for a, b in pairs),
        actuators=tuple(slcp.Actuator(tendon=t, gear=300.0) for t in ("b", "a", "c")),
        tendons=tendons,
        initial_state={"left.shift": -0.16, "right.shift": 0.16, "box.y": 0.1},
        sigma=0.02,
        step_size=0.005,
    )
    return slcp.Simulator(scene, options, dtype="float64")


SOFT = 2.0  # N
ALL = [slcp.Options("rem-logistic"), slcp.Options("hard"), slcp.Options("hard", friction="coulomb")]


def states(sim, worlds, seed):
    rng = np.random.default_rng(seed)
    x = sim.scene.x0 + rng.normal(size=(worlds, sim.nx)) * np.repeat([0.01, 0.5], sim.scene.nv)
    return x, rng.uniform(-0.2, 0.2, (worlds, sim.nu))


LAWS = [(options, 0.0) for options in ALL] + [(ALL[0], SOFT)]


@pytest.mark.parametrize("options, sigma", LAWS, ids=str)
def test_derivatives_are_differences_whatever_yields(options, sigma):
    sim = gripper(options, sigma)
    x, u = states(sim, 24, 3)
    lin = sim.linearize(x, u)
    e, good = 1e-6, np.ones(len(x), bool)
    columns = []
    for j in range(sim.nx + sim.nu):
        move = np.zeros(sim.nx + sim.nu)
        move[j] = e
        sides = [sim.step(x + s * move[: sim.nx], u + s * move[sim.nx :]) for s in (1.0, -1.0, 0.5, -0.5)]
        wide, close = ((a.state - b.state) / d for a, b, d in ((*sides[:2], 2 * e), (*sides[2:], e)))
        good &= np.abs(wide - close).max(1) < 1e-4 * (1.0 + np.abs(wide).max(1))
        columns.append(wide)
    found = np.concatenate([lin.A, lin.B], 2)
    expected = np.stack(columns, 2)
    size = np.abs(expected).max((1, 2))
    good &= np.asarray(lin.status) == 0
    assert good.sum() >= 16  # the others have a kink there
    assert (np.abs(found - expected).max((1, 2)) / size)[good].max() < 1e-5
    assert ((np.abs(lin.B).max(1) == 0.0).any() or sigma) and (np.abs(lin.B).max(1) > 0.0).any()


def differences(value, size, e=1e-6):
    """Central differences of value(e) and by how much a longer step has others."""
    wide, close = ((value(d) - value(-d)) / (2.0 * d) for d in (e * size, 0.5 * e * size))
    return wide, np.abs(wide - close)


@pytest.mark.parametrize("options, sigma", [LAWS[0], LAWS[1], LAWS[3]], ids=str)
def test_gradients_by_every_number_of_the_tendons(options, sigma):
    sim = gripper(options, sigma)
    x, u = states(sim, 24, 4)
    us, worlds = np.repeat(u[:, None], 3, 1), 24
    names = [n for n in sim.params.names if n.startswith("tendon_")] + ["gear", "step_size"]
    weight = np.random.default_rng(0).normal(size=(worlds, 4, sim.nx))
    found = slcp.vjp(sim, x, us, weight, parameters=tuple(names))
    solved = np.asarray(sim.rollout(x, us).status) == 0
    compared = 0
    for name in names:
        base = np.broadcast_to(sim.params[name], (worlds, *sim.params[name].shape))
        exact = found.parameters[name].reshape(worlds, -1)
        for k in range(exact.shape[1]):
            if name.startswith("tendon_force") and (k == 3 or (not sigma and name.endswith("sigma"))):
                continue  # it has none

            def value(e, name=name, k=k, base=base):
                moved = base.reshape(worlds, -1).copy()
                moved[:, k] += e
                run = sim.rollout(x, us, sim.params.replace(**{name: moved.reshape(base.shape)}))
                return np.sum(weight * run.states, (1, 2))

            steps = 1e-4 if sigma else 1e-6  # of a mean, which has no kink
            tried, apart = differences(value, np.abs(base.reshape(worlds, -1)[0, k]) + 1e-3, steps)
            size = np.abs(tried) + np.abs(exact[:, k]) + 1e-4
            good = solved & (apart < 1e-4 * size)
            assert good.sum() >= 14
            assert (np.abs(exact[:, k] - tried) / size)[good].max() < 1e-3, name
            compared += int((np.abs(tried[good]) > 1e-4).sum())
    assert compared > 150
    assert (np.abs(found.parameters["tendon_force_limit"][:, :3]) > 0.0).any(0).all()
    assert (np.abs(found.parameters["tendon_force_sigma"][:, :3]) > 0.0).any(0).all() == bool(sigma)


def pressing(sigma):
    """An arm of two links, whose inertia is another one at every place, that servos press on a floor."""
    links = (
        slcp.Body("upper", 1.0, 0.02, com=(0.2, 0.0)),
        slcp.Body("fore", 0.6, 0.01, "upper", anchor=(0.4, 0.0), com=(0.15, 0.0)),
    )
    given = zip(links, (300.0, 200.0), (6.0, 2.0))
    tendons, motors = zip(*(slcp.limited_servo(b, k, f, force_sigma=sigma * f) for b, k, f in given))
    shapes = (
        slcp.Shape("floor", None, "halfplane", offset=(0.0, -0.33), angle=np.pi / 2),
        slcp.Shape("tip", "fore", "disc", 0.03, offset=(0.3, 0.0)),
    )
    scene = slcp.Scene("pressing", links, shapes, (slcp.Contact("floor", "tip", 0.5),), actuators=motors,
                       tendons=tendons, sigma=0.05, step_size=0.01)  # fmt: skip
    sim, rng = slcp.Simulator(scene, slcp.Options("rem-logistic"), dtype="float64"), np.random.default_rng(3)
    place = np.array([-0.6, 0.35]) + rng.normal(size=(16, 2)) * 0.03  # the tip at the floor
    x = np.concatenate([place, rng.normal(size=(16, 2)) * 0.5], 1)
    return sim, x, place + rng.normal(size=(16, 2)) * 0.03


@pytest.mark.parametrize("scene", ["gripper", "pressing"])
@pytest.mark.parametrize("sigma", [0.0, SOFT])
def test_second_derivatives_are_differences_of_first_ones(sigma, scene):
    if scene == "pressing":
        sim, x, u = pressing(0.15 * sigma)
    else:
        sim = gripper(slcp.Options("rem-logistic"), sigma)
        x, u = states(sim, 16, 5)
    weight = np.random.default_rng(1).normal(size=x.shape)
    exact, status = slcp.weighted_hessian(sim, x, u, weight)
    z = np.concatenate([x, u], 1)

    def slopes(moved):
        lin = sim.linearize(moved[:, : sim.nx], moved[:, sim.nx :])
        return np.einsum("bi,bij->bj", weight, np.concatenate([lin.A, lin.B], 2))

    tried, good = np.zeros_like(exact), np.asarray(status) == 0
    unsure = np.zeros(len(x))
    for j, unit in enumerate(np.eye(z.shape[1])):
        tried[:, :, j], apart = differences(lambda e, unit=unit: slopes(z + e * unit), 1.0)
        unsure = np.maximum(unsure, apart.max(1))
    size = np.abs(tried).max((1, 2)) + 1e-3
    good &= unsure < 1e-3 * size
    assert good.sum() >= 8
    assert (np.abs(exact - tried).max((1, 2)) < 1e-5 * size + 3.0 * unsure)[good].all()
    driven = np.abs(exact[good][:, -sim.nu :]).max((1, 2))
    assert 0.0 < driven.max() and (driven.min() > 0.0) == bool(sigma)


@pytest.mark.parametrize("scene", [0, 1, 2])
def test_random_mechanisms_hold_by_the_oracle(scene):
    """Bodies, contacts and limits that nobody chose; the judge shares no code with the kernels."""
    task = Task(1, scene, "generic", residuals=("hard", "rem-logistic"), per_chunk=12, part="limits")
    made = task.make_scene()
    worlds, us = task.worlds(0, made), task.controls(0, made)
    sim = slcp.Simulator(made, slcp.Options("hard"), dtype="float64", strategy="generic")
    run = roll(sim, worlds, us)
    pulls, limit = asked(made, worlds, run.states[:, 1]), worlds.numbers["tendon_force_limit"]
    yields = np.abs(pulls)[:, made.structure.limited] > limit[:, made.structure.limited]
    assert yields.any() and not yields.all()
    assert run_task(task).failures == []


@pytest.mark.slow
def test_derivatives_of_random_mechanisms_are_differences():
    task = Task(1, 1, "generic", residuals=("hard",), per_chunk=24, part="limit-derivatives")
    tally = run_task(task)
    assert tally.failures == []
    for what in ("derivatives", "gradients"):
        assert sum(n for key, n in tally.counts.items() if key[-1] == f"compared {what}") >= 4


@pytest.mark.parametrize("rule", [True, False])
def test_a_trajectory_tells_how_hard_tendons_pull(rule):
    """What drives a mass is its momentum's change; with worlds and steps of their own, with and without a
    limit, after the step has met the spring half a step on and the damper at its end, or before.
    """
    for limit in (LIMIT, None):
        scene = slider(limit, implicit_damping=rule, implicit_stiffness=rule)
        sim = slcp.Simulator(scene, slcp.Options("hard"), dtype="float64")
        us = np.random.default_rng(1).uniform(-0.1, 0.1, (3, 50, 1))
        params = sim.params.replace(
            step_size=[0.01, 0.004, 0.002], **{"servo.tendon_damping": [5.0, 20.0, 9.0]}
        )
        run = sim.rollout(np.zeros((3, 2)), us, params, record=("controls",))
        h = np.array([0.01, 0.004, 0.002])[:, None]
        np.testing.assert_allclose(run.tendon_forces[..., 0], np.diff(run.states[..., 1]) / h, atol=1e-9)
        assert run[0].tendon_forces.shape == (50, 1) == run[0].controls.shape
    with pytest.raises(slcp.ArgumentError, match="controls were not recorded, and some pull at tendons"):
        _ = rolled(scene, 0.1, 3).tendon_forces


def test_what_does_not_have_limits_says_so():
    limited = slider()
    with pytest.raises(slcp.StrategyError, match="force_limit of tendons is offered by the generic"):
        slcp.Simulator(limited, strategy="specialised")
    with pytest.raises(slcp.StrategyError, match="integrator 'leapfrog' with force_limit of tendons"):
        slcp.Simulator(limited, slcp.Options("hard", integrator="leapfrog"))
    with pytest.raises(slcp.SceneError, match="force_limit is -1.0; it must not be negative"):
        slider(-1.0)
    with pytest.raises(slcp.SceneError, match="force_limit is nan; it must be finite"):
        slider(float("nan"))
    sim = gripper(slcp.Options("hard"))
    with pytest.raises(slcp.ArgumentError, match="tendon_force_limit of 'd' is 2.0; it was built w"):
        sim.params.replace(tendon_force_limit=[1.0, 1.0, 1.0, 2.0])
    assert "force limit" in str(sim.scene)
