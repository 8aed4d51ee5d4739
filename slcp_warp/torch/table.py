"""The kernels' table of parameters as a tensor, made from tensors by name."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..description.acting import BUILT, acting
from ..description.columns import places_of_all
from ..description.scene import Scene
from ..gradients.tape import derivatives_exist
from ..inputs.checks import array, shown
from ..inputs.errors import ArgumentError, ArgumentTypeError
from ..inputs.rules import COVARIANCES
from ..parameters import ParameterError, Parameters
from ..simulator import Simulator
from .operators import handle_of, table_op

Values = Parameters | Mapping[str, Tensor] | None


def parameter_table(sim: Simulator, params: Values, like: Tensor) -> Tensor:
    """The kernels' table of parameters, (1 or B, width), with gradients to the tensors that went in."""
    if not isinstance(params, Parameters | Mapping | None):
        raise ArgumentTypeError(
            f"params is a {type(params).__name__}; Parameters or a dict of tensors by name is needed"
        )
    base = params if isinstance(params, Parameters) else sim.params
    if base.scene.structure != sim.scene.structure:
        raise ParameterError(
            f"params belong to scene {base.scene.name!r}; this simulator has {sim.scene.name!r}"
        )
    if isinstance(params, Parameters) and params.requires_grad:
        raise ParameterError(
            "params are tracked, which is for wp.Tape; for gradients in PyTorch give tensors by name, "
            'as params={"friction": tensor}'
        )
    table = _base_table(base, like.dtype, like.device)
    if params is None or isinstance(params, Parameters):
        return table
    if any(isinstance(value, Tensor) and value.requires_grad for value in params.values()):
        derivatives_exist(sim.options.method)
    parts = [name for name in params if isinstance(name, str) and "." in name]
    unknown = [name for name in params if name not in base.names and name not in parts]
    if unknown:
        raise ParameterError(f"no parameter {shown(unknown)}; there are {list(base.names)}")
    columns = []
    for name, start, shape in base.layout.columns:
        size = math.prod(shape)
        kept = table[:, start : start + size]
        given = _column(name, params[name], shape, size, like) if name in params else kept
        if name in params and name in BUILT and name != "shape_angle" and not _has_shape(params[name], shape):
            given = _where_it_acts(given, kept, acting(sim.scene.structure, name))
        columns.append(given)
    rows = {len(c) for c in columns} - {1}
    if len(rows) > 1:
        raise ParameterError(f"params disagree on the number of worlds: {sorted(rows)}")
    count = rows.pop() if rows else 1
    table = torch.cat([c.expand(count, -1) for c in columns], 1)
    return _with_parts(table, sim.scene, {name: params[name] for name in parts}, like)


def _has_shape(value: Any, shape: tuple[int, ...]) -> bool:
    """Whether a value has a number for everything that the parameter has one of, or that for each world."""
    own = tuple(np.shape(value)) if not isinstance(value, Tensor) else tuple(value.shape)
    return own == shape or own[1:] == shape


def _where_it_acts(given: Tensor, kept: Tensor, acts: list[bool]) -> Tensor:
    """One number for all parts, of those that the scene was built with; the others keep theirs."""
    each = given.shape[1] // max(len(acts), 1)
    mask = torch.tensor(acts, dtype=torch.bool, device=given.device).repeat_interleave(each)
    return torch.where(mask, given, kept)


def _with_parts(table: Tensor, scene: Scene, values: Mapping[str, Any], like: Tensor) -> Tensor:
    """The table with numbers of single parts, "box.mass", after those of all."""
    try:
        places = places_of_all(scene, values, "params")
    except ArgumentError as error:
        raise ParameterError(str(error)) from None
    for name, value in values.items():
        column = _column(name, value, (), 1, like)
        if len(column) > 1 and len(table) == 1:
            table = table.expand(len(column), -1)
        if len(column) not in (1, len(table)):
            raise ParameterError(f"{name} is for {len(column)} worlds, other numbers are for {len(table)}")
        at = torch.tensor(places[name], device=like.device)
        table = torch.index_copy(table, 1, at, column.expand(len(table), len(at)))
    return table


def _base_table(params: Parameters, dtype: torch.dtype, device: torch.device) -> Tensor:
    if torch.compiler.is_compiling():
        return table_op(handle_of(params), dtype, device)
    return torch.as_tensor(params.table(), dtype=dtype, device=device)


def _column(name: str, value: Any, shape: tuple[int, ...], size: int, like: Tensor) -> Tensor:
    if not isinstance(value, Tensor):
        value = value if type(value) in (int, float) else array(name, value, error=ParameterError)
        value = torch.as_tensor(value, dtype=like.dtype, device=like.device)
    if value.dtype != like.dtype or value.device != like.device:
        raise ParameterError(
            f"{name} is a tensor of {value.dtype} on {value.device}; {like.dtype} on {like.device} is needed"
        )
    if name in COVARIANCES and value.ndim < 2:  # times the identity, as in `Parameters.replace`
        value = value[..., None, None] * torch.eye(shape[0], dtype=like.dtype, device=like.device)
    if len(shape) == 2 and value.shape == shape[:1]:  # of each item, not of each world
        value = value[:, None].expand(shape)
    if value.shape == shape or value.ndim == 0:
        return value.reshape(1, -1).expand(1, size)
    if value.shape[1:] == shape:
        return value.reshape(len(value), size)
    if value.ndim == len(shape) + 1 and value.shape[1:] == (1,) * len(shape):
        return value.reshape(len(value), 1).expand(-1, size)
    if value.ndim == 1:
        return value[:, None].expand(-1, size)
    need = ", ".join(["B", *map(str, shape)])
    raise ParameterError(f"{name} has shape {tuple(value.shape)}; give a scalar, {shape}, (B,) or ({need})")
