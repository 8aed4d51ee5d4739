"""Whether Warp's adjoint of a user's policy is right, at states of a rollout."""

import copy
import functools
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
import warp as wp
from torch import Tensor

from slcp_warp.kernels.policies.contract import PolicyKernel

from ..gradients.adjoint_check import near
from ..inputs.errors import ArgumentError
from ..policies.function import Function
from ..simulator import Simulator
from .asked import AskedFunction

STATE, KEPT = "the state", "what it remembers"
WORLDS, TIMES = 64, 4  # of a rollout at which it is looked
_right: set[tuple[PolicyKernel, int, int]] = set()
_checking = threading.Lock()


def check_adjoint(policy: Function, sim: Simulator, states: Tensor) -> None:
    """Raise ArgumentError where the adjoint is wrong at recorded states (B, N+1, nx); once for a function."""
    key = policy.kernel(sim)[0], sim.nx, sim.nu
    with _checking:
        if key in _right:
            return
        fine = sim
        if sim.dtype is not wp.float64:
            fine = Simulator(sim.scene, sim.options, sim.device, "float64", sim.strategy)
        sample = states[:WORLDS].detach().double()
        sample = sample[torch.isfinite(sample).all(-1).all(-1)]
        if not len(sample):  # no world tells
            return
        wrong = _wrong(policy, fine, sample)
        if wrong:
            raise ArgumentError(
                f"Warp's adjoint of {key[0].in_words!r} by {wrong} is not its derivative; loops of a fixed "
                "length and components that are assigned once, or by +=, are needed for a gradient"
            )
        _right.add(key)


def _wrong(policy: Function, sim: Simulator, states: Tensor) -> str:
    """What the function is differentiated wrongly by; "" if it is not."""
    own = copy.copy(policy)
    own.arrays = {name: _plain(value) for name, value in policy.arrays.items()}
    arrays = {
        name: torch.as_tensor(value, device=states.device)
        for name, value in own.arrays.items()
        if isinstance(value, np.ndarray) and value.ndim
    }

    def start(given: dict[str, Tensor]) -> tuple[Tensor, ...]:
        return AskedFunction(own, sim, {name: given[name] for name in arrays}).start(given[STATE])

    def ask(k: int, given: dict[str, Tensor]) -> tuple[Tensor, ...]:
        asked = AskedFunction(own, sim, {name: given[name] for name in arrays})
        u, after = asked(k, given[STATE], (given[KEPT],) if KEPT in given else ())
        return u, *after

    memory = start({STATE: states[:, 0], **arrays})
    by = _differs(start, {STATE: states[:, 0], **arrays}) if memory else ""
    steps = states.shape[1] - 1
    for k in range(steps):
        given = {STATE: states[:, k], **dict(zip((KEPT,), memory)), **arrays}
        if not by and k in np.linspace(0, steps - 1, TIMES).astype(int):
            by = _differs(functools.partial(ask, k), given)
        memory = ask(k, given)[1:]
    return by


def _differs(f: Callable[[dict[str, Tensor]], tuple[Tensor, ...]], given: dict[str, Tensor]) -> str:
    """The input by which the adjoint of a weighted sum of f's outputs differs from differences."""
    generator = torch.Generator().manual_seed(0)

    def normal(like: Tensor) -> Tensor:
        return torch.randn(like.shape, generator=generator, dtype=like.dtype).to(like.device)

    weights = [normal(out) for out in f(given)]
    for name, value in given.items():
        along, of_all = normal(value), name not in (STATE, KEPT)

        def moved(by: float, name: str = name, along: Tensor = along, of_all: bool = of_all) -> np.ndarray:
            found = f({**given, name: given[name] + by * along})
            each = sum(((w * out).sum(1) for w, out in zip(weights, found)), torch.zeros(()))
            return (each.sum()[None] if of_all else each).detach().cpu().numpy()

        leaf = value.detach().clone().requires_grad_()
        with torch.enable_grad():
            found = f({**given, name: leaf})
            total = sum(((w * out).sum() for w, out in zip(weights, found)), torch.zeros(()))
        (slope,) = torch.autograd.grad(total, leaf) if total.requires_grad else (torch.zeros_like(leaf),)
        product = slope * along
        slopes = product.sum()[None] if of_all else product.flatten(1).sum(1)
        if not near(slopes.cpu().numpy(), moved):
            return name
    return ""


def _plain(value: Any) -> Any:
    """Numbers in float64, but whole ones as they are."""
    whole = isinstance(value, wp.array) and value.dtype is wp.int32
    return value if whole else np.asarray(value.numpy() if isinstance(value, wp.array) else value, np.float64)
