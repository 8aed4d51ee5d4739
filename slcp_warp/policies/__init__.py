"""Policies: whatever gives the controls of a rollout or a sweep, evaluated inside its kernel.

Those that follow plans and libraries are in `slcp_warp.ddp`. Any object with ``kernel(sim) -> (PolicyKernel,
struct)`` is one, too.
"""

from slcp_warp.kernels.policies.contract import PolicyFunctions, PolicyKernel

from ..stepping.callback import Callback
from .around import Around
from .function import Function
from .linear import Linear
from .network import Network
from .saved import load_policy, save_policy

__all__ = [
    "Around",
    "Callback",
    "Function",
    "Linear",
    "Network",
    "PolicyFunctions",
    "PolicyKernel",
    "load_policy",
    "save_policy",
]
