"""What a policy makes of a world's number: rows that it looks up, and whether it acts alike in all worlds."""

import ast
from typing import Any

import warp as wp

from slcp_warp.kernels.policies.contract import PolicyKernel
from slcp_warp.kernels.policies.tracking import TRACKING

from ..inputs.arrays import ArrayError
from ..inputs.checks import attribute


def alike(policy: Any) -> bool:
    """Whether a policy acts by state and time alone; of one that does not say it nobody knows."""
    return attribute(policy, "alike") is True


def check_rows(kernel: PolicyKernel, struct: Any, sim: Any, worlds: int | None) -> None:
    """Raise ArrayError for a policy that has not got a row for each of so many worlds (None: any number)."""
    while kernel.inner is not None:
        kernel, struct = kernel.inner, struct.inner
    if kernel == TRACKING:
        rows, need = struct.us.shape[0], f"1 or {worlds} is needed, one per world"
        if rows not in (1, worlds):
            need = "one for all worlds is needed" if worlds in (None, 1) else need
            raise ArrayError(f"policy holds {rows} trajectories; {need}")
        return
    functions = kernel.functions(sim.nx, sim.nu, sim.dtype)
    for name in sorted(_looked_up(functions.control) | _looked_up(functions.start)):
        rows = len(getattr(struct, name, ())) if isinstance(getattr(struct, name, None), wp.array) else None
        if rows is not None and (worlds is None or rows < worlds):
            asked = "any world's number" if worlds is None else f"numbers up to {worlds - 1}"
            raise ArrayError(
                f"policy looks up data.{name} by the world's number, and has {rows} rows; it is asked for "
                f"{asked}"
            )


def _looked_up(function: Any) -> set[str]:
    """Arrays of `data` whose first index is the world's number, in a Warp function (data, world, ...): by
    itself or another name of it, where nothing asks first how large it is, and nothing else takes its name.
    """
    if function is None or not isinstance(function.adj.tree.body[0], ast.FunctionDef):
        return set()
    body = function.adj.tree.body[0]
    data, world = (each.arg for each in body.args.args[:2])
    alias: dict[str, str] = {}
    numbers = {world}
    for node in ast.walk(body):
        if isinstance(node, ast.Assign | ast.AugAssign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            if any(isinstance(each, ast.Name) and each.id == world for each in targets):
                return set()
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                if isinstance(node.value, ast.Name) and node.value.id == world:
                    numbers.add(node.targets[0].id)
                for name in _of(node.value, data, {}):
                    alias[node.targets[0].id] = name
    asked = {
        id(inner)
        for node in ast.walk(body)
        if isinstance(node, ast.If | ast.IfExp | ast.While) and _names(node.test) & numbers
        for inner in ast.walk(node)
    }
    found = set()
    for node in ast.walk(body):
        if isinstance(node, ast.Subscript) and id(node) not in asked:
            first = node.slice.elts[0] if isinstance(node.slice, ast.Tuple) else node.slice
            if isinstance(first, ast.Name) and first.id in numbers:
                found |= _of(node.value, data, alias)
    return found


def _names(node: ast.AST) -> set[str]:
    """The names in an expression, but for those that only say what is looked up."""
    if isinstance(node, ast.Subscript):
        return set()
    found = {node.id} if isinstance(node, ast.Name) else set()
    return found.union(*map(_names, ast.iter_child_nodes(node)))


def _of(value: ast.expr, data: str, alias: dict[str, str]) -> set[str]:
    """The array's name where a value is one of `data`."""
    if isinstance(value, ast.Attribute) and isinstance(value.value, ast.Name) and value.value.id == data:
        return {value.attr}
    return {alias[value.id]} if isinstance(value, ast.Name) and value.id in alias else set()
