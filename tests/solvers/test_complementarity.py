"""Batches of plain (stochastic) complementarity problems: residuals, an independent solver, multi-starts,
gradients, bad input.
"""

import functools

import numpy as np
import pytest
import warp as wp
from random_scenes import diagonal, problems
from scipy.optimize import least_squares, linprog, minimize
from scipy.stats import norm

import slcp_warp as slcp
from slcp_warp.simulator.residuals import residual

SIGMAS = (0.2, 0.02, 1e-3)
SIZES = [  # residual, n, rank: rem-normal differs from rem-logistic in its smoothing alone
    (name, n, rank)
    for name in ("rem-logistic", "rem-normal", "hard")
    for n, rank in ((4, 4), (4, 2), (1, 1), (8, 4))
    if n < 8 or name != "rem-normal"
]


def smooth(x, sigma, noise):
    if noise == "normal":
        return x * norm.cdf(x / sigma) + sigma * norm.pdf(x / sigma)
    return sigma * np.logaddexp(0.0, x / sigma)


def rem_by_scipy(a, b, sigma, noise):
    """A lambda of one problem by SciPy's least squares, sigma lowered in steps."""
    d, x = np.diag(a), np.zeros(len(b))  # x = D lambda - w
    for level in np.geomspace(max(sigma, 2.0), sigma, 12):

        def equations(x, level=level):
            return smooth(-x, level, noise) - b - a @ (smooth(x, level, noise) / d)

        x = least_squares(equations, x, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    return a @ (smooth(x, sigma, noise) / d), np.abs(equations(x)).max()


@pytest.mark.parametrize("name,n,rank", SIZES)
def test_solutions_of_random_problems(device, name, n, rank):
    a, b = problems(n, rank, 300)
    for sigma in SIGMAS if name != "hard" else (1.0,):
        sol = slcp.solve_complementarity(a, b, sigma, name, device=device)
        assert (sol.status == 0).all()
        own = diagonal(a) * sol.impulse
        w = np.einsum("bij,bj->bi", a, sol.impulse) + b
        error = np.minimum(own, w) if name == "hard" else own - smooth(own - w, sigma, name[4:])
        assert np.abs(error).max() < 1e-10
        np.testing.assert_allclose(sol.w, w, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rem-logistic", "hard"])
def test_few_rows_and_many_have_the_same_solution(device, name):
    """Three rows are solved in their own space (few_rows.py), the same beside another in that of v."""
    a, b = problems(3, 3, 3000, seed=5)
    a += 0.05 * np.eye(3)
    beside = np.broadcast_to(np.eye(4), (len(a), 4, 4)).copy()
    beside[:, :3, :3] = a
    more = np.concatenate([b, np.full((len(b), 1), 0.7)], axis=1)
    for sigma in SIGMAS:
        few, many = (
            slcp.solve_complementarity(A, c, sigma, name, device=device) for A, c in ((a, b), (beside, more))
        )
        assert (few.status == 0).all() and (many.status == 0).all()
        scale = np.abs(few.impulse).max(axis=1, keepdims=True) + 1.0
        assert (np.abs(few.impulse - many.impulse[:, :3]) / scale).max() < 1e-10
        assert (few.impulse > 0.1).sum() > 2000


@pytest.mark.parametrize(
    "name", ["rem-logistic", *(pytest.param(x, marks=pytest.mark.slow) for x in ("erm-normal", "hard"))]
)
def test_float32_torch_tensors(device, name):
    torch = pytest.importorskip("torch")
    a, b = problems(4, 3, 300, seed=8)
    where = wp.device_to_torch(wp.get_device(device))
    given = [torch.tensor(x, dtype=torch.float32, device=where) for x in (a, b)]
    sol = slcp.solve_complementarity(*given, 0.1, name)
    for x in (sol.impulse, sol.w, sol.status, sol.iterations, *sol.vjp(torch.ones_like(given[1]))[:2]):
        assert isinstance(x, torch.Tensor) and x.device == given[0].device
    assert sol.impulse.dtype == torch.float32
    status, lam = (x.cpu().numpy() for x in (sol.status, sol.impulse))
    assert (status == 0).mean() > (0.95 if name == "erm-normal" else 0.999)
    own = diagonal(a) * lam
    w = np.einsum("bij,bj->bi", a, lam.astype(float)) + b
    size = np.abs(b).max(axis=1, keepdims=True) + np.abs(own).max(axis=1, keepdims=True)
    if name == "erm-normal":
        exact = slcp.solve_complementarity(a, b, 0.1, name, device=device)
        f = [[objective(x[i], a[i], b[i], 0.1, name) for i in range(len(a))] for x in (lam, exact.impulse)]
        better = np.array(f[0]) <= np.array(f[1]) * 1.001 + 1e-5 * size[:, 0] ** 2
        assert better[(status == 0) & (exact.status == 0)].mean() > 0.98
        return
    error = np.minimum(own, w) if name == "hard" else own - smooth(own - w, 0.1, name[4:])
    assert (np.abs(error) / size)[status == 0].max() < 1e-5


@pytest.mark.parametrize("n,rank", [(4, 4), (4, 2), pytest.param(8, 4, marks=pytest.mark.slow)])
def test_continuation_ends_at_the_hard_solution(device, n, rank):
    a, b = problems(n, rank, 300, seed=7)
    sol = slcp.solve_complementarity(a, b, residual="hard", method="continuation", device=device)
    assert (sol.status == 0).all()
    w = np.einsum("bij,bj->bi", a, sol.impulse) + b
    assert np.abs(np.minimum(diagonal(a) * sol.impulse, w)).max() < 1e-10
    direct = slcp.solve_complementarity(a, b, residual="hard", device=device)
    np.testing.assert_allclose(sol.w, direct.w, atol=1e-9)  # of the two A lambda
    assert sol.iterations.mean() >= direct.iterations.mean() >= 1.0


def test_continuation_without_a_solution(device):
    a = np.kron(np.eye(2), [[1.0, -1.0], [-1.0, 1.0]])  # w1 + w2 = b1 + b2 < 0
    b = [-1.0, 0.0, 1.0, 1.0]
    sol = slcp.solve_complementarity(a, b, residual="hard", method="continuation", device=device)
    assert sol.status == slcp.Status.NOT_CONVERGED


def test_rem_agrees_with_an_independent_solver(device):
    for rank in (4, 2):
        a, b = problems(4, rank, 12, seed=1)
        for sigma in (0.2, 0.02):
            sol = slcp.solve_complementarity(a, b, sigma, "rem-logistic", device=device)
            for i in range(len(a)):
                pushed, left = rem_by_scipy(a[i], b[i], sigma, "logistic")
                if left < 1e-12:
                    np.testing.assert_allclose(a[i] @ sol.impulse[i], pushed, atol=1e-10)


def objective(lam, a, b, sigma, name):
    return residual(name, np.diag(a) * lam, a @ lam + b, sigma).sum()


@pytest.mark.parametrize("name", ["erm-normal", pytest.param("erm-logistic", marks=pytest.mark.slow)])
def test_erm_is_stationary_and_no_worse_than_its_start(device, name):
    for rank in (4, 2):
        a, b = problems(4, rank, 60, seed=2)
        for sigma in SIGMAS:
            sol = slcp.solve_complementarity(a, b, sigma, name, device=device)
            start = slcp.solve_complementarity(a, b, sigma, name.replace("erm", "rem"), device=device)
            assert (sol.status == 0).all()
            for i in range(len(a)):
                f = functools.partial(objective, a=a[i], b=b[i], sigma=sigma, name=name)
                got = f(sol.impulse[i])
                assert got <= f(start.impulse[i]) * (1.0 + 1e-12)
                step = 1e-5 * sigma
                slope = [(f(sol.impulse[i] + step * e) - f(sol.impulse[i] - step * e)) / (2.0 * step)
                         for e in np.eye(4)]  # fmt: skip
                assert np.abs(slope).max() < 1e-5 * sigma * (1.0 + np.abs(a[i]).max() ** 2)


def test_erm_ends_where_its_objective_is_lost_in_rounding(device):
    """The two friction rows of a body that leaves: in the normal's tail the terms of (15) cancel."""
    a = np.kron(np.eye(2), [[1.25, 0.75], [0.75, 1.25]])
    b = 0.1 * np.linspace(-10.0, 10.0, 2000)[:, None] * np.ones(4)
    sol = slcp.solve_complementarity(np.tile(a, (len(b), 1, 1)), b, 0.1, "erm-normal", device=device)
    assert (sol.status == 0).all()
    own = 1.25 * sol.impulse
    x = own - sol.w
    by_a, by_w = own * norm.cdf(-x / 0.1), own * norm.cdf(x / 0.1) - smooth(x, 0.1, "normal")
    assert np.abs(1.25 * by_a + by_w @ a).max() < 1e-11


@pytest.mark.slow
def test_erm_against_searches_from_many_starts(device):
    rng = np.random.default_rng(5)
    a, b = problems(4, 4, 8, seed=3)
    sigma = 0.2
    sol = slcp.solve_complementarity(a, b, sigma, "erm-normal", device=device)
    for i in range(len(a)):
        f = functools.partial(objective, a=a[i], b=b[i], sigma=sigma, name="erm-normal")
        starts = sol.impulse[i] + rng.normal(size=(6, 4)) * (0.2 + np.abs(sol.impulse[i]))
        best = min(minimize(f, x, method="BFGS").fun for x in starts)
        assert f(sol.impulse[i]) <= best + 1e-7


@pytest.mark.parametrize(
    "name,scaling",
    [
        ("rem-logistic", "inertia"),
        pytest.param("rem-logistic", "none", marks=pytest.mark.slow),
        ("erm-normal", "inertia"),
        ("hard", "inertia"),
    ],
)
def test_gradients(device, name, scaling):
    a, b = problems(4, 4, 20, seed=4)
    a += 0.5 * np.eye(4)
    rng = np.random.default_rng(6)
    sigma = rng.uniform(0.1, 0.3, size=b.shape)
    weight = rng.normal(size=b.shape)
    solve = functools.partial(slcp.solve_complementarity, residual=name, scaling=scaling, device=device)
    sol = solve(a, b, sigma)
    keep = sol.status == 0
    if name == "hard":
        keep &= np.abs(diagonal(a) * sol.impulse - sol.w).min(axis=1) > 1e-3
    assert keep.mean() > 0.8
    by_a, by_b, by_sigma = sol.vjp(weight)
    turn = rng.normal(size=a.shape)
    turn = turn + turn.swapaxes(1, 2)
    for grad, move in ((by_a, (turn, 0, 0)), (by_b, (0, 1.0 + b, 0)), (by_sigma, (0, 0, 1.0 + sigma))):
        step = 1e-6
        ends = [solve(a + k * step * move[0], b + k * step * move[1], sigma + k * step * move[2]).impulse
                for k in (-1, 1)]  # fmt: skip
        exact = ((ends[1] - ends[0]) * weight).sum(axis=1) / (2.0 * step)
        got = (grad * next(m for m in move if not np.isscalar(m))).reshape(len(a), -1).sum(axis=1)
        np.testing.assert_allclose(got[keep], exact[keep], rtol=2e-5, atol=2e-6)


def test_gradients_on_a_tape(device):
    a, b = problems(4, 4, 3, seed=4)
    arrays = [wp.array(x, dtype=wp.float64, device=device, requires_grad=True) for x in (a, b)]
    with wp.Tape() as tape:
        sol = slcp.solve_complementarity(*arrays, 0.1)
    weight = np.random.default_rng(0).normal(size=b.shape)
    tape.backward(grads={sol.impulse: wp.array(weight, dtype=wp.float64, device=device)})
    by_a, by_b, by_sigma = slcp.solve_complementarity(a, b, 0.1, device=device).vjp(weight)
    np.testing.assert_allclose(arrays[0].grad.numpy(), by_a, rtol=1e-12)
    np.testing.assert_allclose(arrays[1].grad.numpy(), by_b, rtol=1e-12)
    assert by_sigma.shape == ()


def test_no_solution(device):
    a = np.array([[1.0, -1.0], [-1.0, 1.0]])  # w1 + w2 = b1 + b2 < 0
    a = np.pad(a, (0, 2)) + np.diag([0.0, 0.0, 1.0, 1.0])
    sol = slcp.solve_complementarity(a, [-1.0, -1.0, 0.0, 0.0], residual="rem-logistic", device=device)
    assert sol.status == slcp.Status.INFEASIBLE
    assert sol.impulse.shape == (4,)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_what_a_linear_program_calls_infeasible(device, dtype):
    """Random singular A = L L', no w = L v + b positive: A y of the y that says so is zero by rounding."""
    rng = np.random.default_rng(1)
    for n, rank in ((4, 2), (4, 1)):
        L, b = rng.normal(size=(150, n, rank)), rng.normal(size=(150, n))
        a = (L @ L.swapaxes(1, 2)).astype(dtype)
        status = slcp.solve_complementarity(a, b.astype(dtype), residual="hard", device=device).status
        free = [(None, None)] * rank
        none = [linprog(np.zeros(rank), A_ub=-part, b_ub=c, bounds=free).status == 2 for part, c in zip(L, b)]
        assert 0.2 < np.mean(none) < 0.8
        assert (status[none] == slcp.Status.INFEASIBLE).all()
        assert (status[np.logical_not(none)] != slcp.Status.INFEASIBLE).all()
    near = np.array([[1.0, -1.0 + 1e-12], [-1.0 + 1e-12, 1.0]])
    sol = slcp.solve_complementarity(np.pad(near, (0, 2)) + np.diag([0.0, 0, 1, 1]), [-1.0, -1, 0, 0],
                                     residual="hard", device=device)  # fmt: skip
    assert sol.status != slcp.Status.INFEASIBLE  # it has a solution, of 1e12


@pytest.mark.parametrize(
    "change,message",
    [
        ({"A": np.ones((3, 4))}, "n, n"),
        ({"A": np.triu(np.ones((4, 4)))}, "symmetry"),
        ({"A": -np.eye(4)}, "eigenvalue -1"),
        ({"A": np.diag([1.0, 1.0, 1.0, 0.0])}, "diagonal"),
        ({"b": np.zeros(3)}, "b has shape"),
        ({"b": np.full(4, np.nan)}, "finite"),
        ({"sigma": 0.0}, "positive"),
        ({"sigma": np.ones(3)}, "sigma has shape"),
        ({"residual": "erm"}, "choose one of"),
        ({"method": "lemke"}, "method is 'lemke'; choose one of"),
        ({"method": "continuation"}, "use residual='hard'"),
    ],
)
def test_bad_input(change, message):
    given = {"A": np.eye(4), "b": np.zeros(4), **change}
    with pytest.raises((slcp.ArrayError, slcp.OptionError), match=message):
        slcp.solve_complementarity(**given)
