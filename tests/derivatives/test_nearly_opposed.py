"""Two rows of a contact that oppose each other but for 2e-5 of their entries (docs: gradients)."""

import dataclasses

import numpy as np

import slcp_warp as slcp
from slcp_warp.scripts.benchmarks.fuzz.judged import parameters
from slcp_warp.scripts.benchmarks.fuzz.tasks import Task


def of_random_mechanism(**options):
    """A contact on a lever of mu times its gap, which presses by 5e7 N s, and a gradient there."""
    task = Task(90001, 44, "specialised")
    scene = task.make_scene()
    given = dataclasses.replace(task.methods()[0][0], **options)
    worlds = task.worlds(0, scene).part([166])
    sim = slcp.Simulator(scene, given, device="cpu", dtype="float64", strategy="specialised")
    numbers = parameters(sim, worlds.numbers)
    weight = np.zeros((1, 2, sim.nx))
    weight[:, 1] = 1.0
    back = slcp.vjp(sim, worlds.x, np.zeros((1, 1, sim.nu)), weight, numbers)
    return sim, worlds.x, numbers, sim.linearize(worlds.x, worlds.u if sim.nu else None, numbers), back.x0[0]


def test_hard_contact_has_its_derivative():
    sim, x, numbers, found, back = of_random_mechanism(residual="hard")
    assert found.status[0] == 0
    size = np.abs(found.A).max()
    e = 1e-7
    for j in range(sim.nx):
        move = np.zeros(sim.nx)
        move[j] = e
        slope = (sim.step(x + move, None, numbers).state - sim.step(x - move, None, numbers).state) / (2 * e)
        np.testing.assert_allclose(found.A[0, :, j], slope[0], atol=1e-3 * size)
    np.testing.assert_allclose(back, found.A[0].sum(0), atol=1e-3 * size)


def test_a_hessian_without_digits_has_no_derivative():
    """A, squared: 2.5e-19 of the diagonal."""
    _sim, _x, _numbers, found, back = of_random_mechanism(residual="erm-normal")
    assert found.status[0] == slcp.Status.NOT_CONVERGED
    assert np.isnan(back).all()
