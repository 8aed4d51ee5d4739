"""Derivatives along trajectories of piles, each step from the roots of the one before, as DDP takes them."""

import numpy as np
import pytest
import warp as wp

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape
from slcp_warp.ddp.dynamics.simulated import dynamics_of

EPS = 1e-6


def pile(rng, count=8):
    """Discs and boxes with sides, whose rounded corners several shapes share, two columns between walls."""
    bodies, x0, heights = [], [], [0.0, 0.0]
    shapes = [
        slcp.Shape("ground", None, "halfplane", angle=np.pi / 2, contype=0),
        slcp.Shape("wall", None, "halfplane", offset=(0.45, 0.0), angle=np.pi, contype=0),
        slcp.Shape("left", None, "halfplane", offset=(-0.1, 0.0), angle=0.0, contype=0),
    ]
    for i in range(count):
        name, column = f"body {i}", i % 2
        if rng.random() < 0.5:
            half = rng.uniform(0.04, 0.1)
            mass, inertia = 40.0 * half, 20.0 * half**3
            shapes.append(slcp.Shape(name, name, "disc", half))
        else:
            w, t = rng.uniform(0.1, 0.22), rng.uniform(0.08, 0.14)
            mass, half = 60.0 * w * t, t / 2.0
            inertia = mass * (w * w + t * t) / 12.0
            shapes += list(slcp.box(name, name, w, t, corner_radius=0.01, sides=True))
        bodies.append(slcp.Body(name, mass=mass, inertia=inertia, joint="free"))
        x0 += [
            0.22 * column + 0.02 * rng.standard_normal(),
            heights[column] + half + 0.01,
            0.05 * rng.standard_normal(),
        ]
        heights[column] += 2.0 * half + 0.02
    return slcp.Scene(
        "pile", tuple(bodies), tuple(shapes), contacts="auto", friction=0.5, step_size=0.02, sigma=0.05,
        initial_state=(*x0, *np.zeros(len(x0))),
    )  # fmt: skip


@pytest.mark.parametrize("seed", [0, 1])
def test_no_step_of_a_pile_is_refused(seed):
    """A column that is zero but for roundings of its terms is never right to a part of itself: one of a
    thousand such steps was NOT_CONVERGED for it, and DDP over 75 steps DYNAMICS_FAILED.
    """
    sc = pile(np.random.default_rng(seed))
    sim = slcp.Simulator(sc, device="cpu", dtype="float64", strategy="generic")
    rng, worlds, steps, nx = np.random.default_rng(seed), 16, 60, sim.nx
    x = np.tile(sc.x0, (worlds, 1))
    x[:, sc.nv :] += 0.3 * rng.standard_normal((worlds, sc.nv))
    run = sim.rollout(x, np.zeros((worlds, steps, 0)))
    assert (run.status == slcp.Status.SOLVED).all()

    dynamics = dynamics_of(sim)
    given = [wp.array(run.states, dtype=wp.float64), wp.zeros((worlds, steps, 0), dtype=wp.float64)]
    fx = wp.zeros((worlds, steps, nx, nx), dtype=wp.float64)
    fu = wp.zeros((worlds, steps, nx, 0), dtype=wp.float64)
    status, active = wp.zeros((worlds, steps), dtype=wp.int32), wp.ones(worlds, dtype=wp.int32)
    params = dynamics.parameter_array(sim.params, worlds)
    dynamics.linearize_into(*given, params, fx, fu, None, status, active)
    assert not status.numpy().any(), np.argwhere(status.numpy())

    for world, step in ((6, 4), (7, 31)):  # those that were refused: of the first pile, of the second
        z = np.tile(run.states[world, step], (2 * nx, 1))
        z[:nx] += EPS * np.eye(nx)
        z[nx:] -= EPS * np.eye(nx)
        ends = sim.step(z, np.zeros((2 * nx, 0)))
        assert (ends.status == slcp.Status.SOLVED).all()
        slopes = (ends.state[:nx] - ends.state[nx:]).T / (2.0 * EPS)
        miss = np.abs(fx.numpy()[world, step] - slopes).max()
        assert miss <= 1e-5 * np.abs(slopes).max()


@pytest.mark.parametrize("sideways", [0.0, 1.0])
@pytest.mark.parametrize("light", [0.1, 1e-3])
def test_a_heavy_body_lands_on_a_light_one(light, sideways):
    """The lower contact sticks, the upper one too or slides. Rows yield here by more than bodies at a kink
    miss what is asked of them: it was taken for one, and A was off by a hundred times its size.
    """
    bodies = (Body("light", light, 5e-3 * light, joint="free"), Body("heavy", 300.0, 1.5, joint="free"))
    shapes = (
        Shape("ground", None, "halfplane", angle=np.pi / 2),
        Shape("lower", "light", "disc", 0.1),
        Shape("upper", "heavy", "disc", 0.1),
    )
    start = (0.0, 0.1, 0.0, 0.02, 0.295, 0.0, *([0.0] * 3), sideways, -1.0, 0.0)
    friction = 0.05 if sideways else 1.0
    touches = (Contact("ground", "lower", 1.0), Contact("lower", "upper", friction))
    own = Scene("two", bodies, shapes, touches, step_size=0.01, initial_state=start)
    sim = slcp.Simulator(own, slcp.Options("hard", friction="coulomb"), device="cpu", strategy="generic")
    x = own.x0 + 0.003 * np.random.default_rng(0).standard_normal((6, 12))
    ways = 1e-6 * np.concatenate([np.eye(12), -np.eye(12)])
    after = sim.step((x[:, None] + ways).reshape(-1, 12)).state.reshape(6, 2, 12, 12)
    slopes = (after[:, 0] - after[:, 1]).transpose(0, 2, 1) / 2e-6
    found = sim.linearize(x)
    assert (found.status == 0).all() and (sim.step(x).impulse[:, [0, 2]] > 100.0).all(1).sum() > 2
    np.testing.assert_allclose(found.A, slopes, atol=1e-5 * np.abs(slopes).max())


def test_a_and_gradients_of_a_tumbling_stack_are_the_same():
    """Rows that depend on each other but for 1e-12 took a hundred refinements, which ended where changes were
    small but many: both were up to 6e-4 apart.
    """
    own = slcp.scenes.stack(10)
    sim = slcp.Simulator(own, device="cpu", strategy="generic")
    rng = np.random.default_rng(0)
    x = np.tile(own.x0, (3, 1))
    x[:, own.nv :] = rng.standard_normal((3, own.nv))
    x = sim.rollout(x, steps=60).states[:, 10::10].reshape(-1, sim.nx)
    found, weight = sim.linearize(x), rng.standard_normal(x.shape)
    weights = np.zeros((len(x), 2, sim.nx))
    weights[:, 1] = weight
    pulled = slcp.vjp(sim, x, np.zeros((len(x), 1, 0)), weights).x0
    by_columns = np.einsum("bi,bij->bj", weight, found.A)
    assert (found.status == 0).all() and np.abs(found.A).max() < 1e3  # 1/h is 100
    np.testing.assert_array_less(np.abs(pulled - by_columns).max(1), 5e-6 * np.abs(by_columns).max(1))
