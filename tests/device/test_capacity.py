"""Scenes of more rows, or pairs, than a set of them has bits: every way in solves them or refuses them."""

import functools

import numpy as np
import pytest
import warp as wp

import slcp_warp as slcp
from slcp_warp import Actuator, Body, Contact, Scene, Shape, ddp
from slcp_warp.kernels.ensembles import sweep
from slcp_warp.kernels.gradients import adjoint
from slcp_warp.kernels.mechanism.kinematics import make_types
from slcp_warp.kernels.method import Method
from slcp_warp.kernels.plain import complementarity
from slcp_warp.kernels.policies.open_loop import OPEN_LOOP
from slcp_warp.kernels.specialisation import Specialisation
from slcp_warp.kernels.step import rollout
from slcp_warp.kernels.structure import MOST_ROWS, CapacityError

MANY = {"rows": (20, 0.5), "pairs": (36, None)}  # points under a body, and their friction


@functools.cache
def sled(points, friction):
    """A free body over the ground on the last four of its points, and a cart that is pushed."""
    at = [(x, -0.03) for x in np.linspace(-0.5, 0.5, points - 4)]
    at += [(x, -0.05) for x in (-0.4, -0.2, 0.2, 0.4)]
    shapes = (
        *(Shape(f"p{i}", "sled", "disc", 0.0, offset=xy) for i, xy in enumerate(at)),
        Shape("ground", None, "halfplane", angle=np.pi / 2),
    )
    contacts = tuple(Contact("ground", f"p{i}", 0.0 if friction is None else friction) for i in range(points))
    bodies = (Body("sled", 1.0, 0.1, joint="free"), Body("cart", 1.0, 0.1, joint="prismatic"))
    start = (0.0, 0.051, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return Scene("sled", bodies, shapes, contacts, actuators=(Actuator("cart"),), initial_state=start)


@pytest.fixture(params=MANY)
def large(request):
    return sled(*MANY[request.param])


def simulator(scene, residual="rem-logistic", **options):
    return slcp.Simulator(scene, slcp.Options(residual=residual, **options), device="cpu")


def hold(scene):
    """A policy that does nothing."""
    nx = 2 * scene.nv
    plan = {"us": np.zeros((1, 1)), "xs": np.zeros((2, nx)), "K": np.zeros((1, 1, nx))}
    return ddp.TrackingPolicy(type("Plan", (), plan))


def cost(scene):
    return ddp.costs.quadratic(np.eye(2 * scene.nv), np.eye(1))


W = np.linspace(-1.0, 1.0, 8)  # of the states after two steps, whose gradient by the first one is asked for
US = np.zeros((1, 2, 1))


def touching(scene):
    """On its points, .1 mm inside, the cart at 1 m/s."""
    x = np.array(scene.x0)
    x[1], x[7] = 0.0499, 1.0
    return x


def by_differences(sim, x, step=1e-6):
    """The gradient of W x_2 by x_0."""
    moved = np.repeat(x[None], 16, 0) + step * np.r_[np.eye(8), -np.eye(8)]
    run = sim.rollout(moved, np.zeros((16, 2, 1)))
    assert not run.status.any()
    after = run.states[:, -1] @ W
    return (after[:8] - after[8:]) / (2.0 * step)


def linearized(sim, x):
    first, second = (sim.linearize(y).A for y in (x, sim.step(x).state))
    return W @ second @ first


def taped(sim, x, **kept):
    x0 = wp.array(x[None], dtype=wp.float64, device="cpu", requires_grad=True)
    with wp.Tape() as tape:
        run = sim.rollout(x0, wp.zeros((1, 2, 1), dtype=wp.float64, device="cpu"), **kept)
    weights = np.zeros(run.states.shape)
    weights[0, -1] = W
    tape.backward(grads={run.states: wp.array(weights, dtype=wp.float64, device="cpu")})
    return x0.grad.numpy()[0]


def by_torch(sim, x):
    torch = pytest.importorskip("torch")
    from slcp_warp import torch as differentiable

    start = torch.tensor(x, requires_grad=True)
    states = differentiable.rollout(sim, start, torch.zeros((2, 1), dtype=torch.float64))
    (states[0] if isinstance(states, tuple) else states)[-1].dot(torch.tensor(W)).backward()
    return start.grad.numpy()


def pulled(sim, x):
    weights = np.zeros((1, 3, 8))
    weights[0, -1] = W
    return slcp.vjp(sim, x[None], US, weights).x0[0]


def pushed(sim, x):
    worlds = np.repeat(x[None], 8, 0)
    return slcp.jvp(sim, worlds, np.zeros((8, 2, 1)), np.eye(8)).tangent[:, -1] @ W


GRADIENTS = {
    "linearize": linearized,
    "checkpoint": lambda sim, x: taped(sim, x, checkpoint=1),
    "tape": taped,
    "torch": by_torch,
    "vjp": pulled,
    "jvp": pushed,
}


def planned(sim, x):
    return ddp.solve(ddp.Problem(sim, cost(sim.scene), 2), x, US[0]).us


def planned_from_two(sim, x):
    starts = np.stack([US[0], US[0] + 1.0])
    return ddp.solve_multistart(ddp.Problem(sim, cost(sim.scene), 2), x, starts).best.us


PLANS = {"ddp": planned, "multistart": planned_from_two}
REFUSED = {
    "specialised": lambda sim, x: slcp.Simulator(sim.scene, device="cpu", strategy="specialised"),
    "trapezoidal": lambda sim, x: simulator(sim.scene, integrator="trapezoidal"),
    "gap at the end": lambda sim, x: simulator(sim.scene, "hard", gap="end"),
    "erm": lambda sim, x: simulator(sim.scene, "erm-normal"),
    "noise of the state": lambda sim, x: simulator(sim.scene, noise="state"),
    "specialised sweep": lambda sim, x: slcp.sweep(
        sim.scene, hold(sim.scene), slcp.SweepSpec(worlds=1), device="cpu", strategy="specialised"
    ),
    "trapezoidal sweep": lambda sim, x: slcp.sweep(
        sim.scene, hold(sim.scene), slcp.SweepSpec(worlds=1), device="cpu", integrator="trapezoidal"
    ),
}  # fmt: skip


@pytest.mark.parametrize("way", GRADIENTS)
def test_derivatives_are_differences(large, way):
    sim, x = simulator(large), touching(large)
    expected = by_differences(sim, x)
    assert np.ptp(expected[:3]) > 0.1  # contact stops what it would else hand on
    np.testing.assert_allclose(GRADIENTS[way](sim, x), expected, rtol=0, atol=1e-6 * np.abs(expected).max())


def test_a_weighted_hessian_is_a_difference_of_gradients(large):
    sim, x = simulator(large), touching(large)
    hessian, status = slcp.weighted_hessian(sim, x[None], US[:, 0], W[None])
    sides = [sim.linearize(x + side * 1e-6 * np.eye(8)).A for side in (1.0, -1.0)]
    expected = np.einsum("i,bij->bj", W, sides[0] - sides[1]) / 2e-6
    assert not status.any() and np.abs(expected).max() > 1.0
    np.testing.assert_allclose(hessian[0, :8, :8], expected, rtol=0, atol=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize("way", PLANS)
def test_plans_are_minima(large, way):
    """Of the sum of x'x/2 + u'u/2, worked out of a rollout: any other control costs more."""
    sim, x = simulator(large), touching(large)
    us = np.reshape(PLANS[way](sim, x), (1, 2, 1))
    moved = us + np.array([[0, 0], [1e-2, 0], [-1e-2, 0], [0, 1e-2], [0, -1e-2]])[:, :, None]
    run = sim.rollout(np.repeat(x[None], 5, 0), moved)
    total = 0.5 * (run.states[:, :-1] ** 2).sum((1, 2)) + 0.5 * (moved**2).sum((1, 2))
    assert np.abs(us).max() > 1e-3 and (total[1:] > total[0]).all()


def test_a_library_is_built(large):
    """Its first entry is what a plan of its horizon begins with."""
    sim, x = simulator(large), touching(large)
    problem = ddp.Problem(sim, cost(large), 5)
    library = ddp.build_library(problem, x, 2)
    plan = ddp.solve(problem, x, np.zeros((5, 1)))
    assert len(library) == 2 and np.array_equal(library.x[0], plan.xs[library.age[0]])
    np.testing.assert_allclose(library.u[0], plan.us[library.age[0]], rtol=0, atol=1e-6)


@pytest.mark.parametrize("way", REFUSED)
def test_refused(large, way):
    with pytest.raises(slcp.StrategyError):
        REFUSED[way](simulator(large), large.x0)


@pytest.mark.parametrize("residual", ["rem-logistic", "hard"])
def test_solved(large, residual):
    """Steps, rollouts, particles and sweeps: the body rests on its points."""
    sim = simulator(large, residual)
    params = sim.params.replace(sigma=1e-3)
    states = sim.rollout(large.x0, np.zeros((100, 1)), params).states
    held = sim.rollout(large.x0, params=params, policy=hold(large), steps=100).states
    np.testing.assert_allclose(held, states, rtol=0, atol=1e-9)
    weight = sim.step(states[-1], None, params).contact_impulse[:, 0].sum() / params["step_size"]
    np.testing.assert_allclose(weight, 9.81, rtol=1e-3)
    assert np.abs(states[:, 1] - 0.051).max() < 2e-3
    spec = slcp.SweepSpec(worlds=5, duration=2.0, residuals=(residual,), step_sizes=(0.01,), observe=1,
                          window=1.0, velocity_sd=0.0, torque_sd=0.1, parameters={"sigma": 1e-3})  # fmt: skip
    report = slcp.sweep(large, hold(large), spec, device="cpu", dtype="float64")
    assert (report.table["status"] == 0).all()
    assert np.abs(report.samples[0]).max() < 2e-3  # 1 m in 0.45 s where a row is ignored
    assert (report.table["contact_share"] > 0.8).all() and (np.abs(report.table["lowest_gap"]) < 3e-3).all()
    if residual == "hard":
        cloud = slcp.particles(sim, large.x0, covariance=1e-8 * np.eye(8), count=50)
        assert cloud.solved == 50


@pytest.mark.slow
def test_a_sweep_does_not_depend_on_its_kernels(device):
    """Starts, kicks, noise of parameters and torques, samples and contacts: as in one launch."""
    scene, rng = slcp.scenes.flicking_finger(), np.random.default_rng(1)
    plan = {"us": 0.3 * rng.standard_normal((20, 2)), "xs": np.tile(scene.x0, (21, 1)),
            "K": 0.1 * rng.standard_normal((20, 2, 6))}  # fmt: skip
    policy = ddp.TrackingPolicy(type("Plan", (), plan), scene.state_period)
    spec = slcp.SweepSpec(
        worlds=60, duration=2.0, window=1.0, sample_every=0.25, velocity_sd=1.0, torque_sd=0.3, observe=2,
        parameter_sd={"mass": 0.2, "step_size": 0.1}, kick_times=(0.5, 1.0), kick_sd=1.0,
        residuals=("rem-logistic",),
    )  # fmt: skip
    one, other, split = (
        slcp.sweep(scene, policy, spec, scaling="none", dtype="float64", device=device, **way)
        for way in ({"strategy": "specialised"}, {"strategy": "generic"}, {"strategy": "generic", "chunk": 7})
    )
    assert (one.table["status"] == 0).all() and one.table["contact_share"].max() > 0.1
    np.testing.assert_allclose(other.samples[0], one.samples[0], atol=1e-5)
    for name in ("contact_share", "lowest_gap", "status", "drawn_link1.mass", "drawn_step_size"):
        np.testing.assert_allclose(other.table[name], one.table[name], rtol=1e-5, err_msg=name)
    np.testing.assert_array_equal(split.samples[0], other.samples[0])


def of(structure, method=None):
    return Specialisation(structure, wp.float64, method or Method())


FACTORIES = {
    "types": lambda s: make_types(s, wp.float64),
    "step": lambda s: rollout.make_step_kernel(of(s)),
    "rollout": lambda s: rollout.make_rollout_kernel(of(s), OPEN_LOOP, False),
    "gap at the end": lambda s: rollout.make_step_kernel(of(s, Method("hard", gap="end"))),
    "sweep": lambda s: sweep.make_sweep_kernel(of(s), OPEN_LOOP),
    "adjoint": lambda s: adjoint.make_adjoint_kernel(of(s), True, False),
}


@pytest.mark.parametrize("kernel", FACTORIES)
def test_no_factory_makes_a_kernel_with_too_few_bits(kernel):
    """Whoever calls it. One row less than an int has bits is the most: the next one would be its sign."""
    for points, friction in MANY.values():
        with pytest.raises(CapacityError, match=f"at most {MOST_ROWS} rows"):
            FACTORIES[kernel](sled(points, friction).structure)


def test_plain_problems_have_the_same_bound():
    A = np.eye(MOST_ROWS + 1)
    with pytest.raises(slcp.ArrayError, match=f"n <= {MOST_ROWS}"):
        slcp.solve_complementarity(A, A[0])
    with pytest.raises(CapacityError):
        complementarity.make_complementarity_kernel(
            MOST_ROWS + 1, wp.float64, complementarity.method_of("hard", "none"), False
        )
    assert MOST_ROWS == np.iinfo(np.int32).bits - 1
