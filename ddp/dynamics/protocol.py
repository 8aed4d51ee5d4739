"""What the solver asks of its dynamics."""

from typing import Any, Protocol

REQUIRED = (
    *("nx", "nu", "nw", "dtype", "device", "step_function", "initial_carry", "linearize_into", "lift_into"),
    "parameter_array",
)


class Dynamics(Protocol):
    """Discrete-time dynamics x' = f(x, u), as `WarpDynamics` is; of a `slcp_warp.Simulator` one is made.

    Attributes:
        nx, nu: numbers of states and controls.
        nw: number of curved outputs y: V.f_zz = sum_i (lift V)_i d2y_i/dz2 with z = (x, u); -1: second
            derivatives are weighed where they are made, by ``prepare_weighed``.
        dtype: Warp scalar type.
        device: Warp device.
        params: default numbers, an object with ``replace(**changes)``.
    """

    nx: int
    nu: int
    nw: int
    dtype: Any
    device: Any
    params: Any

    def step_function(self) -> Any:
        """Warp function ``(params, row, x, u, carry) -> (x', carry, status)``, status 0 if solved."""

    def initial_carry(self) -> Any:
        """Warp function ``() -> carry`` for the first step of a trajectory."""

    def linearize_into(
        self, xs: Any, us: Any, params: Any, fx: Any, fu: Any, second: Any, status: Any, active: Any
    ) -> None:
        """Derivatives along xs (B, N+1, nx), us (B, N, nu) of the problems with active (B,) = 1.

        Writes fx (B, N, nx, nx), fu (B, N, nx, nu), second (B N, nw, nz, nz) unless None, status (B, N), 0 if
        good.

        A dynamics may also have ``prepare_linearize``, which takes the same arguments and returns a function
        without any that does this for the same arrays at less overhead, and ``prepare_candidates``, as of
        `GenericDynamics`, that rolls out in kernels of its own instead of DDP's with the step function.
        ``prepare_weighed``, of nw = -1, takes the same and then weights (B, N+1, nx) and asked (B,), and
        returns two such functions. One writes fx, fu and status of the problems with active = 1, the other
        one second (B N, 1, nz, nz) of those with asked = 1: f_zz of every step, weighed by what stands in
        weights for the state after it, and 0 where that has no digits.
        """

    def lift_into(self, params: Any, lift: Any) -> None:
        """Write lift (B, nw, nx)."""

    def parameter_array(self, params: Any, batch: int) -> Any:
        """The numbers of ``params`` on the device, wp.array2d (1 or batch rows)."""
