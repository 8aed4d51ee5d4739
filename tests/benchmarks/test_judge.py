"""The judge of the stability battery and fuzz against the oracle: mass, forces, energy, with all numbers."""

import dataclasses

import numpy as np
import pytest
from oracle import Oracle
from plan import ROOT, imported_files
from random_scenes import random_tree
from simulators import scene

import slcp_warp as slcp
from slcp_warp import Actuator, Body, Scene
from slcp_warp.scripts.benchmarks.fuzz.draws import Worlds
from slcp_warp.scripts.benchmarks.fuzz.judge import Outcome, judge
from slcp_warp.scripts.benchmarks.fuzz.problem import Problem, Truth
from slcp_warp.scripts.benchmarks.mechanics.complementarity import complementarity, partner
from slcp_warp.scripts.benchmarks.stability.check import Checker


@pytest.mark.parametrize("seed", range(4))
def test_mass_forces_and_energy_of_driven_trees(seed):
    rng = np.random.default_rng(seed)
    tree = random_tree(rng, 4)
    motors = tuple(Actuator(body.name, gear=float(rng.uniform(-5.0, 5.0))) for body in tree.bodies)
    tree = dataclasses.replace(tree, actuators=motors)
    oracle, checker = Oracle(tree), Checker(tree, {})
    q, v = rng.standard_normal((2, 1, 6, tree.nv))
    u = rng.standard_normal((1, 6, tree.nu))
    mass, force, size, energy = checker.dynamics(q, v, u)
    np.testing.assert_allclose(mass[0], oracle.mass_matrix(q[0]), rtol=0, atol=1e-11)
    np.testing.assert_allclose(force[0], oracle.force(q[0], v[0], u[0]), rtol=0, atol=1e-9)
    np.testing.assert_allclose(energy[0], oracle.energy(q[0], v[0]), rtol=1e-11)
    assert (size[0] >= np.abs(force[0]) * (1.0 - 1e-9)).all()  # a sum of magnitudes


def test_numbers_of_every_world_are_its_own():
    finger = scene("flicking_finger")
    rng = np.random.default_rng(1)
    numbers = finger.default_parameters()
    changed = {
        name: numbers[name] * rng.uniform(0.8, 1.2, (3, *numbers[name].shape))
        for name in ("mass", "damping", "gear")
    }
    checker = Checker(finger, changed)
    q, v = rng.standard_normal((2, 3, 2, finger.nv))
    u = rng.standard_normal((3, 2, finger.nu))
    mass, force, _, _ = checker.dynamics(q, v, u)
    for i in range(3):
        own = Oracle(finger, **{name: value[i] for name, value in changed.items()})
        np.testing.assert_allclose(mass[i], own.mass_matrix(q[i]), rtol=0, atol=1e-11)
        np.testing.assert_allclose(force[i], own.force(q[i], v[i], u[i]), rtol=0, atol=1e-9)


def test_the_mechanics_shares_no_code_with_the_kernels():
    named = {ROOT / "kernels" / f"{name}.py" for name in ("method", "structure")}  # what there is, by name
    own = [
        *(ROOT / "scripts/benchmarks/mechanics").glob("*.py"),
        ROOT / "slcp_warp/description/kinematics.py",
    ]
    for path in own:
        kernels = {target for target in imported_files(path) if target.is_relative_to(ROOT / "kernels")}
        assert kernels <= named, path.name
    assert len(own) == 14


@pytest.mark.parametrize("residual", ["rem-logistic", "rem-normal"])
def test_the_other_side_of_a_root(residual):
    """(17): e^(-a/sigma) + e^(-b/sigma) = 1 in closed form; both: the root of phi, symmetric."""
    method = slcp.Options(residual).method
    sigma = np.full(6, 0.1)
    a = np.array([1e-3, 0.01, 0.05, 0.1, 0.3, 0.4])
    b = partner(a, sigma, method)
    assert np.abs(complementarity(a, b, sigma, method)).max() < 1e-15
    np.testing.assert_allclose(partner(b, sigma, method), a, rtol=1e-9)
    if residual == "rem-logistic":
        np.testing.assert_allclose(b, -sigma * np.log(-np.expm1(-a / sigma)), rtol=1e-9)
    assert np.isinf(partner(np.array([0.0, -1.0]), sigma[:2], method)).all()


def test_what_is_fast_elsewhere_is_no_measure():
    """A slider stopped by its limit, off by 1e-4 m/s, beside another that comes at 100 km/s."""
    slow, fast = (Body(name, 1.0, 0.1, joint="prismatic", lower=0.0) for name in ("slow", "fast"))
    still = {"joint": "prismatic", "lower": 0.0, "parent": "slow"}

    def error(bodies, miss):
        scene = Scene("sliders", bodies, gravity=(0.0, 0.0))
        numbers = {name: value[None] for name, value in scene.default_parameters().items()}
        x = np.array([[0.0, 0.0, -1.0, -1e5]])
        truth = Truth(scene, Worlds(numbers, x, np.zeros((1, 0)), np.zeros(1, int)))
        p = Problem(truth, truth.drive(), slcp.Options("hard").method, "float32")
        v = np.array([[miss, 0.0]])
        lam = np.linalg.solve(p.jac[0].T, p.drive.h_mass[0] @ (v - p.drive.free)[0])[None]
        out = Outcome(np.concatenate([truth.h[:, None] * v, v], 1), lam, np.zeros((1, 2)), np.zeros(1, int))
        return judge(p, out).strict["contact"][0]

    assert error((slow, fast), 0.0) < 1e-9
    assert error((slow, fast), 1e-4) > 1.0
    assert error((slow, dataclasses.replace(fast, **still)), 1e-4) < 1.0  # one carries the other
