"""The commands' files of every kind, as `slcp_warp.results.records` reads them."""

import warnings
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.library.entries import scene_digest
from slcp_warp.ddp.results.plan_check import PLAN, check_plan
from slcp_warp.results.record_checks import TRAJECTORY, Arrays, check_trajectory, finite, length, shapes
from slcp_warp.results.records import Check, Record, RecordError, read_kind, read_record
from slcp_warp.results.simulated import Simulated
from slcp_warp.storage.files import FileError

__all__ = ["Record", "RecordError", "load_plan", "load_policy", "load_record", "read_kind"]


def load_record(path: Path, kind: str) -> Record:
    """Read a file of a kind.

    Raises:
        RecordError: truncated, of another kind or of a newer version, without its scene, or inconsistent.
        FileNotFoundError: no such file.
    """
    return read_record(path, kind, *CHECKS[kind])


def device_facts(sim: slcp.Simulator) -> dict[str, Any]:
    """Header entries: where and in which precision was simulated."""
    return {"device": str(sim.device), "dtype": sim.dtype.__name__}


def load_policy(path: Path, scene: slcp.Scene) -> tuple[Any, dict[str, Any]]:
    """The policy that a library, plan or policy file holds, and header entries about it."""
    kind = read_kind(path)
    if kind == "policy":
        policy = slcp.policies.load_policy(path)
        return policy, {"policy": type(policy).__name__.lower(), "policy_file": path.name}
    if kind == "library":
        library = ddp.Library.load(path)
        library.check_scene(scene)
        return library.policy(), {"policy": "nearest", "policy_file": path.name, "entries": len(library)}
    plan = load_plan(path, scene)
    facts = {"policy": "tracking", "policy_file": path.name, "planned_step_size": plan.step_size}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # `tell_gains` says it as commands do
        return ddp.TrackingPolicy(ddp.Result.of(plan), scene.state_period), facts


def load_plan(path: Path, scene: slcp.Scene) -> Record:
    """A plan for a mechanism.

    Raises:
        RecordError: as of `load_record`, or it was planned for another scene.
    """
    plan = load_record(path, "plan")
    if scene_digest(plan.scene) != scene_digest(scene):
        unlike = [
            f.name for f in fields(scene) if repr(getattr(plan.scene, f.name)) != repr(getattr(scene, f.name))
        ]
        there = f"scene {plan.scene.name!r}, not {scene.name!r}"
        raise RecordError(f"{path} was planned for {there}; {', '.join(unlike)} differ")
    return plan


SURFACE = ("axis0", "axis1", "axis2", "gap")


def check_surface(arrays: Arrays, simulated: Simulated) -> None:
    """Distances on a grid of the first three coordinates."""
    axes = SURFACE[:3]
    counts = tuple(length(arrays, name, 0, 1) for name in axes)
    if min(counts) < 2 or simulated.scene.nv < 3:
        raise FileError(f"a grid of {counts} points; two a coordinate and three coordinates are needed")
    shapes(arrays, {"gap": counts})
    finite(arrays, *axes, "gap")
    for name in axes:
        if np.any(np.diff(arrays[name]) <= 0.0):
            raise FileError(f"array {name!r} does not rise")


CHECKS: dict[str, tuple[tuple[str, ...], Check]] = {
    "trajectory": (TRAJECTORY, check_trajectory),
    "plan": (PLAN, check_plan),
    "surface": (SURFACE, check_surface),
}
