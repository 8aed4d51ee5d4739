"""Costs of optimal control problems: sums over k of l(x_k, u_k, k), and a final cost l_f(x_N)."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.control.cost_functions import check_cost, make_later, make_plain, make_quadratic
from slcp_warp.kernels.control.costs import CostFunctions
from slcp_warp.kernels.device.compile import seen_by
from slcp_warp.kernels.factories import cached

from ..inputs.checks import array, flag, function, whole
from ..inputs.errors import ArgumentError, ArgumentTypeError
from ..inputs.user_code import UNKNOWN, Known, check_indices, of_user, reads
from .windows import ROUNDING, Windows

Moved = Callable[[np.ndarray, int, float, int | None], np.ndarray]
# (weights, first, pace, nodes) -> those of a cost whose step j is step first + j pace of this one


class Cost:
    """A running and a final cost as Warp functions, made for each dtype; their weights are run-time data.

    Args:
        make: ``make(dtype, VX, VU) -> CostFunctions``, called once per dtype, and again once a global or
            enclosed number, array or function that it names has changed; VX, VU are the vector types of a
            state and a control. Functions read weights as ``weights[row, i]``. It must be a function of a
            module, or be kept and passed again, for kernels to be found again instead of being compiled anew.
        weights: numbers (P,), or one row per problem (B, P).
        nx: number of states that the cost needs, or None for any.
        nu: number of controls, or None for any.
        nodes: N + 1 for the horizon N that the weights belong to, or None for any.
        fixed: (P,) which weights are no numbers but say what the others are of: `with_weights` keeps them.
        steady: whether the running cost is the same function at every step.
    """

    def __init__(
        self,
        make: Callable[..., CostFunctions],
        weights: Any = (),
        nx: int | None = None,
        nu: int | None = None,
        nodes: int | None = None,
        fixed: Any = None,
        steady: bool = False,
    ) -> None:
        function("make", make, 3)
        for name, size in (("nx", nx), ("nu", nu), ("nodes", nodes)):
            if size is not None:
                whole(name, size, 0 if name == "nu" else 1)
        values = np.atleast_1d(array("weights", weights, finite=False))
        if values.ndim > 2 or not np.isfinite(values).all():
            raise ArgumentError(
                f"weights must be finite numbers of shape (P,) or (B, P), got shape {values.shape}"
            )
        self.make, self.weights = make, values
        self.nx, self.nu, self.nodes, self.steady = nx, nu, nodes, flag("steady", steady)
        self.points: tuple[Any, ...] = ()  # of bodies, that terms are of; in the order of the weights
        self.windows: Windows | None = None  # of time, in which running terms count
        self._moved: Moved | None = None  # weights of other steps, where these are data
        self._asked: tuple[Callable[..., Any], int] | None = None  # what tells whether it asks for the step
        own = np.zeros(values.shape[-1]) if fixed is None else array("fixed", fixed, (values.shape[-1],))
        self.fixed = own != 0.0

    def functions(self, dtype: Any, nx: int, nu: int) -> CostFunctions:
        """Warp functions for a scalar type and sizes, made once, and anew where `make` sees other values."""
        return _functions(self.make, seen_by(self.make), dtype, nx, nu)

    def same(self, other: "Cost") -> bool:
        """Whether another cost is of the same functions, with the same weights, points and windows."""
        plain = ("nx", "nu", "nodes", "steady", "points", "windows")
        return (
            self.make is other.make
            and all(getattr(self, name) == getattr(other, name) for name in plain)
            and np.array_equal(self.weights, other.weights)
            and np.array_equal(self.fixed, other.fixed)
        )

    def with_weights(self, weights: Any) -> "Cost":
        """The same functions with other numbers, (P,) or (B, P); nothing is compiled."""
        other = Cost(self.make, weights, self.nx, self.nu, self.nodes, steady=self.steady)
        self._hand_on(other)
        if other.weights.shape[-1] != self.weights.shape[-1]:
            raise ArgumentError(
                f"weights must have {self.weights.shape[-1]} columns, got {other.weights.shape[-1]}"
            )
        before, after = (np.atleast_2d(each.weights)[:, self.fixed] for each in (self, other))
        changed = (after != before[:1]).any(axis=0)
        if changed.any():
            at = int(np.flatnonzero(changed)[0])
            place = int(np.flatnonzero(self.fixed)[at])
            raise ArgumentError(
                f"weights[..., {place}] is {after[after[:, at] != before[0, at], at][0]}; it says what other "
                f"weights are of, and must stay {before[0, at]}"
            )
        return other

    def follows_steps(self, nx: int, nu: int) -> bool:
        """Whether its running function may be another one from step to step."""
        if self.steady or self.windows is not None or self.nodes is not None:
            return not self.steady
        if self._asked is None:
            return reads(self.functions(wp.float64, nx, nu).running, 4)
        make, place = self._asked
        vectors = wp.types.vector(nx, wp.float64), wp.types.vector(max(nu, 1), wp.float64)
        return reads(make(wp.float64, *vectors)[0], place)

    def check_moves(self, nx: int, nu: int, why: str) -> None:
        """Raise ArgumentError for a cost of the step's number that is code for these steps alone."""
        if self.windows is None and self._moved is None and self.follows_steps(nx, nu):
            raise ArgumentError(
                f"{why}; the cost's running function asks for the step's number, and is code for its own "
                "steps alone: costs.terms with start and end, costs.quadratic with a target of every node or "
                "costs.plain can be of others"
            )

    def from_step(self, first: int, horizon: int | None = None) -> "Cost":
        """The cost of the steps from this one on, which becomes step 0; what is given by node then ends where
        it does, or goes on with its last node over a horizon.
        """
        if self.steady or (first == 0 and horizon is None):
            return self
        if self.windows is not None:
            return self._within(
                replace(self.windows, begun=self.windows.begun + first * self.windows.step_size)
            )
        nodes = None
        if self.nodes is not None:
            nodes = self.nodes - first if horizon is None else horizon + 1
        if self._moved is not None:
            return self._with(self._moved(self.weights, first, 1.0, nodes), nodes)
        other = Cost(make_later(self.make, first), self.weights, self.nx, self.nu, nodes)
        other.fixed = self.fixed
        return other

    def in_steps_of(self, step_size: float, own: float | None = None) -> "Cost":
        """The cost of steps of another size [s]: windows of terms are times; so is what belongs to nodes or
        steps of a size `own`, where it is given.
        """
        if self.windows is not None:
            same = self.windows.step_size == step_size
            return self if same else self._within(replace(self.windows, step_size=step_size))
        if self.steady or own is None or step_size == own or self._moved is None:
            return self
        nodes = None if self.nodes is None else max(1, round((self.nodes - 1) * own / step_size)) + 1
        return self._with(self._moved(self.weights, 0, step_size / own, nodes), nodes)

    def _within(self, windows: Windows) -> "Cost":
        """With other windows."""
        other = self._with(windows.into(self.weights), self.nodes)
        other.windows = windows
        return other

    def _with(self, weights: np.ndarray, nodes: int | None) -> "Cost":
        """With other weights, of other nodes."""
        other = Cost(self.make, weights, self.nx, self.nu, nodes, steady=self.steady)
        self._hand_on(other)
        return other

    def _hand_on(self, other: "Cost") -> None:
        """What the same functions have with whatever weights."""
        for name in ("points", "windows", "_moved", "_asked"):
            setattr(other, name, getattr(self, name))
        if other.weights.shape[-1] == self.weights.shape[-1]:
            other.fixed = self.fixed

    def rows(self, batch: int) -> np.ndarray:
        """Weights as rows (1 or B, max(P, 1))."""
        rows = np.atleast_2d(self.weights)
        if rows.shape[0] not in (1, batch):
            raise ArgumentError(f"cost weights have {rows.shape[0]} rows, the batch has {batch} problems")
        return rows if rows.shape[1] else np.zeros((1, 1))


@cached
def _functions(make: Callable[..., CostFunctions], seen: str, dtype: Any, nx: int, nu: int) -> CostFunctions:
    """What `make` gives; `seen`: digest of what it is made of."""
    vectors = wp.types.vector(nx, dtype), wp.types.vector(max(nu, 1), dtype)
    functions = make(dtype, *vectors)
    if not isinstance(functions, CostFunctions):
        raise ArgumentTypeError(
            f"a cost's make must return costs.CostFunctions, got {type(functions).__name__}"
        )
    with of_user(f"costs: they are none of {nx} states and {nu} controls for {dtype.__name__}"):
        check_cost(functions, dtype, *vectors)
    x, u = Known(nx), Known(max(nu, 1))
    check_indices("costs: running", functions.running, UNKNOWN, UNKNOWN, x, u)
    check_indices("costs: final", functions.final, UNKNOWN, UNKNOWN, x)
    return functions


def plain(make: Callable[..., Any]) -> Cost:
    """A cost without weights: ``make(dtype, VX, VU) -> (running(x, u, k), final(x) or None)`` in Warp.

    Derivatives come from differences in double precision (see `slcp_warp.kernels.control.costs`).
    """
    function("make", make, 3)
    cost = Cost(make_plain(make), [0.0, 1.0])
    cost._moved, cost._asked = _other_steps, (make, 2)
    return cost


def _other_steps(weights: np.ndarray, first: int, pace: float, nodes: int | None) -> np.ndarray:
    """Of a plain cost."""
    start, own = weights[..., :1], weights[..., 1:]
    return np.concatenate([start + first * own, pace * own], axis=-1)


def _other_targets(weights: np.ndarray, first: int, pace: float, nodes: int | None, nx: int, nu: int) -> Any:
    """Of a quadratic cost, between its nodes, and beyond them at the last."""
    before = 2 * nx * nx + nu * nu
    given = weights[..., before:].reshape(*weights.shape[:-1], -1, nx)
    assert nodes is not None
    at = np.minimum(first + pace * np.arange(nodes), given.shape[-2] - 1.0)
    low = np.floor(at + ROUNDING).astype(int)
    share = np.maximum(at - low, 0.0)[:, None]
    high = np.minimum(low + 1, given.shape[-2] - 1)
    targets = (1.0 - share) * given[..., low, :] + share * given[..., high, :]
    return np.concatenate([weights[..., :before], targets.reshape(*weights.shape[:-1], -1)], axis=-1)


def quadratic(Q: Any, R: Any, Qf: Any = None, target: Any = None) -> Cost:
    """l = (x - t_k)' Q (x - t_k) / 2 + u' R u / 2, final cost (x - t_N)' Qf (x - t_N) / 2.

    Args:
        Q: symmetric (nx, nx).
        R: symmetric (nu, nu).
        Qf: symmetric (nx, nx), default 0.
        target: state (nx,), or one per node (N+1, nx), for problems of that horizon only; default 0.
    """
    Q, R = array("Q", Q, ("nx", "nx")), array("R", R, ("nu", "nu"))
    nx, nu = Q.shape[0], R.shape[0]
    if not nx or not nu:
        raise ArgumentError(f"Q has shape {Q.shape} and R {R.shape}; neither may be empty")
    Qf = np.zeros((nx, nx)) if Qf is None else array("Qf", Qf)
    target = np.zeros(nx) if target is None else array("target", target)
    for name, value, size in (("Q", Q, nx), ("R", R, nu), ("Qf", Qf, nx)):
        if value.shape != (size, size):
            raise ArgumentError(
                f"{name} must be a symmetric matrix ({size}, {size}), got shape {value.shape}"
            )
        if not np.allclose(value, value.T, rtol=1e-12, atol=1e-14):
            i, j = np.unravel_index(np.argmax(np.abs(value - value.T)), value.shape)
            raise ArgumentError(
                f"{name} must be symmetric, got {name}[{i}, {j}] = {value[i, j]:g} and "
                f"{name}[{j}, {i}] = {value[j, i]:g}"
            )
    if target.ndim not in (1, 2) or target.shape[-1] != nx:
        raise ArgumentError(f"target must have shape ({nx},) or (N+1, {nx}), got {target.shape}")
    weights = np.concatenate([a.ravel() for a in (Q, R, Qf, target)])
    nodes = len(target) if target.ndim == 2 and len(target) > 1 else None
    cost = Cost(make_quadratic, weights, nx=nx, nu=nu, nodes=nodes, steady=nodes is None)
    cost._moved = partial(_other_targets, nx=nx, nu=nu)
    return cost
