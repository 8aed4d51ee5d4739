"""Costs of optimal control problems: sums over k of l(x_k, u_k, k), and a final cost l_f(x_N)."""

from slcp_warp.kernels.control.costs import CostFunctions

from ..description.points import Point, centre_of_mass, position
from .cost import Cost, plain, quadratic
from .terms import NO_COST, Term, effort, terms

__all__ = [
    "NO_COST",
    "Cost",
    "CostFunctions",
    "Point",
    "Term",
    "centre_of_mass",
    "effort",
    "plain",
    "position",
    "quadratic",
    "terms",
]
