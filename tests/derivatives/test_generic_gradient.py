"""Gradients with generic kernels, which any scene has: against differences, and specialised kernels' ones."""

import functools
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from parameter_checks import check, crane, errors, hub, jib, lever, smooth, states
from random_scenes import near_contact, random_tree
from simulators import scene
from taped import loss_of, on_device

import slcp_warp as slcp
from slcp_warp import ddp, scenes

slow = pytest.mark.slow
SHIFTS = {1: 0.75, 2: -0.15, 3: 1.0 / 60.0}  # sixth-order central difference


def generic(sc, dtype="float64", **options):
    return slcp.Simulator(sc, slcp.Options(**options), device="cpu", dtype=dtype, strategy="generic")


def inside(params):
    """Some damping and length everywhere: less than none is refused, so there is no difference at 0."""
    names = [name for name in ("damping", "spring_length") if name in params.names]
    return params.replace(**{name: np.maximum(params[name], 0.05) for name in names})


def tree_with_contacts(seed):
    rng = np.random.default_rng(seed)
    return random_tree(rng, int(rng.integers(2, 5)), contacts=True)


@pytest.mark.parametrize(
    "make",
    [crane, jib, hub, lever, functools.partial(scene, "sprung"), functools.partial(tree_with_contacts, 4)],
)
def test_every_column_against_differences(make):
    """Joints of every kind, capsules, springs with dampers, limits, friction: shapes that turn and slide."""
    sc = make()
    sim = generic(sc)
    x, u, force = states(sc, 10)
    check(errors(sim, x, u, inside(sim.params), force, smooth))


@pytest.mark.parametrize("make", [crane, hub, lever, functools.partial(tree_with_contacts, 4)])
def test_every_column_of_the_leapfrog(make):
    """Its Coriolis forces hang on all that its prediction does."""
    sc = make()
    sim = generic(sc, integrator="leapfrog")
    x, u, force = states(sc, 10)
    x[:, sc.nv :] *= 3.0
    check(errors(sim, x, u, inside(sim.params), force, smooth))


@slow
@pytest.mark.parametrize("residual", ["rem-logistic", "rem-normal", "hard"])
@pytest.mark.parametrize("seed", [0, 1, 2, 4, 5, 6])  # of 3 differences lose too many digits
def test_every_column_of_random_scenes(seed, residual):
    sc = tree_with_contacts(seed)
    sim = generic(sc, residual=residual, scaling="none" if seed % 3 == 2 else "inertia")
    x, u, force = states(sc, 10)

    def rows(traj, params):
        return (traj.impulse[:, 0] > 0.0).astype(int)

    found = errors(sim, x, u, inside(sim.params), force, rows if residual == "hard" else smooth)
    check({key: error for key, error in found.items() if residual != "hard" or key[0] != "sigma"})


def differences(sim, x, us, weight, params, moves, step):
    """Derivatives of sum(weight * states) along moves {name: (move of x or of a parameter)}."""
    out = {}
    for name, move in moves.items():
        total = np.zeros(len(x))
        for k, share in SHIFTS.items():
            for sign in (1.0, -1.0):
                by = sign * k * step
                moved = params if name == "x0" else params.replace(**{name: params[name] + by * move})
                traj = sim.rollout(x + by * move if name == "x0" else x, us, moved)
                assert not traj.status.any(), name
                total += sign * share * (traj.states * weight).sum((1, 2)) / step
        out[name] = total
    return out


def thrown(sc, count, seed=3, speed=0.5):
    rng = np.random.default_rng(seed)
    x = np.tile(sc.x0, (count, 1))
    x[:, : sc.nv] += 1e-4 * rng.standard_normal((count, sc.nv))
    x[:, sc.nv :] += speed * rng.standard_normal((count, sc.nv))
    return x


@pytest.mark.parametrize(
    "options, boxes, seed",  # of states with no kink nearer than 1e-7 m
    [
        pytest.param({}, 30, 5, marks=pytest.mark.full),
        ({"residual": "hard"}, 30, 3),
        ({"residual": "hard", "friction": "coulomb"}, 6, 3),
    ],
)
def test_thrown_stack(options, boxes, seed):
    """Two steps of 90 degrees of freedom and 120 rows."""
    sc = scenes.stack(boxes, [1.0] * boxes, 0.5, size=0.1)
    sim = generic(sc, **options)
    x = thrown(sc, 2, seed)
    rng = np.random.default_rng(4)
    us, weight = np.zeros((2, 2, 0)), rng.standard_normal((2, 3, sim.nx))
    params = sim.params.replace(sigma=0.02)
    names = ["mass", "inertia", "friction", "shape_offset", "gravity", "step_size"]
    names += [] if options else ["sigma"]
    back = slcp.vjp(sim, x, us, weight, params, parameters=names)
    moves = {"x0": rng.standard_normal(x.shape)}
    for name in names:
        moves[name] = rng.standard_normal(params[name].shape) * np.abs(params[name]).max()
    slopes = {"x0": back.x0, **back.parameters}
    exact = {n: (slopes[n] * move).reshape(2, -1).sum(1) for n, move in moves.items()}
    best = {name: np.full(2, np.inf) for name in moves}
    for step in 10.0 ** -np.arange(3.0, 9.0):  # kinks lie near, and some slopes are small
        for name, found in differences(sim, x, us, weight, params, moves, step).items():
            largest = np.abs(slopes[name] * np.abs(moves[name]).max()).reshape(2, -1).max(1)
            best[name] = np.fmin(best[name], np.abs(found - exact[name]) / largest)
    for name, error in best.items():
        assert error.max() < 1e-6, (name, error)


def test_equal_to_specialised_kernels():
    """The finger under controls and under feedback, every output."""
    sc = scene("flicking_finger")
    rng = np.random.default_rng(5)
    x0, us = near_contact(sc, rng, 12), rng.standard_normal((12, 6, 2))
    weight, gain = rng.standard_normal((12, 7, 6)), 0.1 * rng.standard_normal((12, 6, 2, 6))
    found = []
    for strategy in ("generic", "specialised"):
        sim = slcp.Simulator(sc, slcp.Options(scaling="none"), device="cpu", strategy=strategy)
        back = slcp.vjp(sim, x0, us, weight, parameters=sim.params.names)
        own = {"x0": back.x0, "us": back.controls, **back.parameters}
        x = on_device(x0, "cpu")
        arrays = [on_device(a, "cpu") for a in (us, np.repeat(x0[:, None], 6, 1), gain)]
        policy = ddp.TrackingPolicy(SimpleNamespace(us=arrays[0], xs=arrays[1], K=arrays[2]))
        with wp.Tape() as tape:
            traj = sim.rollout(x, policy=policy, steps=8, record="controls")
            loss = loss_of(traj.states, np.repeat(weight[:, :1], 9, 1), "cpu")
        tape.backward(loss)
        own |= {"policy x0": x.grad.numpy()}
        own |= {f"policy {n}": a.grad.numpy() for n, a in zip(("us", "xs", "gain"), arrays)}
        found.append(own)
    for name, value in found[0].items():
        np.testing.assert_allclose(
            value, found[1][name], atol=1e-8 * (1.0 + np.abs(value).max()), err_msg=name
        )


@pytest.mark.parametrize("gaps", [False, True])
def test_a_recorded_step_is_a_rollout_of_one(gaps):
    """`sim.step` on a tape against A and B of the same states; x and u may have gaps in memory."""
    sim, rng = generic(scene("flicking_finger"), scaling="none"), np.random.default_rng(6)
    x0, u0 = near_contact(sim.scene, rng, 5), rng.standard_normal((5, 2))
    weight = rng.standard_normal((5, 1, 6))
    every = 2 if gaps else 1
    wide = [on_device(np.repeat(a, every, axis=1), "cpu") for a in (x0, u0)]
    with wp.Tape() as tape:
        x, u = (a[:, ::every] for a in wide) if gaps else wide
        made = sim.step(x, u)
        loss = loss_of(made.state.reshape((5, 1, 6)), weight, "cpu")
    tape.backward(loss)
    lin = sim.linearize(x0, u0)
    assert (made.status.numpy() == slcp.Status.SOLVED).all() and (lin.status == slcp.Status.SOLVED).all()
    for array, by in zip(wide, (lin.A, lin.B), strict=True):
        want = np.einsum("wi,wij->wj", weight[:, 0], by)
        np.testing.assert_allclose(
            array.grad.numpy()[:, ::every], want, atol=1e-8 * (1.0 + np.abs(want).max())
        )
        if gaps:
            assert not array.grad.numpy()[:, 1::2].any()


def test_checkpoints_change_nothing():
    sc = scenes.stack(5, [1.0] * 5, 0.5, size=0.1)
    sim, us = generic(sc), wp.zeros((2, 4, 0), dtype=wp.float64, device="cpu")
    weight = np.random.default_rng(2).standard_normal((2, 5, sim.nx))
    weight[:, 1::2] = 0.0  # of the states that are not kept
    found = []
    for every in (None, 2):
        x = on_device(thrown(sc, 2), "cpu")
        with wp.Tape() as tape:
            states = sim.rollout(x, us, checkpoint=every).states
            loss = loss_of(states, weight[:, ::every], "cpu")
        tape.backward(loss)
        found.append(x.grad.numpy())
    np.testing.assert_allclose(found[1], found[0], rtol=1e-8, atol=1e-8 * np.abs(found[0]).max())


def test_unsolved_worlds_have_no_gradient():
    sc = scenes.stack(5, [1.0] * 5, 0.5, size=0.1)
    sim = generic(sc)
    x = thrown(sc, 3)
    x[1, 0] = np.nan
    back = slcp.vjp(sim, x, np.zeros((3, 2, 0)), np.ones((3, 3, sim.nx)), parameters="mass")
    assert back.status[1] == slcp.Status.NONFINITE
    for slopes in (back.x0, back.parameters["mass"]):
        assert np.isnan(slopes[1]).all() and np.isfinite(slopes[[0, 2]]).all()


def test_chunks_of_worlds():
    """As many worlds at a time as a workspace takes: the same numbers."""
    sc = scenes.stack(5, [1.0] * 5, 0.5, size=0.1)
    sim, x = generic(sc), thrown(sc, 5)
    arguments = x, np.zeros((5, 2, 0)), np.ones((5, 3, sim.nx))
    whole = slcp.vjp(sim, *arguments, parameters="mass")
    sim.kernels.stepping.chunk = 2
    parts = slcp.vjp(sim, *arguments, parameters="mass")
    np.testing.assert_array_equal(parts.x0, whole.x0)
    np.testing.assert_array_equal(parts.parameters["mass"], whole.parameters["mass"])


def test_pytorch_has_the_same_gradients():
    torch = pytest.importorskip("torch")
    from slcp_warp import torch as differentiable

    sc = scenes.stack(5, [1.0] * 5, 0.5, size=0.1)
    sim, x = generic(sc), thrown(sc, 3)
    us, weight = np.zeros((3, 4, 0)), np.random.default_rng(2).standard_normal((3, 5, sim.nx))
    back = slcp.vjp(sim, x, us, weight, parameters="friction")
    start, friction = (torch.tensor(a, requires_grad=True) for a in (x, sim.params["friction"]))
    states = differentiable.rollout(sim, start, torch.tensor(us), {"friction": friction}).states
    (states * torch.tensor(weight)).sum().backward()
    total = back.parameters["friction"].sum(0)
    np.testing.assert_allclose(start.grad, back.x0, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(friction.grad, total, rtol=1e-8, atol=1e-9 * np.abs(total).max())


@slow
def test_closed_loops_in_pytorch_are_those_of_specialised_kernels():
    torch = pytest.importorskip("torch")
    from slcp_warp import torch as differentiable

    sc, found = scene("flicking_finger"), []
    torch.manual_seed(0)
    module = torch.nn.Sequential(torch.nn.Linear(6, 4), torch.nn.Tanh(), torch.nn.Linear(4, 2)).double()
    for strategy in ("generic", "specialised"):
        sim = slcp.Simulator(sc, slcp.Options(scaling="none"), device="cpu", strategy=strategy)
        start = torch.tensor(near_contact(sc, np.random.default_rng(5), 8), requires_grad=True)
        module.zero_grad()
        states = differentiable.closed_loop(sim, start, module, 10).states
        (states * torch.linspace(-1.0, 1.0, 6, dtype=torch.float64)).sum().backward()
        found.append([start.grad.numpy(), *(p.grad.numpy().copy() for p in module.parameters())])
    for ours, theirs in zip(*found):
        np.testing.assert_allclose(ours, theirs, atol=1e-8 * (1.0 + np.abs(theirs).max()))


@pytest.mark.slow
def test_no_gradient_is_that_of_another_solution():
    """Coulomb's friction may have several: a world whose steps end elsewhere when solved again has none."""
    sc = slcp.scenes.heap(8)
    sim = slcp.Simulator(sc, slcp.Options("hard", friction="coulomb"), dtype="float64", strategy="generic")
    x = np.tile(sc.x0, (40, 1))
    x[:, sc.nv :] += np.random.default_rng(0).standard_normal((40, sc.nv))
    us, weight = np.zeros((40, 60, 0)), np.ones((40, 61, sim.nx))
    run = sim.rollout(x, us)
    solved = run.status == 0
    found = slcp.vjp(sim, x, us, weight * (np.arange(61) == 60)[:, None]).x0
    none = np.isnan(found).any(axis=1)
    assert none[~solved].all() and none[solved].sum() > 3 and (~none).sum() > 10
    along = np.random.default_rng(1).standard_normal(x.shape)

    def difference(h):  # contacts change beyond 1e-9; none where a neighbour ends in another solution
        ends = [sim.rollout(x + s * h * along, us).states[:, -1].sum(axis=1) for s in (-1.0, 1.0)]
        return (ends[1] - ends[0]) / (2.0 * h)

    slope, exact, again = (found * along).sum(axis=1), difference(1e-9), difference(3e-10)
    trusted = ~none & (np.abs(again - exact) <= 1e-3 * (1.0 + np.abs(exact)))
    close = np.abs(slope - exact) <= 1e-3 * (1.0 + np.abs(exact))
    assert trusted.sum() > 20 and close[trusted].mean() > 0.9
