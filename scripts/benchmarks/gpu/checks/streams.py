"""Streams of Warp's and of PyTorch's, threads, and several devices: the same bits on all of them."""

import contextlib
import importlib.util
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import warp as wp

from ..record import Found
from ..setting import Setting, cast

WORLDS, STEPS, LATE = 4096, 20, 50_000_000  # clock ticks that a side stream is kept busy


def run(setting: Setting, found: Found) -> None:
    """Rollouts on side streams, and of several threads at once, on the default stream and on their own."""
    dtype = setting.sizes.dtypes[-1]
    sim, work = setting.finger(dtype), setting.workload(min(WORLDS, setting.sizes.states), STEPS)
    x, us = cast(dtype, work.x0, work.controls)
    want = sim.rollout(x, us).states

    def same(stream: Any = None) -> bool:
        with wp.ScopedStream(stream) if stream is not None else contextlib.nullcontext():
            arrays: list[Any] = [wp.array(a, dtype=sim.dtype, device=setting.device) for a in (x, us)]
            return np.array_equal(sim.rollout(*arrays).states.numpy(), want)

    found.check("once more on the default stream", same())
    with ThreadPoolExecutor(4) as pool:
        found.check("four threads at once", all(pool.map(lambda _: same(), range(8))))
    if not setting.gpu:
        found.note("a CPU has no streams")
        return
    side = [wp.Stream(setting.device) for _ in range(4)]
    found.check("on a side stream", same(side[0]))
    found.check("on four side streams in turn", all(same(stream) for stream in 2 * side))
    generic = setting.stack(dtype)
    start = np.tile(generic.scene.x0, (64, 1)).astype(dtype)
    us = np.zeros((64, STEPS, generic.nu), dtype)
    plain = generic.rollout(start, us).states
    with wp.ScopedStream(side[1]):
        moved = generic.rollout(start, us).states
    found.check("generic kernels on a side stream", np.array_equal(plain, moved))


def torch_streams(setting: Setting, found: Found) -> None:
    """Tensors that PyTorch's current stream makes late, used at once; gradients of `slcp_warp.torch`."""
    if importlib.util.find_spec("torch") is None:
        found.note("PyTorch is not installed")
        return
    import torch

    dtype = setting.sizes.dtypes[-1]
    sim, work = setting.finger(dtype), setting.workload(min(WORLDS, setting.sizes.states), STEPS)
    x, us = cast(dtype, work.x0, work.controls)
    want = sim.rollout(x, us).states
    if setting.gpu and not torch.cuda.is_available():
        found.note("this PyTorch has no CUDA")
        return
    place = wp.device_to_torch(setting.device)
    late = _late if setting.gpu else _at_once
    for name, stream in _torch_streams(torch, setting):
        with stream:
            tensors = late(torch, place, x, us)
            states = 1.0 * sim.rollout(*tensors).states  # on PyTorch's stream: it must wait for Warp's
            got = states.cpu().numpy()
        found.check(f"Simulator.rollout on {name}", np.array_equal(got, want))
    from slcp_warp import torch as differentiable

    gradients = []
    for name, stream in _torch_streams(torch, setting):
        with stream:
            start, controls = (t.requires_grad_() for t in late(torch, place, x, us))
            outcome = differentiable.rollout(sim, start, controls)
            outcome.states.sum().backward()
            gradients.append([t.grad.cpu().numpy() for t in (start, controls)])
        same = all(np.array_equal(a, b, equal_nan=True) for a, b in zip(gradients[0], gradients[-1]))
        found.check(f"slcp_warp.torch.rollout and its gradient on {name}",
                    same and np.array_equal(outcome.states.detach().cpu().numpy(), want))  # fmt: skip


def _torch_streams(torch: Any, setting: Setting) -> list[tuple[str, Any]]:
    if not setting.gpu:
        return [("the only stream", contextlib.nullcontext())]
    place = wp.device_to_torch(setting.device)
    side = torch.cuda.Stream(place)
    return [
        ("PyTorch's default stream", contextlib.nullcontext()),
        ("a side stream", torch.cuda.stream(side)),
    ]


def _at_once(torch: Any, place: str, *arrays: np.ndarray) -> list[Any]:
    return [torch.as_tensor(a, device=place).clone() for a in arrays]


def _late(torch: Any, place: str, *arrays: np.ndarray) -> list[Any]:
    """Tensors that are zero until PyTorch's current stream has slept a while."""
    given = [torch.as_tensor(a, device=place) for a in arrays]
    out = [torch.zeros_like(a) for a in given]
    torch.cuda.synchronize(place)
    torch.cuda._sleep(LATE)
    for target, source in zip(out, given):
        target.copy_(source)
    return out


def devices(setting: Setting, found: Found) -> None:
    """Every other GPU of the same kind: the bits of the first."""
    others = [d.alias for d in wp.get_cuda_devices() if d.alias != setting.device] if setting.gpu else ["cpu"]
    if not others:
        found.note("one device: nothing to compare")
    dtype = setting.sizes.dtypes[-1]
    work = setting.workload(min(WORLDS, setting.sizes.states), STEPS)
    x, us = cast(dtype, work.x0, work.controls)
    want = setting.finger(dtype).rollout(x, us)
    for other in others:
        done = setting.finger(dtype, device=other).rollout(x, us)
        same = np.array_equal(done.states, want.states) and np.array_equal(done.status, want.status)
        kinds = [wp.get_device(d).arch for d in (setting.device, other)] if setting.gpu else [0, 0]
        if kinds[0] == kinds[1]:
            found.check(f"{other} has the bits of {setting.device}", same)
        else:
            found.row(other, arch=kinds[1], same_bits=same)
