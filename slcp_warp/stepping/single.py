"""Rollouts in launches of single steps: for policies with generic kernels, and for Python's."""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.contact.problem import COLD
from slcp_warp.kernels.device.launch import launch
from slcp_warp.kernels.device.tables import copy_rows
from slcp_warp.kernels.policies.ask import make_ask_kernel
from slcp_warp.kernels.step.single import make_settle_kernel
from slcp_warp.kernels.structure import Structure

from .arrays import Controls, RolloutArrays, StepArrays
from .host import Asked

Ask = Callable[[int, wp.array, wp.array, wp.array], None]  # step, states, status, controls that it fills


def rollout_by_steps(
    step: Callable[[StepArrays], None], s: Structure, a: RolloutArrays, controls: Controls
) -> None:
    """All steps of every world, with multipliers handed on from step to step.

    Args:
        step: one of all worlds.
        s: the structure of the scene.
        a: what the rollout reads and fills.
        controls: a policy, in a kernel or on the host.
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
    ask = _ask(s, a, controls)
    settle = make_settle_kernel(dtype)
    copy_rows(state, a.states[:, 0])
    for k in range(controls.steps):
        ask(k, state, a.status, us)
        step(single)
        found = [us, after, impulse, gap, multiplier, code]
        kept = [state, warm, a.states, a.controls, a.impulse, a.gap, a.status]
        launch(settle, worlds, [k, *found, *kept], device)


def _ask(s: Structure, a: RolloutArrays, controls: Controls) -> Ask:
    """What fills in the controls of a step."""
    dtype, device = a.x0.dtype, a.x0.device
    if isinstance(controls.policy, Asked):
        asked = controls.policy

        def ask_host(k: int, state: wp.array, status: wp.array, us: wp.array) -> None:
            if k % asked.every == 0 and s.nu:
                us.assign(asked.controls(k, state.numpy()))

        return ask_host
    kernel = make_ask_kernel(controls.policy, 2 * s.nv, s.nu, dtype)
    size = controls.policy.functions(2 * s.nv, s.nu, dtype).memory
    memory = wp.zeros((a.worlds, size), dtype=dtype, device=device)

    def ask(k: int, state: wp.array, status: wp.array, us: wp.array) -> None:
        launch(kernel, a.worlds, [k, controls.struct, state, status, memory, us], device)

    return ask
