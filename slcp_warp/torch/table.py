"""The kernels' table of parameters as a tensor, made from tensors by name."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..gradients.table import base_of, fill
from ..gradients.tape import derivatives_exist
from ..inputs.checks import array
from ..parameters import ParameterError, Parameters
from ..simulator import Simulator
from .operators import handle_of, table_op

Values = Parameters | Mapping[str, Tensor] | None
INSTEAD = 'for gradients in PyTorch give tensors by name, as params={"friction": tensor}'


def parameter_table(sim: Simulator, params: Values, like: Tensor) -> Tensor:
    """The kernels' table of parameters, (1 or B, width), with gradients to the tensors that went in."""
    base = base_of(params, sim.params, "tensors", INSTEAD)
    table = _base_table(base, like.dtype, like.device)
    if params is None or isinstance(params, Parameters):
        return table
    if any(isinstance(value, Tensor) and value.requires_grad for value in params.values()):
        derivatives_exist(sim.options.method)
    filled: Tensor = fill(Tensors(like.dtype, like.device), table, base, params)
    return filled


@dataclass(frozen=True)
class Tensors:
    """Tensors of a type on a device: see `gradients.table.Library`."""

    dtype: torch.dtype
    device: torch.device

    def known(self, name: str, value: Any) -> Tensor:
        """A value as a tensor."""
        if not isinstance(value, Tensor):
            value = value if type(value) in (int, float) else array(name, value, error=ParameterError)
            return self.numbers(value)
        if value.dtype != self.dtype or value.device != self.device:
            raise ParameterError(
                f"{name} is a tensor of {value.dtype} on {value.device}; "
                f"{self.dtype} on {self.device} is needed"
            )
        return value

    def numbers(self, value: np.ndarray) -> Tensor:
        """A tensor of numbers."""
        return torch.as_tensor(value, dtype=self.dtype, device=self.device)

    def broadcast(self, value: Tensor, shape: tuple[int, ...]) -> Tensor:
        """A view, repeated along axes of length one."""
        return value.expand(shape)

    def where(self, which: Sequence[bool], first: Tensor, second: Tensor) -> Tensor:
        """Columns of the first or of the second."""
        return torch.where(torch.tensor(which, dtype=torch.bool, device=self.device), first, second)

    def join(self, columns: Sequence[Tensor]) -> Tensor:
        """Columns beside each other."""
        return torch.cat(list(columns), 1)

    def put(self, table: Tensor, places: Sequence[int], columns: Tensor) -> Tensor:
        """The table with other columns in some places."""
        return torch.index_copy(table, 1, torch.tensor(places, device=self.device), columns)


def _base_table(params: Parameters, dtype: torch.dtype, device: torch.device) -> Tensor:
    if torch.compiler.is_compiling():
        return table_op(handle_of(params), dtype, device)
    return torch.as_tensor(params.table(), dtype=dtype, device=device)
