"""A rollout with its derivative, and a linearisation without one, as JAX transforms them."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from jax.custom_derivatives import SymbolicZero

from slcp_warp.kernels.factories import cached

from ..gradients.open_loop import bounds_of
from ..gradients.table import check_values
from ..gradients.tape import derivatives_exist
from ..inputs.arrays import ArrayError
from ..simulator import Simulator
from .foreign import backward_of, forward_of, linearization_of

SECOND = (
    "second derivatives of slcp_warp.jax are not supported; slcp_warp.weighted_hessian and "
    "Simulator.linearize(second=True) give those of a step"
)
LINEARIZED = (
    "the Jacobians of slcp_warp.jax.linearize have no derivatives; put jax.lax.stop_gradient around what "
    "they are taken at, or take gradients of slcp_warp.jax.step"
)
PUSHED = "external_force is differentiated, but has no gradient; put jax.lax.stop_gradient around it"


@cached
def rollout_of(sim: Simulator, every: int, check: bool) -> Callable[..., tuple[jax.Array, jax.Array]]:
    """(x0, us, table, force) -> states and status, with a derivative by the first three, backwards, once.

    Args:
        sim: whose kernels step.
        every: keep every `every`-th state; 0: all of them.
        check: whether the table's values are looked at.
    """

    def run(x: jax.Array, us: jax.Array, table: jax.Array, force: jax.Array) -> tuple[jax.Array, jax.Array]:
        states, status = _call(sim, every, check and not _looked_at(sim, table))(x, us, table, force)
        return states, status

    guarded = without_derivative(run, SECOND)

    def forward(*given: Any) -> tuple[Any, Any]:
        derivatives_exist(sim.options.method)
        if given[3].perturbed:
            raise ArrayError(PUSHED)
        x, us, table, force = (each.value for each in given)
        found = guarded(x, us, table, force)
        wanted = (None,) if given[2].perturbed else ()  # in a structure, as JAX traces what is not
        return found, (wanted, x, us, table, force, *found)

    def backward(kept: Any, slopes: Any) -> tuple[Any, ...]:
        wanted, *arrays = kept
        if isinstance(slopes[0], SymbolicZero):
            return None, None, None, None
        by_x, by_us, by_table = pullback_of(sim, every, bool(wanted))(slopes[0], *arrays)
        if wanted and len(arrays[2]) == 1:
            by_table = by_table.sum(0, keepdims=True)
        return by_x, by_us, by_table if wanted else None, None

    differentiable = jax.custom_vjp(run)
    differentiable.defvjp(forward, backward, symbolic_zeros=True)
    return differentiable


@cached
def _call(sim: Simulator, every: int, check: bool) -> Callable[..., Any]:
    """The foreign function, which JAX keeps for the shapes that it was called with."""

    @jax.jit
    def run(x: jax.Array, us: jax.Array, table: jax.Array, force: jax.Array) -> Any:
        steps = us.shape[1]
        states = len(bounds_of(steps, every)) if every else steps + 1
        sizes = {"states": (len(x), states, sim.nx), "status": (len(x),)}
        return forward_of(sim, every, check)(x, us, table, force, output_dims=sizes)

    return run


@cached
def pullback_of(sim: Simulator, every: int, parameters: bool) -> Callable[..., tuple[jax.Array, ...]]:
    """The gradient by states, then what the rollout took and gave -> the gradients by x0, controls and, with
    `parameters`, each world's table (B, P).
    """

    @jax.jit
    def run(by_states: jax.Array, x: jax.Array, us: jax.Array, table: jax.Array, *rest: Any) -> Any:
        rows = len(x) if parameters else 0
        sizes = {"by_x": x.shape, "by_us": us.shape, "by_table": (rows, table.shape[1])}
        call = backward_of(sim, every, parameters)
        return tuple(call(by_states, x, us, table, *rest, output_dims=sizes))

    return without_derivative(run, SECOND)


@cached
def jacobians_of(sim: Simulator, check: bool) -> Callable[..., tuple[jax.Array, ...]]:
    """(x, u, table, force) -> A, B and status; with `check` the table's values are looked at."""

    def run(x: jax.Array, u: jax.Array, table: jax.Array, force: jax.Array) -> tuple[jax.Array, ...]:
        return _linearize(sim, check and not _looked_at(sim, table))(x, u, table, force)

    return run


@cached
def _linearize(sim: Simulator, check: bool) -> Callable[..., tuple[jax.Array, ...]]:
    @jax.jit
    def run(x: jax.Array, u: jax.Array, table: jax.Array, force: jax.Array) -> tuple[jax.Array, ...]:
        worlds, nx = x.shape
        sizes = {"A": (worlds, nx, nx), "B": (worlds, nx, sim.nu), "status": (worlds,)}
        return tuple(linearization_of(sim, check)(x, u, table, force, output_dims=sizes))

    return without_derivative(run, LINEARIZED)


def _looked_at(sim: Simulator, table: jax.Array) -> bool:
    """Whether a table has been looked at: it has values, and not only a shape, where nothing traces."""
    if isinstance(table, jax.core.Tracer):
        return False
    check_values(sim.params, np.asarray(table, float))
    return True


def without_derivative(function: Callable[..., Any], why: str) -> Callable[..., Any]:
    """A function whose own derivative is an error that says why."""
    guarded = jax.custom_jvp(function)

    @guarded.defjvp
    def _(_values: Any, _directions: Any) -> Any:
        raise NotImplementedError(why)

    return guarded
