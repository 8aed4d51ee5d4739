"""Launches of the kernels that differentiate the step, whatever the method."""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.derivatives import expansion, second_differences
from slcp_warp.kernels.derivatives.curvature import in_closed_form
from slcp_warp.kernels.device.launch import Prepared
from slcp_warp.kernels.device.relay import Relay, Run
from slcp_warp.kernels.device.tables import empty_table, make_copy_kernel
from slcp_warp.kernels.specialisation import Specialisation

from ..inputs.arrays import zeros


def curved_outputs(spec: Specialisation) -> int:
    """Outputs with second derivatives of their own: v' (nv), or v*, v' (2 nv) where q' = q + h v*."""
    s, _, method = spec
    return 2 * s.nv if method.trapezoidal else s.nv


def lift(spec: Specialisation, step_size: np.ndarray) -> np.ndarray:
    """(B, nw, nx) from step sizes (B,): V . f_zz = sum_i (lift V)_i second[i], x' = (q + h v*, v')."""
    nv, nw = spec.structure.nv, curved_outputs(spec)
    out = np.zeros((len(step_size), nw, 2 * nv))
    out[:, :nv, :nv] = step_size[:, None, None] * np.eye(nv)
    out[:, nw - nv :, nv:] = np.eye(nv)
    return out


def at_states(
    spec: Specialisation,
    make: Callable[..., Callable[[], None]],
    params: wp.array,
    x: wp.array,
    u: wp.array,
    external: wp.array,
    second: bool,
) -> tuple[wp.array, wp.array, wp.array, wp.array]:
    """Derivatives of one step at states x (B, nx) under controls u (B, max(nu, 1)).

    Args:
        make: `prepare_linearize` of the kernels that serve the scene.

    Returns:
        A (B, nx, nx), B (B, nx, nu), second derivatives (B or 0, nw, nz, nz), status (B,).
    """
    (s, dtype, _), device, worlds = spec, x.device, x.shape[0]
    nx, nu, nw = 2 * s.nv, s.nu, curved_outputs(spec)
    shapes = (worlds, 1, nx, nx), (worlds, 1, nx, nu), (worlds if second else 0, nw, nx + nu, nx + nu)
    fx, fu, fzz = (zeros(shape, dtype, device) for shape in shapes)
    status = wp.zeros((worlds, 1), dtype=wp.int32, device=device)
    xs, us = (a.contiguous().reshape((worlds, 1, a.shape[1])) for a in (x, u))
    everything = wp.zeros(0, dtype=wp.int32, device=device)
    make(params, xs, us, external, everything, (fx, fu, fzz, status), second)()
    by_x, by_u, codes = (a.reshape((worlds, *a.shape[2:])) for a in (fx, fu, status))
    return by_x, by_u, fzz, codes


def prepare(
    spec: Specialisation,
    device: Any,
    params: wp.array,
    xs: wp.array,
    us: wp.array,
    external: wp.array,
    active: wp.array,
    outputs: tuple[wp.array, wp.array, wp.array, wp.array],
    second: bool,
    both: tuple[Specialisation, Specialisation] | None = None,
) -> Callable[[], Any]:
    """A repeatable launch along B trajectories; the outputs are fx, fu, fzz and status.

    Args:
        params: (1 or B, P).
        xs: states (B, N or more, nx).
        us: controls (B, N, max(nu, 1)).
        external: (0 or B, 3 bodies).
        active: (0 or B,), 1 for the trajectories to linearise along.
        outputs: (B, N, nx, nx), (B, N, nx, nu), (B N, nw, nz, nz) or no second derivatives, (B, N).
        second: whether second derivatives are wanted.
        both: of fast kernels and of those that take what they leave; None: those of `spec` do it all.
    """
    steps = us.shape[1]
    items = us.shape[0] * steps
    if not second or in_closed_form(spec.method):
        inputs = [params, steps, xs, us, external, active, *outputs]
        if both is not None:
            fast, full = (expansion.make_linearize_kernel(each, second) for each in both)
            return Run(fast, full, items, 1, inputs, device, grain=8)
        kernel = expansion.make_linearize_kernel(spec, second)
        return Prepared(kernel, items, [0, 0, 0, Relay(), *inputs], device, grain=8)
    tables, widen = [], []
    for source in (params, external):
        target = source
        if source.dtype != wp.float64:
            target = empty_table(source.shape, wp.float64, device)
            if source.shape[0] > 0:
                kernel = make_copy_kernel(source.dtype, wp.float64)
                widen.append(Prepared(kernel, source.shape[0], [source, target], device))
        tables.append(target)
    kernel = second_differences.make_difference_kernel(spec)
    inputs = [tables[0], steps, xs, us, tables[1], active, *outputs]
    run = Prepared(kernel, items, inputs, device, grain=1)

    def all_of_it() -> None:
        for command in (*widen, run):
            command()

    return all_of_it
