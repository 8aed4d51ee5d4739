"""Policies that a rollout or a sweep evaluates inside its kernel."""

import functools
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from slcp_warp import Simulator
from slcp_warp.inputs.checks import array, attribute, choice, instance, number
from slcp_warp.inputs.errors import ArgumentError, ArgumentTypeError
from slcp_warp.inputs.limits import bounded, limit_rows
from slcp_warp.kernels.policies import policies as kernels

from .library.library import Library

METRICS = ("covariance", "variance")


def wrap(difference: np.ndarray, period: np.ndarray) -> np.ndarray:
    """Differences (..., nx) less the nearest multiple of each component's period (0: none)."""
    safe = np.where(period > 0.0, period, 1.0)
    return np.where(period > 0.0, difference - safe * np.round(difference / safe), difference)


def whitening(library: Library, metric: str) -> np.ndarray:
    """W (nx, nx) with |W dx| the norm of (20), scaled by the covariance of the x_i.

    Periodic components are wrapped.
    """
    x = wrap(library.x, library.period)
    centred = x - x.mean(axis=0)
    covariance = centred.T @ centred / max(len(x) - 1, 1)
    if metric == "variance":
        covariance = np.diag(np.diag(covariance))
    spread = np.trace(covariance) / len(covariance)
    covariance += (1e-9 * spread if spread > 0.0 else 1.0) * np.eye(len(covariance))
    return np.linalg.inv(np.linalg.cholesky(covariance))


def images(x: np.ndarray, period: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """States with periodic components in [0, period) and their images within half a period of that range.

    Returns (T, nx) states and (T,) the rows of x that they belong to.
    """
    safe = np.where(period > 0.0, period, 1.0)
    points = np.where(period > 0.0, x - safe * np.floor(x / safe), x)
    owner = np.arange(len(x))
    for j in np.flatnonzero(period > 0.0):
        shift = np.where(points[:, j] < period[j] / 2.0, period[j], -period[j])
        copies = points.copy()
        copies[:, j] += shift
        points, owner = np.concatenate([points, copies]), np.concatenate([owner, owner])
    return points, owner


def tree(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Balanced k-d tree of points (T, n) as an order (T,) and the dimension (T,) that every place splits.

    The node of a range of places is its middle; each split is along the range's widest dimension.
    """
    order = np.arange(len(points))
    split = np.zeros(len(points), dtype=np.int32)
    pending = [(0, len(points))]
    while pending:
        a, b = pending.pop()
        if a >= b:
            continue
        part = points[order[a:b]]
        dimension = int(np.argmax(np.ptp(part, axis=0)))
        middle = (a + b) // 2
        order[a:b] = order[a:b][np.argsort(part[:, dimension], kind="stable")]
        split[middle] = dimension
        pending += [(a, middle), (middle + 1, b)]
    return order, split


def _put(sim: Simulator, values: Any) -> wp.array:
    if isinstance(values, wp.array):
        if values.dtype is not sim.dtype or values.device != sim.device or not values.is_contiguous:
            raise ArgumentError(
                f"a policy's Warp array is of {values.dtype.__name__} on {values.device}; a contiguous array "
                f"of {sim.dtype.__name__} on {sim.device} is needed"
            )
        return values
    return wp.array(np.ascontiguousarray(values), dtype=sim.dtype, device=sim.device)


def _rows(name: str, values: np.ndarray, count: int) -> np.ndarray:
    """One row for each of `count` entries."""
    if len(values) not in (1, count):
        raise ArgumentError(f"{name} are for {len(values)} entries; there are {count}")
    return np.tile(values, (count // len(values), 1))


def _put_limits(sim: Simulator, struct: Any, limits: tuple[np.ndarray, np.ndarray]) -> None:
    """Limits of the controls in a policy's struct; a policy without any has none there."""
    if bounded(*limits):
        struct.lower, struct.upper = (_put(sim, a) for a in limits)


class NearestPolicy:
    """The nearest-neighbour rule (20) over a library; its controls stay within the entries' limits.

    Args:
        library: the entries.
        metric: "covariance" (Mahalanobis) or "variance" (its diagonal).
        min_gain: entries whose plan gains less over zero controls are left out (passive plans).
        feedback_limit: the feedback term K (x - x_j) is clamped to this size [control units].
        whiten: (nx, nx) matrix of another norm.
        control_limits: (lower, upper), each a number or (nu,), for all entries; None: the library's.
    """

    def __init__(
        self,
        library: Library,
        metric: str = "covariance",
        min_gain: float = -np.inf,
        feedback_limit: float = np.inf,
        whiten: np.ndarray | None = None,
        control_limits: Any = None,
    ) -> None:
        instance("library", library, Library, "a ddp.Library")
        choice("metric", metric, METRICS)
        feedback_limit = number("feedback_limit", feedback_limit, 0.0, above=True, infinite=True)
        min_gain = number("min_gain", min_gain, infinite=True)
        if not len(library):
            raise ArgumentError("library is empty; a policy needs at least one entry")
        keep = library.gain >= min_gain
        if not keep.any():
            raise ArgumentError(
                f"min_gain {min_gain} leaves no entry; the largest gain is {library.gain.max():.3g}"
            )
        self.library = library.select(keep)
        if control_limits is not None:
            limits = limit_rows(control_limits, library.u.shape[1])
            lower, upper = (_rows("control_limits", a, len(self.library)) for a in limits)
            self.library = replace(self.library, lower=lower, upper=upper)
        self.whiten = whitening(self.library, metric) if whiten is None else array("whiten", whiten)
        nx = library.x.shape[1]
        if self.whiten.shape != (nx, nx) or not np.isfinite(self.whiten).all():
            raise ArgumentError(
                f"whiten has shape {self.whiten.shape}; finite numbers ({nx}, {nx}) are needed"
            )
        self.feedback_limit = min(float(feedback_limit), 1e30)

    def arrays(self, sim: Simulator) -> tuple[str, Any]:
        """Kernel name and struct for a simulator."""
        self.library.check_scene(sim.scene)
        lib = self.library
        struct = kernels.make_nearest(sim.nx, sim.nu, sim.dtype).Struct()
        put = functools.partial(_put, sim)
        struct.us, struct.xs, struct.gain = put(lib.u), put(lib.x), put(lib.K)
        points, owner = images(lib.x, lib.period)
        order, split = tree(points @ self.whiten.T)
        struct.nodes, struct.whitening = put((points @ self.whiten.T)[order]), put(self.whiten)
        struct.split = wp.array(split, dtype=wp.int32, device=sim.device)
        struct.entry = wp.array(owner[order], dtype=wp.int32, device=sim.device)
        struct.period = put(lib.period)
        struct.limit = self.feedback_limit
        _put_limits(sim, struct, (lib.lower, lib.upper))
        return "nearest", struct


class TrackingPolicy:
    """u = us_k + K_k (x - xs_k) along trajectories, by time, within the limits of the plan.

    The last step is held.

    Args:
        result: of `ddp.solve`, for one problem or as many as there are worlds; or any object with `us`
            (N, nu), `xs` (N+1, nx) and `K` (N, nu, nx), or with a batch axis. Warp arrays (with a batch axis)
            that require gradients collect them from rollouts on a `wp.Tape`; a control at its limit has the
            derivative 0.
        period: (nx,) as in `Scene.state_period`.
        control_limits: as of a `Problem`; None: `lower` and `upper` of the result where it has them.
    """

    def __init__(self, result: Any, period: np.ndarray | None = None, control_limits: Any = None) -> None:
        for name in ("us", "xs", "K"):
            if not isinstance(attribute(result, name), np.ndarray | wp.array):
                raise ArgumentTypeError(
                    f"result is a {type(result).__name__}; us, xs and K, arrays, are needed: a ddp.Result"
                )
        single = result.us.ndim == 2
        self.us, self.xs, self.K = (a[None] if single else a for a in (result.us, result.xs, result.K))
        self.period = np.zeros(self.xs.shape[-1]) if period is None else array("period", period)
        if control_limits is None and getattr(result, "lower", None) is not None:
            control_limits = result.lower, result.upper
        self.limits = limit_rows(control_limits, self.us.shape[-1])

    def arrays(self, sim: Simulator) -> tuple[str, Any]:
        """Kernel name and struct for a simulator."""
        size = self.xs.shape[-1], self.us.shape[-1], self.period.shape
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
        struct = kernels.make_tracking(sim.nx, sim.nu, sim.dtype).Struct()
        put = functools.partial(_put, sim)
        struct.us, struct.gain, struct.period = put(self.us), put(self.K), put(self.period)
        struct.xs = put(self.xs)
        _put_limits(sim, struct, self.limits)
        return "tracking", struct
