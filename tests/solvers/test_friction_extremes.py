"""Friction of free discs over a ground, by plain formulas: light inertias, small and large coefficients."""

import functools

import numpy as np
import pytest

import slcp_warp as slcp

COULOMB = slcp.Options(residual="hard", friction="coulomb")


@functools.cache
def simulator(discs, dtype="float64", options=COULOMB, strategy="generic"):
    """Discs over a ground; contacts: disc and ground, then discs in pairs."""
    names = [f"disc{i}" for i in range(discs)]
    ground = slcp.Shape("ground", None, "halfplane", angle=np.pi / 2)
    pairs = [("ground", name) for name in names]
    pairs += [(names[i], names[j]) for i in range(discs) for j in range(i + 1, discs)]
    sc = slcp.Scene(
        "discs",
        tuple(slcp.Body(name, 1.0, 0.01, joint="free") for name in names),
        (ground, *(slcp.Shape(name, name, "disc", 0.1) for name in names)),
        tuple(slcp.Contact(a, b, 0.5) for a, b in pairs),
    )
    return slcp.Simulator(sc, options, "cpu", dtype, strategy=strategy)


def stepped(x, radius, mass, inertia, friction, **numbers):
    """A step of one world: v' (discs, 3), impulses (contacts, 2), M dv - h f and J' lambda, J_t v'."""
    n = len(mass)
    sim = simulator(n)
    sizes = np.zeros((n + 1, 2))
    sizes[1:] = np.array(radius)[:, None]
    params = sim.params.replace(radius=sizes, mass=mass, inertia=inertia, friction=friction, **numbers)
    step = sim.step(np.array([x], float), params=params)
    assert step.status[0] == slcp.Status.SOLVED
    (v, moved), q = step.state[0].reshape(2, n, 3)[::-1], np.reshape(x, (2, n, 3))[0]
    assert np.isfinite(moved).all()
    lam = step.contact_impulse[0]
    h, force = params["step_size"], np.zeros((n, 3))
    force[:, :2] = np.array(mass)[:, None] * params["gravity"]
    kinetic = np.stack([mass, mass, inertia], -1) * (v - np.reshape(x, (2, n, 3))[1])
    pushed, slip = np.zeros((n, 3)), []
    pairs = [(None, i) for i in range(n)] + [(i, j) for i in range(n) for j in range(i + 1, n)]
    for (a, b), (normal, along) in zip(pairs, lam, strict=True):
        e = np.array([0.0, 1.0]) if a is None else (q[b] - q[a])[:2] / np.linalg.norm((q[b] - q[a])[:2])
        t = np.array([-e[1], e[0]])
        slip.append(t @ v[b, :2] - radius[b] * v[b, 2])
        pushed[b] += *(normal * e + along * t), -radius[b] * along
        if a is not None:
            slip[-1] -= t @ v[a, :2] + radius[a] * v[a, 2]
            pushed[a] -= *(normal * e + along * t), radius[a] * along
    return v, lam, kinetic - h * force, pushed, np.array(slip)


def test_what_is_solved_without_friction_gives_back_none_of_it():
    """Three discs of hardly any inertia, the third on the second: the fixed point takes its lift from a
    problem without friction, whose solution nothing slides in. It gave back mu lambda_n along the contact.
    """
    x = [0.0, 0.099, 1.0, 0.201, 0.099, 0.0, 0.201, 0.3, 0.0, *[0.0] * 9]
    friction = [1.0, 1.0, 0.3, 1.0, 0.3, 1.0]
    v, lam, change, pushed, slip = stepped(x, [0.1] * 3, [1.0] * 3, [5e-11] * 3, friction, step_size=1e-4)
    np.testing.assert_allclose(pushed, change, rtol=0, atol=1e-8)
    np.testing.assert_allclose(v[:, 1], [10.0, 10.0, 0.0], rtol=0, atol=1e-6)
    np.testing.assert_allclose(slip[[0, 1, 5]], 0.0, rtol=0, atol=1e-6)
    assert (np.abs(lam[:, 1]) <= np.array(friction) * lam[:, 0] + 1e-12).all()


def test_a_small_coefficient_holds_what_hardly_resists():
    """A ring of next to no inertia, mu = 1e-9, thrown flat: friction stops its slip, and spends a fifth of
    what it could; mu v_t is 1e-10 of the other velocities.
    """
    mass, inertia = [1e-6, 1e-6], [5e-17, 5e-17]
    x = [0.0, 0.1, 0.0, 5.0, 0.1, 1.0, -4.5, -69.8, 0.0, 99.6, 52.0, 0.0]
    numbers = {"step_size": 0.01, "gravity": [0.0, -1000.0]}
    _v, lam, change, pushed, slip = stepped(x, [0.1, 0.1], mass, inertia, [1e-9] * 3, **numbers)
    np.testing.assert_allclose(pushed, change, rtol=0, atol=1e-13)
    assert abs(slip[0]) < 1e-3  # 4.5 m/s before
    assert abs(lam[0, 1]) < 0.5e-9 * lam[0, 0]


@pytest.mark.parametrize("mu", [1e-6, 1e-5])
def test_a_small_coefficient_never_speeds_up(mu):
    """A point and a disc inside the ground, at rest along it: what slides is what the other contact pushed,
    and friction is against it.
    """
    mass, radius = [1e6, 3162277.66], [0.0, 0.1]
    x = [0.0, -0.05, 0.0, 0.07071067811865477, 0.02071067811865475, 0.0, *[0.0] * 6]
    numbers = {"step_size": 0.05, "gravity": [0.0, -1000.0]}
    _v, lam, change, pushed, slip = stepped(x, radius, mass, [100.0, 15811.0], [mu] * 3, **numbers)
    np.testing.assert_allclose(pushed, change, rtol=0, atol=1e-8 * lam.max())
    rubs = lam[:, 1] * slip
    assert (rubs <= 1e-6 * mu * lam[:, 0] * mu).all()


@pytest.mark.parametrize("speed", [1e20, 1e31, 1e100])
def test_the_ground_stops_what_comes_at_any_speed(speed):
    """Beyond 1e30 m/s no row was looked at, and the disc was in the ground with no impulse."""
    x = [0.0, 0.1, 0.0, 0.0, -speed, 0.0]
    v, lam, change, pushed, _slip = stepped(x, [0.1], [1.0], [0.01], [0.5])
    np.testing.assert_allclose(v[0, 1] / speed, 0.0, rtol=0, atol=1e-10)
    np.testing.assert_allclose(lam[0] / speed, [1.0, 0.0], rtol=0, atol=1e-10)
    np.testing.assert_allclose(pushed / speed, change / speed, rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    "options, strategy, dtype, mu",
    [
        (COULOMB, "generic", "float32", 1e6),
        (COULOMB, "generic", "float64", 1e6),
        (slcp.Options(residual="hard"), "generic", "float32", 1e6),
        (slcp.Options(residual="rem-normal"), "generic", "float32", 1e6),
        (slcp.Options(residual="hard"), "specialised", "float32", 100.0),
        (slcp.Options(residual="hard"), "specialised", "float32", 1e6),
        (slcp.Options(residual="rem-normal"), "specialised", "float32", 1e6),
    ],
)
def test_a_large_coefficient_hides_no_overlap(options, strategy, dtype, mu):
    """Three touching discs of radius .1 thrown by up to 1 km/s, mu = 1e6: whatever is SOLVED ends apart, as
    far as the rows of the start tell. Beside terms of mu v_t 70 m/s into each other were nothing.
    """
    rng = np.random.default_rng(0)
    worlds, sim = 80, simulator(3, dtype, options, strategy)
    up = rng.uniform(0.1, 1.0, (worlds, 1))
    angle = rng.uniform(0.2, 3.0, (worlds, 2))
    steps = 0.2 * np.stack([np.cos(angle), np.sin(angle)], -1)
    places = np.concatenate([np.zeros((worlds, 1, 2)), np.cumsum(steps, axis=1)], axis=1)
    places[..., 1] += 0.1 + rng.choice([0.0, 1e-3, 1.0], (worlds, 1)) * up
    x = np.zeros((worlds, 2, 3, 3))
    x[:, 0, :, :2] = places
    places = x[:, 0, :, :2].astype(dtype).astype(float)
    x[:, 1] = rng.choice([1.0, 30.0, 1000.0], (worlds, 1, 1)) * rng.uniform(-1.0, 1.0, (worlds, 3, 3))
    inertia = rng.choice([1e-10, 5e-3, 50.0], (worlds, 1)) * np.ones(3)
    level = {} if options.residual == "hard" else {"sigma": 1e-4}
    params = sim.params.replace(friction=mu, inertia=inertia, step_size=0.01, **level)
    step = sim.step(x.reshape(worlds, -1), params=params)
    solved = step.status == slcp.Status.SOLVED
    assert solved.any()
    v, speed = step.state[:, 9:].reshape(worlds, 3, 3)[..., :2], np.abs(x[:, 1]).max((1, 2))
    for a, b in [(None, 0), (None, 1), (None, 2), (0, 1), (0, 2), (1, 2)]:
        between = np.array([0.0, 1.0]) + 0.0 * places[:, 0] if a is None else places[:, b] - places[:, a]
        length = np.linalg.norm(between, axis=1)
        gap = places[:, b, 1] - 0.1 if a is None else length - 0.2
        closing = v[:, b] - (0.0 if a is None else v[:, a])
        w = np.sum(between * closing, axis=1) / length + gap / 0.01
        assert (w >= -1e-4 * speed - 1e-4)[solved].all()
