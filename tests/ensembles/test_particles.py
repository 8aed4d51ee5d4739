"""The smoothed step against the mean of the hard one under noise, and the units question."""

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp.scripts.studies.particles import SD, H, unit_differences

VERTICAL = np.diag([0.0, (H * SD) ** 2, 0.0, 0.0, 0.0, 0.0])


@pytest.mark.slow
@pytest.mark.parametrize("residual", ["rem-logistic", "rem-normal"])
def test_one_row_is_the_mean_of_the_hard_impulse(residual):
    scene = slcp.scenes.particle()
    hard = slcp.Simulator(scene, slcp.Options(residual="hard"), device="cpu")
    smooth = slcp.Simulator(scene, slcp.Options(residual=residual, noise="state"), device="cpu")
    params = smooth.params.replace(step_size=H, position_covariance=VERTICAL[:3, :3], velocity_covariance=0.0)
    for gap in (-0.002, 0.0, 0.003):
        x = np.array([0.0, gap, 0.0, 0.0, 0.0, 0.0])
        cloud = slcp.particles(
            hard, x, params=hard.params.replace(step_size=H), covariance=VERTICAL, count=40000,
            logistic=residual == "rem-logistic",
        )  # fmt: skip
        step = smooth.step(x, None, params)
        assert cloud.solved == 40000
        assert abs(step.impulse[0] - cloud.impulse[0]) < 4.0 * cloud.impulse_error[0]
        np.testing.assert_allclose(step.state[4], cloud.state[4], atol=4.0 * cloud.state_error[4])


@pytest.mark.slow
def test_inertia_scaling_makes_units_of_mass_and_with_sigma_of_length_irrelevant():
    rows = unit_differences(100, 0)
    change = {(r["scaling"], r["unit"], r["sigma in the unit"]): r["change"] for r in rows}
    assert not any(r["unsolved"] for r in rows)
    assert change["inertia", "gram", False] < 1e-12 and change["inertia", "gram, millimetre", True] < 1e-12
    assert change["inertia", "millimetre", False] > 1e-5  # the noise is then another one
    assert min(change["none", unit, True] for unit in ("gram", "millimetre")) > 1e-3


def test_bad_particles_are_refused():
    smooth = slcp.Simulator(slcp.scenes.particle(), device="cpu")
    hard = slcp.Simulator(slcp.scenes.particle(), slcp.Options(residual="hard"), device="cpu")
    with pytest.raises(slcp.ParameterError, match="need residual='hard'"):
        slcp.particles(smooth, np.zeros(6), covariance=VERTICAL)
    with pytest.raises(slcp.ParameterError, match=r"covariance has shape \(3, 3\); \(6, 6\)"):
        slcp.particles(hard, np.zeros(6), covariance=np.eye(3))
    with pytest.raises(slcp.ParameterError, match="eigenvalue -1"):
        slcp.particles(hard, np.zeros(6), covariance=-np.eye(6))
    with pytest.raises(slcp.ParameterError, match="count is 1"):
        slcp.particles(hard, np.zeros(6), covariance=VERTICAL, count=1)
    us, zero = np.zeros((4, 0)), np.zeros((6, 6))
    with pytest.raises(slcp.ParameterError, match="xs and K belong together"):
        slcp.particle_rollout(hard, np.zeros(6), us, covariance=zero, xs=np.zeros((5, 6)))
    with pytest.raises(slcp.ParameterError, match=r"K has shape \(3, 0, 6\); \(4, 0, 6\) is needed"):
        slcp.particle_rollout(
            hard, np.zeros(6), us, covariance=zero, xs=np.zeros((5, 6)), K=np.zeros((3, 0, 6))
        )


@pytest.mark.slow
def test_particle_rollout_diffuses_in_flight_and_is_the_rollout_without_noise():
    scene = slcp.scenes.particle()
    hard = slcp.Simulator(scene, slcp.Options(residual="hard"), device="cpu")
    params = hard.params.replace(step_size=H)
    x0, us = np.array([0.0, 0.1, 0.0, 0.3, 0.0, 0.0]), np.zeros((20, 0))
    still = slcp.particle_rollout(hard, x0, us, params, covariance=np.zeros((6, 6)), count=3)
    plain = hard.rollout(x0, us, params)
    np.testing.assert_allclose(
        still.states, np.broadcast_to(plain.states, still.states.shape), atol=1e-12
    )  # kernels apart
    assert still.states[0, -1, 1] < 1e-3  # it has landed: contact is in the comparison

    spread = np.diag([0.0, 0.0, 0.0, SD**2, 0.0, 0.0])
    flying = slcp.particle_rollout(
        hard, [0.0, 9.0, 0.0, 0.0, 0.0, 0.0], us, params, covariance=spread, count=20000
    )
    count = np.arange(21)  # free flight: v is a random walk, q' = q + h v'
    np.testing.assert_allclose(flying.states[:, :, 3].var(0), count * SD**2, rtol=0.05)
    walked = np.cumsum(count**2) * (H * SD) ** 2
    np.testing.assert_allclose(flying.states[:, 1:, 0].var(0), walked[1:], rtol=0.05)
