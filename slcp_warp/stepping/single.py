"""Rollouts in launches of single steps: under policies in Python."""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.contact.problem import COLD
from slcp_warp.kernels.device.launch import launch
from slcp_warp.kernels.device.tables import copy_rows
from slcp_warp.kernels.step.single import make_settle_kernel
from slcp_warp.kernels.structure import Structure

from .arrays import RolloutArrays, StepArrays
from .host import Asked


def rollout_by_steps(
    step: Callable[[StepArrays], None], s: Structure, a: RolloutArrays, policy: Asked, steps: int
) -> None:
    """All steps of every world, with multipliers handed on from step to step.

    Args:
        step: one of all worlds.
        s: the structure of the scene.
        a: what the rollout reads and fills.
        policy: on the host.
        steps: N.
    """
    worlds, dtype, device = a.worlds, a.x0.dtype, a.x0.device

    def room(width: int) -> wp.array:
        return wp.zeros((worlds, width), dtype=dtype, device=device)

    nx, width = 2 * s.nv, s.nr + 2 * len(s.pairs)
    cold = np.tile(np.where(np.arange(width) < s.nr, COLD, 0.0), (worlds, 1))
    warm: Any = wp.array(cold, dtype=dtype, device=device)
    state, after, us = wp.clone(a.x0, requires_grad=False), room(nx), room(max(s.nu, 1))
    impulse, gap, multiplier = room(s.nr), room(s.nr), room(width)
    code = wp.zeros(worlds, dtype=wp.int32, device=device)
    single = StepArrays(a.table, state, us, a.external, warm, after, impulse, gap, multiplier, code)
    settle = make_settle_kernel(dtype)
    copy_rows(state, a.states[:, 0])
    felt = None
    for k in range(steps):
        if k % policy.every == 0 and s.nu:
            us.assign(policy.controls(k, state.numpy(), felt))
        step(single)
        if policy.look is not None and (k + 1) % policy.every == 0:
            felt = policy.look(*(each.numpy() for each in (state, us, after, impulse, gap, code)))
        found = [us, after, impulse, gap, multiplier, code]
        kept = [state, warm, a.states, a.controls, a.impulse, a.gap, a.status]
        launch(settle, worlds, [k, *found, *kept], device)
