"""Policies that count steps, in sweeps with steps of several sizes."""

import warnings
from typing import Any

from ...inputs.checks import attribute
from ...policies.function import Function
from ...tasks.task import Task


def warn_of_steps(name: str, policy: Any, task: Task, sizes: tuple[float, ...], sim: Any) -> None:
    """Say of a user's function, called `name`, that it reads the number of the step where steps of other
    sizes than the scene's are asked for: it knows no time.
    """
    own = task.scene.step_size
    others = [size for size in sizes if size != own]
    while others and not isinstance(policy, Function) and policy is not None:
        policy = attribute(policy, "policy")  # of one in another
    if not others or policy is None or not policy.reads_steps(sim):
        return
    warnings.warn(
        f"policy {name!r} reads the number of the step, which is of another time with steps of "
        f"{others[0]:g} s than with the scene's of {own:g} s, and policies.Function is told none. Sweep each "
        "size with numbers of its own, the size among them; policies.OpenLoop(us, step_size) is followed in "
        "time by itself",
        RuntimeWarning,
        stacklevel=4,
    )
