"""Generic kernels under float32: a world is solved to what its rounded states and numbers mean."""

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp.scripts.benchmarks.fuzz.draws import Worlds, single
from slcp_warp.scripts.benchmarks.fuzz.judged import judged
from slcp_warp.scripts.benchmarks.fuzz.verdicts import HOLDS

LAWS = {"hard": {"residual": "hard"}, "coulomb": {"residual": "hard", "friction": "coulomb"}, "smoothed": {}}
ROUNDED = 2.0**-24  # relative, of a number in single precision


def simulator(scene, law):
    return slcp.Simulator(scene, slcp.Options(**LAWS[law]), device="cpu", dtype="float32", strategy="generic")


@pytest.mark.parametrize("law", LAWS)
def test_wedged_discs_rest(law):
    """Three discs of 0.1 m beside each other between walls 0.6 m apart, whose gaps are 0 to a rounding of up
    to 3e-8 m: by 3e-6 m/s the rows excluded each other, and the walls leaned by the rounding of pi.
    """
    scene = slcp.scenes.heap(10, width=0.6)
    sim = simulator(scene, law)
    x = scene.x0[None].astype(np.float32)
    numbers = {
        name: single(np.asarray(value, float)[None]) for name, value in scene.default_parameters().items()
    }
    for _ in range(8):  # every state is rounded
        worlds = Worlds(numbers, x.astype(float), np.zeros((1, 0)), np.zeros(1, int))
        verdicts, step = judged(worlds, sim)
        assert verdicts.verdict[0] == HOLDS, verdicts.reason
        assert step.status[0] == slcp.Status.SOLVED
        assert np.abs(step.state - scene.x0)[0, : scene.nv].max() < (1e-5 if law == "smoothed" else 1e-7)
        x = step.state
    assert np.abs(x[0, scene.nv :]).max() < 1.5e-6  # no gap jumps between a rounding and 0


@pytest.mark.parametrize("aside, up", [(0.0, 0.0), (300.0, 0.0), (0.0, 300.0)])
def test_what_is_no_rounding_acts(aside, up):
    """A disc 1e-6 m inside the ground leaves it, one as far above sinks to it, also far to the side; 300 m up
    float32 tells neither from a disc that touches.
    """
    scene = slcp.scenes.heap(1)
    ground = replace(scene.shapes[0], offset=(0.0, up))
    scene = replace(scene, shapes=(ground, *scene.shapes[1:]))
    x = np.tile(scene.x0, (2, 1))
    x[:, 0] = aside
    x[:, 1] += [up - 1e-6, up + 1e-6]
    rises = simulator(scene, "hard").step(x.astype(np.float32)).state[:, scene.nv + 1] * 0.01
    np.testing.assert_allclose(rises, [0.0, 0.0] if up else [1e-6, -1e-6], atol=ROUNDED)


def test_tall_stacks_hold_under_coulombs_friction():
    """50 boxes that begin to slide and turn at .1 m/s: what they hand on is 200 times what each of them does,
    and rounds by less than a hundred thousandth of that. 13 of 30 were refused.
    """
    scene = slcp.scenes.stack(50, friction=0.5)
    x = np.tile(scene.x0, (30, 1))
    x[:, scene.nv :] += 0.1 * np.random.default_rng(0).standard_normal((30, scene.nv))
    x = single(x)
    numbers = {
        name: single(np.repeat(np.asarray(value, float)[None], 30, 0))
        for name, value in scene.default_parameters().items()
    }
    worlds = Worlds(numbers, x, np.zeros((30, 0)), np.zeros(30, int))
    verdicts, step = judged(worlds, simulator(scene, "coulomb"))
    solved = step.status == slcp.Status.SOLVED
    assert np.all(verdicts.verdict[solved] == HOLDS), verdicts.reason
    assert (~solved).sum() <= 1


@pytest.mark.parametrize("law", ["hard", "coulomb"])
def test_a_weight_of_a_million_rests_on_one_of_one(law):
    """What the lower box passes on is a million times what it does by itself, and all of it what the upper
    one brings: from 1e5 on such worlds were NOT_CONVERGED.
    """
    scene = slcp.scenes.stack(2, friction=0.5)
    sim = simulator(scene, law)
    heavy = np.array([1.0, 1e3, 1e5, 1e6, 1e8])
    mass = np.stack([np.ones(5), heavy], 1)
    params = sim.params.replace(mass=mass, inertia=mass * sim.params["inertia"])
    run = sim.rollout(np.tile(scene.x0, (5, 1)), steps=20, params=params, record=("impulse",))
    assert run.status.tolist() == [slcp.Status.SOLVED] * 5
    assert np.abs(run.states[:, -1, : scene.nv] - scene.x0[: scene.nv]).max() < 1e-6
    weight = mass.sum(1) * 9.81 * scene.step_size
    pressed = run.impulse[:, -1, [i for i, n in enumerate(scene.row_names) if "ground" in n]].sum(1)
    np.testing.assert_allclose(pressed, weight, rtol=2e-5)


def test_a_push_that_passes_by_a_wrist():
    """A peg's corner slides on a rounded edge, whose push leads past the axis of a wrist on rail and lift:
    its torque is a difference of two that are hundreds of times as large, and rounds by more than a hundred
    thousandth of what the wrist itself has. 7 of these were refused; the oracle finds none wrong.
    """
    made = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "tasks" / "peg.py"))
    sim, rng, worlds = simulator(made["scene"](), "coulomb"), np.random.default_rng(0), 400
    x = np.tile([5e-8, -0.0053955, -5.8e-7, 3.4e-5, -0.0496, -5.8e-4], (worlds, 1))
    x[:, 1] += rng.uniform(-4e-6, 4e-6, worlds)
    x[:, 3:] *= rng.uniform(0.5, 1.5, (worlds, 3))
    drawn = {"friction": rng.uniform(0.4, 0.7, worlds), "rail.anchor_x": np.full(worlds, -0.00151)}
    drawn |= {"rail.angle": np.full(worlds, 0.01221), "pin.radius_0": np.full(worlds, 0.0052222)}
    params = sim.params.replace(**drawn)
    numbers = {}
    for name in params.names:
        shape = (worlds, *params.layout.shape(name))
        numbers[name] = single(np.broadcast_to(np.asarray(params[name], float), shape))
    u = np.tile([0.0, -0.1, 0.0], (worlds, 1))
    verdicts, step = judged(Worlds(numbers, single(x), single(u), np.zeros(worlds, int)), sim)
    assert (step.status == slcp.Status.SOLVED).all()
    assert (np.asarray(verdicts.verdict) == HOLDS).all(), np.unique(verdicts.reason)
    assert (np.abs(step.contact_impulse).max((1, 2)) > 1e-3).sum() > worlds / 2
