"""Proofs about single worlds, by SciPy and enumeration: whether any velocity opens the rows, whether Coulomb
contact has a solution, and how large a solution is.
"""

import itertools
from fractions import Fraction
from typing import Any

import numpy as np

from slcp_warp.results.pictures.kinematics import Array

from ..mechanics.complementarity import rubbed
from ..shared.optional import scipy_module
from .problem import FLOOR, Problem

MOST_MODES = 1_024
FASTEST = (
    1e5  # velocities that open rows, in units of the acting rows' speeds: pi/2 in float32 is a direction, too
)
OPEN, PRESS, STICK, LEFT, RIGHT = range(5)


def widest_opening(p: Problem, i: int) -> float:
    """The largest t <= 1 such that some velocity gives every row (Coulomb: every normal row) w >= t, with w
    in units of the speeds of the rows that act at v_free: below 0 no velocity up to FASTEST of them opens
    the rows.
    """
    rows = ~p.tangent
    jac, rate = p.jac[i][rows], p.rate[i][rows]
    if not len(rate):
        return 1.0
    size = np.maximum(np.abs(jac).max(1), 1e-9)  # every row by itself: its largest entry is 1
    jac, rate = jac / size[:, None], rate / size
    acts = p.free[i][rows] < 0.0
    acts = acts if acts.any() else ~acts
    speed = max(
        1e-12, float(np.abs(rate[acts]).max()), float((np.abs(jac) @ np.abs(p.drive.free[i]))[acts].max())
    )
    linprog = scipy_module("optimize").linprog
    goal = np.r_[np.zeros(jac.shape[1]), -1.0]
    sides = np.c_[-jac, np.ones(len(rate))]
    bounds = [(-FASTEST, FASTEST)] * jac.shape[1] + [(None, 1.0)]
    found = linprog(goal, sides, rate / speed, bounds=bounds, method="highs")
    return float(-found.fun) if found.status == 0 else np.nan


def opens(p: Problem, i: int) -> bool:
    """Whether some velocity gives every row w >= 0, for the numbers as they stand and without rounding: the
    simplex method on fractions for max t, J v + d/h >= t, Bland's rule. Floating-point programs end at 1e-7.
    """
    sides = [[-Fraction(x) for x in row] + [Fraction(1), Fraction(d)] for row, d in zip(p.jac[i], p.rate[i])]
    return _largest(sides) >= 0 if sides else True


def _largest(rows: list[list[Fraction]]) -> Fraction:
    """max t of slack = d - a x >= 0 for rows (a, d), x = (v, t) free, t their last; stops at t >= 0. `rows`
    holds the dictionary: what the slacks (or those x that took their places) lose by each that is not basic.
    """
    n = len(rows[0]) - 1
    names: list[Any] = [f"x{j}" for j in range(n)]  # not basic; slacks are numbers, free variables texts
    basic: list[Any] = list(range(len(rows)))
    goal = [Fraction(0)] * (n - 1) + [Fraction(1), Fraction(0)]  # gain by each, and value

    def pivot(r: int, c: int) -> None:
        by = rows[r][c]
        rows[r] = [x / by for x in rows[r]]
        rows[r][c] = 1 / by
        for k, row in enumerate(rows):
            if k != r and row[c]:
                share = row[c]
                rows[k] = [x - share * y for x, y in zip(row, rows[r])]
                rows[k][c] = -share * rows[r][c]
        share = goal[c]
        goal[:n] = [x - share * y for x, y in zip(goal[:n], rows[r][:n])]
        goal[c] = -share * rows[r][c]
        goal[n] += share * rows[r][n]
        names[c], basic[r] = basic[r], names[c]

    pivot(min(range(len(rows)), key=lambda k: rows[k][n]), n - 1)  # t = min d: every slack is >= 0
    while goal[n] < 0:
        free = [c for c in range(n) if isinstance(names[c], str) and goal[c]]
        gains = [c for c in range(n) if not isinstance(names[c], str) and goal[c] > 0]
        if not free and not gains:
            break
        c = free[0] if free else min(gains, key=lambda c: names[c])
        sign = 1 if goal[c] > 0 else -1
        tied = [k for k in range(len(rows)) if not isinstance(basic[k], str) and sign * rows[k][c] > 0]
        if not tied:
            return Fraction(1)  # without a bound
        pivot(min(tied, key=lambda k: (rows[k][n] / abs(rows[k][c]), basic[k])), c)
    return goal[n]


def least_motion(p: Problem, i: int) -> tuple[Array, Array] | None:
    """v' and lambda of hard contact with Anitescu's friction: the least |v' - v_free|_H that opens the rows
    (Lawson and Hanson's least distances); None where nothing opens them.
    """
    jac, b = p.jac[i], p.free[i]
    if not len(b):  # SciPy's nnls frees an empty matrix twice
        return p.drive.free[i], np.zeros(0)
    size = np.sqrt(np.maximum(p.diag[i], FLOOR))
    root = np.linalg.cholesky(p.drive.h_mass[i])
    g = np.linalg.solve(root, jac.T).T / size[:, None]
    unit = max(1e-300, float(np.abs(b / size).max(initial=0.0)))
    matrix = np.vstack([g.T, -(b / size / unit)[None]])
    goal = np.r_[np.zeros(len(root)), 1.0]
    try:
        dual, _ = scipy_module("optimize").nnls(matrix, goal, maxiter=50 * (len(b) + 3))
    except RuntimeError:
        return None
    rest = goal - matrix @ dual
    if rest[-1] < 1e-13:
        return None
    lam = dual / rest[-1] * unit / size
    move = np.linalg.solve(root.T, np.linalg.solve(root, jac.T @ lam))
    return p.drive.free[i] + move, lam


def coulomb_solution(
    p: Problem, i: int, acting: Array | None = None, accuracy: float = 1e-11, like: Array | None = None
) -> tuple[Array, Array] | None | bool:
    """v' and lambda of a solution of Coulomb contact, by trying all modes of all rows (or of those `acting`
    (nr,), the others open): the one with the least impulses, or, of those that hold on the scale of the data
    alone, the nearest to the impulses `like` (nr,). None where there is none, False where there are too many
    modes to try.
    """
    groups: list[tuple[tuple[int, ...], tuple[int, ...]]] = []
    for r in range(len(p.tangent)):
        if p.tangent[r]:
            continue
        if acting is not None and not acting[r]:
            groups.append(((r, r + 1) if p.tangent[r + 1 : r + 2].any() else (r,), (OPEN,)))
        elif r + 1 < len(p.tangent) and p.tangent[r + 1]:
            groups.append(((r, r + 1), (OPEN, STICK, LEFT, RIGHT)))
        else:
            groups.append(((r,), (OPEN, PRESS)))
    if np.prod([len(modes) for _, modes in groups], dtype=float) > MOST_MODES:
        return False
    best: Any = None
    least = np.inf
    for modes in itertools.product(*(modes for _, modes in groups)):
        lam = _impulses(p, i, [g for g, _ in groups], modes)
        if lam is None:
            continue
        w = p.free[i] + p.a[i] @ lam
        size = (np.abs(p.free[i]) + np.abs(p.a[i]) @ np.abs(lam)).max() + 1e-300
        if like is not None:
            size = np.abs(p.free[i]).max()
        if _legal(p, i, [g for g, _ in groups], lam, w, accuracy * size):
            far = np.abs(p.diag[i] * (lam if like is None else lam - like)).max()
            if far < least:
                best, least = lam, far
    if best is None:
        return None
    return p.drive.free[i] + np.linalg.solve(p.drive.h_mass[i], p.jac[i].T @ best), best


def _impulses(p: Problem, i: int, groups: list[Any], modes: tuple[int, ...]) -> Array | None:
    """The impulses that the modes ask for; None where their system has no solution."""
    n = len(p.tangent)
    basis, zero = [], []  # columns of lambda = basis x, and rows that must vanish
    for rows, mode in zip(groups, modes):
        if mode == OPEN:
            continue
        unit = np.zeros(n)
        unit[rows[0]] = 1.0
        zero.append(rows[0])
        if mode in (LEFT, RIGHT):
            unit[rows[1]] = p.mu[i, rows[1]] * (1.0 if mode == RIGHT else -1.0)
        basis.append(unit)
        if mode == STICK:
            unit = np.zeros(n)
            unit[rows[1]] = 1.0
            basis.append(unit)
            zero.append(rows[1])
    if not basis:
        return np.zeros(n)
    columns = np.array(basis).T
    scale = np.sqrt(np.maximum(p.diag[i], FLOOR))
    matrix = (p.a[i] @ columns)[zero] / scale[zero][:, None]
    goal = -p.free[i][zero] / scale[zero]
    x, *_ = np.linalg.lstsq(matrix, goal, rcond=1e-12)
    x = x + np.linalg.lstsq(matrix, goal - matrix @ x, rcond=1e-12)[0]  # where masses differ by much
    out: Array = columns @ x
    return out


def _legal(p: Problem, i: int, groups: list[Any], lam: Array, w: Array, miss: float) -> bool:
    """Whether impulses and velocities w obey the contact law to `miss` [m/s]."""
    a = p.diag[i]
    for rows in groups:
        n = rows[0]
        if w[n] < -miss or a[n] * lam[n] < -miss or min(w[n], a[n] * lam[n]) > miss:
            return False
        if len(rows) == 2:
            t = rows[1]
            bound = p.mu[i, t] * max(lam[n], 0.0)
            asked = rubbed(lam[t], w[t], max(a[t], FLOOR), bound)
            if a[t] * abs(lam[t] - asked) > miss:
                return False
    return True
