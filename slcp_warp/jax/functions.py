"""A rollout, a step and its Jacobians as functions of JAX arrays."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..gradients.tape import derivatives_exist
from ..inputs.arrays import ArrayError, with_batch
from ..inputs.checks import array, flag, instance, whole
from ..simulator import Simulator
from .operators import jacobians_of, rollout_of
from .table import JaxArrays, Values, parameter_table


class Outcome(NamedTuple):
    """states (B, N+1, nx), or the next state (B, nx) of a step; status (B,), as `slcp_warp.Status`."""

    states: jax.Array
    status: jax.Array


class Jacobians(NamedTuple):
    """A = dx'/dx (B, nx, nx) and B = dx'/du (B, nx, nu) of a step; status (B,)."""

    A: jax.Array
    B: jax.Array
    status: jax.Array


def rollout(
    sim: Simulator,
    x0: Any,
    controls: Any,
    params: Values = None,
    *,
    external_force: Any = None,
    checkpoint: int | None = None,
    check: bool = True,
) -> Outcome:
    """Step every world N times; differentiable by x0, controls and the parameters that are JAX arrays.

    Args:
        sim: a simulator on the arrays' device, of their precision.
        x0: (B, nx) or (nx,).
        controls: (B, N, nu), or (N, nu) for all worlds.
        params: `Parameters`, or arrays by name for those that differ from `sim.params`: a scalar, the
            parameter's own shape, (B,) or (B, *shape).
        external_force: as in `Simulator.rollout`; no gradient.
        checkpoint: keep every k-th state only, as in `Simulator.rollout`.
        check: whether values of parameters are looked at (on a GPU this waits for them).

    Raises:
        ArrayError: another shape or precision.
        ParameterError: an unknown name or an illegal value; where JAX traces, an illegal value is an error
            of JAX's, which says the same.
        OptionError: a gradient by parameters that the options do not have.
    """
    instance("sim", sim, Simulator, "a slcp_warp.Simulator")
    flag("check", check)
    x, us = given(sim, "x0", x0, (sim.nx,)), given(sim, "controls", controls, (None, sim.nu))
    if np.ndim(controls) == 2:  # for all worlds
        us = jnp.broadcast_to(us, (len(x), *us.shape[1:]))
    if len(x) != len(us):
        raise ArrayError(f"controls has shape {np.shape(controls)}; ({len(x)}, N, {sim.nu}) is needed")
    every = 0 if checkpoint is None else whole("checkpoint", checkpoint)
    table, force = _shared(sim, x, params, external_force)
    states, status = rollout_of(sim, every, check and _unseen(params))(x, us, table, force)
    return Outcome(states, status) if np.ndim(x0) == 2 else Outcome(states[0], status[0])


def step(sim: Simulator, x: Any, u: Any = None, params: Values = None, **options: Any) -> Outcome:
    """One step: a rollout of length one.

    Args:
        sim, params, options: as for `rollout`.
        x: (B, nx) or (nx,).
        u: (B, nu), or (nu,) for all worlds; None: zero.
    """
    instance("sim", sim, Simulator, "a slcp_warp.Simulator")
    states, controls = _states_and_controls(sim, x, u)
    after, status = rollout(sim, states, controls[:, None], params, **options)
    return Outcome(after[:, 1], status) if np.ndim(x) == 2 else Outcome(after[0, 1], status[0])


def linearize(
    sim: Simulator,
    x: Any,
    u: Any = None,
    params: Values = None,
    *,
    external_force: Any = None,
    check: bool = True,
) -> Jacobians:
    """Jacobians of a step (M27), as `Simulator.linearize` gives them; they have no derivative themselves.

    Args:
        sim, params, external_force, check: as for `rollout`.
        x: (B, nx) or (nx,).
        u: (B, nu), or (nu,) for all worlds; None: zero.

    Raises:
        OptionError: options without derivatives.
    """
    instance("sim", sim, Simulator, "a slcp_warp.Simulator")
    flag("check", check)
    derivatives_exist(sim.options.method)
    states, controls = _states_and_controls(sim, x, u)
    table, force = _shared(sim, states, params, external_force)
    A, B, status = jacobians_of(sim, check and _unseen(params))(states, controls, table, force)
    return Jacobians(A, B, status) if np.ndim(x) == 2 else Jacobians(A[0], B[0], status[0])


def _states_and_controls(sim: Simulator, x: Any, u: Any) -> tuple[jax.Array, jax.Array]:
    """(B, nx) and (B, nu)."""
    states = given(sim, "x", x, (sim.nx,))
    if u is None:
        return states, jnp.zeros((len(states), sim.nu), dtype=states.dtype)
    controls = given(sim, "u", u, (sim.nu,))
    if np.ndim(u) == 2 and len(controls) != len(states):
        raise ArrayError(f"u has shape {np.shape(u)}; ({len(states)}, {sim.nu}) or ({sim.nu},) is needed")
    return states, jnp.broadcast_to(controls, (len(states), sim.nu))


def _shared(sim: Simulator, x: jax.Array, params: Values, external_force: Any) -> tuple[jax.Array, jax.Array]:
    """The table of parameters and the external force (0 or B, 3 bodies) of B worlds."""
    bodies = sim.scene.structure.nb
    force = jnp.zeros((0, 3 * bodies), dtype=x.dtype)
    if external_force is not None:
        force = given(sim, "external_force", external_force, (bodies, 3)).reshape(-1, 3 * bodies)
        if len(force) != len(x):
            raise ArrayError(f"external_force is given for {len(force)} worlds, x0 for {len(x)}")
    table = parameter_table(sim, params)
    if len(table) not in (1, len(x)):
        raise ArrayError(f"params are given for {len(table)} worlds, x0 for {len(x)}")
    return table, force


def _unseen(params: Values) -> bool:
    """Whether parameters have values that nobody looked at; `Parameters` were when they were made."""
    return isinstance(params, Mapping) and len(params) > 0


def given(sim: Simulator, name: str, value: Any, shape: tuple[int | None, ...]) -> jax.Array:
    """A checked array with a batch axis: JAX's, or numbers."""
    library = JaxArrays.of(sim)
    if isinstance(value, jax.Array):
        library.check(name, value, ArrayError)
    else:
        value = library.numbers(array(name, value, finite=False, error=ArrayError))
    batched: jax.Array = with_batch(name, value, shape)
    return batched
