"""The contact laws, and which of them a method asks for: the one place that chooses.

A law answers for the contact problem of a step (`contact/problem.py`) what solves it, and how the solution
changes with the problem. Another law is a file with these two factories, and its line here.

`make_solver(spec)` returns
    solve(world, problem, warm) -> v', z, lambda, status, iterations; warm: z of the last step.

`make_response(spec)` returns the functions, at a solution (lambda, z) of a problem,
    factor(world, problem, lambda, z, normals) -> Factor; normals: M^-1 J_i' of the rows in the mask;
    yielding(...): the same where what is near is refined, whose rows may yield more;
    solve(factor, minv, jac, scale, mask, dv0, f2, column) -> dv', dz, where dv0 is the change of v' at fixed
        lambda, -f2 that of w by J and d/h, and column the number of what is changed, q first; called for
        every column, and so without the rest of the problem, which would be copied each time;
    refined(...) -> the same of a factor whose `near` is 1, refined (`contact/refinement.py`);
    dual(factor, problem, lambda, z, target) -> Dual, the weights of `dual.py`;
the last two not numbers where refinement finds none;
with `scaled`, whether D enters; `roots`, whether z is the unknown, so that at fixed z lambda changes with D
(then there is `transposed`, too, for second derivatives); and `complete`, or None: what a law adds to its
factor that has a second form in the rows, of y and p for lambda and v':
    complete(factor, problem, lambda, force, motion, scale_by_q) -> Factor; force (j, k): d/dq_k of
        J' y - M p; motion (i, k): d/dq_k of J_i p.
"""

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace

import warp as wp

from ..method import Method
from ..specialisation import Specialisation
from .convex import make_solver
from .convex_response import make_convex_response
from .coulomb import make_coulomb_solver
from .coulomb_response import make_coulomb_response
from .erm_descent import make_erm_solver
from .erm_response import make_erm_response


@dataclass(frozen=True)
class Law:
    """A contact law: its factories, and what only some laws have."""

    make_solver: Callable[[Specialisation], wp.Function]
    make_response: Callable[[Specialisation], SimpleNamespace]
    whole: bool = False  # where one row acts all are in the system
    joined: bool = False  # where rows are JAMMED, others that press may free them: all are tried
    second: bool = False  # second derivatives have a closed form
    fast: bool = False  # `make_solver` knows fast methods
    by_diagonal: bool = False  # z = A_ii lambda - w whatever the scaling, else D lambda - w
    hides: bool = False  # rows are J_n +- mu J_t, in which a large coefficient hides J_n
    weighs: bool = False  # rows that exclude each other have an answer, too: the least expected error


CONVEX = Law(make_solver, make_convex_response, hides=True, second=True, fast=True)
COULOMB = Law(make_coulomb_solver, make_coulomb_response, joined=True, fast=True, by_diagonal=True)
ERM = Law(make_erm_solver, make_erm_response, whole=True, weighs=True)


def law_of(method: Method, rows: int = 1) -> Law:
    """The law that a method asks for; without rows there is nothing to tell laws apart by."""
    if rows and method.coulomb:
        return COULOMB
    return ERM if rows and method.erm else CONVEX
