"""The nearest-neighbour rule (20) over a library, evaluated inside a rollout's or a sweep's kernel."""

import copy
import functools
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from slcp_warp import Simulator
from slcp_warp.inputs.checks import array, choice, instance, number
from slcp_warp.inputs.errors import ArgumentError
from slcp_warp.inputs.limits import limit_rows
from slcp_warp.kernels.policies.contract import PolicyKernel
from slcp_warp.kernels.policies.nearest import nearest_kernel
from slcp_warp.policies.arrays import put, put_limits
from slcp_warp.policies.saved import Content

from .entries import NEEDED, Entries
from .tree import put_tree

METRICS = ("covariance", "variance")
TELLS = 1e-6  # of W's largest entry: least weight by which the images of a periodic component are told apart
ROUNDINGS = 16.0  # of the kernels' precision
CLOCK = 2.0**30  # of one step between timed entries, in units of the states' spread; exact in float32


def wrap(difference: np.ndarray, period: np.ndarray) -> np.ndarray:
    """Differences (..., nx) less the nearest multiple of each component's period (0: none)."""
    safe = np.where(period > 0.0, period, 1.0)
    return np.where(period > 0.0, difference - safe * np.round(difference / safe), difference)


def whitening(library: Entries, metric: str) -> np.ndarray:
    """W (nx, nx) with |W dx| the norm of (20), scaled by the covariance of the x_i.

    Of entries that belong to steps of a run it is the spread about the mean of the same step. Periodic
    components are measured from the mean of their directions, within half a period: where a period begins
    does not matter.
    """
    step = np.zeros(len(library.x), int) if library.step is None else library.step
    centred = wrap(library.x - _directions(library.x, library.period, step), library.period)
    centred = centred - _means(centred, step)
    covariance = centred.T @ centred / max(len(centred) - 1, 1)
    if metric == "variance":
        covariance = np.diag(np.diag(covariance))
    spread = np.trace(covariance) / len(covariance)
    covariance += (1e-9 * spread if spread > 0.0 else 1.0) * np.eye(len(covariance))
    return np.linalg.inv(np.linalg.cholesky(covariance))


def _means(x: np.ndarray, step: np.ndarray) -> np.ndarray:
    """The mean of the rows of the same step, for every row."""
    sums = np.stack([np.bincount(step, weights=column) for column in x.T], axis=1)
    return (sums / np.maximum(np.bincount(step), 1)[:, None])[step]


def _directions(x: np.ndarray, period: np.ndarray, step: np.ndarray) -> np.ndarray:
    """The mean direction of periodic components in the rows of a step, for every row; zero of others."""
    rate = np.where(period > 0.0, 2.0 * np.pi / np.where(period > 0.0, period, 1.0), 0.0)
    up, across = _means(np.sin(rate * x), step), _means(np.cos(rate * x), step)
    return np.where(period > 0.0, np.arctan2(up, across) / np.where(rate > 0.0, rate, 1.0), 0.0)


def rotated(white: np.ndarray, period: np.ndarray, dtype: Any) -> tuple[np.ndarray, np.ndarray]:
    """W rotated so that its last rows are of periodic components alone, and what tells their images apart.

    Returns R (nx, nx) with |R dx| = |W dx|, and (p, p + 1) for p periodic components: C, R's last rows, upper
    triangular, with its diagonal inverted; in the last column half a period and what differences of C dx in
    the precision of the kernels may be off by.
    """
    turning = period > 0.0
    p, places = int(turning.sum()), np.argsort(turning, kind="stable")
    if p == 0:
        return white, np.zeros((0, 1))
    triangle = np.linalg.qr(white[:, places])[1]
    least = TELLS * max(np.abs(white).max(), np.finfo(float).tiny)
    for j in range(len(triangle) - p, len(triangle)):
        if abs(triangle[j, j]) < least:
            triangle[j, j] = least  # what the norm does not see tells images apart all the same
    out = np.empty_like(triangle)
    out[:, places] = triangle
    corner, periods = triangle[-p:, -p:], period[turning]
    size = np.abs(np.linalg.inv(corner)) @ (np.abs(corner) @ (2.0 * periods))
    near = np.concatenate([corner, (0.5 * periods + ROUNDINGS * np.finfo(dtype).eps * size)[:, None]], axis=1)
    near[np.arange(p), np.arange(p)] = 1.0 / np.diag(corner)
    return out, near


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


def _due(step: np.ndarray) -> np.ndarray:
    """For every step up to the last that has entries the nearest one that has, the earlier of two."""
    known, every = np.unique(step), np.arange(step.max() + 1)
    after = np.searchsorted(known, every)
    before = np.maximum(after - 1, 0)
    return np.where(every - known[before] <= known[after] - every, known[before], known[after])


def _rows(name: str, values: np.ndarray, count: int) -> np.ndarray:
    """One row for each of `count` entries."""
    if len(values) not in (1, count):
        raise ArgumentError(f"{name} are for {len(values)} entries; there are {count}")
    return np.tile(values, (count // len(values), 1))


class NearestPolicy:
    """The nearest-neighbour rule (20), (M37) over a library; controls stay within the entries' limits.

    Of a library whose entries belong to steps of a run (`Library.step`) only those of the step are asked; at
    steps of another size, those of the same time. After the run's end its last ones are.

    Args:
        library: the entries.
        metric: "covariance" (Mahalanobis) or "variance" (its diagonal).
        min_gain: entries whose plan gains less over zero controls are left out (passive plans).
        feedback_limit: the feedback term K (x - x_j) is clamped to this size [control units].
        whiten: (nx, nx) matrix of another norm.
        control_limits: (lower, upper), each a number or (nu,), for all entries; None: the library's.
    """

    sees_states = True  # whatever else a task's policies see
    alike = True  # in all worlds: by state and time alone

    def __init__(
        self,
        library: Entries,
        metric: str = "covariance",
        min_gain: float = -np.inf,
        feedback_limit: float = np.inf,
        whiten: np.ndarray | None = None,
        control_limits: Any = None,
    ) -> None:
        instance("library", library, Entries, "a ddp.Library")
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
        self.rate, self.step_size = 1.0, library.step_size

    @property
    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the controls of every entry, (M, nu)."""
        return self.library.lower, self.library.upper

    @property
    def timed(self) -> bool:
        """Whether entries belong to steps of a run."""
        return self.library.step is not None

    def at(self, step_size: float) -> "NearestPolicy":
        """The same for steps of another size [s], where entries belong to steps of a run."""
        h = number("step_size", step_size, 0.0, above=True)
        out = copy.copy(self)
        if self.library.step_size is not None:
            out.rate, out.step_size = h / self.library.step_size, h
        return out

    def kernel(self, sim: Simulator) -> tuple[PolicyKernel, Any]:
        """Kernel and struct for a simulator."""
        self.library.check_scene(sim.scene)
        lib = self.library
        points, owner = images(lib.x, lib.period)
        whiten, near = rotated(self.whiten, lib.period, wp.dtype_to_numpy(sim.dtype))
        points = points @ whiten.T
        kernel = nearest_kernel(len(points), self.timed, len(near))
        struct = kernel.functions(sim.nx, sim.nu, sim.dtype).Struct()
        own = functools.partial(put, sim)
        struct.us, struct.xs, struct.gain = own(lib.u), own(lib.x), own(lib.K)
        if lib.step is not None:
            points = np.concatenate([points, CLOCK * lib.step[owner][:, None]], axis=1)
            struct.clock, struct.rate, struct.begin, struct.due = CLOCK, self.rate, 0.0, own(_due(lib.step))
        put_tree(sim, struct.tree, points, owner)
        struct.tree.near = own(near)
        struct.whitening = own(whiten)
        struct.period = own(lib.period)
        struct.limit = self.feedback_limit
        put_limits(sim, struct, (lib.lower, lib.upper))
        return kernel, struct

    def content(self) -> Content:
        """What it is made from, see `slcp_warp.policies.saved`."""
        arrays = {name: getattr(self.library, name) for name in NEEDED}
        values = {"header": self.library.header, "feedback_limit": self.feedback_limit}
        values |= {"step_size": self.step_size}
        return Content(values, arrays | {"whiten": self.whiten})

    @classmethod
    def of_content(cls, content: Content) -> "NearestPolicy":
        """From what `content` gave."""
        arrays = dict(content.arrays)
        limit, whiten = content.values["feedback_limit"], arrays.pop("whiten")
        out = cls(Entries(**arrays, header=content.values["header"]), feedback_limit=limit, whiten=whiten)
        size = content.values.get("step_size")
        return out if size is None else out.at(size)
