"""Coulomb's hard friction of many contacts: modes found directly, judged by an oracle in NumPy."""

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from oracle_coulomb import natural_map
from simulators import scene

import slcp_warp as slcp
from slcp_warp.kernels.generic.linear.lu import make_lu
from slcp_warp.kernels.generic.work import M33, V3

COULOMB = slcp.Options(residual="hard", friction="coulomb")


def thrown(sc, worlds, rng, spread=0.0):
    """States around a scene's start, velocities N(0, 1)."""
    x = np.tile(sc.x0, (worlds, 1))
    x[:, sc.nv :] += rng.standard_normal((worlds, sc.nv))
    x[:, : sc.nv] += spread * rng.standard_normal((worlds, sc.nv))
    return x


def rolled(sc, x, steps, **changes):
    """A rollout by the generic kernels, without controls."""
    sim = slcp.Simulator(sc, COULOMB, "cpu", "float64", strategy="generic")
    return sim.rollout(
        x, np.zeros((len(x), steps, sim.nu)), sim.params.replace(**changes), record=("impulse",)
    )


@pytest.mark.parametrize(
    "boxes,worlds,steps,mu,most",
    [(3, 400, 75, 0.5, 3), (6, 300, 40, 1.0, 1), (6, 300, 40, 2.0, 8), (15, 60, 30, 0.5, 1)],
    ids=["3 boxes", "rough", "rougher", "15 boxes"],
)
def test_thrown_stacks_are_solved(boxes, worlds, steps, mu, most):
    """All but one step in 10,000; where friction holds contacts against each other, a few more."""
    sc = slcp.scenes.stack(boxes)
    run = rolled(sc, thrown(sc, worlds, np.random.default_rng(3)), steps, friction=mu * np.ones(2 * boxes))
    assert (run.status != slcp.Status.SOLVED).sum() <= most


@pytest.mark.parametrize("name", ["walker", "hopper", "heap", "stack", "unequal"])
def test_law_holds(name):
    """0 <= w_n _|_ lambda_n >= 0, the cone, friction against the slip, M dv = J' lambda, step by step."""
    rng = np.random.default_rng(4)
    sc = (
        slcp.scenes.stack(5, masses=list(10.0 ** rng.uniform(-2, 2, 5))) if name == "unequal" else scene(name)
    )
    x = thrown(sc, 40, rng, 1e-3)
    run = rolled(sc, x, 120)
    assert (run.status == slcp.Status.SOLVED).mean() > 0.95
    going = run.status == slcp.Status.SOLVED
    pressed = 0
    for k in range(0, 120, 12):
        step = SimpleNamespace(state=run.states[going, k + 1], impulse=run.impulse[going, k])
        worst = natural_map(sc, float, run.states[going, k], np.zeros((going.sum(), sc.nu)), step)
        assert worst.max() < 1e-10, k
        pressed += (step.impulse > 0).any(1).sum()
    assert pressed > 50


@pytest.mark.parametrize(
    "discs,width,worlds,most",
    [(10, 0.63, 150, 0), (30, 1.05, 12, 0), (10, 0.6, 60, 3), (100, 2.1, 2, 1)],
    ids=["10 discs", "30 discs", "wedged", "100 discs"],
)
def test_thrown_heaps_are_solved(discs, width, worlds, most):
    """Loops of contacts that stick; wedged exactly between two walls a few worlds have no solution."""
    sc = slcp.scenes.heap(discs, width=width)
    run = rolled(sc, thrown(sc, worlds, np.random.default_rng(11)), 40)
    assert (run.status != slcp.Status.SOLVED).sum() <= most
    if discs > 10:  # the oracle looks at all pairs
        return
    going = np.flatnonzero(run.status == slcp.Status.SOLVED)[:2]
    for k in (5, 20):
        step = SimpleNamespace(state=run.states[going, k + 1], impulse=run.impulse[going, k])
        worst = natural_map(sc, float, run.states[going, k], np.zeros((len(going), 0)), step)
        assert worst.max() < 1e-10 and (step.impulse > 0).sum() > 2 * discs


def test_a_thrown_heap_is_looked_at_again():
    """Starts of 60 discs that no path of the usual length solves, with a few pairs or with all: longer ones
    do, and ground and walls give the momentum that the discs take.
    """
    sc = slcp.scenes.heap(60, width=1.68)
    found = ((2, 14), (5, 6), (5, 8))
    x = np.concatenate([thrown(sc, 30, np.random.default_rng(seed))[[world]] for seed, world in found])
    run = rolled(sc, x, 1)
    going = np.flatnonzero(run.status == slcp.Status.SOLVED)
    assert len(going) >= 2
    for world in going:
        rises = (run.states[world, 1] - x[world])[sc.nv + 1 :: 3] + 9.81 * 0.01
        np.testing.assert_allclose(borne(sc, run.impulse[world, 0]), rises.sum(), rtol=1e-9)


def test_the_law_holds_in_large_islands():
    """50 boxes thrown from a stack, without and with a last step: so many blocks come near by passes."""
    sc = slcp.scenes.stack(50)
    x = thrown(sc, 6, np.random.default_rng(7))
    run = rolled(sc, x, 12)
    assert (run.status == slcp.Status.SOLVED).all()
    for k in (0, 1, 11):
        step = SimpleNamespace(state=run.states[:, k + 1], impulse=run.impulse[:, k])
        worst = natural_map(sc, float, run.states[:, k], np.zeros((len(x), 0)), step)
        assert worst.max() < 1e-10 and (step.impulse > 0).sum() > 600


def test_a_heap_comes_to_rest():
    """30 discs with 5 % of room between the walls settle; ground and walls bear their weight."""
    sc = slcp.scenes.heap(30, width=1.05)
    run = rolled(sc, sc.x0[None], 300)
    assert run.status[0] == slcp.Status.SOLVED
    assert np.abs(run.states[0, -1, sc.nv :]).max() < 1e-9
    np.testing.assert_allclose(borne(sc, run.impulse[0, -1]), 30 * 9.81 * 0.01, rtol=1e-9)


def borne(sc, impulse):
    """What ground and walls bear of the weight in a step."""
    names = np.array(sc.row_names)
    up = {"ground": ("+", 1.0), "left_wall": ("-", 1.0), "right_wall": ("-", -1.0)}  # rows n +, t -
    return sum(sign * impulse[np.char.startswith(names, wall) & np.char.endswith(names, row)].sum()
               for wall, (row, sign) in up.items())  # fmt: skip


@pytest.mark.parametrize("discs,width", [(15, 0.84), (60, 1.68)])
def test_what_lies_still_stays_without_a_last_step(discs, width):
    """A heap at rest is solved by modes where it is small, from the convex solution where it is large. It is
    put at rest: discs may go on turning each other as gears do, which nothing brakes.
    """
    sc = slcp.scenes.heap(discs, width=width)
    x = rolled(sc, sc.x0[None], 300).states[:, -1]
    x[:, sc.nv :] = 0.0
    run = rolled(sc, x, 1)
    assert run.status[0] == slcp.Status.SOLVED
    assert np.abs(run.states[0, -1, sc.nv :]).max() < 1e-8
    np.testing.assert_allclose(borne(sc, run.impulse[0, -1]), discs * 9.81 * 0.01, rtol=1e-7)


def test_rest_stays():
    """A stack at rest for 200 steps: nothing moves but by rounding of the gaps."""
    sc = slcp.scenes.stack(10)
    run = rolled(sc, sc.x0[None], 200)
    assert np.abs(run.states[0, -1] - sc.x0).max() < 1e-10
    np.testing.assert_allclose(run.impulse[0, -1, 0:4:2].sum(), 10 * 9.81 * 0.01, rtol=1e-9)


def test_what_nothing_presses_falls_freely():
    """A block between fingers that touch it and do not press: not a bit of rounding holds it."""
    sc = scene("grasp")
    run = rolled(sc, sc.x0[None], 20)
    assert run.status[0] == slcp.Status.SOLVED
    fall = sc.x0[:5] + np.array([0, 0, 0, -9.81 * sc.step_size**2 * 20 * 21 / 2, 0])
    np.testing.assert_allclose(run.states[0, -1, :5], fall, rtol=0, atol=1e-12)


def envelopes(rng, first):
    """A matrix of 3 x 3 blocks in an envelope, dominated by its diagonal, whose signs differ: dense, and as
    `lu.py` stores it.
    """
    n = len(first)
    dense = np.zeros((3 * n, 3 * n))
    lower, upper, at = [], [], []
    for i in range(n):
        at.append(len(lower) - first[i])
        for j in range(first[i], i + 1):
            rows, columns = slice(3 * i, 3 * i + 3), slice(3 * j, 3 * j + 3)
            dense[rows, columns] = rng.standard_normal((3, 3))
            if i == j:
                dense[rows, columns] += 20.0 * np.diag(rng.choice([-1.0, 1.0], 3))
            if i != j:
                dense[columns, rows] = rng.standard_normal((3, 3))
            lower.append(dense[rows, columns])
            upper.append(dense[columns, rows].T)
    return dense, np.array(lower), np.array(upper), np.array(at, np.int32)


def test_lu_solves_with_a_matrix_and_its_transpose():
    lu = make_lu()

    @wp.kernel(module="unique", enable_backward=False)
    def solve_both(
        m: wp.array(dtype=M33), u: wp.array(dtype=M33), first: wp.array(dtype=int), at: wp.array(dtype=int),
        order: wp.array(dtype=int), x: wp.array(dtype=V3), y: wp.array(dtype=V3), n: int,
    ):  # fmt: skip
        lu.factor(m, u, first, at, 0, n)
        lu.solve(m, u, first, at, order, x, 0, n)
        lu.solve(u, m, first, at, order, y, 0, n)

    rng = np.random.default_rng(0)
    first = np.array([0, 0, 1, 0, 2, 4, 3], np.int32)
    n = len(first)
    dense, lower, upper, at = envelopes(rng, first)
    order = rng.permutation(n).astype(np.int32)
    b = rng.standard_normal((n, 3))
    m, u = (wp.array(a, dtype=M33, device="cpu") for a in (lower, upper))
    x, y = (wp.array(b, dtype=V3, device="cpu") for _ in range(2))
    indices = [wp.array(a, dtype=int, device="cpu") for a in (first, at, order)]
    wp.launch(solve_both, 1, inputs=[m, u, *indices, x, y, n], device="cpu")
    for found, matrix in ((x, dense), (y, dense.T)):
        expected = np.linalg.solve(matrix, b[order].ravel()).reshape(n, 3)
        np.testing.assert_allclose(found.numpy()[order], expected, rtol=0, atol=1e-12)
