"""Batches of plain (stochastic) linear complementarity problems, differentiable in A, b and sigma."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.device.launch import launch
from slcp_warp.kernels.method import ERM, REM
from slcp_warp.kernels.plain.complementarity import (
    make_complementarity_adjoint_kernel,
    make_complementarity_kernel,
    method_of,
)
from slcp_warp.kernels.structure import MOST_ROWS

from ..gradients.tape import record, wants_gradient
from ..inputs import checks
from ..inputs.arrays import Array, ArrayError, device_of, from_batch, kind_of, to_batch
from ..inputs.checks import choice
from ..options import CHOICES, OptionError
from ..storage.printed import Arrays

RESIDUALS = (*REM, *ERM, "hard")
METHODS = ("direct", "continuation")
DEFINITE = 1e-6  # an eigenvalue below minus this part of the largest is negative


@dataclass(frozen=True, repr=False)
class Complementarity(Arrays):
    """Solution of a batch of problems, in the kind of array that A is.

    Attributes:
        impulse: lambda, (B, n).
        w: A lambda + b, (B, n).
        status: (B,), as `Status`; where it is not SOLVED impulses mean nothing. With redundant rows lambda is
            not unique, A lambda is.
        iterations: (B,), linear systems solved, about; at most the limit where the solver gave up.
    """

    impulse: Array
    w: Array
    status: Array
    iterations: Array
    _arrays: tuple[wp.array, ...]
    _key: tuple[Any, ...]
    _kind: str
    _batched: bool
    _sigma_shape: tuple[int, ...]

    def __getstate__(self) -> dict[str, Any]:
        kept = [(each.numpy(), str(each.device)) for each in self._arrays]
        return vars(self) | {"_arrays": kept}

    def __setstate__(self, state: dict[str, Any]) -> None:
        arrays: tuple[wp.array, ...] = tuple(
            wp.array(values, dtype=wp.dtype_from_numpy(values.dtype), device=device)
            for values, device in state["_arrays"]
        )
        vars(self).update(state | {"_arrays": arrays})

    def vjp(self, impulse_grad: Array) -> tuple[Array, Array, Array]:
        """Gradients by A, b and sigma of a scalar whose gradient by the impulses is given.

        Args:
            impulse_grad: (B, n).

        Returns:
            A_grad (B, n, n), symmetric: the derivative along symmetric changes of A; b_grad (B, n);
            sigma_grad in sigma's shape (zero for "hard"). NaN where the status is not SOLVED.
        """
        A, _b, sigma = self._arrays[:3]
        given = to_batch("impulse_grad", impulse_grad, (sigma.shape[1],), A.dtype, A.device)
        if given.array.shape != sigma.shape:
            raise ArrayError(f"impulse_grad has shape {given.array.shape}; {tuple(sigma.shape)} is needed")
        grads = [wp.zeros_like(x) for x in self._arrays[:3]]
        self._adjoint(given.array, grads)
        by_sigma = grads[2].numpy().astype(np.float64)
        by_sigma = _reduce(by_sigma, self._sigma_shape, self._batched)
        return (*(from_batch(g, self._kind, self._batched) for g in grads[:2]), by_sigma)

    def _adjoint(self, impulse_grad: wp.array, grads: list[wp.array]) -> None:
        kernel = make_complementarity_adjoint_kernel(*self._key)
        launch(kernel, len(impulse_grad), [*self._arrays, impulse_grad, *grads], impulse_grad.device)


def solve_complementarity(
    A: Any,
    b: Any,
    sigma: Any = 0.1,
    residual: str = "rem-logistic",
    scaling: str = "inertia",
    method: str = "direct",
    *,
    device: Any = None,
    dtype: str | None = None,
    check: bool = True,
) -> Complementarity:
    """Solve 0 <= lambda, w = A lambda + b >= 0, lambda w = 0 (3) under noise of b, section IV.A.

    REM residuals solve E[min(D_i lambda_i, w_i + noise)] = 0, eqs. (17) and footnote 3: one solution of A
    lambda. ERM residuals minimise sum_i E[min(D_i lambda_i, w_i + noise)^2], eq. (15) and footnote 3: not
    convex, the least of the stationary points that descents from several starts reach, never above the REM
    solution's objective, not always the least of all (docs/understand/residuals.md). "hard" has no noise.
    Recorded on a `wp.Tape` for Warp arrays that require a gradient (then sigma must be a (B, n) Warp array to
    get one).

    Args:
        A: (B, n, n), symmetric positive semidefinite, n <= 31; NumPy, torch (no autograd), JAX or Warp array.
        b: (B, n). Without B: one problem.
        sigma: noise levels, > 0, scalar, (n,), (B,) (if B != n) or (B, n), in units of b.
        residual: "rem-logistic", "rem-normal", "erm-logistic", "erm-normal" or "hard".
        scaling: "inertia", D = diag(A), or "none", D = 1.
        method: "direct", Newton's method at the sigma asked for, with an interior-point method where that
            fails; or, for "hard" only, "continuation", eqs. (5)-(6) (Chen and Mangasarian): smoothed problems
            with sigma lowered to zero, each solved from the solution of the last. Slower, and without a proof
            of infeasibility (NOT_CONVERGED); see docs/understand/residuals.md.
        device: where NumPy arrays are solved; default that of A, or Warp's default device.
        dtype: "float64" or "float32"; default that of A, float64 for anything else.
        check: whether A is tested (on the host) for symmetry and definiteness.

    Raises:
        OptionError: residual, scaling or method not offered, or not together.
        ArrayError: bad shape, non-finite, asymmetric or indefinite A.
    """
    _choose(residual, scaling, method)
    kind = kind_of(A)
    dtype = _dtype_name(A) if dtype is None else dtype
    number = getattr(wp, choice("dtype", dtype, ("float32", "float64"), error=OptionError))
    device = checks.device(device_of(A) if device is None else device)
    checks.flag("check", check)
    given = to_batch("A", A, ("n", "n"), number, device)
    worlds, n = given.array.shape[:2]
    if given.array.shape[2] != n or not 0 < n <= MOST_ROWS:
        raise ArrayError(f"A has shape {tuple(given.array.shape)}; (B, n, n) with n <= {MOST_ROWS} is needed")
    right = to_batch("b", b, (n,), number, device)
    if right.array.shape[0] != worlds:
        raise ArrayError(
            f"b has shape {tuple(right.array.shape)}; ({worlds}, {n}) is needed, one row a matrix"
        )
    if check:
        _check(given.array.numpy(), right.array.numpy(), scaling)
    levels, shape = _levels(sigma, residual, worlds, n, number, device)
    key = (n, number, method_of(residual, scaling))
    impulse, w = (wp.zeros((worlds, n), dtype=number, device=device) for _ in range(2))
    status, iterations = (wp.zeros(worlds, dtype=wp.int32, device=device) for _ in range(2))
    arrays = (given.array, right.array, levels, impulse, w, status)
    kernel = make_complementarity_kernel(*key, method == "continuation")
    launch(kernel, worlds, [*arrays, iterations], device)
    found, slack, code, count = (from_batch(x, kind, given.batched) for x in (impulse, w, status, iterations))
    solution = Complementarity(found, slack, code, count, arrays, key, kind, given.batched, shape)
    _record(solution)
    return solution


def _choose(residual: str, scaling: str, method: str) -> None:
    for name, value, choices in (
        ("residual", residual, RESIDUALS),
        ("scaling", scaling, CHOICES["scaling"]),
        ("method", method, METHODS),
    ):
        choice(name, value, choices, error=OptionError)
    if method == "continuation" and residual != "hard":
        raise OptionError(
            f"method is 'continuation' with residual {residual!r}; it leads to the hard solution: use "
            "residual='hard', or method='direct'"
        )


def _record(solution: Complementarity) -> None:
    inputs, impulse = solution._arrays[:3], solution._arrays[3]
    if not wants_gradient(*inputs):
        return
    impulse.requires_grad = True

    def backward() -> None:
        grads = [x.grad if x.requires_grad else wp.zeros_like(x, requires_grad=False) for x in inputs]
        solution._adjoint(impulse.grad, grads)
        impulse.grad.zero_()

    record(backward, inputs, impulse)


def _dtype_name(A: Any) -> str:
    name = A.dtype.__name__ if isinstance(A, wp.array) else str(checks.attribute(A, "dtype"))
    return "float32" if name.endswith("float32") else "float64"


def _levels(
    sigma: Any, residual: str, worlds: int, n: int, number: Any, device: Any
) -> tuple[wp.array, tuple[int, ...]]:
    """Noise levels as (B, n), and the shape that they came in."""
    if isinstance(sigma, wp.array) and sigma.shape == (worlds, n):
        return to_batch("sigma", sigma, (n,), number, device).array, (worlds, n)
    if kind_of(sigma) == "torch" and not sigma.is_meta:
        sigma = sigma.detach().cpu()
    value = checks.array("sigma", sigma.numpy() if isinstance(sigma, wp.array) else sigma,
                         finite=residual != "hard", error=ArrayError)  # fmt: skip
    if value.shape not in ((), (n,), (worlds,), (worlds, n)):
        raise ArrayError(
            f"sigma has shape {value.shape}; (), ({n},), ({worlds},) or ({worlds}, {n}) is needed"
        )
    if residual != "hard" and not (value > 0.0).all():
        raise ArrayError(f"sigma is {value.min():g}; positive numbers are needed, or residual='hard'")
    full = value[:, None] if value.shape == (worlds,) != (n,) else value
    full = np.ascontiguousarray(np.broadcast_to(full, (worlds, n)))
    return wp.array(full, dtype=number, device=device), value.shape


def _reduce(full: np.ndarray, shape: tuple[int, ...], batched: bool) -> Any:
    """Gradient by the (B, n) levels as one by a value of `shape` that was broadcast to them."""
    worlds, n = full.shape
    if shape == ():
        return full.sum()
    if shape == (n,):
        return full.sum(axis=0)
    return full.sum(axis=1) if shape == (worlds,) else full


def _check(A: np.ndarray, b: np.ndarray, scaling: str) -> None:
    for name, value in (("A", A), ("b", b)):
        if not np.isfinite(value).all():
            raise ArrayError(f"{name} holds {value[~np.isfinite(value)][0]}; finite numbers are needed")
    full = A.astype(np.float64)
    size = np.abs(full).max(axis=(1, 2))
    skew = np.abs(full - full.swapaxes(1, 2)).max(axis=(1, 2))
    if (skew > DEFINITE * size).any():
        raise ArrayError(
            f"A[{skew.argmax()}] differs by {skew.max():.3g} from its transpose; symmetry is needed"
        )
    least = np.linalg.eigvalsh(full).min(axis=1)
    if (least < -DEFINITE * size).any():
        raise ArrayError(f"A[{least.argmin()}] has the eigenvalue {least.min():.3g}; at least 0 is needed")
    diagonal = np.einsum("bii->bi", full)
    if scaling == "inertia" and not (diagonal > 0.0).all():
        raise ArrayError("A has a zero on its diagonal, D of scaling='inertia'; use scaling='none'")
