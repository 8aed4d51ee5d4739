"""Implicit damping: decay for every c h/m, energy, contact, order, derivatives where dampers are stiff."""

import dataclasses

import numpy as np
import pytest
from differences import differences
from oracle import Oracle, residual
from parameter_checks import check, errors, lever, smooth, states
from random_scenes import near_contact
from scipy.integrate import solve_ivp
from simulators import WIDTH

import slcp_warp as slcp

H = 0.01
RATIOS = np.geomspace(0.1, 1e4, 21)  # x = c h/m
INTEGRATORS = ("euler", "trapezoidal")


def slider(damping=0.0, **changes):
    body = slcp.Body("slider", 1.0, 0.1, joint="prismatic", damping=damping)
    return slcp.Scene("slider", (body,), step_size=H, gravity=(0.0, 0.0), **changes)


def simulators(scene, device, dtype="float64", **options):
    """One for every integrator and kernel strategy that there is, by name."""
    euler, trapezoidal = (slcp.Options(integrator=name, **options) for name in INTEGRATORS)
    return {
        "euler": slcp.Simulator(scene, euler, device=device, dtype=dtype),
        "generic": slcp.Simulator(scene, euler, device=device, dtype=dtype, strategy="generic"),
        "trapezoidal": slcp.Simulator(scene, trapezoidal, device=device, dtype=dtype),
    }


def test_a_slider_decays_as_the_rules_say(device, dtype):
    """v_k = v_0/(1 + x)^k with Euler, v_0/(1 + x + x^2/2)^k with the trapezoidal rule, no change of sign."""
    rounding = {"float64": 1e-14, "float32": 1e-6}[WIDTH[dtype]]
    factor = {"euler": 1 + RATIOS, "generic": 1 + RATIOS, "trapezoidal": 1 + RATIOS + RATIOS**2 / 2}
    x = np.tile([0.0, 1.0], (len(RATIOS), 1))
    for name, sim in simulators(slider(), device, WIDTH[dtype]).items():
        run = sim.rollout(x, np.zeros((len(x), 30, 0)), sim.params.replace(damping=RATIOS[:, None] / H))
        assert not run.status.any()
        v = run.states[:, :, 1].astype(float)
        exact = factor[name][:, None] ** -np.arange(31.0)
        assert (np.abs(v - exact) <= 60 * rounding).all(), name
        before, after = v[:, :-1], v[:, 1:]  # a step is right to rounding of what it starts from
        error = np.abs(after - before / factor[name][:, None])
        assert (error <= rounding * np.abs(before) + 1e-37).all(), name
        assert (np.abs(after) <= np.abs(before)).all(), name
        assert (after * np.sign(before) >= -rounding * np.abs(before) - 1e-37).all(), name


def test_a_scene_can_keep_the_explicit_rule(device):
    """v_k = v_0 (1 - x)^k, the paper's r(q, v): what was there before diverges for x > 2."""
    sim = slcp.Simulator(slider(300.0, implicit_damping=False), device=device, dtype="float64")
    run = sim.rollout(np.array([0.0, 1.0]), np.zeros((20, 0)))
    np.testing.assert_allclose(run.states[:, 1], (-2.0) ** np.arange(21), rtol=1e-12)
    finger = slcp.scenes.flicking_finger()
    assert not finger.implicit_damping and not finger.structure.implicit_damping
    assert slcp.Scene("a", slider().bodies).implicit_damping


def damped_links(gravity=(0.0, 0.0)):
    """A double pendulum."""
    links = (
        slcp.Body("upper", 1.0, 0.05, com=(0.5, 0.0), damping=1.0),
        slcp.Body("lower", 1.0, 0.02, parent="upper", anchor=(1.0, 0.0), com=(0.4, 0.0), damping=1.0),
    )
    return slcp.Scene("damped_links", links, gravity=gravity, step_size=H)


def tied_bodies():
    """Two free bodies tied to each other and to the world by dampers between points; nothing else acts."""
    bodies = (slcp.Body("a", 1.0, 0.05, joint="free"), slcp.Body("b", 0.5, 0.02, joint="free"))
    springs = (
        slcp.Spring("a", "b", (0.3, 0.1), (-0.2, 0.1), damping=1.0),
        slcp.Spring("a", "b", (0.3, -0.1), (-0.2, -0.1), damping=1.0),
        slcp.Spring(None, "a", (-0.6, 0.1), (-0.3, 0.0), damping=1.0),
    )
    start = (0.0, 0.0, 0.0, 1.0, 0.1, 0.3, *np.zeros(6))
    return slcp.Scene("tied_bodies", bodies, springs=springs, gravity=(0.0, 0.0), step_size=H,
                      initial_state=start)  # fmt: skip


def kinetic(scene, x, **changes):
    q, v = x[..., : scene.nv], x[..., scene.nv :]
    return 0.5 * np.einsum("...i,...ij,...j->...", v, Oracle(scene, **changes).mass_matrix(q), v)


@pytest.mark.parametrize("make, names", [
    (damped_links, ("damping",)), (tied_bodies, ("spring_damping",)),
])  # fmt: skip
def test_energy_never_grows_where_only_dampers_act(device, make, names):
    """From c h/m = .1 to 1e4 in bodies that are coupled; springs turn as they shorten."""
    scene = make()
    rng = np.random.default_rng(1)
    x = np.tile(scene.x0, (len(RATIOS), 1))
    x[:, scene.nv :] = 0.5 * rng.standard_normal((len(x), scene.nv))
    steps = 60
    for name, sim in simulators(scene, device).items():
        params = sim.params.replace(**{key: np.multiply.outer(RATIOS / H, np.ones(sim.params[key].shape))
                                       for key in names})  # fmt: skip
        run = sim.rollout(x, np.zeros((len(x), steps, 0)), params)
        assert not run.status.any(), name
        energy = kinetic(scene, run.states)
        # the trapezoidal rule keeps the energy of what turns freely to (h speed/length)^2 only
        start = energy[:, :1] * (1e-3 if name == "trapezoidal" and make is tied_bodies else 1e-9)
        assert (energy[:, 1:] <= energy[:, :-1] + start).all(), name
        assert (energy[:, 1:] < energy[:, :1]).all(), name
        if make is damped_links:
            assert (energy[:, -1] < 0.05 * energy[:, 0]).all(), name


def pushed_sliders():
    """A driven slider behind a damped one, both on one line, and the exact rest of neither."""
    bodies = (
        slcp.Body("pusher", 0.5, 0.1, joint="prismatic"),
        slcp.Body("load", 1.0, 0.1, joint="prismatic", anchor=(1.0, 0.0), damping=1.0),
    )
    shapes = (slcp.Shape("pusher", "pusher", "disc", 0.5), slcp.Shape("load", "load", "disc", 0.5))
    return slcp.Scene("pushed_sliders", bodies, shapes, (slcp.Contact("pusher", "load"),),
                      (slcp.Actuator("pusher"),), gravity=(0.0, 0.0), step_size=H)  # fmt: skip


def test_what_pushes_a_damper_feels_its_force(device):
    """Through a hard contact the two move at u/c in the end, and the contact carries u."""
    for name, sim in simulators(pushed_sliders(), device, residual="hard").items():
        c = RATIOS / H
        params = sim.params.replace(damping=np.stack([0.0 * c, c], 1))
        us = np.ones((len(c), 600, 1))
        run = sim.rollout(np.zeros((len(c), 4)), us, params, record="impulse")
        assert not run.status.any(), name
        stiff = c > 10.0  # others are not at the end yet
        end = run.states[stiff, -1, 2:]
        np.testing.assert_allclose(end, np.stack([1.0 / c[stiff]] * 2, axis=1), rtol=1e-6)
        np.testing.assert_allclose(run.impulse[stiff, -1, 0], H, rtol=1e-6)
        first = run.states[:, 1, 2:]
        assert (first >= 0.0).all() and (np.diff(run.states[:, :, 2:], axis=1) > -1e-12).all(), name


def net():
    """Free discs over ground, tied in another order than the scene names them: blocks of M + h C."""
    names = ("a", "b", "c", "d", "e")
    bodies = tuple(slcp.Body(n, 0.5 + 0.2 * i, 0.02, joint="free") for i, n in enumerate(names))
    shapes = (slcp.Shape("ground", None, "halfplane", angle=np.pi / 2),
              *(slcp.Shape(n, n, "disc", 0.2) for n in names))  # fmt: skip
    contacts = (*(slcp.Contact("ground", n, 0.5) for n in names), slcp.Contact("b", "c", 0.3))
    ties = (("a", "d"), ("d", "b"), ("e", None), ("d", "a"))
    springs = tuple(slcp.Spring(one, other, (0.1, 0.05 * i), (-0.1, 0.1 * i), stiffness=20.0, damping=3.0,
                                length=0.4) for i, (one, other) in enumerate(ties))  # fmt: skip
    start = np.array([[0.5 * i, 0.21, 0.0] for i in (0, 2, 3, 1, 5)]).ravel()
    return slcp.Scene("net", bodies, shapes, contacts, springs=springs, step_size=H,
                      initial_state=(*start, *np.zeros(15)))  # fmt: skip


@pytest.mark.parametrize("stiff", [1.0, 1e3])
@pytest.mark.parametrize("make", [net, lever])
def test_contact_with_dampers_is_the_oracles(device, make, stiff):
    """(M + h C) v' = M v + h (r + u) + J' lambda with r without dampers, and w, in both kernel strategies."""
    scene = make()
    rng = np.random.default_rng(2)
    x = near_contact(scene, rng, 60, gaps=(0.0, 0.005, -0.02), spread=0.1)
    changes = {"spring_damping": stiff * scene.default_parameters()["spring_damping"],
               "damping": stiff * rng.uniform(0.1, 1.0, scene.nv)}  # fmt: skip
    problem = Oracle(scene, **changes).problem(x)
    sims = simulators(scene, device)
    size = np.abs(problem["vfree"]).max(1, keepdims=True) + np.abs(problem["rate"]).max(1, keepdims=True)
    for name in ("euler", "generic"):
        sim = sims[name]
        step = sim.step(x, params=sim.params.replace(**changes))
        assert not step.status.any()
        assert (step.impulse > 1e-3).any(0).mean() > 0.4
        r1, r2 = residual(problem, step.state[:, scene.nv :], step.impulse)
        inertia = np.einsum("...ii->...i", problem["M"])
        assert (np.abs(r1) <= 1e-11 * inertia.max(1, keepdims=True) * size).all(), name
        assert (np.abs(r2) <= 1e-10 * size).all(), name


def pendulums(spring_damping=0.0, damping=0.0):
    """Two hinged links tied to each other by a spring with a damper."""
    links = (slcp.Body("one", 1.0, 0.05, com=(0.5, 0.0), damping=damping),
             slcp.Body("two", 1.0, 0.02, anchor=(1.0, 0.0), com=(0.4, 0.0), damping=damping))  # fmt: skip
    spring = slcp.Spring("one", "two", (0.8, 0.0), (0.5, 0.0), 10.0, spring_damping, 0.5)
    return slcp.Scene("pendulums", links, springs=(spring,), initial_state=(-1.0, -0.5, 0.0, 0.0))


def test_lightly_damped_motion_is_second_order(device):
    """Dampers in joints, and between points that turn."""
    sim = slcp.Simulator(pendulums(), slcp.Options(integrator="trapezoidal"), device=device, dtype="float64")
    x0 = sim.scene.x0
    for numbers in ({"damping": 0.5}, {"spring_damping": 2.0}):
        truth = Oracle(sim.scene, **{k: np.full(sim.params[k].shape, v) for k, v in numbers.items()})

        def motion(t, x, truth=truth):
            return np.concatenate(
                [x[2:], np.linalg.solve(truth.mass_matrix(x[:2]), truth.force(x[:2], x[2:]))]
            )

        exact = solve_ivp(motion, (0.0, 1.0), x0, method="DOP853", rtol=1e-11, atol=1e-11).y[:, -1]
        miss = []
        for h in (0.02, 0.01, 0.005):
            run = sim.rollout(x0, np.zeros((round(1 / h), 0)), sim.params.replace(step_size=h, **numbers))
            miss.append(np.abs(run.states[-1] - exact).max())
        miss = np.array(miss)
        assert miss[0] < 2e-2 and (miss[:-1] / miss[1:] > 3.5).all(), (numbers, miss)


def test_stiff_springs_with_dampers(device):
    """Euler with explicit springs is stable for h^2 k < 4 m + 2 h c, with implicit ones for all k and c, like
    the trapezoidal rule.
    """
    body = slcp.Body("slider", 1.0, 0.1, joint="prismatic", stiffness=1.0, damping=1.0)
    scene = slcp.Scene("sprung_slider", (body,), gravity=(0.0, 0.0), step_size=H)
    early = dataclasses.replace(scene, implicit_stiffness=False)
    x = np.repeat([0.01, 1.0, 100.0, 1e4], 3)
    limit = 4.0 + 2.0 * x
    late, explicit = (simulators(sc, device) for sc in (scene, early))
    rules = {f"explicit {name}": explicit[name] for name in ("euler", "generic")} | late
    for name, sim in rules.items():
        bounded = not name.startswith("explicit")
        share = np.tile([0.5, 10.0, 1e4] if bounded else [0.5, 0.99, 1.01], 4)
        params = sim.params.replace(damping=x[:, None] / H, stiffness=(share * limit)[:, None] / H**2)
        run = sim.rollout(np.tile([1e-3, 0.0], (len(x), 1)), np.zeros((len(x), 4000, 0)), params)
        stretch = np.abs(run.states[:, :, 0]).max(1)
        np.testing.assert_array_equal(stretch < 1e-2, (share < 1.0) | bounded, err_msg=name)


STIFF = {"damping": 80.0, "spring_damping": 300.0}
STIFF_SPRINGS = {"damping": 0.1, "spring_stiffness": 2e4}  # (h omega)^2 of 8


@pytest.mark.slow
@pytest.mark.parametrize(
    "integrator, residual",
    [("euler", "rem-logistic"), pytest.param("trapezoidal", "erm-logistic", marks=pytest.mark.full)],
    ids=INTEGRATORS,
)
def test_derivatives_where_dampers_are_stiff(device, integrator, residual):
    """A, B, second derivatives, and the gradient by every parameter, light dampers and stiff ones, and with
    Euler's step stiff springs.

    The gradients of REM through the trapezoidal rule are looked at in tests/solvers/test_erm.py.
    """
    scene = lever()
    options = slcp.Options(residual, integrator=integrator)
    sim = slcp.Simulator(scene, options, device=device, dtype="float64")
    x, u, force = states(scene, 40)
    for changes in ({"damping": 0.1}, STIFF, *([STIFF_SPRINGS] if integrator == "euler" else [])):
        params = sim.params.replace(**changes)

        def jacobians(x, u, params=params):
            lin = sim.linearize(x, u, params, second=integrator == "euler")  # one kernel, not two
            assert not lin.status.any()
            return np.concatenate([lin.A, lin.B], axis=-1)

        exact = differences(lambda x, u, params=params: sim.step(x, u, params).state, x, u)
        scale = 1.0 + np.abs(exact).max((1, 2), keepdims=True)
        assert (np.abs(jacobians(x, u) - exact) / scale).max() < 1e-6
        if integrator == "euler":
            second = sim.linearize(x, u, params, second=True).second
            exact = differences(lambda x, u: jacobians(x, u)[:, scene.nv :], x, u)
            scale = 1.0 + np.abs(exact).max((1, 2, 3), keepdims=True)
            assert (np.abs(second - exact) / scale).max() < 1e-6
        check(errors(sim, x, u, params, force, smooth))
