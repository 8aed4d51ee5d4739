"""The named scenes step without failure and do what they are named after.

One set of kernels (the generic ones) serves most of them.
"""

import math

import numpy as np
import pytest
from oracle import Oracle
from simulators import scene

import slcp_warp as slcp
from slcp_warp import scenes


def roll(sc, device, seconds, u=None, residual="rem-logistic", strategy="generic"):
    """States (N + 1, nx) of a rollout from the scene's initial state."""
    sim = slcp.Simulator(sc, slcp.Options(residual=residual), device=device, strategy=strategy)
    steps = round(seconds / sc.step_size)
    controls = np.zeros((1, steps, sc.nu)) if u is None else np.tile(u, (1, steps, 1))
    traj = sim.rollout(sc.x0[None], controls)
    assert (traj.status == 0).all()
    assert np.isfinite(traj.states).all()
    return traj.states[0]


@pytest.mark.parametrize("name", scenes.NAMED)
def test_scene_is_documented_and_small(name):
    sc = scenes.NAMED[name]()
    assert sc.name == name and scenes.NAMED[name].__doc__
    assert sc.structure.nr <= 31  # what the specialised kernels take
    assert np.isfinite(sc.x0).all()


def test_every_scene_can_be_drawn(tmp_path):
    """Points, capsules, rectangles, half-planes on bodies, links and springs, without stepping."""
    from slcp_warp.scripts.charts.scene_sheet import sheet

    drawn = {name: scene(name) for name in (*scenes.NAMED, "sprung", "capsules", "blocks", "moving_plane")}
    still = {name: (sc, np.tile(sc.x0[: sc.nv], (2, 1))) for name, sc in drawn.items()}
    assert sheet(still, tmp_path / "scenes.png").stat().st_size > 10_000


def test_stack_stands(device):
    x = roll(scenes.stack(), device, 1.0)
    np.testing.assert_allclose(x[-1, :9], scenes.stack().x0[:9], atol=1e-3)


@pytest.mark.parametrize("spread", [True, False])
def test_beam_comes_to_rest_level_on_its_supports(device, spread):
    x = roll(scenes.beam(spread=spread), device, 1.0)
    np.testing.assert_allclose(x[-1, 1:3], [0.05, 0.0], atol=1e-3)
    np.testing.assert_allclose(x[-1, 4:], 0.0, atol=1e-4)


def test_box_lands_and_rests_on_a_side(device):
    sc = scenes.box_toss()
    x = roll(sc, device, 2.0)
    oracle = Oracle(sc)
    quarter = x[-1, 2] / (math.pi / 2)
    assert abs(quarter - round(quarter)) < 1e-3
    np.testing.assert_allclose(x[-1, 3:], 0.0, atol=1e-3)
    assert oracle.energy(x[-1, :3], x[-1, 3:]) < 0.3 * oracle.energy(x[0, :3], x[0, 3:])
    assert oracle.rows(x[:, :3])[0].min() > -1e-3


def test_disc_rolls_without_slip(device):
    x = roll(scenes.rolling_disc(), device, 2.0)
    np.testing.assert_allclose(x[:, 3], 1.0, atol=1e-9)
    np.testing.assert_allclose(x[:, 3] + 0.1 * x[:, 5], 0.0, atol=1e-9)
    assert np.ptp(x[:, 1]) < 1e-9


def test_disc_rolls_down_a_slope_at_two_thirds_of_g_sin(device):
    x = roll(scenes.slope("disc", 0.3, 0.4), device, 1.0, residual="hard")
    along = -(x[:, 3] * math.cos(0.3) + x[:, 4] * math.sin(0.3))
    assert along[-1] == pytest.approx(2.0 / 3.0 * 9.81 * math.sin(0.3), rel=1e-3)
    np.testing.assert_allclose(along - 0.1 * x[:, 5], 0.0, atol=1e-6)


def test_block_on_a_slope_sticks_or_slides_with_friction(device):
    stuck = roll(scenes.slope("block", 0.3, 0.4), device, 1.0, residual="hard")
    np.testing.assert_allclose(stuck[-1], stuck[0], atol=1e-9)
    slid = roll(scenes.slope("block", 0.3, 0.2), device, 1.0, residual="hard")
    speed = np.hypot(slid[-1, 3], slid[-1, 4])
    assert speed == pytest.approx(9.81 * (math.sin(0.3) - 0.2 * math.cos(0.3)), rel=0.05)


def test_balls_exchange_momentum(device):
    x = roll(scenes.two_balls(), device, 1.0)
    mass = np.array([1.0, 2.0])
    q, v = x[:, :6].reshape(-1, 2, 3), x[:, 6:].reshape(-1, 2, 3)
    momentum = np.einsum("b,tbi->ti", mass, v[..., :2])
    np.testing.assert_allclose(momentum, momentum[:1] + np.zeros_like(momentum), atol=1e-12)
    assert abs(v[-1, :, 2]).min() > 0.5  # friction set both spinning
    meet = np.argmax(np.abs(np.diff(x[:, 6])))
    normal = q[meet, 1, :2] - q[meet, 0, :2]
    rebound = (v[-1, 1, :2] - v[-1, 0, :2]) @ normal / np.linalg.norm(normal)
    approach = (v[0, 1, :2] - v[0, 0, :2]) @ normal / np.linalg.norm(normal)
    assert approach < -1.0 and abs(rebound) < 0.02  # inelastic


def test_pole_hits_the_wall_and_does_not_pass(device):
    x = roll(scenes.cart_pole(), device, 2.0)
    reach = x[:, 0] - 0.6 * np.sin(x[:, 1])
    assert 0.565 < np.abs(reach).max() < 0.6 - 0.03 + 1e-3
    assert np.abs(x[:, 0]).max() < 0.3 + 1e-3


def test_pushed_block_moves_and_stops(device):
    x = roll(scenes.push_block(), device, 1.5)
    assert 0.05 < x[-1, 1] < 0.5
    np.testing.assert_allclose(x[-1, 5:], 0.0, atol=1e-2)
    driven = roll(scenes.push_block(), device, 1.0, u=[8.0])
    assert driven[-1, 1] > 1.0 and abs(driven[-1, 3]) < 0.1


def test_opposing_limits_hold(device):
    sc = scenes.opposing_limits()
    layer = sc.step_size * sc.sigma
    assert np.abs(roll(sc, device, 1.0)[:, 0]).max() < 10 * layer
    hard = roll(sc, device, 1.0, residual="hard")
    assert np.abs(hard[1:, 0]).max() <= 0.5e-4 + 1e-12


@pytest.mark.slow
def test_hopper_leaves_the_ground_again(device):
    x = roll(scenes.hopper(), device, 0.8)
    lowest = np.argmin(x[:120, 1])
    assert x[lowest:, 1].max() > x[lowest, 1] + 0.25
    assert -0.31 < x[:, 4].min() < -0.05  # on its spring


@pytest.mark.slow
def test_walker_lands_and_stands(device):
    x = roll(scenes.walker(), device, 2.0)
    assert x[:, 1].min() > 0.75 and x[-1, 1] == pytest.approx(0.81, abs=0.02)
    assert np.abs(x[:, 2]).max() < 0.4


def test_critical_friction_of_the_painleve_rod():
    """The force of one sliding contact accelerates its end out of the ground below mu = 4/3 only."""
    for friction, sign in ((4 / 3 - 1e-6, 1), (4 / 3 + 1e-6, -1)):
        sc = scenes.painleve_rod(friction)
        q = sc.x0[None, :3]
        oracle = Oracle(sc)
        gap, jn, jt, _ = oracle.contact_jacobian(q, 1)  # the leading end
        assert abs(gap[0]) < 1e-12
        push = jn[0] - friction * jt[0] * np.sign(jt[0] @ sc.x0[3:])
        assert np.sign(jn[0] @ np.linalg.solve(oracle.mass_matrix(q)[0], push)) == sign


@pytest.mark.slow
@pytest.mark.parametrize("sigma", [0.1, 0.01, 1e-3])
def test_rod_that_lands_flat_is_solved(device, sigma):
    """Two ends at once with friction: the rank is 3 of 4 rows, impulses cancel to rounding."""
    sc = scenes.painleve_rod(1.5)
    sim = slcp.Simulator(sc, device=device)
    rng = np.random.default_rng(2)
    q = 10.0 ** rng.uniform(-6, -2, (700, 1)) * rng.standard_normal((700, 3))
    x = np.concatenate([q, 1.5 * rng.standard_normal((700, 3))], axis=1)
    assert (sim.step(x, np.zeros((700, 0)), sim.params.replace(sigma=sigma)).status == 0).all()


@pytest.mark.slow
@pytest.mark.parametrize("friction,residual", [(1.5, "rem-logistic"), (1.2, "hard"), (1.5, "hard")])
def test_painleve_rod_is_solved_and_stays_out(device, friction, residual):
    sc = scenes.painleve_rod(friction)
    x = roll(sc, device, 1.5, residual=residual, strategy="auto")
    assert Oracle(sc).rows(x[:, :3])[0].min() > -1e-4
    np.testing.assert_allclose(x[-1, 3:], 0.0, atol=1e-3)
    np.testing.assert_allclose(x[-1, 1], 0.0, atol=1e-3)
