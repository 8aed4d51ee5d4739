"""Rows that are all but opposed: solutions, where there are any, are impulses against each other so large
that their rounding is not small beside the data. What is SOLVED satisfies w = A lambda + b on their scale.
"""

import numpy as np
import pytest

import slcp_warp as slcp

HELD = {np.float32: 4e-5, np.float64: 2e-9}  # of |b| + sigma; 2e-5 is documented, of twice the terms
SIGMA = 0.05


def nearly_opposed(rng, count, n, rank, dtype):
    """A = G G' (B, n, n) and b: half of G's rows are the others' opposites but for 1e-8 to 1e-2."""
    g = rng.normal(size=(count, n, rank))
    part = rng.uniform(*((-8, -2) if dtype is np.float32 else (-17, -7)), (count, 1, 1))
    half = n // 2
    g[:, half : 2 * half] = -g[:, :half] + 10**part * rng.normal(size=(count, half, rank))
    weight = 10 ** rng.uniform(-3, 3, (count, n, 1)) if n == 4 else np.ones((count, n, 1))
    a = np.einsum("bij,bkj->bik", g * weight, g * weight).astype(dtype)
    return a, (rng.normal(size=(count, n)) * weight[..., 0]).astype(dtype)


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name,scaling", [("hard", "inertia"), ("rem-logistic", "none")])
@pytest.mark.parametrize("n", [2, 4])  # few rows and then the general method; the general method
def test_what_is_solved_holds_on_the_scale_of_the_data(name, scaling, n, dtype):
    a, b = nearly_opposed(np.random.default_rng(0), 20000, n, n, dtype)
    sol = slcp.solve_complementarity(a, b, SIGMA, name, scaling, device="cpu")
    solved = sol.status == slcp.Status.SOLVED
    assert 0.2 < solved.mean() < 0.6  # of opposed rows about half are shut
    wide = np.longdouble
    w = np.einsum("bij,bj->bi", a.astype(wide), sol.impulse.astype(wide)) + b
    size = np.abs(b).max(1) + SIGMA
    assert (np.abs(w - sol.w).max(1) / size)[solved].max() < HELD[dtype]
    if name == "hard":
        miss = np.abs(np.minimum(np.einsum("bii->bi", a) * sol.impulse, w)).max(1)
        assert (miss / size)[solved].max() < HELD[dtype]


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name,scaling", [("hard", "inertia"), ("rem-logistic", "none")])
def test_opposed_rows_beside_something_fast_are_judged_by_their_own_data(name, scaling, dtype):
    """Rounding of J v' that was nothing beside another body's 1e5 m/s was all of what a slow one did."""
    rng, count = np.random.default_rng(1), 20000
    slow, b = nearly_opposed(rng, count, 2, 2, dtype)
    a = np.zeros((count, 4, 4), dtype)
    a[:, :2, :2] = slow
    a[:, 2, 2] = a[:, 3, 3] = 1.0
    b = np.concatenate([b, np.full((count, 2), -1e5, dtype)], 1)
    sol = slcp.solve_complementarity(a, b, SIGMA, name, scaling, device="cpu")
    solved = sol.status == slcp.Status.SOLVED
    assert 0.1 < solved.mean() < 0.8
    wide = np.longdouble
    w = np.einsum("bij,bj->bi", a.astype(wide), sol.impulse.astype(wide)) + b
    size = np.abs(b[:, :2]).max(1) + SIGMA
    assert (np.abs(w - sol.w)[:, :2].max(1) / size)[solved].max() < HELD[dtype]
