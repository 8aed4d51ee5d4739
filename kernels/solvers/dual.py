"""Weights of the equations of a contact problem's solution whose changes sum up to that of target.v'.

With F1 = M w - J' lambda, w = v' - v_free, and w_i = J_i v' + d_i/h of every row:

    target.dv' = P.dF1 + sum_i rho_i dw_i + bend_i.dJ_i + kappa_i dD_i + sigma_i dlog(sigma_i) + L.dM R.
"""

from typing import Any

import warp as wp

from ..factories import cached
from ..mechanism.kinematics import make_types
from ..structure import Structure


@cached
def make_dual(s: Structure, dtype: type) -> Any:
    """The struct of the weights; a law leaves zero what it does not have."""
    t = make_types(s, dtype)

    @wp.struct
    class Dual:
        p: t.VQ  # P
        rho: t.VR
        slides: t.VR  # lambda_t/(mu lambda_n) of sliding contacts (Coulomb's friction), in the friction row
        kappa: t.VR  # zero without inertia scaling
        sigma: t.VR  # zero if hard
        bend: t.JR  # zero but for ERM
        left: t.VQ  # L, zero but for ERM
        right: t.VQ  # R

    return Dual
