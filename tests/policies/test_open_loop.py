"""Controls that do not look: those of a rollout's own sequence, in time, late, saved."""

import numpy as np
import pytest
from test_host import SCENE, task

import slcp_warp as slcp
from slcp_warp import measures, policies

STEPS = 75
WAVE = 1.5 * np.sin(0.2 * np.arange(STEPS))[:, None]


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
def test_a_sequence_is_a_rollouts_own_controls(device, strategy):
    sim = slcp.Simulator(SCENE, slcp.Options("hard"), device=device, dtype="float64", strategy=strategy)
    x0 = np.tile(SCENE.x0, (3, 1))
    each = WAVE * np.array([1.0, -0.5, 0.0])[:, None, None]
    for us in (WAVE, each):
        own = sim.rollout(x0, us if us.ndim == 3 else np.tile(us, (3, 1, 1)))
        found = sim.rollout(x0, policy=policies.OpenLoop(us), steps=STEPS)
        np.testing.assert_allclose(found.states, own.states, rtol=0.0, atol=1e-12)
    held = sim.rollout(x0, policy=policies.OpenLoop(WAVE[:10]), steps=20, record="controls")
    np.testing.assert_array_equal(held.controls[0, :10], WAVE[:10])
    np.testing.assert_array_equal(held.controls[0, 10:], np.tile(WAVE[9], (10, 1)))


def test_a_sequence_is_followed_in_time():
    wave = policies.OpenLoop(WAVE, 0.02)
    np.testing.assert_array_equal(wave.at(0.01).us[0, :, 0], np.repeat(WAVE[:, 0], 2))
    np.testing.assert_array_equal(wave.at(0.04).us[0, :, 0], WAVE[::2, 0])
    third = wave.at(0.02 / 3.0)
    np.testing.assert_array_equal(third.us[0, :, 0], np.repeat(WAVE[:, 0], 3))
    with pytest.raises(slcp.InputError, match="no step size"):
        policies.OpenLoop(WAVE).at(0.01)
    own = task(measures={"u": measures.integral(measures.control(0)), "x": measures.final("pusher.shift")})
    still = own.replace(disturbances=slcp.Disturbances(), control_limits=None, start=None)
    given = {"worlds": 1, "cases": slcp.Options("hard"), "dtype": "float64"}
    for h in (0.02, 0.01):
        part = slcp.sweep(still, wave, step_sizes=[h], **given).part("policy")
        assert part["u"][0] == pytest.approx(0.02 * WAVE.sum(), rel=1e-12)


def test_limits_delay_and_files_are_those_of_every_policy(tmp_path):
    wave = policies.OpenLoop(WAVE, 0.02)
    again = policies.load_policy(policies.save_policy(wave, tmp_path / "wave.npz"))
    assert again.step_size == 0.02
    late = task(
        disturbances=slcp.Disturbances(delay=0.04), control_limits=(-1.0, 0.5), start=None,
        measures={"u": measures.integral(measures.control(0))},
    )  # fmt: skip
    for policy in (wave, again):
        part = slcp.sweep(late, policy, worlds=2, cases=slcp.Options("hard"), dtype="float64").part("policy")
        expected = 0.02 * np.clip(WAVE[:-2], -1.0, 0.5).sum()
        np.testing.assert_allclose(part["u"], expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (([0.0, 1.0],), "us has shape"),
        ((np.zeros((0, 1)),), "us has shape"),
        (([[np.nan]],), "us"),
        (("sine",), "us"),
        ((WAVE, 0.0), "step_size is 0"),
    ],
)
def test_what_is_no_sequence_is_said(given, says):
    with pytest.raises(slcp.InputError, match=says):
        policies.OpenLoop(*given)


def test_a_sequence_of_other_controls_is_refused():
    with pytest.raises(slcp.InputError, match="us has 2 controls; scene 'push_block' needs 1"):
        slcp.sweep(task(), policies.OpenLoop(np.zeros((5, 2))), worlds=2)
