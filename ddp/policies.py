"""Tracking a plan, evaluated inside a rollout's or a sweep's kernel."""

import copy
import functools
import math
import warnings
from types import SimpleNamespace
from typing import Any

import numpy as np
import warp as wp

from slcp_warp import Scene, Simulator
from slcp_warp.inputs.checks import array, attribute, number, shown, whole
from slcp_warp.inputs.errors import ArgumentError, ArgumentTypeError
from slcp_warp.inputs.limits import limit_rows
from slcp_warp.kernels.policies.contract import PolicyKernel
from slcp_warp.kernels.policies.tracking import TRACKING, make_tracking
from slcp_warp.policies.arrays import kept_period, own_period, period_of, put, put_limits
from slcp_warp.policies.saved import Content
from slcp_warp.storage.printed import counted

SAME = 1e-6  # of a step: times that differ by less are the same


def in_steps_of(
    rate: float, us: np.ndarray, xs: np.ndarray, K: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Controls (B, N', nu), states (B, N'+1, nx) and gains of trajectories, in steps `rate` times as long.

    Controls and gains are those at the same time, states between their own.
    """
    steps = us.shape[1]
    count = max(1, math.ceil(steps / rate - SAME))
    place = np.arange(count + 1) * rate
    row = np.minimum(np.floor(place + SAME).astype(int), steps - 1)
    share = np.clip(place - row, 0.0, 1.0)[:, None]
    after = np.minimum(row + 1, xs.shape[1] - 1)
    return us[:, row[:-1]], (1.0 - share) * xs[:, row] + share * xs[:, after], K[:, row[:-1]]


def _warn_of_gains(result: Any) -> None:
    """Say of a `ddp.Result` that it ended at no minimum, whose gains are none to rely on."""
    fine = attribute(result, "positive_definite")
    if isinstance(fine, np.ndarray) and not fine.all():
        which = "it" if fine.ndim == 0 else f"{np.count_nonzero(~fine)} of {counted(fine.size, 'plan')}"
        warnings.warn(
            f"result: {which} ended at no minimum, where Q_uu is not positive definite (min_pivot); the "
            "gains may amplify what they should correct: look at its undisturbed run, or plan on from it",
            RuntimeWarning,
            stacklevel=3,
        )


class TrackingPolicy:
    """u = us_k + K_k (x - xs_k) along trajectories (M36), by step, within the limits of the plan.

    The last step is held. The controls of a plan that act later than they are sent (`Result.delay`) are sent
    as much earlier: u = us_(k+d) + K_(k+d) (x - xs_k), to be delayed by the task or `policies.Around`. Where
    the plan's step size is known and steps of another one are made, the plan is followed in time (`at`).

    Args:
        result: of `ddp.solve`, for one problem or as many as there are worlds; or any object with `us`
            (N, nu), `xs` (N+1, nx) and `K` (N, nu, nx), or with a batch axis. Warp arrays (with a batch axis)
            that require gradients collect them from rollouts on a `wp.Tape`; a control at its limit has the
            derivative 0.
        period: (nx,) as in `Scene.state_period`; None: that of the scene that it is followed in.
        control_limits: as of a `Problem`; None: `lower` and `upper` of the result where it has them.
        step_size: of the plan [s]; None: that of the result's simulator, where it has one.
        gain: K times that. A plan's gains know neither noise nor delay: where these shake it, less may do
            better, and 0 is the plan by itself.

    A RuntimeWarning where DDP ended without gains to rely on: at what is no minimum.
    """

    sees_states = True  # whatever else a task's policies see
    alike = True  # in all worlds: by state and time alone

    def __init__(
        self,
        result: Any,
        period: np.ndarray | None = None,
        control_limits: Any = None,
        step_size: float | None = None,
        gain: float = 1.0,
    ) -> None:
        for name in ("us", "xs", "K"):
            if not isinstance(attribute(result, name), np.ndarray | wp.array):
                best = ", its `best`" if hasattr(result, "best") else ""
                raise ArgumentTypeError(
                    f"result is a {type(result).__name__}; us, xs and K, arrays, are needed: a "
                    f"ddp.Result{best}"
                )
        _warn_of_gains(result)
        single = result.us.ndim == 2
        self.us, self.xs, self.K = (a[None] if single else a for a in (result.us, result.xs, result.K))
        if number("gain", gain, 0.0) != 1.0:
            if isinstance(self.K, wp.array):
                raise ArgumentError(f"gain is {gain}; of gains that are Warp arrays 1 is needed")
            self.K = gain * self.K
        self.early = whole("result.delay", attribute(result, "delay") or 0, 0, self.us.shape[1] - 1)
        if self.early:
            self.us, self.K = self.us[:, self.early :], self.K[:, self.early :]
        self.period = None if period is None else array("period", period)
        if control_limits is None and getattr(result, "lower", None) is not None:
            control_limits = result.lower, result.upper
        self.limits = limit_rows(control_limits, self.us.shape[-1])
        self.worlds = len(self.us)
        self._scene = attribute(attribute(result, "simulated"), "scene")
        own = _one_step_size(attribute(result, "simulated")) if step_size is None else step_size
        self.step_size = None if own is None else number("step_size", own, 0.0, above=True)

    def __repr__(self) -> str:
        of = "" if self._scene is None else f" of scene {self._scene.name!r}"
        step = "" if self.step_size is None else f" of {self.step_size:g} s"
        return f"<TrackingPolicy{of}: {counted(self.worlds, 'plan')}, {self.us.shape[1]} steps{step}>"

    def kernel(self, sim: Simulator) -> tuple[PolicyKernel, Any]:
        """Kernel and struct for a simulator."""
        self.check_names(sim.scene)
        period = self.xs.shape[-1:] if self.period is None else self.period.shape
        size = self.xs.shape[-1], self.us.shape[-1], period
        if size != (sim.nx, sim.nu, (sim.nx,)):
            raise ArgumentError(
                f"the trajectory has {size[0]} states, {size[1]} controls and a period of shape {size[2]}; "
                f"scene {sim.scene.name!r} needs {sim.nx}, {sim.nu} and ({sim.nx},)"
            )
        worlds, steps = self.us.shape[:2]
        if self.K.shape != (worlds, steps, sim.nu, sim.nx) or self.xs.shape[0] != worlds:
            raise ArgumentError(
                f"K has shape {self.K.shape} and xs {self.xs.shape}; with us {self.us.shape} K must be "
                f"({worlds}, {steps}, {sim.nu}, {sim.nx}) and xs ({worlds}, {steps} or more, {sim.nx})"
            )
        if len(self.limits[0]) not in (1, worlds):
            raise ArgumentError(
                f"control_limits are for {len(self.limits[0])} trajectories; there are {worlds}"
            )
        struct = make_tracking(sim.nx, sim.nu, sim.dtype).Struct()
        own = functools.partial(put, sim)
        struct.us, struct.gain, struct.period = (
            own(self.us, "us"),
            own(self.K, "K"),
            own(period_of(self.period, sim)),
        )
        struct.xs = own(self.xs, "xs")
        put_limits(sim, struct, self.limits)
        return TRACKING, struct

    def check_names(self, scene: Scene) -> None:
        """Raise an error for a scene whose states or controls have other names than those of the plan's."""
        for what in ("state_names", "control_names"):
            own = None if self._scene is None else getattr(self._scene, what)
            if own is not None and own != getattr(scene, what):
                raise ArgumentError(
                    f"the plan is of scene {self._scene.name!r}, with {what} {shown(list(own))}; scene "
                    f"{scene.name!r} has {shown(list(getattr(scene, what)))}"
                )

    def at(self, step_size: float) -> "TrackingPolicy":
        """The plan for steps of another size [s]: controls and gains held, states between its own.

        Raises:
            ArgumentError: a plan without a step size, or of Warp arrays, whose gradients would be lost.
        """
        h = number("step_size", step_size, 0.0, above=True)
        if self.step_size is None or not all(isinstance(a, np.ndarray) for a in (self.us, self.xs, self.K)):
            why = "has no step size" if self.step_size is None else "is of Warp arrays"
            raise ArgumentError(f"the plan {why}; it is followed with its own steps only, not with {h} s")
        out = copy.copy(self)
        out.us, out.xs, out.K = in_steps_of(h / self.step_size, self.us, self.xs, self.K)
        out.step_size = h
        return out

    def foreseeing(self) -> "TrackingPolicy":
        """The same plan, asked about the states in which its controls act, by the steps of these."""
        out = copy.copy(self)
        out.us, out.K = (np.concatenate([a[:, :1]] * self.early + [a], axis=1) for a in (self.us, self.K))
        out.early = 0
        return out

    def content(self) -> Content:
        """What it is made from, see `slcp_warp.policies.saved`."""
        arrays = {"us": self.us, "xs": self.xs, "K": self.K}
        arrays = {name: a.numpy() if isinstance(a, wp.array) else a for name, a in arrays.items()}
        kept = (kept_period(self.period), *self.limits)
        return Content({"step_size": self.step_size}, arrays | dict(zip(("period", "lower", "upper"), kept)))

    @classmethod
    def of_content(cls, content: Content) -> "TrackingPolicy":
        """From what `content` gave."""
        a = content.arrays
        plan = SimpleNamespace(us=a["us"], xs=a["xs"], K=a["K"])
        return cls(plan, own_period(a["period"]), (a["lower"], a["upper"]), content.values.get("step_size"))


def _one_step_size(simulated: Any) -> float | None:
    """Of all plans of a result [s], where it has them."""
    parameters = attribute(simulated, "parameters")
    if parameters is None:
        return attribute(simulated, "step_size")
    sizes = np.ravel(parameters["step_size"])
    if np.ptp(sizes) > 0.0:
        raise ArgumentError(
            f"result has plans of steps of {sizes.min():g} to {sizes.max():g} s; those of one step size are "
            "needed, as of result.select(i)"
        )
    return float(sizes[0])
