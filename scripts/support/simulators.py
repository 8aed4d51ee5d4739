"""A command's options made into scenes, simulators, parameters and states."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp.measures.signals import Signal

from .rules import NO_RULE, OneRule


def named_scene(name: str, option: str = "--scene") -> slcp.Scene:
    """The scene of a name or a file; ValueError names the option and lists the names there are."""
    if Path(name).suffix in (".toml", ".json", ".xml"):
        return slcp.load_scene(name)
    if name not in slcp.scenes.NAMED:
        names = ", ".join(slcp.scenes.NAMED)
        raise ValueError(f"{option} is {name!r}; give a .toml, .json or .xml (MJCF) file, or one of {names}")
    return slcp.scenes.NAMED[name]()


def mechanism_name(scene: slcp.Scene) -> str:
    """The scene's name if its mechanism is that of the named scene, whatever its numbers; else ""."""
    make = slcp.scenes.NAMED.get(scene.name)
    known = make is not None and make().structure == replace(scene.structure, uncertain=False)
    return scene.name if known else ""


def default_scaling(scene: slcp.Scene) -> str:
    """The scaling that a scene wants where no option says otherwise: that of the task of its name, if any."""
    task = task_of(scene)
    return "inertia" if task is None else task.options.scaling


def observed_of(scene: slcp.Scene) -> int:
    """The state whose rate a sweep of a scene judges: that of the task of its name, or the first."""
    task = task_of(scene)
    return (None if task is None else observed_state(task)) or 0


def observed_state(task: slcp.Task) -> int | None:
    """The state whose rate the task measures first; None: it measures none."""
    for measure in task.measures.values():
        of = measure.of
        if measure.reduction == "rate" and isinstance(of, Signal) and of.kind == "state" and of.minus is None:
            return of.place(task.scene)
    return None


def task_of(scene: slcp.Scene) -> slcp.Task | None:
    """The named task of a named scene's name and mechanism."""
    make = slcp.tasks.NAMED.get(mechanism_name(scene))
    return None if make is None else make()


def make_simulator(
    scene: slcp.Scene,
    rules: OneRule = NO_RULE,
    device: str | None = None,
    dtype: str = "float64",
) -> slcp.Simulator:
    """A simulator from a command's options."""
    return simulator_of(scene, rules.of(slcp.Options(scaling=default_scaling(scene))), device, dtype)


def simulator_of(
    scene: slcp.Scene, options: slcp.Options, device: str | None = None, dtype: str = "float64"
) -> slcp.Simulator:
    """A simulator; ValueError for a device that there is not."""
    try:
        return slcp.Simulator(scene, options, device=device, dtype=dtype)
    except RuntimeError as error:  # Warp's answer to an unknown device
        raise ValueError(f"--device {device!r}: {error}") from error


def make_params(
    sim: slcp.Simulator,
    step_size: float | None = None,
    sigma: float | None = None,
    settings: list[str] | None = None,
) -> slcp.Parameters:
    """The scene's numbers with those of the options."""
    changes = parse_settings(settings, "--set")
    own = {k: v for k, v in (("step_size", step_size), ("sigma", sigma)) if v is not None}
    if twice := sorted(own.keys() & changes.keys()):
        raise ValueError(f"--set {twice[0]} and --{twice[0].replace('_', '-')} are both given")
    if sigma is not None and sim.options.hard:
        raise ValueError(f"--sigma is {sigma:g}, which the hard problem has not; --residual smoothed has")
    return sim.params.replace(**changes, **own)


def parse_settings(settings: list[str] | None, option: str) -> dict[str, Any]:
    """Options of the form name=value or name=v1,v2,.. as a dictionary."""
    changes: dict[str, Any] = {}
    for text in settings or []:
        name, equals, value = text.partition("=")
        if not equals:
            raise ValueError(f"{option} is {text!r}; name=value is needed")
        if name in changes:
            raise ValueError(f"{option} {name} is given more than once")
        values = numbers(value, f"{option} {name}")
        changes[name] = float(values[0]) if len(values) == 1 else values
    return changes


def numbers(text: str, name: str, count: int | None = None) -> np.ndarray:
    """The numbers of a comma-separated option; ValueError names the option."""
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        raise ValueError(f"{name} is {text!r}; comma-separated numbers are needed") from None
    if count is not None and len(values) != count:
        raise ValueError(f"{name} has {len(values)} numbers; {count} are needed")
    return values


def start_state(scene: slcp.Scene, text: str, otherwise: np.ndarray) -> np.ndarray:
    """The state (nx,) of --start: all numbers in order, or name=value,.. of some, the others as they are.

    Args:
        otherwise: (nx,) what is not named.
    """
    if "=" not in text:
        return numbers(text, "--start", 2 * scene.nv)
    out = np.array(otherwise, float)
    for part in text.split(","):
        name, _, value = part.partition("=")
        (out[scene.state_index(name.strip())],) = numbers(value, f"--start {name.strip()}", 1)
    return out


def start_states(
    scene: slcp.Scene,
    start: str | None,
    worlds: int,
    velocity_sd: float,
    seed: int,
    default: np.ndarray | None = None,
) -> np.ndarray:
    """Initial states (worlds, nx): the start with normal noise on the velocities.

    Args:
        default: where no start is given, (nx,); None: the scene's.
    """
    own = scene.x0 if default is None else default
    x0 = own if start is None else start_state(scene, start, own)
    if not (math.isfinite(velocity_sd) and velocity_sd >= 0.0):
        raise ValueError(f"--velocity-sd is {velocity_sd}; it must be >= 0")
    x = np.tile(x0, (worlds, 1))
    x[:, scene.nv :] += velocity_sd * np.random.default_rng(seed).standard_normal((worlds, scene.nv))
    return x
