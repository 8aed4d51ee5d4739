"""Limits of force as the mean of a clamp, and D beside them: quadrature, closed forms and the oracle."""

import numpy as np
import pytest
from scipy.integrate import quad

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.scripts.benchmarks.fuzz.draws import Worlds
from slcp_warp.scripts.benchmarks.fuzz.judge import Outcome
from slcp_warp.scripts.benchmarks.fuzz.judged import judged
from slcp_warp.scripts.benchmarks.fuzz.verdicts import HOLDS

LIMIT, SIGMA, H = 5.0, 1.5, 0.01


def slider(sigma=SIGMA, stiffness=200.0, damping=20.0, limit=LIMIT, **more):
    """A mass of 1 kg on a rail that a servo drives."""
    tendon = slcp.Tendon("servo", ("slide.shift",), (1.0,), stiffness, damping, 0.0, limit, sigma)
    return slcp.Scene(
        "slider",
        (slcp.Body("slide", 1.0, 0.01, joint="prismatic", **more),),
        actuators=(slcp.Actuator(tendon="servo", gear=stiffness),),
        tendons=(tendon,),
        gravity=(0.0, 0.0),
        sigma=0.1,
        step_size=H,
    )


def mean_by_quadrature(f):
    """E[clip(f + xi)] of logistic xi, by its density."""

    def part(z):
        return np.clip(f + SIGMA * z, -LIMIT, LIMIT) / (4.0 * np.cosh(0.5 * z) ** 2)

    kinks = sorted((side * LIMIT - f) / SIGMA for side in (-1.0, 1.0))
    edges = [-60.0, *(k for k in kinks if abs(k) < 60.0), 60.0]
    return sum(quad(part, a, b, epsabs=1e-13, limit=200)[0] for a, b in zip(edges, edges[1:]))


def test_the_force_is_the_mean_of_the_clamp():
    """M (v' - v)/h is it, at what the step's end asks for, from far below the limit to far beyond."""
    sim = slcp.Simulator(slider(), dtype="float64")
    us = np.linspace(-0.4, 0.4, 41)[:, None]
    x = np.zeros((41, 2))
    new = sim.step(x, us).state[:, 1]
    asked = 200.0 * (us[:, 0] - 0.5 * H * new) - 20.0 * new
    assert np.abs(asked).max() > 10.0 * LIMIT
    np.testing.assert_allclose(new / H, [mean_by_quadrature(f) for f in asked], atol=1e-9)
    run = sim.rollout(x, us[:, None], record="controls")
    np.testing.assert_allclose(run.tendon_forces[:, 0, 0], new / H, atol=1e-9)


def test_hard_laws_have_the_clamp_and_small_noise_tends_to_it():
    us = np.full((1, 1), LIMIT / 200.0 * 1.21)  # by which the step's end asks for the limit
    clamp = slcp.Simulator(slider(0.0), slcp.Options("hard"), dtype="float64").rollout(np.zeros(2), us)
    hard = slcp.Simulator(slider(), slcp.Options("hard"), dtype="float64").rollout(np.zeros(2), us)
    np.testing.assert_array_equal(hard.states, clamp.states)
    apart = [
        np.abs(
            slcp.Simulator(slider(s), dtype="float64").rollout(np.zeros(2), us).states - clamp.states
        ).max()
        for s in (1e-1, 1e-3, 1e-5)
    ]
    assert 0.0 < apart[2] < 0.02 * apart[1] < 4e-4 * apart[0]


@pytest.mark.parametrize("stiffness", [200.0, 1e4, 1e7])
@pytest.mark.parametrize("share", [1e-6, 0.03, 1.0])
def test_means_that_act_on_each_other_are_found(stiffness, share):
    """A chain of five links whose servos ask for far too much, in 2,000 states."""
    names = [f"link{i}" for i in range(5)]
    links = tuple(
        slcp.Body(n, 1.0, 0.01, names[i - 1] if i else None, anchor=(0.3 * (i > 0), 0.0), com=(0.15, 0.0))
        for i, n in enumerate(names)
    )
    made = [
        slcp.limited_servo(b, stiffness, f, force_sigma=share * f) for b, f in zip(links, (30, 8, 4, 2, 1))
    ]
    tendons, motors = zip(*made)
    scene = slcp.Scene("chain", links, actuators=motors, tendons=tendons, step_size=H)
    sim, rng = slcp.Simulator(scene, dtype="float64"), np.random.default_rng(2)
    x = rng.normal(size=(2000, 10)) * np.repeat([1.0, 3.0], 5)
    u = rng.normal(size=(2000, 5)) * 0.3 + x[:, :5] * rng.integers(0, 2, (2000, 1))
    step = sim.step(x, u)
    assert (step.status == slcp.Status.SOLVED).all()
    numbers = {n: np.broadcast_to(v, (2000, *np.shape(v))) for n, v in scene.default_parameters().items()}
    verdicts, _ = judged(Worlds(numbers, x, u, np.zeros(2000, int)), sim, out=Outcome.of(step))
    assert (verdicts.verdict == HOLDS).all()


@pytest.mark.parametrize("residual", ["rem-logistic", "rem-normal"])
@pytest.mark.parametrize("stiffness", [1e3, 1e6])
@pytest.mark.parametrize("sigma", [0.0, 2.0])
def test_smoothed_contact_has_a_solution_whatever_yields(residual, stiffness, sigma):
    """A slider at a wall, by steps near its servo's limit. With the D of what had not yielded, another law on
    either side of the limit, 643 of 20,000 had none at 1e6 N/m.
    """
    scene = slider(sigma, stiffness, 50.0, 20.0, upper=0.0)
    sim, rng, n = (
        slcp.Simulator(scene, slcp.Options(residual), dtype="float64"),
        np.random.default_rng(0),
        5000,
    )
    x = np.stack([-np.abs(rng.normal(size=n)) * 3e-3, rng.normal(size=n) * 0.3], 1)
    u = rng.uniform(-0.002, 0.05, (n, 1)) * 2e4 / stiffness
    step = sim.step(x, u)
    assert (step.status == slcp.Status.SOLVED).all()
    numbers = {k: np.broadcast_to(v, (n, *np.shape(v))) for k, v in scene.default_parameters().items()}
    verdicts, _ = judged(Worlds(numbers, x, u, np.zeros(n, int)), sim, out=Outcome.of(step))
    assert (verdicts.verdict == HOLDS).all()


@pytest.mark.parametrize("share", [0.0, 0.03, 0.3, 3.0, 1e3])
def test_a_snake_of_servos_falls_on_the_ground(share):
    """Eight links on a floating base, each with a servo that asks for too much: contact has looks of its own
    at what yields; after those of the motion without it 210 of 300 worlds were lost.
    """
    bodies, shapes = [slcp.Body("base", 1.0, 0.01, joint="free")], [slcp.Shape("base", "base", "disc", 0.04)]
    for i in range(8):
        parent, name = bodies[-1].name, f"link{i}"
        bodies.append(slcp.Body(name, 0.5, 0.005, parent, anchor=(0.2 * (i > 0), 0.0), com=(0.1, 0.0)))
        shapes.append(slcp.Shape(name, name, "disc", 0.04, offset=(0.2, 0.0)))
    tendons, motors = zip(*(slcp.limited_servo(b, 1e3, 2.0, force_sigma=2.0 * share) for b in bodies[1:]))
    ground = slcp.Shape("ground", None, "halfplane", angle=np.pi / 2)
    scene = slcp.Scene(
        "snake",
        tuple(bodies),
        (ground, *shapes),
        slcp.touching(tuple(shapes), (ground,), 0.5),
        actuators=motors,
        tendons=tendons,
        sigma=0.05,
        step_size=0.01,
    )
    rng = np.random.default_rng(0)
    q = np.zeros((100, 11))
    q[:, 1] = 0.3
    x = np.concatenate([q, 2.0 * rng.normal(size=q.shape)], 1)
    u = np.repeat(0.3 * rng.normal(size=(100, 1, 8)), 60, 1)
    run = slcp.Simulator(scene, dtype="float64").rollout(x, u)
    assert (run.status == slcp.Status.SOLVED).all()


@pytest.mark.parametrize("residual", ["hard", "rem-logistic"])
@pytest.mark.parametrize("sigma", [0.0, 2.0])
def test_a_mass_bounces_by_where_its_motor_alone_leads(residual, sigma):
    """By the motion without contact, in which the motor gives what it can (M54): by that of a branch of the
    step 95 of 20,000 had no solution, and some did not bounce.
    """
    tendon = slcp.Tendon("servo", ("ball.shift",), (1.0,), 1e3, 20.0, 0.0, 20.0, sigma)
    ground = slcp.Shape("ground", None, "halfplane", angle=np.pi / 2)
    ball = slcp.Shape("ball", "ball", "disc", 0.05)
    scene = slcp.Scene(
        "bouncer",
        (slcp.Body("ball", 1.0, 0.01, joint="prismatic", axis=(0.0, 1.0)),),
        (ground, ball),
        slcp.touching((ball,), (ground,), restitution=0.5),
        actuators=(slcp.Actuator(tendon="servo", gear=1e3),),
        tendons=(tendon,),
        step_size=H,
    )
    sim, rng, n = (
        slcp.Simulator(scene, slcp.Options(residual), dtype="float64"),
        np.random.default_rng(0),
        5000,
    )
    x = np.stack([rng.uniform(0.04, 0.1, n), rng.uniform(-4.0, 0.0, n)], 1)
    u = rng.uniform(0.0, 0.12, (n, 1))
    step = sim.step(x, u)
    assert (step.status == slcp.Status.SOLVED).all()
    numbers = {k: np.broadcast_to(v, (n, *np.shape(v))) for k, v in scene.default_parameters().items()}
    verdicts, _ = judged(Worlds(numbers, x, u, np.zeros(n, int)), sim, out=Outcome.of(step))
    assert (verdicts.verdict == HOLDS).all()


def test_what_a_motor_presses_at_a_wall_rests_by_the_whole_mass():
    """A stalled motor of 20 N holds a mass in the layer of a wall where e^(-D F h/s) + e^(-w/s) = 1, D of the
    mass and all that its servo would add to it, 1/(m + h d + h^2/2 k).
    """
    scene = slider(0.0, 1e4, 50.0, 20.0, upper=0.0)
    sim = slcp.Simulator(scene, dtype="float64")
    rest = sim.rollout(np.array([-0.01, 0.0]), np.full((3000, 1), 0.1)).states[-1]
    scale = 1.0 / (1.0 + H * 50.0 + 0.5 * H**2 * 1e4)
    gap = -H * 0.1 * np.log1p(-np.exp(-scale * 20.0 * H / 0.1))
    assert abs(rest[1]) < 1e-12
    assert -rest[0] == pytest.approx(gap, rel=1e-9)


def test_gradients_by_the_limit_are_those_of_what_is_asked_for():
    """Far below the limit a line through 0 meets the mean. Its slope moves with the limit and its noise; the
    force at 0 does not.
    """
    sim = slcp.Simulator(slider(), dtype="float64")
    us, weight = np.full((1, 1, 1), 2e-7), np.array([[[0.0, 0.0], [0.0, 1.0]]])
    names = ("tendon_force_limit", "tendon_force_sigma")
    found = slcp.vjp(sim, np.zeros((1, 2)), us, weight, parameters=names).parameters
    for name, base in zip(names, (LIMIT, SIGMA)):
        ends = [
            sim.rollout(np.zeros((1, 2)), us, sim.params.replace(**{name: base * (1.0 + e)})).states[0, -1, 1]
            for e in (1e-4, -1e-4)
        ]
        slope = (ends[0] - ends[1]) / (2e-4 * base)
        assert abs(slope) > 1e-9
        np.testing.assert_allclose(found[name].ravel(), slope, rtol=1e-4)


def test_plans_see_a_slope_beyond_what_a_motor_gives():
    """Set-points that ask for 20 times the force: under the clamp nothing changes by them."""
    slopes = [
        np.abs(slcp.Simulator(slider(s), dtype="float64").linearize(np.zeros(2), [0.5]).B).max()
        for s in (0.0, 0.3 * LIMIT, LIMIT)
    ]
    assert slopes[0] == 0.0 < slopes[1] < slopes[2]


@pytest.mark.slow
def test_a_plan_goes_through_limits_that_are_means():
    """A two-link arm from 12 starts to a place, by set-points, with 12 and 3 N m. Under the clamp most of
    these end at a kink.
    """

    def solved(share, asked=False, starts=12):
        bodies = (
            slcp.Body("upper", 1.0, 0.02, com=(0.2, 0.0)),
            slcp.Body("fore", 0.6, 0.01, "upper", anchor=(0.4, 0.0), com=(0.15, 0.0)),
        )
        given = zip(bodies, (200.0, 60.0), (12.0, 3.0))
        tendons, motors = zip(*(slcp.limited_servo(b, k, f, force_sigma=share * f) for b, k, f in given))
        scene = slcp.Scene("arm", bodies, actuators=motors, tendons=tendons, step_size=0.02)
        names, goal = ("upper.angle", "fore.angle"), (0.6, 0.8)
        Term = slcp.costs.Term
        running = [
            Term(
                "square", 1e-3, control=f"{n}_servo", **({"minus": f"{n}.angle"} if asked else {"target": g})
            )
            for n, g in zip(("upper", "fore"), goal)
        ]
        final = [Term("square", 100.0, state=n, target=g) for n, g in zip(names, goal)]
        final += [Term("square", 1.0, state=n) for n in ("upper.vangle", "fore.vangle")]
        sim = slcp.Simulator(scene, dtype="float64")
        problem = ddp.Problem(sim, slcp.costs.terms(scene, running, final), 60)
        x0 = np.random.default_rng(1).normal(size=(12, 4)) * [0.3, 0.5, 0.5, 0.5] + [-1.5, 0.0, 0.0, 0.0]
        return ddp.solve(problem, x0[:starts], np.broadcast_to(goal, (starts, 60, 2)).copy())

    ends = ddp.Status.CONVERGED, ddp.Status.SMALL_IMPROVEMENT
    clamp, mean = solved(0.0), solved(0.03)
    assert (clamp.status == ddp.Status.LINE_SEARCH_FAILED).sum() >= 3
    assert (mean.status != ddp.Status.LINE_SEARCH_FAILED).all()
    assert np.isin(mean.status, ends).sum() >= 8
    assert np.median(mean.cost) < 1e-3
    spared = solved(0.03, asked=True, starts=4)  # a cost of what the springs are asked for
    assert (np.abs(spared.xs[:, -1, :2] - (0.6, 0.8)) < 1e-2).all()
    apart = [np.abs(each.us[:4] - each.xs[:4, :-1, :2]).max((1, 2)) for each in (spared, mean)]
    assert np.median(apart[0]) < 0.2 * np.median(apart[1])


def test_a_noise_without_a_limit_is_refused():
    with pytest.raises(slcp.SceneError, match="force_sigma is 1.0, of a force without a limit"):
        slider(1.0, limit=None)
    with pytest.raises(slcp.SceneError, match="force_sigma is -1.0; it must not be negative"):
        slider(-1.0)
