"""Proofs about single worlds, by SciPy and enumeration: whether any velocity opens the rows, whether Coulomb
contact has a solution, and how large a solution is.
"""

import itertools
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np

from slcp_warp.description.kinematics import Array

from ..mechanics import extended
from ..mechanics.complementarity import rubbed
from ..mechanics.rational import Row, largest, product, rational, solve
from ..shared.optional import scipy_module
from .problem import EPSILON, FLOOR, Problem

MOST_MODES = 1_024
FASTEST = (
    1e5  # velocities that open rows, in units of the acting rows' speeds: pi/2 in float32 is a direction, too
)
CLOSED = 1e-6  # of its terms: what keeps a row from being open
REFINED = 4  # refinements of least impulses
ROUNDED = 4e-16  # of an impulse found in fractions
OPEN, PRESS, STICK, LEFT, RIGHT = range(5)


def widest_opening(p: Problem, i: int) -> float:
    """The largest t <= 1 such that some velocity gives every row (Coulomb: every normal row) w >= t, with w
    in units of the speeds of its island (`_speeds`): below 0 no velocity up to FASTEST of them opens them.
    In single precision w is less what a rounding of the row's entries and of its lengths makes of it.
    """
    rows = ~p.tangent
    jac, rate, bound = p.jac[i][rows], p.rate[i][rows], p.bound[i][rows]
    rounding = EPSILON["float32"] if p.dtype == "float32" else 0.0
    rate = rate - rounding * p.size[i][rows]
    if not len(rate):
        return 1.0
    size = np.maximum(np.abs(jac).max(1), 1e-9)  # every row by itself: its largest entry is 1
    jac, rate = jac / size[:, None], rate / size
    acts = p.free[i][rows] < 0.0
    speed = _speeds(p, i, jac, rate, acts if acts.any() else ~acts)
    unit = np.where(np.abs(jac) > 0.0, speed, 0.0).max(1)
    share, one = speed / unit[:, None], np.eye(jac.shape[1])
    rounds = bound / size[:, None] * share * rounding
    linprog = scipy_module("optimize").linprog
    sides = np.block([[-jac * share, rounds, np.ones((len(rate), 1))],
                      [one, -one, 0.0 * one[:, :1]], [-one, -one, 0.0 * one[:, :1]]])  # fmt: skip
    goal, limits = np.r_[np.zeros(2 * len(one)), -1.0], np.r_[rate / unit, np.zeros(2 * len(one))]
    bounds = [(-FASTEST, FASTEST)] * len(one) + [(0.0, FASTEST)] * len(one) + [(None, 1.0)]
    found = linprog(goal, sides, limits, bounds=bounds, method="highs")
    return float(-found.fun) if found.status == 0 else np.nan


def _speeds(p: Problem, i: int, jac: Array, rate: Array, acts: Array) -> Array:
    """The speed of every coordinate's island (nv,), of what hangs together or touches over rows that act at
    v_free: the largest of their terms. What touches nothing counts as the slowest that does, or as it is.
    """
    near = np.abs(p.drive.h_mass[i]) > 0.0
    for row in jac[acts]:
        near |= np.outer(row != 0.0, row != 0.0)
    for _ in range(len(near)):
        near = near.astype(int) @ near.astype(int) > 0
    free = np.abs(p.drive.free[i])
    terms = np.maximum(np.abs(rate), np.abs(jac) @ free)[acts, None] * (jac[acts] != 0.0)
    speed = (near * terms.max(0)).max(1)
    out: Array = np.where(speed > 0.0, speed, np.maximum(terms.max(1).min(), free))
    return np.maximum(out, 1e-12)


def opens(p: Problem, i: int) -> bool:
    """Whether some velocity gives every row w >= 0, for the numbers as they stand and without rounding: the
    simplex method on fractions for max t, J v + d/h >= t, Bland's rule. Floating-point programs end at 1e-7.
    """
    sides = [[-Fraction(x) for x in row] + [Fraction(1), Fraction(d)] for row, d in zip(p.jac[i], p.rate[i])]
    return largest(sides) >= 0 if sides else True


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
    shut = b + jac @ move < -CLOSED * (np.abs(b) + np.abs(jac) @ np.abs(move))
    return None if shut.any() else (p.drive.free[i] + move, lam)


def least_push(p: Problem, i: int, lam: Array) -> Array:
    """H^-1 J' lambda (nv,) of an answer of `least_motion`, its pressing rows shut in extended precision: as
    v' - v_free large impulses that cancel each other leave it few digits.
    """
    jac, rate = (part[i][lam > 0.0].astype(np.longdouble) for part in (p.jac, p.rate))
    right = np.concatenate([jac.T, p.drive.rhs[i][:, None]], 1)
    moved = extended.solve(p.drive.h_mass[i : i + 1].astype(np.longdouble), right[None])[0]
    a, w = jac @ moved[:, :-1], rate + jac @ moved[:, -1]
    x = lam[lam > 0.0].astype(np.longdouble)
    for _ in range(REFINED):
        x = x - np.linalg.lstsq(a.astype(float), (a @ x + w).astype(float), rcond=None)[0]
    out: Array = (moved[:, :-1] @ x).astype(float)
    return out


def coulomb_solution(
    p: Problem, i: int, acting: Array | None = None, accuracy: float = 1e-11, like: Array | None = None,
    exact: bool = False,
) -> tuple[Array, Array] | None | bool:  # fmt: skip
    """v' and lambda of a solution of Coulomb contact, by trying all modes of all rows (or of those `acting`
    (nr,), the others open): the one with the least impulses, or, of those that hold on the scale of the data
    alone, the nearest to the impulses `like` (nr,). None where there is none, False where there are too many
    modes to try. `exact`: systems are solved in fractions, and every row must hold on the scale of its data.
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
    rounded = _exactly(p, i) if exact else _impulses
    for modes in itertools.product(*(modes for _, modes in groups)):
        found = rounded(p, i, [g for g, _ in groups], modes)
        if found is None:
            continue
        lam, w = found
        size = np.full(len(w), (np.abs(p.free[i]) + np.abs(p.a[i]) @ np.abs(lam)).max() + 1e-300)
        if like is not None:
            size[:] = np.abs(p.free[i]).max()
        if exact:
            size = np.abs(p.rate[i]) + np.abs(p.jac[i]) @ np.abs(p.drive.free[i])
            size = size + ROUNDED / accuracy * p.diag[i] * np.abs(lam)
        if _legal(p, i, [g for g, _ in groups], lam, w, accuracy * size):
            far = np.abs(p.diag[i] * (lam if like is None else lam - like)).max()
            if far < least:
                best, least = lam, far
    if best is None:
        return None
    return p.drive.free[i] + np.linalg.solve(p.drive.h_mass[i], p.jac[i].T @ best), best


def _asked(p: Problem, i: int, groups: list[Any], modes: tuple[int, ...]) -> tuple[Array, list[int]]:
    """What modes ask for: columns of lambda = columns x (nr, n), and the n rows whose w must vanish."""
    n = len(p.tangent)
    basis, zero = [], []
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
    return np.array(basis).reshape(-1, n).T, zero


def _impulses(p: Problem, i: int, groups: list[Any], modes: tuple[int, ...]) -> tuple[Array, Array] | None:
    """The impulses that the modes ask for, by least squares, and w."""
    columns, zero = _asked(p, i, groups, modes)
    if not zero:
        return np.zeros(len(p.tangent)), p.free[i]
    scale = np.sqrt(np.maximum(p.diag[i], FLOOR))
    matrix = (p.a[i] @ columns)[zero] / scale[zero][:, None]
    goal = -p.free[i][zero] / scale[zero]
    x, *_ = np.linalg.lstsq(matrix, goal, rcond=1e-12)
    x = x + np.linalg.lstsq(matrix, goal - matrix @ x, rcond=1e-12)[0]  # where masses differ by much
    lam = columns @ x
    return lam, p.free[i] + p.a[i] @ lam


def _exactly(p: Problem, i: int) -> Callable[..., tuple[Array, Array] | None]:
    """The same for the numbers as they stand, without rounding; None where the rows depend on each other."""
    mass, jac = rational(p.drive.h_mass[i]), rational(p.jac[i])
    right: Row = [Fraction(x) for x in p.drive.rhs[i]]
    responses = [solve(mass, row) or row for row in jac]
    a = [[product(row, other) for other in responses] for row in jac]
    start = solve(mass, right) or right
    free = [product(row, start) + Fraction(d) for row, d in zip(jac, p.rate[i])]

    def impulses(_: Problem, __: int, groups: list[Any], modes: tuple[int, ...]) -> Any:
        columns, zero = _asked(p, i, groups, modes)
        basis = rational(columns.T)
        x = solve([[product(a[r], unit) for unit in basis] for r in zero], [-free[r] for r in zero])
        if x is None:
            return None
        lam = [sum((s * unit[r] for s, unit in zip(x, basis)), Fraction(0)) for r in range(len(a))]
        w = [b + product(row, lam) for b, row in zip(free, a)]
        return np.array(lam, float), np.array(w, float)

    return impulses


def _legal(p: Problem, i: int, groups: list[Any], lam: Array, w: Array, within: Array) -> bool:
    """Whether impulses and velocities w obey the contact law to `within` (nr,) [m/s]."""
    a = p.diag[i]
    for rows in groups:
        n = rows[0]
        miss = within[list(rows)].max()
        if w[n] < -miss or a[n] * lam[n] < -miss or min(w[n], a[n] * lam[n]) > miss:
            return False
        if len(rows) == 2:
            t = rows[1]
            bound = p.mu[i, t] * max(lam[n], 0.0)
            asked = rubbed(lam[t], w[t], max(a[t], FLOOR), bound)
            if a[t] * abs(lam[t] - asked) > miss:
                return False
    return True
