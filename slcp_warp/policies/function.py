"""A user's own function as a policy, compiled into the kernels that ask it."""

import keyword
from collections.abc import Callable
from typing import Any

import warp as wp

from slcp_warp.kernels.policies.contract import PolicyFunctions, PolicyKernel
from slcp_warp.kernels.policies.function import ARRAYS, Fields, function_kernel

from ..inputs.arrays import kind_of
from ..inputs.checks import array, function, shown, whole
from ..inputs.errors import ArgumentError, ArgumentTypeError
from ..inputs.user_code import UNKNOWN, Known, check_indices, of_user, reads
from ..simulator import Simulator
from .arrays import put

MOST_MEMORY = 1024
MAKERS = tuple("dtype VX VU Data Memory".split())
ARGUMENTS = tuple("data world step x memory".split())


class Function:
    """A user's control(data, world, step, x) -> u, a Warp function; `data` holds the arrays given by name.

    With memory from step to step it is control(data, world, step, x, memory) -> (u, memory). Worlds of a
    sweep are counted through all its chunks; arrays that are looked up by `world` itself need a row for each.
    Policies with other numbers, but the same function, names and
    axes, share their kernels.

    Args:
        control: a Warp function whose arguments data and x are of `typing.Any`, or a function
            ``make(dtype, VX, VU, Data) -> Warp function`` that gets the numbers' type, the vector types of a
            state and of a control (of max(nu, 1)), and the type of `data`; with memory
            ``make(dtype, VX, VU, Data, Memory)``.
        memory: how many numbers are kept.
        start: start(data, world, x) -> memory, or its maker, called like control's; None: zeros.
        arrays: numbers, or arrays of up to four axes, taken in the simulator's precision; a Warp array of
            int32 stays one.

    Raises:
        ArgumentError, ArgumentTypeError: what is no function of this kind, or no finite numbers; with a
            simulator: what Warp cannot translate.
    """

    def __init__(
        self,
        control: wp.Function | Callable[..., Any],
        memory: int = 0,
        start: wp.Function | Callable[..., Any] | None = None,
        **arrays: Any,
    ) -> None:
        self.memory = whole(ARGUMENTS[-1], memory, 0, MOST_MEMORY)
        if start is not None and not self.memory:
            raise ArgumentError("start is given, but memory is 0")
        kept = int(self.memory > 0)
        _takes("control", control, ARGUMENTS[: 4 + kept], 4 + kept)
        if start is not None:
            _takes("start", start, (*ARGUMENTS[:2], ARGUMENTS[3]), 4 + kept)
        self.control, self.start = control, start
        self.arrays = {name: _numbers(name, value) for name, value in arrays.items()}
        fields: Fields = tuple(
            (name, value.ndim, value.dtype if getattr(value, "dtype", None) is wp.int32 else None)
            for name, value in self.arrays.items()
        )
        name = getattr(control, "__name__", None) or getattr(control, "key", "control")
        self._kernel = function_kernel(control, start, self.memory, fields, str(name).rpartition(".")[2])

    def kernel(self, sim: Simulator) -> tuple[PolicyKernel, Any]:
        """Kernel and struct for a simulator."""
        with of_user(
            f"policies.Function: {self._kernel.in_words!r} is no control(data, world, step, x"
            f"{', memory) -> (u, memory)' if self.memory else ') -> u'} for {sim.nx} states, {sim.nu} "
            f"controls and {sim.dtype.__name__}{self._given()}"
        ):
            functions = self._kernel.functions(sim.nx, sim.nu, sim.dtype)
        self._check_indices(functions, sim.nx)
        struct = functions.Struct()
        for name, value in self.arrays.items():
            if isinstance(value, wp.array) and value.dtype is wp.int32:
                if value.device != sim.device:
                    raise ArgumentError(f"{name} is a Warp array on {value.device}; {sim.device} is needed")
                setattr(struct, name, value)
            else:
                setattr(struct, name, put(sim, value, name) if value.ndim else float(value))
        return self._kernel, struct

    def reads_steps(self, sim: Simulator) -> bool:
        """Whether the control names the number of the step; True where its code is not known."""
        return reads(self._kernel.functions(sim.nx, sim.nu, sim.dtype).control, ARGUMENTS.index("step"))

    def _given(self) -> str:
        """The arrays as a function names them, for errors: "with data.kp, data.ref[i, j]"."""
        if not self.arrays:
            return ", and data holds nothing"
        named = (
            f"data.{name}{[', '.join('ijkl'[: value.ndim])] if value.ndim else ''}".replace("'", "")
            for name, value in self.arrays.items()
        )
        return f", with {', '.join(named)}"

    def _check_indices(self, functions: PolicyFunctions, nx: int) -> None:
        """Raise ArgumentError for an index that its arrays, a state or its memory do not have."""
        shapes = tuple((name, tuple(a.shape)) for name, a in self.arrays.items() if a.ndim)
        data, x = Known(arrays=shapes), Known(nx)
        memory = Known(self.memory) if self.memory else UNKNOWN
        check_indices("policies.Function", functions.control, data, UNKNOWN, UNKNOWN, x, memory)
        check_indices("policies.Function", functions.start, data, UNKNOWN, x)


def _numbers(name: str, value: Any) -> Any:
    """Finite numbers, or a Warp array as it is."""
    if keyword.iskeyword(name) or not name.isidentifier():
        raise ArgumentError(f"{name!r} cannot be the name of an array; a name in Python's sense is needed")
    if isinstance(value, wp.array):
        if value.dtype not in (wp.float32, wp.float64, wp.int32):
            raise ArgumentError(f"{name} is a Warp array of {shown(value.dtype)}; numbers are needed")
        return value
    if kind_of(value) == "torch":
        value = value.detach().cpu().numpy()
    out = array(name, value)
    if out.ndim >= len(ARRAYS):
        raise ArgumentError(f"{name} has shape {out.shape}; at most {len(ARRAYS) - 1} axes are possible")
    return out


def _takes(name: str, given: Any, arguments: tuple[str, ...], types: int) -> None:
    """An error for what is neither a Warp function of these arguments nor a maker of one."""
    if isinstance(given, wp.Function):
        came = list(given.input_types)
        if len(came) != len(arguments):
            raise ArgumentTypeError(f"{name} takes ({', '.join(came)}); ({', '.join(arguments)}) is needed")
        return
    function(name, given, types, called=f", ({', '.join(MAKERS[:types])})")
