"""Linear feedback around a point."""

from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.policies.contract import PolicyKernel
from slcp_warp.kernels.policies.tracking import TRACKING, make_tracking

from ..inputs.checks import array
from ..inputs.errors import ArgumentError
from ..inputs.limits import limit_rows
from ..simulator import Simulator
from .arrays import kept_period, own_period, period_of, put, put_limits
from .saved import Content


class Linear:
    """u = u_ref + K (x - x_ref), within limits: tracking of a single point, by the same kernels.

    Args:
        K: (nu, nx), or (B, nu, nx) for one per world.
        x_ref: (nx,), or (B, nx); None: zero.
        u_ref: (nu,), or (B, nu); None: zero.
        limits: (lower, upper) of the controls, each a number, (nu,) or (B, nu); None: none beside a task's.
        period: (nx,) as in `Scene.state_period`: differences are taken within half a period; None: that of
            the scene, zeros: none.

    Raises:
        ArgumentError: other shapes, or numbers that are not finite.
    """

    def __init__(
        self,
        K: Any,
        x_ref: Any = None,
        u_ref: Any = None,
        limits: Any = None,
        period: np.ndarray | None = None,
    ) -> None:
        gain = _rows("K", K, 2)
        nu, nx = gain.shape[1:]
        x = _rows("x_ref", np.zeros(nx) if x_ref is None else x_ref, 1)
        u = _rows("u_ref", np.zeros(nu) if u_ref is None else u_ref, 1)
        for name, value, size in (("x_ref", x, nx), ("u_ref", u, nu)):
            if value.shape[1] != size:
                raise ArgumentError(
                    f"{name} has {value.shape[1]} components; with K {gain.shape} {size} are needed"
                )
        counts = {len(gain), len(x), len(u)} - {1}
        if len(counts) > 1:
            raise ArgumentError(f"K, x_ref and u_ref are for {len(gain)}, {len(x)} and {len(u)} worlds")
        self.worlds = counts.pop() if counts else 1
        self.K, self.x_ref, self.u_ref = (np.repeat(a, self.worlds // len(a), 0) for a in (gain, x, u))
        self.period = None if period is None else array("period", period, (nx,))
        self.limits = limit_rows(limits, nu)
        if len(self.limits[0]) not in (1, self.worlds):
            raise ArgumentError(f"limits are for {len(self.limits[0])} worlds; there are {self.worlds}")

    @property
    def alike(self) -> bool:
        """Whether it acts by state and time alone in all worlds."""
        return self.worlds == 1

    def kernel(self, sim: Simulator) -> tuple[PolicyKernel, Any]:
        """Kernel and struct for a simulator."""
        if self.K.shape[1:] != (sim.nu, sim.nx):
            raise ArgumentError(
                f"K has shape {self.K.shape[1:]}; scene {sim.scene.name!r} needs ({sim.nu}, {sim.nx})"
            )
        struct = make_tracking(sim.nx, sim.nu, sim.dtype).Struct()
        struct.us, struct.xs = put(sim, self.u_ref[:, None]), put(sim, self.x_ref[:, None])
        struct.gain, struct.period = put(sim, self.K[:, None]), put(sim, period_of(self.period, sim))
        put_limits(sim, struct, self.limits)
        return TRACKING, struct

    def content(self) -> Content:
        """What it is made from, see `saved`."""
        arrays = {"K": self.K, "x_ref": self.x_ref, "u_ref": self.u_ref}
        arrays["period"] = kept_period(self.period)
        return Content({}, arrays | dict(zip(("lower", "upper"), self.limits)))

    @classmethod
    def of_content(cls, content: Content) -> "Linear":
        """From what `content` gave."""
        a = content.arrays
        return cls(a["K"], a["x_ref"], a["u_ref"], (a["lower"], a["upper"]), own_period(a["period"]))


def _rows(name: str, value: Any, ndim: int) -> np.ndarray:
    """Finite numbers with an axis of worlds."""
    if isinstance(value, wp.array):
        raise ArgumentError(
            f"{name} is a Warp array; numbers are needed (gradients by gains: ddp.TrackingPolicy of one step)"
        )
    found = array(name, value)
    if found.ndim not in (ndim, ndim + 1):
        need = "(nu, nx) or (B, nu, nx)" if ndim == 2 else "one axis, or (B, ...)"
        raise ArgumentError(f"{name} has shape {found.shape}; {need} is needed")
    return found if found.ndim > ndim else found[None]
