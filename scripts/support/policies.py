"""Policies as the commands name them."""

from pathlib import Path
from typing import Any

import slcp_warp as slcp
from slcp_warp import ddp

from .records import load_policy

ZERO, MPC = "zero", "mpc"
HELP = f"{ZERO}, a file of `slcp library` or `optimise`, {MPC}, {MPC}:LIBRARY, or file.py:name"


def named_policy(text: str, scene: slcp.Scene, task: slcp.Task | None) -> tuple[str, Any]:
    """A name for a policy, and the policy; None for no control.

    Args:
        text: "zero"; a file; "mpc" or "mpc:LIBRARY", which plans the task while it runs, 2 passes a step,
            from the shifted plan and the library's, or from the shifted plan, zero and noise;
            "file.py:name" of a policy, or of a function that makes one.
        scene: what is controlled.
        task: of it, where there is one; "mpc" needs it.
    """
    if text == ZERO:
        return ZERO, None
    if text == MPC or text.startswith(f"{MPC}:"):
        if task is None:
            raise ValueError(f"{text}: scene {scene.name!r} is no task; there is nothing to plan for")
        return MPC, planning_policy(task, Path(text.partition(":")[2]) if ":" in text else None)
    if ".py:" in text:
        found = slcp.policies.load_policy(text)
        return text.rpartition(":")[2], found
    return Path(text).stem, load_policy(Path(text), scene)[0]


def planning_policy(task: slcp.Task, library: Path | None) -> ddp.MPC:
    """Model predictive control of a task with its own options as the model."""
    problem = ddp.problem_of(task)
    if library is None:
        return ddp.MPC(problem, starts=["shift", "zero", "noise"])
    entries = ddp.Library.load(library)
    entries.check_scene(task.scene)
    return ddp.MPC(problem, entries, improved=2)
