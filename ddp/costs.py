"""The costs of `slcp_warp.costs`, and the one of the paper's section V."""

from slcp_warp.costs import Cost, CostFunctions, Term, effort, plain, quadratic, terms
from slcp_warp.costs.terms import sum_of
from slcp_warp.inputs.checks import number

__all__ = ["Cost", "CostFunctions", "Term", "effort", "flicking_finger", "plain", "quadratic", "terms"]


def flicking_finger(c_x: float = 1.0, c_u: float = 0.05) -> Cost:
    """Section V: l = -c_x theta_3 + c_u |u|^2, x = (theta_1, theta_2, theta_3, rates), and no final cost."""
    turn, work = Term("linear", -number("c_x", c_x), state=2), effort(number("c_u", c_u))
    return sum_of([f"x{i}" for i in range(6)], ["u0", "u1"], [work, turn])
