"""The kernels' table of parameters as a JAX array, made from arrays by name."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..gradients.table import base_of, fill
from ..inputs.arrays import ArrayError
from ..inputs.checks import array
from ..parameters import ParameterError, Parameters
from ..simulator import Simulator

Values = Parameters | Mapping[str, Any] | None
INSTEAD = 'for gradients in JAX give arrays by name, as params={"friction": array}'


@dataclass(frozen=True)
class JaxArrays:
    """JAX arrays of a precision: see `gradients.table.Library`."""

    dtype: np.dtype

    @classmethod
    def of(cls, sim: Simulator) -> "JaxArrays":
        """Of a simulator's precision.

        Raises:
            ArrayError: JAX has none of it.
        """
        dtype = np.dtype(sim.dtype.__name__)
        if jax.dtypes.canonicalize_dtype(dtype) != dtype:
            raise ArrayError(
                "the simulator computes in float64, which JAX has not got: first "
                'jax.config.update("jax_enable_x64", True), or Simulator(..., dtype="float32")'
            )
        return cls(dtype)

    def check(self, name: str, value: jax.Array, error: type[Exception]) -> None:
        """An error for another precision."""
        if value.dtype != self.dtype:
            raise error(f"{name} is a JAX array of {value.dtype}; one of {self.dtype} is needed")

    def known(self, name: str, value: Any) -> jax.Array:
        """A value as an array."""
        if isinstance(value, jax.Array):
            self.check(name, value, ParameterError)
            return value
        plain = type(value) in (int, float)  # what is not finite is named with the parameter's rule
        return self.numbers(value if plain else array(name, value, error=ParameterError))

    def numbers(self, value: Any) -> jax.Array:
        """An array of numbers."""
        return jnp.asarray(value, dtype=self.dtype)

    def broadcast(self, value: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        """Repeated along axes of length one."""
        return jnp.broadcast_to(value, shape)

    def where(self, which: Sequence[bool], first: jax.Array, second: jax.Array) -> jax.Array:
        """Columns of the first or of the second."""
        return jnp.where(np.array(which, bool), first, second)

    def join(self, columns: Sequence[jax.Array]) -> jax.Array:
        """Columns beside each other."""
        return jnp.concatenate(list(columns), axis=1)

    def put(self, table: jax.Array, places: Sequence[int], columns: jax.Array) -> jax.Array:
        """The table with other columns in some places."""
        return table.at[:, np.array(places)].set(columns)


def parameter_table(sim: Simulator, params: Values) -> jax.Array:
    """The kernels' table of parameters, (1 or B, width), through which gradients flow to what went in."""
    base, library = base_of(params, sim.params, "arrays", INSTEAD), JaxArrays.of(sim)
    table = library.numbers(base.table())
    if params is None or isinstance(params, Parameters):
        return table
    filled: jax.Array = fill(library, table, base, params)
    return filled
