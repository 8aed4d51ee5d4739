"""Policies: whatever gives the controls of a rollout or a sweep, evaluated inside its kernel.

Those that follow plans and libraries are in `slcp_warp.ddp`. Any object with ``kernel(sim) -> (PolicyKernel,
struct)`` is one, too, and any with ``act(x, time, worlds) -> u``, which is asked on the host (`HostPolicy`).
"""

from slcp_warp.kernels.policies.contract import PolicyFunctions, PolicyKernel

from ..stepping.host import HostPolicy
from .around import Around
from .callback import Callback
from .estimated import Belief, Estimated, KalmanFilter, Sensor
from .function import Function
from .linear import Linear
from .network import Network
from .observed import Observation, Observed
from .open_loop import OpenLoop
from .saved import load_policy, save_policy

__all__ = [
    "Around",
    "Belief",
    "Callback",
    "Estimated",
    "Function",
    "HostPolicy",
    "KalmanFilter",
    "Linear",
    "Network",
    "Observation",
    "Observed",
    "OpenLoop",
    "PolicyFunctions",
    "PolicyKernel",
    "Sensor",
    "load_policy",
    "save_policy",
]
