"""A failing case as two files, a scene file and beside it the state, controls and options; and its replay."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp import Scene
from slcp_warp.description.kinematics import Array
from slcp_warp.options import Options
from slcp_warp.stepping.strategy import RENAMED
from slcp_warp.storage.files import parse_json, read_text, reading, write_text

from .draws import Worlds
from .judged import judged, led, predicted, simulator
from .rolled import follow, roll
from .structures import baked
from .tasks import FIELDS, Failure
from .verdicts import Verdicts

EXTRA = ("sigma", "lower", "upper")
FORMAT, VERSION = "slcp-fuzz-case", 1


class CaseError(ValueError):
    """A file that is no case; the message names the file and what is wrong."""


@dataclasses.dataclass(frozen=True)
class Case:
    """One world: a scene with its numbers, and those that a scene does not hold (sigma of every row, limits
    that exclude each other), state (2 nv,), controls (nu,), options, precision, kernels, what was found, and
    the device that runs it. Of a world that is followed controls are (steps, nu), and the last step is the
    one that is judged.
    """

    scene: Scene
    numbers: dict[str, Array]
    x: Array
    u: Array
    options: Options
    dtype: str
    strategy: str
    note: str = ""
    device: str = "cpu"

    @property
    def worlds(self) -> Worlds:
        """The case as a batch of one."""
        numbers = {name: np.array(value)[None] for name, value in self.scene.default_parameters().items()}
        numbers |= {name: value[None] for name, value in self.numbers.items()}
        return Worlds(numbers, self.x[None], self.u[None], np.zeros(1, int))

    def _simulator(self) -> Any:
        return simulator(self.scene, self.options, self.dtype, self.strategy, self.device)

    def states(self) -> Array:
        """States before and after every step (steps + 1, 2 nv) of a world that is followed."""
        out: Array = np.asarray(roll(self._simulator(), self.worlds, self.u[None]).states[0], float)
        return out

    def run(self) -> tuple[Verdicts, Any]:
        """Step it and judge the step."""
        sim, worlds, out, push, known = self._simulator(), self.worlds, None, None, np.ones(1, bool)
        if self.u.ndim == 2:
            steps = follow(roll(sim, worlds, self.u[None]), worlds, self.u[None])
            steps = steps.part(steps.step == steps.step.max())
            worlds, out = steps.worlds, steps.out
        if self.options.integrator == "trapezoidal":
            push, known = predicted(self.scene, worlds, self.options, self.dtype)
        reached = None
        if self.options.integrator == "leapfrog":
            reached, known = led(sim, worlds)
        found, done = judged(worlds, sim, push, out=out, reached=reached)
        found.doubt(known)
        return found, done

    @property
    def verdict(self) -> tuple[str, str]:
        """Verdict and reason."""
        verdicts, _ = self.run()
        return str(verdicts.verdict[0]), str(verdicts.reason[0])


def case_of(failure: Failure) -> Case:
    """The world of a failure by itself."""
    task, scene = failure.task, failure.task.make_scene()
    chunk, place = divmod(failure.world, task.per_chunk)
    world = task.worlds(chunk, scene).part(place)
    numbers = {name: value[0] for name, value in world.numbers.items()}
    u = world.u[0]
    if failure.step is not None:
        u = task.controls(chunk, scene)[place, : failure.step + 1]
    scene = scene.with_listed_contacts() if isinstance(scene.contacts, str) else scene
    note = (f"seed {task.seed}, {task.kernels}, scene {task.scene}, world {failure.world} ({failure.kind}): "
            f"{failure.verdict}, {failure.reason}, error {failure.error:.1e}")  # fmt: skip
    extra = {name: numbers[name] for name in EXTRA}
    return Case(baked(scene, numbers), extra, world.x[0], u, failure.options, failure.dtype,
                task.strategy, note, task.device)  # fmt: skip


def save_case(case: Case, path: Path) -> None:
    """Write `path` (.json) and the scene beside it (.scene.json)."""
    scene = path.with_name(path.stem + ".scene.json")
    slcp.save_scene(case.scene, scene)
    options = {name: getattr(case.options, name) for name in FIELDS}
    content = {
        "format": FORMAT, "version": VERSION, "scene": scene.name, "note": case.note, "dtype": case.dtype,
        "strategy": case.strategy, "options": options,
        "numbers": {name: value.tolist() for name, value in case.numbers.items()}, "x": case.x.tolist(),
        "u": case.u.tolist(),
    }  # fmt: skip
    write_text(path, json.dumps(content, indent=2) + "\n")


def load_case(path: Path, device: str = "cpu") -> Case:
    """Read a case, to be run on a device.

    Raises:
        CaseError: no such case.
        FileNotFoundError: no such file, or none of its scene.
    """
    with reading(path, "a case of `slcp bench fuzz`", CaseError):
        content = parse_json(read_text(path))
        if (content["format"], content["version"]) != (FORMAT, VERSION):
            raise ValueError(f"format {FORMAT!r}, version {VERSION} are needed")
        scene = slcp.load_scene(path.with_name(Path(content["scene"]).name))
        numbers = {name: np.array(content["numbers"][name], float) for name in EXTRA}
        x, u = (np.array(content[name], float) for name in ("x", "u"))
        sizes = (scene.structure.nr, scene.nv, scene.nv, 2 * scene.nv, scene.nu)
        shapes = [n.shape for n in (*numbers.values(), x, u if u.ndim == 1 else u[0])]
        if u.ndim > 2 or shapes != [(size,) for size in sizes]:
            raise ValueError(f"{EXTRA}, x and u need {sizes} numbers")
        return Case(scene, numbers, x, u, Options(**content["options"]), str(content["dtype"]),
                    RENAMED.get(content["strategy"], content["strategy"]), str(content["note"]),
                    device)  # fmt: skip


def describe(case: Case) -> str:
    """The case in one line."""
    o = case.options
    method = "/".join(str(getattr(o, name)) for name in FIELDS if getattr(o, name) is not None)
    nv, rows = case.scene.nv, case.scene.structure.nr
    return f"{case.strategy} {method} {case.dtype}, {nv} dofs, {rows} rows: {case.note}"
