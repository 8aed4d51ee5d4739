"""What a world does with numbers that are not finite, and with its last step's normals."""

import numpy as np
import pytest
import warp as wp
from simulators import scene, simulator

import slcp_warp as slcp
from slcp_warp.kernels.method import Method
from slcp_warp.kernels.specialisation import Specialisation
from slcp_warp.kernels.step.rollout import make_batch
from slcp_warp.kernels.step.step import make_step

BAD = {"NaN": np.nan, "infinite": np.inf}


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
@pytest.mark.parametrize("what", BAD)
def test_a_state_that_is_not_finite_is_not_solved_without_contacts_either(device, strategy, what):
    """A tree without a single row: nothing but the check of the numbers themselves can notice."""
    sim = slcp.Simulator(scene("tree0"), device=device, dtype="float64", strategy=strategy)
    assert sim.nr == 0
    good = 0.1 * np.random.default_rng(0).standard_normal(sim.nx)
    x = np.tile(good, (sim.nx + 1, 1))
    x[np.arange(sim.nx), np.arange(sim.nx)] = BAD[what]
    step = sim.step(x)
    assert (step.status[:-1] == slcp.Status.NONFINITE).all() and step.status[-1] == 0
    np.testing.assert_array_equal(step.state[:-1], x[:-1])
    traj = sim.rollout(x, np.zeros((len(x), 3, sim.nu)))
    assert (traj.status[:-1] == slcp.Status.NONFINITE).all() and traj.status[-1] == 0
    np.testing.assert_array_equal(traj.states[:-1, -1], x[:-1])


def test_a_warm_start_brings_both_components_of_every_normal(device):
    """Normals are stored beside the multipliers, of any length; a pair without one starts cold."""
    structure, dtype = scene("menagerie").structure, wp.float64
    pairs, rows = len(structure.pairs), structure.nr
    batch = make_batch(Specialisation(structure, dtype, Method()), False)

    @wp.kernel(module="unique", enable_backward=False)
    def read(warm: wp.array2d(dtype=dtype), z: wp.array2d(dtype=dtype), normal: wp.array2d(dtype=dtype)):
        world = wp.tid()
        carry = batch.warm_carry(warm, world)
        for i in range(wp.static(rows)):
            z[world, i] = carry.z[i]
        for i in range(wp.static(2 * pairs)):
            normal[world, i] = carry.normal[i]

    rng = np.random.default_rng(0)
    given = rng.standard_normal((5, rows + 2 * pairs))
    given[4, rows:] = 0.0
    z, normal = (wp.zeros((5, n), dtype=dtype, device=device) for n in (rows, 2 * pairs))
    wp.launch(read, dim=5, inputs=[wp.array(given, dtype=dtype, device=device), z, normal], device=device)
    np.testing.assert_array_equal(z.numpy(), given[:, :rows])
    pair = given[:, rows:].reshape(5, pairs, 2)
    length = np.linalg.norm(pair, axis=2, keepdims=True)
    expected = np.divide(pair, length, out=np.zeros_like(pair), where=length > 0.0)
    np.testing.assert_allclose(normal.numpy().reshape(5, pairs, 2), expected, rtol=0, atol=4e-16)
    cold = wp.zeros((0, rows + 2 * pairs), dtype=dtype, device=device)
    wp.launch(read, dim=5, inputs=[cold, z, normal], device=device)
    assert (z.numpy() > 1e20).all()  # no multiplier: every row starts from the velocity


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
def test_a_rollout_is_its_steps_in_every_world(device, strategy):
    """Every step has its own controls, every world its own numbers and external force."""
    sc, steps, worlds = scene("flicking_finger"), 3, 4
    sim = slcp.Simulator(sc, slcp.Options(scaling="none"), device=device, dtype="float64", strategy=strategy)
    rng = np.random.default_rng(2)
    x0 = np.array([-1.0, -1.0, 0.3, 0.0, 0.0, 0.0]) + 0.1 * rng.standard_normal((worlds, 6))
    us, force = rng.standard_normal((worlds, steps, 2)), rng.standard_normal((worlds, 3, 3))
    numbers = {"mass": rng.uniform(0.8, 1.2, (worlds, 3)), "step_size": rng.uniform(0.03, 0.05, worlds)}
    params = sim.params.replace(**numbers)
    run = sim.rollout(x0, us, params, external_force=force)
    assert not run.status.any()
    for world in range(worlds):
        own = sim.params.replace(**{name: value[world] for name, value in numbers.items()})
        x = x0[world]
        for k in range(steps):
            x = sim.step(x, us[world, k], own, external_force=force[world]).state
            np.testing.assert_allclose(run.states[world, k + 1], x, rtol=0, atol=1e-10)


@pytest.mark.parametrize("dtype, far, accuracy", [("float64", 34.0, 1e-9), ("float32", 15.0, 2e-4)])
def test_an_impulse_below_rounding_is_right(device, dtype, far, accuracy):
    """A particle above the ground: (17) for one row, e^(-dv/sigma) + e^(-w/sigma) = 1 with w = d/h + dv."""
    sim = slcp.Simulator(scene("particle"), device=device, dtype=dtype)
    sigma, h = 0.1, sim.scene.step_size
    params = sim.params.replace(gravity=0.0, sigma=sigma)
    w = sigma * np.linspace(1.0, far, 30)
    change = -sigma * np.log1p(-np.exp(-w / sigma))
    x = np.zeros((30, 6))
    x[:, 1] = h * (w - change)
    x = x.astype(dtype).astype(float)
    for _ in range(3):  # the state as the kernel sees it
        change = -sigma * np.log1p(-np.exp(-(x[:, 1] / h + change) / sigma))
    step = sim.step(x, None, params)
    assert not step.status.any()
    np.testing.assert_allclose(step.impulse[:, 0], change, rtol=accuracy)  # of a mass of 1


def test_a_warm_start_changes_no_solution(device):
    sim = simulator("turned_pair", device)
    rng = np.random.default_rng(1)
    x = np.tile(sim.scene.x0, (60, 1))
    x[:, 3:5] = rng.uniform(0.7, 1.4, (60, 1)) * np.stack([np.cos(turn := rng.uniform(-3, 3, 60)),
                                                           np.sin(turn)], -1)  # fmt: skip
    x[:, sim.nx // 2 :] = 0.3 * rng.standard_normal((60, sim.nx // 2))
    first = sim.step(x)
    again = sim.step(x, warm_start=first.multiplier)
    touching = np.abs(first.impulse).max(axis=1) > 1e-6
    assert 5 < touching.sum() and (first.status == 0).all()
    np.testing.assert_array_equal(again.status, first.status)
    np.testing.assert_allclose(again.state, first.state, rtol=0, atol=1e-9)


def test_methods_share_what_depends_on_the_mechanism_alone():
    """Else every method would translate and compile the mechanism's functions anew."""
    structure = scene("tree0").structure
    steps = [
        make_step(Specialisation(structure, wp.float64, method), False)
        for method in (Method(), Method("hard"), Method(scaling="none"))
    ]
    assert all(step.mech is steps[0].mech and step.types is steps[0].types for step in steps)
    assert steps[0].solve_step is not steps[1].solve_step
