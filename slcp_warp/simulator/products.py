"""Products with the derivatives of rollouts, in NumPy: vector-Jacobian, Jacobian-vector, weighted Hessian.

The same numbers come from a `wp.Tape` (vjp) or from `Simulator.linearize`; these ways need neither.
"""

import threading
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from ..gradients import launches as derivatives
from ..gradients.tape import derivatives_exist
from ..inputs.arrays import ArrayError
from ..inputs.checks import array, instance, names
from ..parameters import ParameterError, Parameters
from ..stepping.generic import GenericKernels
from ..storage.printed import Arrays
from .simulator import Simulator

_taping = threading.Lock()  # Warp records on one tape at a time, whichever thread launches


@dataclass(frozen=True, repr=False)
class Pullback(Arrays):
    """Gradients of sum(weights * states), and the rollout.

    Attributes:
        x0: by the initial states, (B, nx).
        controls: by the controls, (B, N, nu).
        parameters: by each parameter that was asked for, (B, *its shape).
        states: of the rollout, (B, N+1, nx).
        status: of the rollout, (B,).
    """

    x0: np.ndarray
    controls: np.ndarray
    parameters: dict[str, np.ndarray]
    states: np.ndarray
    status: np.ndarray


@dataclass(frozen=True, repr=False)
class Pushforward(Arrays):
    """Derivatives of the states along a direction, and the rollout.

    Attributes:
        tangent: (B, N+1, nx).
        states: of the rollout, (B, N+1, nx).
        status: of the rollout, (B,).
    """

    tangent: np.ndarray
    states: np.ndarray
    status: np.ndarray


def vjp(
    sim: Simulator,
    x0: Any,
    controls: Any,
    weights: Any,
    params: Parameters | None = None,
    *,
    parameters: str | Sequence[str] = (),
    external_force: Any = None,
) -> Pullback:
    """Roll out and pull weights on the states back (M31): one forward and one backward launch.

    Args:
        sim: whose rollout it is.
        x0: (B, nx).
        controls: (B, N, nu).
        weights: (B, N+1, nx), of the states.
        params: as for `Simulator.rollout`.
        parameters: name or names of parameters whose gradients are wanted, too; they come per world. Of one
            part, "box.mass", that of its number, (B,), or of its numbers, (B, k).
        external_force: as for `Simulator.rollout`.

    Returns:
        Gradients; NaN in worlds that were not solved, but 0 where all of a world's weights are.

    Raises:
        ArrayError: another shape.
        OptionError, ParameterError: a gradient that does not exist.
    """
    instance("sim", sim, Simulator, "a slcp_warp.Simulator")
    x0, controls = _pair(sim, x0, controls)
    worlds = len(x0)
    shape = (worlds, controls.shape[1] + 1, sim.nx)
    weights = _array("weights", weights, shape)
    sim.parameter_array(params, worlds)  # whether they fit
    given = sim.params if params is None else params
    known = [*given.names, *_parts(given, parameters)]
    parameters = names("parameters", parameters, known, error=ParameterError)
    if parameters:
        own = {name: np.broadcast_to(given[name], (worlds, *sim.params[name].shape)) for name in given.names}
        given = given.replace(**own).track()

    if not worlds:  # a tape has no gradients of empty arrays
        traj = sim.rollout(x0, controls, given)
        none = {name: np.zeros((0, *np.shape(sim.params[name]))) for name in parameters}
        return Pullback(x0, controls, none, traj.states, traj.status)

    def put(a: np.ndarray) -> wp.array:
        return wp.array(a, dtype=sim.dtype, device=sim.device, requires_grad=True)

    x, us, force = put(x0), put(controls), external_force
    if force is not None:
        force = array("external_force", force, ("B", "bodies", 3), finite=False, error=ArrayError)
        force = wp.array(force, dtype=sim.dtype, device=sim.device)
    with _taping:
        with wp.Tape() as tape:
            traj = sim.rollout(x, us, given, external_force=force)
        tape.backward(grads={traj.states: wp.array(weights, dtype=sim.dtype, device=sim.device)})
    found = {name: given.gradient(name) for name in parameters}
    return Pullback(x.grad.numpy(), us.grad.numpy(), found, traj.states.numpy(), traj.status.numpy())


def _parts(params: Parameters, asked: Any) -> list[str]:
    """Names of single parts among those that are asked for; an unknown one is a ParameterError."""
    several = [asked] if isinstance(asked, str) else asked if isinstance(asked, Collection) else []
    found = [name for name in several if isinstance(name, str) and "." in name]
    for name in found:
        params[name]
    return found


def jvp(
    sim: Simulator, x0: Any, controls: Any, dx0: Any, dcontrols: Any = None, params: Parameters | None = None
) -> Pushforward:
    """Roll out and push a direction of x0 and controls forward: the Jacobians of all steps in one launch.

    Args:
        sim: whose steps.
        x0, dx0: (B, nx).
        controls, dcontrols: (B, N, nu); dcontrols None: zero.
        params: as for `Simulator.rollout`.

    Returns:
        Derivatives of the states; NaN from the step on that was not solved.

    Raises:
        ArrayError: another shape.
    """
    instance("sim", sim, Simulator, "a slcp_warp.Simulator")
    derivatives_exist(sim.options.method)
    x0, controls = _pair(sim, x0, controls)
    worlds, steps = controls.shape[:2]
    dx0 = _array("dx0", dx0, x0.shape)
    dus = np.zeros(controls.shape) if dcontrols is None else _array("dcontrols", dcontrols, controls.shape)
    traj = sim.rollout(x0, controls, params)
    nx, width = sim.nx, max(sim.nu, 1)
    fx, fu = sim.empty(worlds, steps, nx, nx), sim.empty(worlds, steps, nx, width)
    status = wp.zeros((worlds, steps), dtype=wp.int32, device=sim.device)
    everything = wp.zeros(0, dtype=wp.int32, device=sim.device)
    us = np.zeros((worlds, steps, width))
    us[..., : sim.nu] = controls

    def put(a: np.ndarray) -> wp.array:
        return wp.array(np.ascontiguousarray(a), dtype=sim.dtype, device=sim.device)

    table = sim.parameter_array(params, worlds)
    outputs = (fx, fu, sim.empty(0, 0, 0, 0), status)
    xs, external = put(traj.states), sim.empty(0, 0)
    sim.kernels.stepping.prepare_linearize(table, xs, put(us), external, everything, outputs, False)()
    jacobians, by_control, code = fx.numpy(), fu.numpy()[..., : sim.nu], status.numpy()
    jacobians[code != 0] = np.nan
    tangent = np.empty((worlds, steps + 1, nx), dtype=jacobians.dtype)
    tangent[:, 0] = dx0
    for k in range(steps):
        tangent[:, k + 1] = np.einsum("bij,bj->bi", jacobians[:, k], tangent[:, k])
        tangent[:, k + 1] += np.einsum("bij,bj->bi", by_control[:, k], dus[:, k])
    return Pushforward(tangent, traj.states, traj.status)


def weighted_hessian(
    sim: Simulator, x: Any, u: Any, weights: Any, params: Parameters | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """sum_i weights_i d2 x'_i / d(x, u)2 of one step: (B, nz, nz), and the status (B,).

    Args:
        sim: whose steps.
        x: (B, nx).
        u: (B, nu).
        weights: (B, nx), of the next state's components.
        params: as for `Simulator.step`.

    Raises:
        ArrayError: another shape.
    """
    instance("sim", sim, Simulator, "a slcp_warp.Simulator")
    x = _array("x", x, ("B", sim.nx))
    u = _array("u", u, (len(x), sim.nu))
    weights = _array("weights", weights, x.shape)
    kernels = sim.kernels.stepping
    if isinstance(kernels, GenericKernels):
        derivatives_exist(sim.options.method)
        return _weighed(sim, kernels, x, u, weights, params)
    lin = sim.linearize(x, u, params, second=True)
    step_size = np.broadcast_to((sim.params if params is None else params)["step_size"], (len(x),))
    lift = derivatives.lift(sim.spec, step_size)
    each = np.einsum("bwi,bi->bw", lift, weights)
    return np.einsum("bw,bwjk->bjk", each, lin.second), lin.status


def _weighed(
    sim: Simulator, kernels: GenericKernels, x: np.ndarray, u: np.ndarray, weights: np.ndarray, params: Any
) -> tuple[np.ndarray, np.ndarray]:
    """Of kernels that weigh second derivatives as they make them."""
    worlds, width = len(x), sim.nx + sim.nu

    def put(*parts: np.ndarray) -> wp.array:
        return wp.array(np.stack(parts, 1), dtype=sim.dtype, device=sim.device)

    second, status = sim.empty(worlds, 1, width, width), wp.zeros((worlds, 1), wp.int32, device=sim.device)
    outputs = (sim.empty(1, 1, 0, 0), sim.empty(1, 1, 0, 0), second, status)
    everything = wp.zeros(0, dtype=wp.int32, device=sim.device)
    xs, us, after = put(x), put(u), put(np.zeros_like(weights), weights)
    table, external = sim.parameter_array(params, worlds), sim.empty(0, 0)
    kernels.prepare_curvature(table, xs, us, external, everything, after, outputs)()
    return second.numpy()[:, 0].astype(float), status.numpy()[:, 0]


def _array(name: str, value: Any, shape: tuple[int | str, ...]) -> np.ndarray:
    return array(name, value, shape, finite=False, error=ArrayError)


def _pair(sim: Simulator, x0: Any, controls: Any) -> tuple[np.ndarray, np.ndarray]:
    x0 = _array("x0", x0, ("B", sim.nx))
    controls = _array("controls", controls, (len(x0), "N", sim.nu))
    if controls.shape[1] < 1:
        raise ArrayError(f"controls has shape {controls.shape}; at least one step is needed")
    return x0, controls
