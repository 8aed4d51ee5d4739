"""Linear systems and programs without rounding, in fractions."""

from fractions import Fraction
from typing import Any

from slcp_warp.description.kinematics import Array

Row = list[Fraction]


def rational(matrix: Array) -> list[Row]:
    """The numbers as they stand."""
    return [[Fraction(x) for x in row] for row in matrix]


def product(a: Row, b: Row) -> Fraction:
    """a' b."""
    return sum((x * y for x, y in zip(a, b)), Fraction(0))


def solve(matrix: list[Row], right: Row) -> Row | None:
    """matrix^-1 right; None for a singular matrix."""
    n = len(right)
    rows = [[*row, x] for row, x in zip(matrix, right)]
    for c in range(n):
        r = next((r for r in range(c, n) if rows[r][c]), None)
        if r is None:
            return None
        rows[c], rows[r] = rows[r], rows[c]
        rows[c] = [x / rows[c][c] for x in rows[c]]
        for k in range(n):
            if k != c and rows[k][c]:
                share = rows[k][c]
                rows[k] = [x - share * y for x, y in zip(rows[k], rows[c])]
    return [row[n] for row in rows]


def largest(rows: list[Row]) -> Fraction:
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
