"""The operators behind `slcp_warp.torch`: a rollout and its backward pass, opaque to PyTorch.

Operators take tensors and numbers only: a simulator goes in by its number. vmap folds its dimension into
the worlds.
"""

import contextlib
import functools
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import torch
import warp as wp
from torch import Tensor

from ..gradients.open_loop import pull, roll_out
from ..gradients.table import check_values as table_check
from ..gradients.tape import derivatives_exist
from ..parameters import Parameters
from ..simulator import Simulator

_kept: list[Any] = []  # for the process: a backward pass may come after its maker's scope
_handles: dict[Simulator | Parameters, int] = {}
_handling = threading.Lock()


@torch.compiler.assume_constant_result
def handle_of(thing: Simulator | Parameters) -> int:
    """The number by which an operator finds its simulator or parameters; given while torch.compile traces."""
    with _handling:
        if thing not in _handles:
            _handles[thing] = len(_kept)
            _kept.append(thing)
        return _handles[thing]


@torch.library.custom_op("slcp_warp::table", mutates_args=())
def table_op(handle: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """The table of kept parameters."""
    return torch.as_tensor(_kept[handle].table(), dtype=dtype, device=device)


@table_op.register_fake
def _(handle: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    return torch.empty(_kept[handle].table().shape, dtype=dtype, device=device)


def check_values(sim: Simulator, table: Tensor) -> None:
    """The errors of `Parameters.replace` for illegal values."""
    table_check(sim.params, table.detach().double().cpu().numpy())


@contextlib.contextmanager
def stream(tensor: Tensor) -> Iterator[None]:
    """Warp launches on PyTorch's stream of the tensor's device."""
    if tensor.is_cuda:
        with wp.ScopedStream(wp.stream_from_torch(torch.cuda.current_stream(tensor.device))):
            yield
    else:
        yield


def plain(tensor: Tensor) -> Tensor:
    """A tensor with the strides of a fresh one: PyTorch ignores that of an axis of length one, and
    `contiguous` keeps it.
    """
    row = tensor.detach().contiguous()
    return row.as_strided(row.shape, torch.empty(row.shape, device="meta").stride())


def blank(shape: Sequence[int], like: Tensor, dtype: torch.dtype | None = None) -> Tensor:
    """Zeros on a tensor's device, filled by Warp: after PyTorch's own threads did it on a CPU they would wait
    busily for more, for milliseconds, on the cores that kernels need.
    """
    out = torch.empty(tuple(shape), dtype=dtype or like.dtype, device=like.device)
    with stream(out):
        wp.from_torch(out, requires_grad=False).zero_()
    return out


def share(sim: Simulator, *tensors: Tensor) -> list[Any]:
    """Warp arrays of the tensors, with the strides of fresh ones: Warp compares them with a gradient's."""
    return [wp.from_torch(plain(t), dtype=sim.dtype, requires_grad=False) for t in tensors]


@torch.library.custom_op("slcp_warp::rollout", mutates_args=())
def rollout_op(
    x0: Tensor, us: Tensor, table: Tensor, force: Tensor, handle: int, every: int, check: bool
) -> tuple[Tensor, Tensor]:
    """States (B, N+1, nx), or every `every`-th of them, and status (B,)."""
    sim = _kept[handle]
    if check:
        check_values(sim, table)
    status = blank((len(x0),), x0, torch.int32)
    with stream(x0):
        x, u, rows, external = share(sim, x0, us, table, force)
        code: Any = wp.from_torch(status)
        kernels = sim.kernels.stepping
        if every:
            return wp.to_torch(roll_out(kernels, rows, x, u, external, code, every)), status
        states = blank((len(x0), us.shape[1] + 1, x0.shape[1]), x0)
        room: Any = wp.from_torch(states)
        roll_out(kernels, rows, x, u, external, code, states=room)
    return states, status


@rollout_op.register_fake
def _(x0: Tensor, us: Tensor, table: Tensor, force: Tensor, handle: int, every: int, check: bool) -> Any:
    steps = us.shape[1]
    kept = -(-steps // every) if every else steps
    return x0.new_empty((x0.shape[0], kept + 1, x0.shape[1])), x0.new_empty((x0.shape[0],), dtype=torch.int32)


@torch.library.custom_op("slcp_warp::rollout_backward", mutates_args=())
def pull_op(
    by_states: Tensor, x0: Tensor, us: Tensor, table: Tensor, force: Tensor, states: Tensor, status: Tensor,
    handle: int, every: int, parameters: bool,
) -> tuple[Tensor, Tensor, Tensor]:  # fmt: skip
    """Gradients by x0, controls and, with `parameters`, the table, from those by the states."""
    sim = _kept[handle]
    derivatives_exist(sim.options.method)
    out = [blank(t.shape, t) for t in (x0, us, table)]
    if not len(x0):
        return out[0], out[1], out[2]
    with stream(x0):
        arrays = share(sim, x0, us, table, force, states, by_states)
        for array, gradient in list(zip(arrays, out))[: 3 if parameters else 2]:
            array.grad = wp.from_torch(gradient, dtype=sim.dtype)
            array.requires_grad = True
        x, u, rows, external, kept, slopes = arrays
        code: Any = wp.from_torch(plain(status))
        pull(sim.kernels.stepping, rows, x, u, external, kept, code, slopes, every)
    return out[0], out[1], out[2]


@pull_op.register_fake
def _(by_states: Tensor, x0: Tensor, us: Tensor, table: Tensor, *rest: Any) -> Any:
    return torch.empty_like(x0), torch.empty_like(us), torch.empty_like(table)


def _remember(ctx: Any, inputs: tuple[Any, ...], output: tuple[Tensor, Tensor]) -> None:
    ctx.save_for_backward(*inputs[:4], *output)
    ctx.handle, ctx.every = inputs[4:6]


def _gradients(pull: Any, ctx: Any, by_states: Tensor) -> tuple[Tensor | None, ...]:
    wanted = ctx.needs_input_grad
    found = pull(by_states, *ctx.saved_tensors, ctx.handle, ctx.every, wanted[2])
    return (*(g if want else None for g, want in zip(found, wanted)), None, None, None, None)


# torch.compile traces the operator with this derivative; eager mode and torch.func use the functions below.
rollout_op.register_autograd(
    lambda ctx, by_states, _by_status: _gradients(pull_op, ctx, by_states), setup_context=_remember
)


class RolloutFunction(torch.autograd.Function):
    """The operator with its derivative: inputs as `rollout_op`, outputs states and status."""

    generate_vmap_rule = True

    @staticmethod
    def forward(*inputs: Any) -> tuple[Tensor, Tensor]:
        """See `rollout_op`."""
        states, status = rollout_op(*inputs)
        return states, status

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: tuple[Tensor, Tensor]) -> None:
        """Keep what the backward pass needs."""
        _remember(ctx, inputs, output)
        ctx.mark_non_differentiable(output[1])

    @staticmethod
    def backward(ctx: Any, by_states: Tensor, _by_status: Any) -> tuple[Tensor | None, ...]:
        """Gradients by x0, controls and the table, where they are wanted."""
        return _gradients(PullFunction.apply, ctx, by_states)


SECOND = (
    "second derivatives of slcp_warp.torch rollouts are not supported; slcp_warp.weighted_hessian "
    "and Simulator.linearize(second=True) give those of a step"
)


class _Gradients(torch.autograd.Function):
    """The first `count` tensors, as what follows from the others, and whose derivative is an error."""

    @staticmethod
    def forward(ctx: Any, count: int, *tensors: Tensor) -> tuple[Tensor, ...]:
        """The gradients."""
        return tuple(t.view_as(t) for t in tensors[:count])

    @staticmethod
    def backward(ctx: Any, *_: Any) -> Any:
        """There is none."""
        raise NotImplementedError(SECOND)


def once(backward: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator: a `backward` without derivatives of its own, which are an error where they are asked for."""

    @functools.wraps(backward)
    def run(ctx: Any, *slopes: Tensor) -> Any:
        with torch.no_grad():
            found = list(backward(ctx, *slopes))
        if torch.is_grad_enabled():  # create_graph
            places = [i for i, each in enumerate(found) if isinstance(each, Tensor)]
            of = [t for t in (*ctx.saved_tensors, *slopes) if isinstance(t, Tensor)]
            marked = _Gradients.apply(len(places), *(found[i] for i in places), *of)
            for i, each in zip(places, marked):
                found[i] = each
        return tuple(found)

    return run


class PullFunction(torch.autograd.Function):
    """The backward operator, whose own derivative is an error."""

    generate_vmap_rule = True

    @staticmethod
    def forward(*inputs: Any) -> tuple[Tensor, Tensor, Tensor]:
        """See `pull_op`."""
        by_x0, by_us, by_table = pull_op(*inputs)
        return by_x0, by_us, by_table

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: tuple[Tensor, ...]) -> None:
        """Nothing is kept."""

    @staticmethod
    def backward(ctx: Any, *_: Any) -> Any:
        """There is none."""
        raise NotImplementedError(SECOND)


def _fold(count: int, value: Tensor, dim: int | None, worlds: int) -> Tensor:
    """(count worlds, ...) from a tensor vmapped over a dimension or not; a row for all becomes one each."""
    value = value.unsqueeze(0).expand(count, *value.shape) if dim is None else value.movedim(dim, 0)
    if value.shape[1] == 1 and worlds > 1:
        value = value.expand(count, worlds, *value.shape[2:])
    return value.reshape(count * value.shape[1], *value.shape[2:])


@rollout_op.register_vmap
def _(info: Any, in_dims: Any, x0: Tensor, us: Tensor, table: Tensor, force: Tensor, *rest: Any) -> Any:
    count, worlds = info.batch_size, x0.shape[0 if in_dims[0] is None or in_dims[0] > 0 else 1]
    folded = [_fold(count, t, d, worlds) for t, d in zip((x0, us, table, force), in_dims)]
    states, status = rollout_op(*folded, *rest)
    return (states.unflatten(0, (count, worlds)), status.unflatten(0, (count, worlds))), (0, 0)


@pull_op.register_vmap
def _(info: Any, in_dims: Any, *inputs: Any) -> Any:
    count, worlds = info.batch_size, inputs[1].shape[0 if in_dims[1] is None or in_dims[1] > 0 else 1]
    rows = inputs[3].shape[0 if in_dims[3] is None or in_dims[3] > 0 else 1]
    folded = [_fold(count, t, d, worlds) for t, d in zip(inputs[:7], in_dims)]
    by_x0, by_us, by_table = (g.unflatten(0, (count, worlds)) for g in pull_op(*folded, *inputs[7:]))
    return (by_x0, by_us, by_table.sum(1, keepdim=True) if rows == 1 else by_table), (0, 0, 0)
