"""Launches of the kernels that differentiate the step, whatever the method."""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.derivatives import expansion, second_differences
from slcp_warp.kernels.derivatives.curvature import in_closed_form
from slcp_warp.kernels.device.launch import Prepared
from slcp_warp.kernels.specialisation import Specialisation


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


def prepare(
    spec: Specialisation,
    device: Any,
    params: wp.array,
    steps: int,
    xs: wp.array,
    us: wp.array,
    external: wp.array,
    active: wp.array,
    outputs: tuple[wp.array, wp.array, wp.array, wp.array],
    second: bool,
) -> Callable[[], None]:
    """A repeatable launch at B problems of `steps` steps each; outputs are fx, fu, fzz, status."""
    items = us.shape[0] * steps
    if not second or in_closed_form(spec.method):
        kernel = expansion.make_linearize_kernel(spec, second)
        return Prepared(kernel, items, [params, steps, xs, us, external, active, *outputs], device, grain=8)
    tables, widen = [], []
    for source in (params, external):
        target = source
        if source.dtype != wp.float64:
            target = wp.zeros(source.shape, dtype=wp.float64, device=device)
            if source.shape[0] > 0:
                kernel = second_differences.make_widen_kernel(source.dtype)
                widen.append(Prepared(kernel, source.shape[0], [source, target], device))
        tables.append(target)
    kernel = second_differences.make_difference_kernel(spec)
    inputs = [tables[0], steps, xs, us, tables[1], active, *outputs]
    run = Prepared(kernel, items, inputs, device, grain=1)

    def all_of_it() -> None:
        for command in (*widen, run):
            command()

    return all_of_it
