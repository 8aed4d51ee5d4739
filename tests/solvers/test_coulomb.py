"""Hard contact with Coulomb's friction: the natural map by an independent oracle, and physics."""

import functools
import math

import numpy as np
import pytest
import warp as wp
from oracle import Oracle
from oracle_coulomb import natural_map
from random_scenes import near_contact
from simulators import NUMPY, WIDTH, scene

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape, scenes

COULOMB = slcp.Options(residual="hard", friction="coulomb")
G = 9.81
TOLERANCE = {wp.float64: 1e-11, wp.float32: 2e-5}


def wedge() -> Scene:
    """A disc with three points on it over coincident and opposed planes: redundant, and it may jam."""
    angles = (0.5, 0.5, 0.9, 0.1)  # outward normals, in units of pi: two that coincide and two walls
    planes = tuple(Shape(f"plane{i}", None, "halfplane", angle=math.pi * a) for i, a in enumerate(angles))
    body = Body("disc", 1.0, 0.02, joint="free")
    shapes = (Shape("disc", "disc", "disc", 0.2), Shape("foot", "disc", "disc", offset=(0.1, -0.2)))
    pairs = tuple(Contact(p.name, s.name, 0.5) for p in planes for s in shapes)
    return Scene("wedge", (body,), (*planes, *shapes), pairs, initial_state=(0.0, 0.3, 0.0, 0.0, 0.0, 0.0))


def rod() -> Scene:
    """Painleve's slender rod of length 2 and mass 1; its lower end slides on the ground."""
    return Scene(
        "rod",
        (Body("rod", 1.0, 1.0 / 3.0, joint="free"),),
        (
            Shape("end", "rod", "disc", offset=(-1.0, 0.0)),
            Shape("ground", None, "halfplane", angle=math.pi / 2),
        ),
        (Contact("ground", "end", 1.0),),
    )


MAKERS = {"wedge": wedge, "rod": rod}


@functools.cache
def named(name):
    return MAKERS[name]() if name in MAKERS else scene(name)


@functools.cache
def simulator(name, device, dtype=wp.float64, options=COULOMB):
    return slcp.Simulator(named(name), options, device=device, dtype=WIDTH[dtype], strategy="specialised")


def states(name, rng, count):
    """States in and near contact, slow, fast and at rest, with the gaps of every kind."""
    sc = named(name)
    if name == "flicking_finger":
        x = near_contact(sc, rng, count)
        x[:, sc.nv :] *= rng.choice([0, 1, 30], (count, 1))
        return x
    x = np.tile(sc.x0, (count, 1))
    x[:, : sc.nv] += rng.choice([0, 1e-3, 0.02, 0.2], (count, 1)) * rng.standard_normal((count, sc.nv))
    x[:, sc.nv :] = rng.choice([0, 1, 30], (count, 1)) * rng.standard_normal((count, sc.nv))
    return x


@pytest.mark.slow
@pytest.mark.parametrize(
    "name,dtype",
    [
        ("flicking_finger", wp.float64),
        ("sliding_block", wp.float64),
        pytest.param("sliding_block", wp.float32, marks=pytest.mark.full),
    ],
    ids=["flicking_finger-float64", "sliding_block-float64", "sliding_block-float32"],
)
def test_contact_law_holds(device, name, dtype):
    rng, count = np.random.default_rng(1), 2000
    x, sim = states(name, rng, count), simulator(name, device, dtype)
    u = rng.standard_normal((count, sim.nu))
    changes = {
        "friction": rng.choice([0, 0.2, 0.5, 1.3, 5.0], (count, 1)) * np.ones(len(named(name).contacts)),
        "step_size": rng.choice([0.001, 0.01, 0.05], count),
    }
    step = sim.step(x, u, sim.params.replace(**changes))
    solved = step.status == slcp.Status.SOLVED
    assert solved.mean() > 0.999 and (np.abs(step.impulse).sum(1) > 0).mean() > 0.5
    worst = natural_map(named(name), NUMPY[dtype], x, u, step, **changes)[solved]
    assert worst.max() < (5e-11 if dtype is wp.float64 else 2e-5)


@pytest.mark.full
def test_redundant_planes_and_jams(device):
    rng, count = np.random.default_rng(1), 1000
    x, sim = states("wedge", rng, count), simulator("wedge", device)
    x[::2, 1] += 0.5  # clear of the walls
    mu = rng.choice([0.0, 0.2, 0.5, 1.5], count)
    changes = {"friction": mu[:, None] * np.ones(8), "step_size": 0.01 * np.ones(count)}
    step = sim.step(x, None, sim.params.replace(**changes))
    assert (step.status[mu < 0.3] == slcp.Status.SOLVED).all()
    solved = step.status == slcp.Status.SOLVED
    assert natural_map(named("wedge"), float, x, x[:, :0], step, **changes)[solved].max() < 1e-11
    # planes within each other's cones that are both pressed: friction holds against whatever pushes
    assert set(step.status[~solved]) == {slcp.Status.JAMMED}
    apart = (step.gap >= 0).all(1)
    assert apart.any() and solved[apart].all()  # without penetration a solution always exists [8]


@pytest.mark.slow
@pytest.mark.parametrize("mu", [1.2, 1.5])
def test_painleve_rod(device, mu):
    # tan = 2: above mu = 4/3 one sense of sliding is inconsistent in continuous time; an impulse ends it
    angle = math.atan(2.0)
    x = np.array([[0.0, math.sin(angle), angle, speed, 0.0, 0.0] for speed in (-1.0, 1.0, 0.0)])
    sim = simulator("rod", device)
    h = 1e-3
    step = sim.step(x, None, sim.params.replace(friction=mu, step_size=h))
    assert not step.status.any()
    changes = {"friction": np.full((3, 1), mu), "step_size": np.full(3, h)}
    # the oracle's level normal has cos(pi/2) = 6e-17 along x, over h
    assert natural_map(rod(), float, x, x[:, :0], step, **changes).max() < 1e-11
    end = step.state[:, 3] + math.sin(angle) * step.state[:, 5]  # velocity of the sliding end
    stopped = np.abs(end) < 1e-9
    assert stopped[2] and not stopped[1]
    assert stopped[0] == (mu > 4.0 / 3.0)


def slide(device, x0, steps, h, **changes):
    sim = simulator("rubbing_particle", device)
    x0 = np.atleast_2d(x0)
    params = sim.params.replace(step_size=h, **changes)
    traj = sim.rollout(x0, np.zeros((len(x0), steps, 0)), params, record=("impulse",))
    assert not traj.status.any()
    return traj


def test_sliding_stop(device):
    h, mu, v = 0.01, 0.5, 3.0
    traj = slide(device, [0.0, 0.0, 0.0, v, 0.0, 0.0], 120, h, friction=mu)
    loss = mu * G * h
    rates = np.maximum(v - loss * np.arange(1, 121), 0.0)  # the discrete law, to rounding
    np.testing.assert_allclose(traj.states[0, 1:, 3], rates, atol=1e-12)
    assert traj.states[0, -1, 0] == pytest.approx(v * v / (2 * mu * G), abs=0.5 * h * v)
    np.testing.assert_allclose(traj.states[0, :, 1], 0.0, atol=1e-13)  # no lift
    assert (np.abs(traj.impulse[..., 1]) <= mu * traj.impulse[..., 0] * (1 + 1e-12)).all()


@pytest.mark.parametrize("factor", [0.99, 1.01])
def test_stick_and_slip_on_a_slope(device, factor):
    mu, h, steps = 0.5, 0.05, 200  # 10 s
    slope = math.atan(factor * mu)
    angle = np.array([0.0, math.pi / 2 + slope])
    traj = slide(device, np.zeros(6), steps, h, friction=mu, shape_angle=angle)
    along = traj.states[0, :, :2] @ [math.cos(slope), math.sin(slope)]
    if factor < 1.0:
        assert np.abs(along).max() < 1e-12
    else:
        pull = -G * (math.sin(slope) - mu * math.cos(slope))
        exact = pull * h * h * np.arange(steps + 1) * (np.arange(steps + 1) + 1) / 2
        np.testing.assert_allclose(along, exact, rtol=1e-9, atol=1e-12)


@pytest.mark.slow
def test_sliding_disc_rolls_at_two_thirds(device):
    disc = scenes.ball_drop(radius=0.1, height=0.0, friction=0.3)
    sim = slcp.Simulator(disc, COULOMB, device=device)
    traj = sim.rollout(
        np.array([0.0, 0.1, 0.0, 3.0, 0.0, 0.0]), np.zeros((300, 0)), sim.params.replace(step_size=0.01)
    )
    v, turn = traj.states[-1, 3], traj.states[-1, 5]
    assert v == pytest.approx(2.0, abs=1e-9) and v + 0.1 * turn == pytest.approx(0.0, abs=1e-9)


@pytest.mark.slow
def test_derivatives_where_modes_do_not_change(device):
    sim, rng = simulator("flicking_finger", device), np.random.default_rng(2)
    x = near_contact(named("flicking_finger"), rng, 400, gaps=(0.0, -0.01))
    u = rng.standard_normal((400, 2))
    lin = sim.linearize(x, u)
    eps, slopes = 1e-6, []
    columns = [np.eye(6)[j] for j in range(6)]
    for c in columns:
        slopes.append((sim.step(x + eps * c, u).state - sim.step(x - eps * c, u).state) / (2 * eps))
    error = np.abs(np.stack(slopes, -1) - lin.A).max((1, 2)) / (1.0 + np.abs(lin.A).max((1, 2)))
    touching = np.abs(sim.step(x, u).impulse[:, 4:]).sum(1) > 0
    assert touching.sum() > 100 and not lin.status.any()
    assert np.quantile(error[touching], 0.98) < 1e-6  # the rest straddles a change of mode
    slopes = [
        (sim.step(x, u + eps * c).state - sim.step(x, u - eps * c).state) / (2 * eps) for c in np.eye(2)
    ]
    error = np.abs(np.stack(slopes, -1) - lin.B).max((1, 2)) / (1.0 + np.abs(lin.B).max((1, 2)))
    assert np.quantile(error[touching], 0.98) < 1e-6


def test_smoothed_coulomb_is_refused():
    with pytest.raises(slcp.OptionError, match="no smoothed form"):
        slcp.Options(friction="coulomb")


@pytest.mark.slow
def test_gap_at_the_end_keeps_curved_shapes_apart():
    """0 <= lambda_n _|_ d(q + h v')/h by the oracle; with the gap at the start bodies sink in."""
    name = "flicking_finger"
    sc = scene(name)
    x = near_contact(sc, np.random.default_rng(5), 300, gaps=(0.0, 0.01, 0.05))
    deepest = {}
    for gap in ("start", "end"):
        sim = simulator(name, "cpu", options=slcp.Options(residual="hard", friction="coulomb", gap=gap))
        step = sim.step(x)
        assert (step.status == 0).all()
        after = Oracle(sc).rows(step.state[:, : sc.nv])[0][:, 4]
        deepest[gap] = after.min()
        if gap == "end":
            pressed = step.contact_impulse[:, 0, 0] > 1e-9
            assert 20 < pressed.sum() < len(x)
            assert np.abs(after[pressed]).max() < 1e-8
    assert deepest["end"] > -1e-8
    assert deepest["start"] < -1e-3
    with pytest.raises(slcp.OptionError, match="gap is 'end'.*no derivatives"):
        sim.linearize(x)


@pytest.mark.full
def test_gap_at_the_end_that_does_not_settle_is_not_called_solved():
    """A walker that lands in steps of .02 s: worlds meet the gap at the end, or are NOT_CONVERGED."""
    sc = scene("walker")
    oracle = Oracle(sc)
    sim = simulator("walker", "cpu", options=slcp.Options(residual="hard", friction="coulomb", gap="end"))
    x = near_contact(sc, np.random.default_rng(1), 400, gaps=(0.0, 0.005))
    share = {}
    for h in (0.005, 0.02):
        step = sim.step(x, params=sim.params.replace(step_size=h))
        solved = step.status == slcp.Status.SOLVED
        assert np.isin(step.status, (slcp.Status.SOLVED, slcp.Status.NOT_CONVERGED)).all()
        pressed = (step.contact_impulse[:, :, 0] > 1e-9) & solved[:, None]
        gaps = np.stack([oracle.contact_jacobian(step.state[:, : sc.nv], k)[0] for k in range(2)], 1)
        assert pressed.sum() > 50
        assert np.abs(gaps[pressed]).max() < 1e-9
        share[h] = solved.mean()
    assert share[0.005] > 0.9 and share[0.02] < 1.0  # not all settle


@pytest.mark.slow
@pytest.mark.parametrize("pairs", [1, 2])
@pytest.mark.parametrize("friction", [None, 0.5])
def test_a_row_that_no_impulse_moves_is_infeasible_where_it_is_violated(friction, pairs):
    """A slider along x over a wall below it: its normal lies across the only direction there is."""
    shapes = (Shape("foot", "cart", "disc", 0.1), Shape("ground", None, "halfplane", angle=math.pi / 2),
              Shape("toe", "cart", "disc", 0.1, offset=(0.3, 0.0)))  # fmt: skip
    contacts = (Contact("ground", "foot", friction), Contact("ground", "toe", friction))[:pairs]
    body = Body("cart", 1.0, 0.1, joint="prismatic", axis=(1.0, 0.0))
    sim = slcp.Simulator(Scene("cart", (body,), shapes, contacts), COULOMB, device="cpu", dtype="float64")
    shut, fine = slcp.Status.INFEASIBLE, slcp.Status.SOLVED
    for depth, status in ((0.02, shut), (1e-6, shut), (1e-14, fine), (0.0, fine)):  # 1e-14: rounding
        anchor = np.array([[0.0, 0.1 - depth]])
        step = sim.step(np.array([[0.0, 1.0]]), None, sim.params.replace(anchor=anchor))
        assert step.status[0] == status and np.isfinite(step.state).all()


def test_gap_at_the_end_is_for_the_hard_problem():
    with pytest.raises(slcp.OptionError, match="Options.gap is 'end' with residual 'rem-logistic'"):
        slcp.Options(gap="end")
