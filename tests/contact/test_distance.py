"""The kernels' signed distance against a search of all directions, for all shapes in all kinds of places."""

import numpy as np
import pytest
import warp as wp
from oracle import Oracle
from random_scenes import near_contact
from simulators import numbers, rounded, scene, simulator

import slcp_warp as slcp

TOLERANCE = {"float32": 3e-6, "float64": 2e-12}


def gaps(name, device, dtype, q, **changes):
    """Contact gaps (B, nr) of the kernels and the oracle's (B, nr) at configurations q, at rest."""
    sim = simulator(name, device, dtype)
    x = np.concatenate([q, np.zeros_like(q)], axis=1)
    got = sim.step(x, np.zeros((len(q), scene(name).nu)), sim.params.replace(**changes)).gap
    (q64,) = rounded(dtype, q)
    return np.asarray(got, float), Oracle(scene(name), **numbers(scene(name), dtype, **changes)).rows(q64)[0]


def check(got, exact, dtype, size=1.0):
    assert np.isfinite(got).all()
    np.testing.assert_allclose(got, exact, rtol=0, atol=TOLERANCE[dtype.__name__] * size)


@pytest.mark.parametrize("spread", [0.3, 1.5, 10.0])
def test_random_places(device, spread, dtype=wp.float64):
    """Deep, touching and far apart; the greatest value is unique even where its direction is not."""
    q = spread * np.random.default_rng(7).standard_normal((400, 4))
    got, exact = gaps("menagerie", device, dtype, q)
    assert (exact < -0.1).mean() > 0.03 and (exact > 0.1).mean() > 0.2
    check(got, exact, dtype, max(1.0, spread))


def test_nearly_touching_places(device, dtype):
    gap = (0.0, 1e-3, -1e-3, 1e-6, 0.05, -0.05)
    x = near_contact(scene("turned_pair"), np.random.default_rng(8), 300, gap)
    got, exact = gaps("turned_pair", device, dtype, x[:, :6])
    assert (np.abs(exact[:, 0]) < 2e-3).mean() > 0.5
    check(got, exact, dtype, 3.0)


def test_concentric_and_axis_aligned_places(device, dtype):
    """Several directions are equally good, or the first guess is of no use: the value is right still."""
    base = scene("turned_pair").default_parameters()
    straight = {"shape_angle": np.zeros(2), "shape_offset": np.zeros((2, 2)), "angle": np.zeros(2)}
    quarter = np.pi / 2
    q = np.zeros((40, 6))
    turns = np.array([0.0, quarter, np.pi, -quarter, 0.3])
    q[:5, 5] = turns  # concentric
    for i, (dx, dy) in enumerate(
        [(1.5, 0.0), (0.0, 0.75), (-1.5, 0.0), (0.0, -0.75), (3, 0), (0, 3), (1e-3, 0)]
    ):
        q[5 * i + 5 : 5 * i + 10, 3:5] = dx, dy
        q[5 * i + 5 : 5 * i + 10, 5] = turns
    for radius in (base["radius"], np.array([[0.5, 0.5], [0.5, 0.5]]), np.array([[0.7, 0.5], [0.7, 0.5]])):
        got, exact = gaps("turned_pair", device, dtype, q, **straight, radius=radius)
        check(got, exact, dtype, 3.0)


def test_steps_from_degenerate_places_are_finite(device, dtype):
    """Concentric circles have no normal; a step from there still returns numbers."""
    sim = simulator("turned_pair", device, dtype)
    params = sim.params.replace(shape_offset=np.zeros((2, 2)), radius=np.array([[0.5, 0.5], [0.5, 0.5]]))
    step = sim.step(np.zeros((3, 12)), np.zeros((3, 0)), params)
    assert np.isfinite(step.state).all() and np.isfinite(step.gap).all() and np.isfinite(step.impulse).all()


def test_needle_and_point_shapes(device, dtype):
    """Very flat ellipses and points of zero radius."""
    rng = np.random.default_rng(9)
    q = 0.8 * rng.standard_normal((200, 6))
    for radius in ([[0.8, 0.01], [0.01, 0.8]], [[1.0, 0.05], [1e-3, 1e-3]]):
        got, exact = gaps("turned_pair", device, dtype, q, radius=np.array(radius))
        check(got, exact, dtype, 3.0)


@pytest.mark.parametrize("name", ["capsules", "pill", "blocks", "slab", "hoop"])
def test_capsules_rectangles_and_rings(device, name, dtype=wp.float64):
    """Beside and beyond their ends; and the rows of a step, by the oracle's solution.

    Deeper than the sum of the radii both sides of a segment are as good: too close for the oracle's grid.
    """
    sc, rng = scene(name), np.random.default_rng(10)
    x = near_contact(sc, rng, 120, (0.0, 0.01, -0.05, np.inf))
    x = x[Oracle(sc).rows(x[:, : sc.nv])[0].min(axis=1) > -0.2]
    got, exact = gaps(name, device, dtype, x[:, : sc.nv])
    assert (np.abs(exact).min(axis=1) < 0.06).mean() > 0.5
    check(got, exact, dtype, 3.0)
    (x64,) = rounded(dtype, x)
    step = simulator(name, device, dtype).step(x)
    oracle, solved = Oracle(sc, **numbers(sc, dtype)), step.status == 0
    assert solved.mean() > 0.95
    assert np.isnan(oracle.step(x64[~solved], hard=True)[1]).any(axis=1).all()  # jammed: infeasible
    state = oracle.step(x64[solved])[0]
    error = np.abs(step.state[solved] - state).max(axis=1) / (1.0 + np.abs(state).max(axis=1))
    assert error.max() < 100 * TOLERANCE[dtype.__name__]


@pytest.mark.parametrize("strategy", ["generic", "specialised"])
def test_rectangles_in_each_other(device, strategy, monkeypatch):
    """Corners leave as the whole does, by the oracle's projections of all corners."""
    sc, rng = scene("blocks"), np.random.default_rng(11)
    x = near_contact(sc, rng, 300, (-0.02, -0.05, -0.1, -0.2))
    oracle = Oracle(sc)
    exact, _, margin = oracle.rows(x[:, : sc.nv])
    sim = slcp.Simulator(sc, slcp.Options("hard"), dtype="float64", device=device, strategy=strategy)
    found = sim.step(x)
    sure = margin > 1e-3  # two sides are not as near
    assert (exact < -0.05).any(axis=1).mean() > 0.5 and sure.mean() > 0.8
    np.testing.assert_allclose(found.gap[sure], exact[sure], atol=1e-9)
    monkeypatch.setattr("oracle.leaving", lambda oracle, q, k, angle, gap: angle)  # each by its nearest side
    assert (np.abs(oracle.rows(x[:, : sc.nv])[0] - exact).max(axis=1) > 1e-3).sum() > 10


@pytest.mark.parametrize("strategy", ["generic", "specialised"])
def test_derivatives_of_rectangles_in_each_other(device, strategy):
    """A of hard steps beside central differences, where a corner leaves by another side than the nearest."""
    sc, rng = scene("blocks"), np.random.default_rng(12)
    x = near_contact(sc, rng, 300, (-0.02, -0.05, -0.1, -0.2))
    sim = slcp.Simulator(sc, slcp.Options("hard"), dtype="float64", device=device, strategy=strategy)
    found, step = sim.linearize(x), 1e-6
    moved = np.eye(sc.nv * 2) * step
    ahead, behind = (sim.step((x[:, None] + s * moved).reshape(-1, x.shape[1])) for s in (1.0, -1.0))
    exact = ((ahead.state - behind.state) / (2.0 * step)).reshape(len(x), -1, x.shape[1]).swapaxes(1, 2)
    well = (found.status == 0) & (np.maximum(ahead.status, behind.status).reshape(len(x), -1).max(1) == 0)
    away = np.abs(sim.step(x).gap).min(axis=1) > 1e-4
    error = np.abs(found.A - exact).max(axis=(1, 2)) / (1.0 + np.abs(exact).max(axis=(1, 2)))
    assert well.sum() > 100 and np.median(error[well]) < 1e-7
    assert (error[well & away] < 1e-5).mean() > 0.97  # sets of rows that change within the differences
