"""What is known in closed form about one contact, to the last digits that float64 allows."""

import math

import numpy as np
import pytest
import warp as wp
from simulators import scene, simulator

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape

H, G, SIGMA = 0.01, 9.81, 0.05


def resting_gap(weight, sigma=SIGMA, h=H):
    """Gap at which the contact carries a velocity `weight` a step: w = -sigma ln(1 - e^(-a / sigma))."""
    return -h * sigma * math.log(-math.expm1(-weight / sigma))


def particle(name, device, gap, velocity=(0.0, 0.0), steps=1, residual="rem-logistic", slope=0.0, **changes):
    """States (B, N + 1, 4) of particles over a tilted plane, in its axes (along, off, rates)."""
    sim, sc = simulator(name, device, wp.float64, "inertia", residual), scene(name)
    gap = np.atleast_1d(np.asarray(gap, float))
    along, off = np.array([math.cos(slope), math.sin(slope)]), np.array([-math.sin(slope), math.cos(slope)])
    velocity = np.broadcast_to(velocity, (len(gap), 2))
    x0 = np.zeros((len(gap), 6))
    x0[:, :2] = gap[:, None] * off
    x0[:, 3:5] = velocity[:, :1] * along + velocity[:, 1:] * off
    angle = sc.default_parameters()["shape_angle"]
    planes = np.array([shape.kind == "halfplane" for shape in sc.shapes])
    params = sim.params.replace(
        shape_angle=np.where(planes, math.pi / 2 + slope, angle), step_size=H, **changes
    )
    traj = sim.rollout(x0, np.zeros((len(gap), steps, 0)), params)
    assert (traj.status == 0).all()
    out = [traj.states[..., i : i + 2] @ axis for i in (0, 3) for axis in (along, off)]
    return np.stack(out, -1)


@pytest.mark.parametrize("sigma", [0.1, 0.05, 0.01])
def test_frictionless_body_rests_at_its_gap(device, sigma):
    gap = resting_gap(G * H, sigma)
    x = particle("particle", device, gap, sigma=sigma)
    np.testing.assert_allclose(x[0, 1], [0.0, gap, 0.0, 0.0], atol=1e-14)
    x = particle("particle", device, 0.02, steps=2500, sigma=sigma)  # and it comes to rest there
    assert x[0, -1, 1] == pytest.approx(gap, rel=1e-9)


@pytest.mark.parametrize("mass", [1e-3, 1e3])
def test_a_gram_and_a_tonne_rest_at_the_same_gap(device, mass):
    gap = resting_gap(G * H)
    x = particle("particle", device, gap, mass=mass, inertia=mass, sigma=SIGMA)
    np.testing.assert_allclose(x[0, 1], [0.0, gap, 0.0, 0.0], atol=1e-13)


def test_coincident_contacts_share_the_weight(device):
    gap = resting_gap(G * H / 3)
    x = particle("stack_of_planes", device, gap, sigma=SIGMA)
    np.testing.assert_allclose(x[0, 1], [0.0, gap, 0.0, 0.0], atol=1e-14)


@pytest.mark.parametrize("friction", [0.0, 0.5, 1.0])
def test_two_friction_rows_rest_at_their_gap(device, friction):
    gap = resting_gap((1 + friction**2) * G * H / 2)
    x = particle("rubbing_particle", device, gap, friction=friction, sigma=SIGMA)
    np.testing.assert_allclose(x[0, 1], [0.0, gap, 0.0, 0.0], atol=1e-14)


@pytest.mark.parametrize("slope,friction", [(0.2, 0.5), (0.3, 0.4), (-0.25, 0.6)])
def test_smoothed_contact_creeps_down_a_slope(device, slope, friction):
    """v_t = (sigma / 2 mu) ln[(1 - e^(-x+)) / (1 - e^(-x-))] with

    x+- = (1 + mu^2) g h (cos t +- sin t / mu) / 2 sigma.
    """
    sigma = 0.1
    weight = (1 + friction**2) * G * H / (2 * sigma)
    load = [weight * (math.cos(slope) + s * math.sin(slope) / friction) for s in (1, -1)]
    creep = sigma / (2 * friction) * (math.log(-math.expm1(-load[0])) - math.log(-math.expm1(-load[1])))
    x = particle("rubbing_particle", device, 1e-3, steps=3000, slope=slope, friction=friction, sigma=sigma)
    assert x[0, -1, 2] == pytest.approx(-creep, rel=1e-9)  # along = uphill for a positive slope
    assert np.sign(x[0, -1, 2]) == -np.sign(slope)


def test_hard_contact_slides_at_its_lift_and_stops_in_v2_over_2_mu_g(device):
    """Started at gap h mu |v_t|, falling as it closes, the particle loses mu g h a step until it stops."""
    mu, v = 0.5, 3.0
    x = particle("rubbing_particle", device, H * mu * v, (v, -(mu**2) * G * H), 80, "hard", friction=mu)[0]
    sliding = np.arange(int(v / (mu * G * H)))
    np.testing.assert_allclose(x[sliding, 2], v - mu * G * H * sliding, atol=1e-11)
    np.testing.assert_allclose(x[sliding, 1], H * mu * x[sliding, 2], atol=1e-11)
    np.testing.assert_allclose(x[-1, 2:], 0.0, atol=1e-12)
    assert x[-1, 0] == pytest.approx(v**2 / (2 * mu * G), rel=0.02)


def test_hard_contact_hops_when_it_starts_sliding_at_gap_zero(device):
    mu, v = 0.5, 3.0
    x = particle("rubbing_particle", device, 0.0, (v, 0.0), 60, "hard", friction=mu)[0]
    assert x[1, 3] == pytest.approx(-G * H + (mu * v + G * H) / (1 + mu**2), rel=1e-12)
    assert 0.9 * x[1, 3] ** 2 / (2 * G) < x[:, 1].max() < mu**2 * v**2 / (2 * G)
    safe = particle("rubbing_particle", device, H * mu * v, (v, 0.0), 60, "hard", friction=mu)[0]
    assert safe[:, 1].max() <= H * mu * v + 1e-12


@pytest.mark.parametrize("slope,friction", [(0.4, 0.5), (-0.4, 0.45)])
def test_hard_contact_sticks_inside_the_friction_angle(device, slope, friction):
    x = particle("rubbing_particle", device, 0.0, steps=200, residual="hard", slope=slope, friction=friction)[
        0
    ]
    np.testing.assert_allclose(x, 0.0, atol=1e-12)


@pytest.mark.parametrize("slope,friction", [(0.6, 0.5), (-0.5, 0.2)])
def test_hard_contact_slips_outside_the_friction_angle(device, slope, friction):
    x = particle("rubbing_particle", device, 0.0, steps=100, residual="hard", slope=slope, friction=friction)[
        0
    ]
    rate = np.diff(x[-20:, 2]) / H
    pull = -G * (math.sin(slope) - math.copysign(friction, slope) * math.cos(slope))
    np.testing.assert_allclose(rate, pull, rtol=1e-9)
    np.testing.assert_allclose(x[-20:, 1], H * friction * np.abs(x[-20:, 2]), rtol=1e-9)


def test_hard_contact_lets_nothing_through(device):
    x = particle("particle", device, np.linspace(0.0, 0.3, 40), (0.0, -5.0), 60, "hard")
    assert x[..., 1].min() > -1e-12
    np.testing.assert_allclose(x[:, -1, 3], 0.0, atol=1e-12)


def test_inelastic_impact_rebounds_at_no_more_than_1_03_sigma(device):
    """A fast particle in no gravity, at every phase of the step; the fastest rebound is from rest at gap 0.

    There e^(-a) + e^(-b) = 1 reads e^v' = e^v + e^-gap in units of h and sigma: ln 2, ln 2.5, ... 1.0352.
    """
    speed = gap = 0.0
    for _ in range(60):
        speed = math.log(math.exp(speed) + math.exp(-gap))
        gap += speed
    assert speed == pytest.approx(1.03517, abs=1e-5)
    start = np.linspace(0.1, 0.1 + 0.04 * 1.3, 4000)
    for sigma in (0.1, 0.02):
        x = particle("particle", device, start, (0.0, -4.0), 60, gravity=np.zeros(2), sigma=sigma)
        assert 0.95 * speed < x[..., 3].max() / sigma <= speed * (1 + 1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["specialised", "generic"])
@pytest.mark.parametrize("residual", ["rem-logistic", "hard"])
def test_a_wall_along_the_only_direction_there_is_does_not_push(residual, strategy, device):
    """A slider along x over level ground, whose normal is (cos, sin) of pi/2: no push along x by rounding."""
    shapes = (Shape("foot", "cart", "disc", 0.1), Shape("ground", None, "halfplane", angle=math.pi / 2))
    body = Body("cart", 1.0, 0.1, joint="prismatic", axis=(1.0, 0.0), anchor=(0.0, 0.1))
    level = Scene("cart", (body,), shapes, (Contact("ground", "foot"),))
    sim = slcp.Simulator(level, slcp.Options(residual=residual), device=device, strategy=strategy)
    for depth, status in ((0.0, slcp.Status.SOLVED), (0.02, slcp.Status.INFEASIBLE)):
        params = sim.params.replace(anchor=np.array([[0.0, 0.1 - depth]]))
        step = sim.step(np.array([[0.0, 1.0]]), params=params)
        assert step.status[0] == status
        assert step.state[0, 1] == 1.0
