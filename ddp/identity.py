"""What decides the plans of a problem, as JSON values: equal ones mean equal plans, in every process."""

import hashlib
import inspect
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import warp as wp

from slcp_warp import Parameters, Simulator
from slcp_warp.description.scene_file import scene_content
from slcp_warp.ensembles.stored.identity import told
from slcp_warp.inputs.errors import ArgumentError

from .problem import Problem


def problem_identity(problem: Problem) -> dict[str, Any]:
    """Dynamics, cost, horizon, numbers and limits of a problem.

    Raises:
        ArgumentError: something whose code or numbers cannot be told.
    """
    cost, dtype = problem.cost, problem.dynamics.dtype
    functions = cost.functions(dtype, problem.nx, problem.nu)
    return {
        "dynamics": _dynamics(problem.dynamics),
        "parameters": _numbers(problem.params),
        "cost": {
            "functions": told([f for f in functions if f is not None], "Problem.cost"),
            "weights": told(cost.weights, "Problem.cost.weights"),
        },
        "horizon": problem.horizon,
        "control_limits": [told(each, "Problem.control_limits") for each in problem.limit_rows()],
        "state_limits": [told(each, "Problem.state_limits") for each in problem.state_limit_rows()],
    }


def simulator_identity(sim: Simulator) -> dict[str, Any]:
    """Scene, options, precision and kind of kernels of a simulator."""
    return {
        "scene": scene_content(sim.scene), "options": told(asdict(sim.options), "Options"),
        "dtype": sim.dtype.__name__, "strategy": sim.strategy,
    }  # fmt: skip


def _dynamics(dynamics: Any) -> dict[str, Any]:
    if isinstance(dynamics, Simulator):
        return simulator_identity(dynamics)
    step = told(dynamics.step_function(), "Problem.dynamics")
    return {"step": step, "dtype": dynamics.dtype.__name__, "nx": int(dynamics.nx), "nu": int(dynamics.nu)}


def _numbers(params: Any) -> Any:
    if isinstance(params, wp.array):
        return told(params.numpy(), "Problem.params")
    if isinstance(params, Parameters):
        return {name: told(params[name], name) for name in params.names}
    if hasattr(params, "values"):
        return told(params.values, "Problem.params")
    raise ArgumentError(f"Problem.params is a {type(params).__name__}, whose numbers cannot be told")


def device_kind(dynamics: Any) -> str:
    """The name of a GPU's model, or "cpu"."""
    device = wp.get_device(dynamics.device)
    return "cpu" if device.is_cpu else str(device.name)


def function_identity(function: Callable[..., Any], what: str) -> Any:
    """A Python function by its code and what it refers to, or where that cannot be told by its source."""
    try:
        return told(function, what)
    except ArgumentError:
        pass
    try:
        text = inspect.getsource(function)
    except (OSError, TypeError) as error:
        raise ArgumentError(f"{what}: nothing tells later whether it is the same function") from error
    return {"name": function.__qualname__, "source": hashlib.sha256(text.encode()).hexdigest()}
