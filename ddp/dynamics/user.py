"""Dynamics made from a user's own Warp function."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.gradients.adjoint_check import adjoint_is_right
from slcp_warp.inputs.checks import array, function, instance, shown, whole
from slcp_warp.inputs.checks import device as checked_device
from slcp_warp.inputs.errors import ArgumentError, ArgumentTypeError
from slcp_warp.kernels.control.user_dynamics import (
    DynamicsFunctions,
    make_component,
    make_linear,
    make_linearize_kernel,
    make_protocol_step,
    no_carry,
)
from slcp_warp.kernels.device.compile import seen_by
from slcp_warp.kernels.device.launch import Prepared
from slcp_warp.kernels.device.tables import empty_table, make_copy_kernel, make_table
from slcp_warp.kernels.factories import cached

__all__ = ["DynamicsFunctions", "Parameters", "WarpDynamics", "linear_system"]


class Parameters:
    """Named numbers of a `WarpDynamics`, laid out in the order given; shared, or one per problem.

    Args:
        shapes: shape of one value of each parameter.
        values: arrays of that shape, or with a batch axis in front.
    """

    def __init__(
        self, shapes: Mapping[str, tuple[int, ...]], values: Mapping[str, Any], dtype: Any, device: Any
    ):
        instance("shapes", shapes, Mapping, "a dict of shapes by name")
        instance("values", values, Mapping, "a dict of values by name")
        lacking = set(shapes) ^ set(values) if set(values) <= set(shapes) else set()
        if lacking:
            raise ArgumentError(f"values lacks {shown(sorted(map(str, lacking)))}")
        self.shapes, self.dtype, self.device = dict(shapes), dtype, device
        self.values = {}
        for name, value in values.items():
            if name not in self.shapes:
                raise ArgumentError(f"unknown parameter {name!r}; known: {shown(list(self.shapes))}")
            given, shape = array(f"parameter {name!r}", value, finite=False), self.shapes[name]
            if given.shape != shape and given.shape[1:] != shape:
                raise ArgumentError(
                    f"parameter {name!r} must have shape {shape} or (B,) + {shape}, got {given.shape}"
                )
            if not np.isfinite(given).all():
                raise ArgumentError(f"parameter {name!r} must be finite, got {shown(value)}")
            self.values[name] = given

    def __reduce__(self) -> tuple[Any, ...]:
        return _parameters_on, (self.shapes, self.values, self.dtype, str(self.device))

    def replace(self, **changes: Any) -> "Parameters":
        """The same with other numbers."""
        return Parameters(self.shapes, {**self.values, **changes}, self.dtype, self.device)

    def array(self, batch: int) -> Any:
        """Rows (1 or batch, P) on the device."""
        flat = []
        for name, shape in self.shapes.items():
            value = self.values[name]
            flat.append(value.reshape(1 if value.shape == shape else value.shape[0], -1))
        rows = max((a.shape[0] for a in flat), default=1)
        if rows not in (1, batch):
            raise ArgumentError(f"params are for {rows} problems, the batch has {batch}")
        flat = [np.broadcast_to(a, (rows, a.shape[1])) for a in flat] or [np.zeros((1, 1))]
        numbers = np.ascontiguousarray(np.concatenate(flat, axis=1))
        return make_table(numbers.astype(wp.dtype_to_numpy(self.dtype)), self.dtype, self.device)


def _parameters_on(shapes: Any, values: Any, dtype: Any, device: str) -> Parameters:
    """Parameters on a device of this name."""
    return Parameters(shapes, values, dtype, checked_device(device))


class WarpDynamics:
    """Dynamics from a Warp function x' = step(params, row, x, u).

    Args:
        make: ``make(dtype, VX, VU) -> DynamicsFunctions`` or just the step, called once per dtype, and again
            once a global or enclosed number, array or function that it names has changed; it reads its
            parameters as ``params[row, i]``, in the order of ``parameters``, arrays flattened. Derivatives
            that it does not give are Warp's own, in double precision, and second ones differences of these;
            if a comparison at random states, made once, says that Warp's are wrong, both are central
            differences. It must be a function of a module, or be kept and passed again, for kernels to be
            found again instead of being compiled anew.
        nx: number of states.
        nu: number of controls.
        parameters: names and default values.
        device: Warp device, default the preferred one.
        dtype: "float64", "float32" or the Warp type.
    """

    def __init__(
        self,
        make: Callable[..., Any],
        nx: int,
        nu: int,
        parameters: Mapping[str, Any] | None = None,
        device: Any = None,
        dtype: Any = "float64",
    ) -> None:
        kinds = [
            kind for kind in (wp.float32, wp.float64) if dtype is kind
            or isinstance(dtype, str) and dtype == kind.__name__
        ]  # fmt: skip
        if not kinds:
            raise ArgumentError(f"dtype must be float32 or float64, got {shown(dtype)}")
        self.dtype: Any = kinds[0]
        function("make", make, 3)
        nx, nu = whole("nx", nx), whole("nu", nu)
        self.make, self.nx, self.nu, self.nw = make, nx, nu, nx
        self.device = checked_device(device)
        instance("parameters", parameters, Mapping | None, "a dict of values by name")
        values = {
            name: array(f"parameter {name!r}", value, finite=False)
            for name, value in (parameters or {}).items()
        }
        shapes = {name: value.shape for name, value in values.items()}
        self.params = Parameters(shapes, values, self.dtype, self.device)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles are made anew of the same; pickles where `make` is a function of a module."""
        given = self.make, self.nx, self.nu, None, str(self.device), self.dtype.__name__
        return type(self), given, {"params": self.params}

    def functions(self, dtype: Any) -> DynamicsFunctions:
        """Of a scalar type; made anew where `make` sees other values."""
        return _dynamics_functions(self.make, seen_by(self.make), dtype, self.nx, self.nu)

    def step_function(self) -> Any:
        """See `Dynamics`."""
        step = self.functions(self.dtype).step
        return make_protocol_step(step, self.nx, self.nu, self.dtype)

    def initial_carry(self) -> Any:
        """See `Dynamics`."""
        return no_carry

    def parameter_array(self, params: Parameters, batch: int) -> Any:
        """See `Dynamics`."""
        if not isinstance(params, Parameters):
            raise ArgumentTypeError(f"params must be ddp.Parameters, got {type(params).__name__}")
        return params.array(batch)

    def linearize_into(self, *arrays: Any) -> None:
        """See `Dynamics`."""
        self.prepare_linearize(*arrays)()

    def prepare_linearize(
        self, xs: Any, us: Any, params: Any, fx: Any, fu: Any, second: Any, status: Any, active: Any
    ) -> Callable[[], None]:
        """`linearize_into` as a function without arguments, to be called many times with less overhead."""
        functions = self.functions(self.dtype)
        widen: Prepared | None = None
        found = functions.jacobians is None or (second is not None and functions.curvature is None)
        numbers, exact = params, False
        if found and self.dtype != wp.float64:
            functions = self.functions(wp.float64)
            numbers = empty_table(params.shape, wp.float64, self.device)
            copy = make_copy_kernel(self.dtype, wp.float64)
            widen = Prepared(copy, params.shape[0], [params, numbers], self.device)
            widen()
        if found:
            component = make_component(functions.step, self.nx, self.nu)
            exact = adjoint_is_right(component, self.nx + self.nu, self.nx, numbers)
        kernel = make_linearize_kernel(functions, self.nx, self.nu, second is not None, self.dtype, exact)
        cells = us.shape[0] * us.shape[1]
        unused = wp.empty((1, 1, 1, 1), dtype=self.dtype, device=self.device) if second is None else second
        inputs = [xs, us, numbers, active, fx, fu, unused, status]
        grain = 16 if found else 256
        run = Prepared(kernel, cells, inputs, self.device, grain=grain)

        def run_widened() -> None:
            assert widen is not None
            widen()
            run()

        return run if widen is None else run_widened

    def lift_into(self, params: Any, lift: Any) -> None:
        """See `Dynamics`: every state is a curved output of its own."""
        lift.assign(np.broadcast_to(np.eye(self.nx), lift.shape))


@cached
def _dynamics_functions(
    make: Callable[..., Any], seen: str, dtype: Any, nx: int, nu: int
) -> DynamicsFunctions:
    """What `make` gives; `seen`: digest of what it is made of."""
    made = make(dtype, wp.types.vector(nx, dtype), wp.types.vector(nu, dtype))
    return made if isinstance(made, DynamicsFunctions) else DynamicsFunctions(made)


def linear_system(A: Any, B: Any, c: Any = None, device: Any = None, dtype: Any = "float64") -> WarpDynamics:
    """x' = A x + B u + c, with exact derivatives.

    Args:
        A: (nx, nx).
        B: (nx, nu).
        c: (nx,), default 0.
        device: Warp device.
        dtype: "float64", "float32" or the Warp type.
    """
    A, B = array("A", A, ("nx", "nx")), array("B", B, ("nx", "nu"))
    nx = A.shape[0]
    if A.shape != (nx, nx) or B.shape[0] != nx or not B.size:
        raise ArgumentError(f"A must be (nx, nx) and B (nx, nu), got {A.shape} and {B.shape}")
    c = np.zeros(nx) if c is None else array("c", c, (nx,))
    return WarpDynamics(make_linear, nx, B.shape[1], {"A": A, "B": B, "c": c}, device, dtype)
