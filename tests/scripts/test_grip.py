"""Section II: the edge of the friction cone, the creep of the smoothed grip, and where optima settle."""

import dataclasses

import numpy as np
import pytest
import warp as wp
from simulators import simulator

import slcp_warp as slcp
from slcp_warp.scripts.studies import grip
from slcp_warp.scripts.studies.grip import cone_edge, creep, optimal_grip

HEIGHT_RATE = 8


def rollout(sim, force, steps, **changes):
    controls = np.repeat(np.stack([force, -force], 1)[:, None], steps, 1)
    return sim.rollout(np.zeros((len(force), 10)), controls, sim.params.replace(**changes)).states


def test_edge_of_the_cone_is_weight_over_twice_friction():
    assert cone_edge(slcp.scenes.grasp()) == pytest.approx(1.0 * 9.81 / (2 * 0.5), rel=1e-12)
    heavier = slcp.scenes.grasp(friction=0.3)
    bodies = (*heavier.bodies[:2], dataclasses.replace(heavier.bodies[2], mass=2.0))
    heavier = dataclasses.replace(heavier, bodies=bodies)
    assert cone_edge(heavier) == pytest.approx(2.0 * 9.81 / (2 * 0.3), rel=1e-12)


def test_hard_grip_holds_inside_the_cone_and_slips_outside():
    sim = simulator("grasp", residual="hard")
    edge = cone_edge(sim.scene)
    falls, holds = rollout(sim, edge * np.array([0.99, 1.01]), 100)[:, -1, 3]
    assert falls < -0.02  # a tenth of a newton short: .1 m/s^2 and more for a second
    assert abs(holds) < 1e-10


def test_smoothed_grip_creeps_at_the_analytic_speed():
    sim = simulator("grasp", dtype=wp.float64)
    force = np.array([16.0, 18.0, 24.0])
    speed = -rollout(sim, force, 10, sigma=0.02)[:, -1, HEIGHT_RATE]
    np.testing.assert_allclose(speed, creep(force, sim.scene, 0.02), rtol=3e-3)
    assert np.isinf(creep(cone_edge(sim.scene), sim.scene, 0.02))


@pytest.mark.full
def test_optimal_grip_sits_on_the_edge_without_noise_and_inside_with_it():
    sim = simulator("grasp", dtype=wp.float64)
    edge = cone_edge(sim.scene)
    ratios = []
    for sigma in (0.1, 0.02, 0.002):
        plan = optimal_grip(sim, sigma)
        assert plan.converged and plan.positive_definite
        np.testing.assert_allclose(plan.us[:, 0], -plan.us[:, 1], rtol=1e-6)  # symmetric, as the task
        ratios.append(plan.us[len(plan.us) // 2, 0] / edge)
    assert ratios[0] > 1.5 > 1.3 > ratios[1] > 1.1 > 1.02 > ratios[2] > 1.0


@pytest.mark.full
def test_command_judges_and_draws(tmp_path, monkeypatch):
    typer_testing = pytest.importorskip("typer.testing")
    app = pytest.importorskip("slcp_warp.scripts.app").app
    monkeypatch.setattr(grip, "SIGMAS", (0.1,))
    arguments = ["grip", "--worlds", "20", "--device", "cpu", "--out", str(tmp_path / "grip.png")]
    result = typer_testing.CliRunner().invoke(app, arguments, env={"COLUMNS": "200"})
    assert result.exit_code == 0, result.output
    assert "hard steps hold from 9.810 N" in result.output
    assert (tmp_path / "grip.png").stat().st_size > 10_000
