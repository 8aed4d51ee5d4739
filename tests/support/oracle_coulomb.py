"""Hard contact with Coulomb's friction by trying all modes, in NumPy float64: is there a solution?

Rows are contacts (n, t) with their mu, or rows without friction (mu None). The law: 0 <= lambda_n _|_ w_n =
J_n v' + d/h >= 0; |lambda_t| <= mu lambda_n, lambda_t = -mu lambda_n sign(J_t v') where J_t v' is not 0;
M (v' - v_free) = J' lambda. A linear complementarity problem that has a solution has one at a vertex, where
the rows that hold are independent, so combinations whose system is singular are passed over.
"""

import itertools

import numpy as np
from oracle import Oracle

OFF, STICK, LEFT, RIGHT = range(4)


def sizes(a, jac, free, rate, mu):
    """Size of the velocities that the data sets, by rows: the largest |J| |v_free| + |d/h|, and what the
    impulses that open violated rows, each alone, make of a row's velocity (a guide nearly along the surface).
    """
    b = jac @ free + rate
    out = np.full(len(b), np.max(np.abs(jac) @ np.abs(free) + np.abs(rate)) + 1e-30)
    for k in range(len(b)):
        if mu[k] is None and b[k] < 0.0:
            out = np.maximum(out, -b[k] * np.abs(a[:, k]) / max(a[k, k], 1e-30))
    return out


def violation(mass, jac, free, rate, mu, v, lam, noise=0.0):
    """Worst error of the equation of motion (over |M|, for joints of one unit) and of the law at (v',
    lambda), relative to `sizes`; `noise` is the rounding of a gap over h.
    """
    a_mat = jac @ np.linalg.solve(mass, jac.T)
    w, size, diag = jac @ v + rate, sizes(a_mat, jac, free, rate, mu), np.maximum(np.diag(a_mat), 1e-30)
    moved = np.max(np.abs(mass @ (v - free) - jac.T @ lam) / np.abs(mass).sum(1))
    errors = [max(moved - noise, 0.0) / size.max()]
    for i, bound in enumerate(mu):
        a = diag[i] * lam[i]
        if bound is None:
            error = abs(min(a, w[i]))
        else:  # the tangential row of the normal row before it
            most = diag[i] * bound * max(lam[i - 1], 0.0)
            error = abs(a - np.clip(a - w[i], -most, most))
        errors.append(max(error - noise, 0.0) / size[i])
    return float(np.max(errors))


def solutions(mass, jac, free, rate, mu, tolerance=1e-9, rank=1e-9):
    """All (v', lambda) that modes give; mu[i] is None for normal rows, a number for the tangential row that
    follows its normal row.
    """
    n = len(rate)
    inverse = np.linalg.inv(mass)
    a = jac @ inverse @ jac.T
    b = jac @ free + rate
    normal = [i for i in range(n) if mu[i] is None]
    rubs = {i: i + 1 < n and mu[i + 1] is not None for i in normal}
    choices = [(OFF, STICK, LEFT, RIGHT) if rubs[i] else (OFF, STICK) for i in normal]
    found = []
    for modes in itertools.product(*choices):
        hold, columns = [], []
        for i, mode in zip(normal, modes):
            if mode == OFF:
                continue
            column = np.zeros(n)
            column[i] = 1.0
            if mode in (LEFT, RIGHT):
                column[i + 1] = mu[i + 1] * (1.0 if mode == RIGHT else -1.0)
            hold.append(i)
            columns.append(column)
            if mode == STICK and rubs[i]:
                column = np.zeros(n)
                column[i + 1] = 1.0
                hold.append(i + 1)
                columns.append(column)
        lam = np.zeros(n)
        if hold:
            spread = np.array(columns).T
            root = np.sqrt(np.maximum(np.diag(a)[hold], 1e-30))
            system = (a[hold] @ spread) / root[:, None] / root
            if np.linalg.svd(system, compute_uv=False)[-1] < rank:
                continue
            lam = spread @ (np.linalg.solve(system, -b[hold] / root) / root)
        v = free + inverse @ (jac.T @ lam)
        if violation(mass, jac, free, rate, mu, v, lam) < tolerance:
            found.append((v, lam))
    return found


def can_open(jac, rate):
    """Whether some velocity opens all of these normal rows, J v + d/h >= 0; a linear program."""
    from scipy.optimize import linprog

    size = np.max(np.abs(jac), axis=1, initial=0.0)
    size = np.where(size > 0.0, size, 1.0)
    n, nv = jac.shape
    grid = np.hstack([-jac / size[:, None], -np.ones((n, 1))])  # least slack
    answer = linprog(np.r_[np.zeros(nv), 1.0], grid, rate / size, bounds=[(None, None)] * nv + [(0.0, None)])
    return bool(answer.x[-1] <= 1e-9 * (1.0 + np.max(np.abs(rate / size), initial=0.0)))


def as_given(kind, value):
    """Numbers as kernels of a precision are given them."""
    return np.asarray(value).astype(kind).astype(float)


def natural_map(sc, kind, x, u, step, **changes):
    """The worst violation of Coulomb's contact law in every world, relative to the size of its terms."""
    s = sc.structure
    numbers = {k: as_given(kind, v) for k, v in {**sc.default_parameters(), **changes}.items()}
    oracle = Oracle(sc, **numbers)
    x, u = as_given(kind, x), as_given(kind, u)
    q, v0 = x[:, : sc.nv], x[:, sc.nv :]
    v, lam = np.asarray(step.state, float)[:, sc.nv :], np.asarray(step.impulse, float)
    problem = oracle.problem(x, u)
    gaps, jac = problem["d"], problem["J"]
    contacts = [oracle.contact_jacobian(q, k) for k in range(len(s.pairs))]
    inverse, h = np.linalg.inv(problem["M"]), problem["h"][..., None]
    rows = np.zeros(jac.shape)
    rate = np.zeros(gaps.shape)
    for i, row in enumerate(s.rows):
        if row.kind == "limit" or row.sign == 0:
            rows[:, i], rate[:, i] = jac[:, i], gaps[:, i] / h[..., 0]
        else:
            rows[:, i] = contacts[row.index][1 if row.sign > 0 else 2]
            rate[:, i] = gaps[:, i] / h[..., 0] if row.sign > 0 else 0.0
    diag = np.maximum(np.einsum("bij,bjk,bik->bi", rows, inverse, rows), 1e-30)
    w = np.einsum("bij,bj->bi", rows, v) + rate
    size = np.abs(rate) + np.einsum("bij,bj->bi", np.abs(rows), np.abs(v0) + np.abs(problem["vfree"]))
    size = size.max(1) + 1e-12
    motion = np.einsum("bij,bj->bi", problem["M"], v) - problem["f"] - np.einsum("bij,bi->bj", rows, lam)
    fast = (np.abs(v) + np.abs(v0) + np.abs(problem["vfree"])).max(1) + 1e-12
    worst = np.abs(np.einsum("bij,bj->bi", inverse, motion)).max(1) / fast
    for i, row in enumerate(s.rows):
        a = diag[:, i] * lam[:, i]
        if row.kind == "limit" or row.sign >= 0:
            miss = np.abs(np.minimum(a, w[:, i]))
        else:
            mu = np.broadcast_to(oracle.p["friction"], (len(x), len(s.pairs)))[:, row.index]
            bound = diag[:, i] * mu * np.maximum(lam[:, i - 1], 0.0)
            miss = np.abs(a - np.clip(a - w[:, i], -bound, bound))
        worst = np.maximum(worst, miss / size)
    return worst
