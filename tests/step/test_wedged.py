"""Discs wedged between walls that they just fit: rows dependent but for 1e-7, impulses 1e5 times the data."""

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp.scripts.benchmarks.fuzz.draws import Worlds
from slcp_warp.scripts.benchmarks.fuzz.judged import judged
from slcp_warp.scripts.benchmarks.fuzz.problem import Problem, Truth
from slcp_warp.scripts.benchmarks.fuzz.proofs import least_motion
from slcp_warp.scripts.benchmarks.fuzz.verdicts import SILENT, WRONG

STEPS, WORLDS = 8, 30
DIGITS = 1e5  # pushes on a body in units of its momenta whose rounding is 1e-11 of these


def pushed(problem, i, velocity, impulse):
    """The largest push on a body, one of a group's terms, in units of what the step does to its momenta; its
    coordinates weighed by energy.
    """
    mass, free = problem.drive.h_mass[i], problem.drive.free[i]
    unit = 1.0 / np.sqrt(np.diag(mass))
    terms = unit * (np.abs(problem.jac[i]).T @ impulse)
    momenta = unit * (np.abs(mass @ free) + np.abs(mass @ (velocity - free)))
    return (terms.reshape(-1, 3).max(1) / momenta.reshape(-1, 3).max(1)).max()


@pytest.mark.parametrize(
    "residual, friction", [("hard", 0.5), ("hard", 0.2), ("rem-logistic", 0.5), ("rem-normal", 0.2)]
)
def test_wedged_discs_are_solved_while_their_impulses_have_digits(residual, friction):
    """Thrown discs, three or four of which fit exactly between the walls: what holds the others up are ever
    larger impulses of ever flatter wedges. A step ends unsolved only where these round by more than momenta
    may miss; smaller ones were lost, too, of smoothed rows a quarter of the worlds.
    """
    count = 10
    scene = slcp.scenes.heap(count, width=0.6, friction=friction)
    sim = slcp.Simulator(scene, slcp.Options(residual=residual), device="cpu", strategy="generic")
    x = np.tile(scene.x0, (WORLDS, 1))
    x[:, scene.nv :] = np.random.default_rng(count).standard_normal((WORLDS, scene.nv))
    held = 0
    for _ in range(STEPS):
        numbers = {
            name: np.broadcast_to(value, (len(x), *np.shape(value)))
            for name, value in scene.default_parameters().items()
        }
        worlds = Worlds(numbers, x, np.zeros((len(x), 0)), np.zeros(len(x), int))
        truth = Truth(scene, worlds)
        verdicts, done = judged(worlds, sim, truth=truth)
        assert not np.isin(verdicts.verdict, (SILENT, WRONG)).any(), verdicts.reason
        problem = Problem(truth, truth.drive(), sim.options.method, "float64")
        solved = done.status == slcp.Status.SOLVED
        for i in np.flatnonzero(~solved):
            found = least_motion(problem, i)
            digits = DIGITS if residual == "hard" else 0.25 * DIGITS  # smoothed rows press harder than these
            assert found is None or pushed(problem, i, *found) > digits
        for i in np.flatnonzero(solved):
            held += pushed(problem, i, done.state[i, scene.nv :], done.impulse[i]) > 0.1 * DIGITS
        x = done.state[solved]
    assert held > 5


def test_what_fails_in_a_rollout_fails_by_itself():
    """The last step's impulses may lead astray: under Anitescu's friction, all solved now, 3 of
    7 were given up for them.
    """
    scene = slcp.scenes.heap(10, width=0.6, friction=0.5)
    options = slcp.Options(residual="hard", friction="coulomb")
    sim = slcp.Simulator(scene, options, device="cpu", strategy="generic")
    x = np.tile(scene.x0, (600, 1))
    x[:, scene.nv :] = np.random.default_rng(3).standard_normal((600, scene.nv))
    run = sim.rollout(x, steps=12)
    failed = run.status != slcp.Status.SOLVED
    assert 0 < failed.sum() < 60
    alone = sim.rollout(run.states[failed, -1], steps=1)  # the same kernel, and its roundings
    np.testing.assert_array_equal(alone.status, run.status[failed])


@pytest.mark.parametrize("residual", ["rem-logistic", "rem-normal"])
def test_smoothed_rows_of_wedged_discs_are_held(residual):
    """A fifth of the worlds was NOT_CONVERGED within twelve steps: a matrix of all rows loses their wedge."""
    scene = slcp.scenes.heap(10, width=0.6, friction=0.5)
    sim = slcp.Simulator(scene, slcp.Options(residual=residual), device="cpu", strategy="generic")
    x = np.tile(scene.x0, (60, 1))
    x[:, scene.nv :] = np.random.default_rng(4).standard_normal((60, scene.nv))
    run = sim.rollout(x, steps=12)
    assert (run.status != slcp.Status.SOLVED).sum() <= 4
