"""A small valid file of every format that is read, how it is loaded, and the one error of what is none."""

import functools
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.library.entries import scene_digest
from slcp_warp.ensembles.statistics.source import MemorySource
from slcp_warp.results.simulated import Simulated
from slcp_warp.scripts.benchmarks.accuracy.results import read_results
from slcp_warp.scripts.benchmarks.stability.report import KEYS, NUMBERS, read_rows
from slcp_warp.scripts.charts.questions import MAP_COLUMNS as MAP
from slcp_warp.scripts.charts.questions import SENSITIVITY_COLUMNS as SENSITIVITY
from slcp_warp.scripts.charts.questions import read_map, read_sensitivity
from slcp_warp.scripts.charts.sweep import SIZE_COLUMNS, read_sizes
from slcp_warp.scripts.support.records import Record, RecordError, load_record
from slcp_warp.scripts.support.tables import write_csv

SHOVE = Path(__file__).resolve().parents[2] / "examples" / "tasks" / "shove.toml"
PARTICLE = slcp.scenes.particle()
WORLDS = slcp.Worlds(np.zeros((2, 4)), kicks=np.ones((2, 1, 2)), numbers=[3, 7])
TOML = """
format = "slcp-scene"
version = 2
name = "two"
gravity = [0.0, -9.81]
[[bodies]]
name = "a"
mass = 1.0
inertia = 0.1
joint = "free"
lower = ["none", -1.0, "none"]
[[bodies]]
name = "b"
parent = "a"
mass = 2.5
inertia = 0.2
anchor = [0.5, 0.0]
"""
MJCF = """<mujoco model="slider"><worldbody>
  <geom name="floor" type="plane" size="1 1 1"/>
  <body name="a" pos="0 0 1"><joint type="slide" axis="0 0 1"/><geom type="sphere" size=".1" mass="2"/></body>
</worldbody></mujoco>
"""


@dataclass(frozen=True)
class Format:
    """How a valid file is written, how any file is loaded, and what is raised for a bad one."""

    suffix: str
    write: Any
    load: Any
    error: type[Exception]


def library(**changes: Any) -> ddp.Library:
    rng = np.random.default_rng(3)
    whole = np.arange(6)
    values = {"x": rng.standard_normal((6, 4)), "u": rng.standard_normal((6, 2)),
              "K": rng.standard_normal((6, 2, 4)), "cost": rng.standard_normal(6),
              "gain": rng.standard_normal(6), "age": whole, "chain": whole, "plan": whole,
              "period": np.array([0.0, np.pi, 0.0, 0.0]),
              "header": {"scene": PARTICLE.name, "digest": scene_digest(PARTICLE)}}  # fmt: skip
    return ddp.Library(**(values | changes))


def sweep_report() -> slcp.SweepReport:
    interval = (0.5, 0.25, 0.75)
    names = ("mean_rate", "share_above", "share_spinning", "share_recovered", "median_recovery_time",
             "contact_share")  # fmt: skip
    case = {"residual": "hard", "step_size": 0.05, "worlds": 3, "seconds": 0.1,
            **dict.fromkeys(names, interval),
            "statuses": {s.name: 3 * (s == slcp.Status.SOLVED) for s in slcp.Status}}  # fmt: skip
    ones = np.ones(3, np.float32)
    table = {"residual": np.full(3, "hard"), "step_size": 0.05 * ones, "world": np.arange(3),
             "contact_share": ones, "lowest_gap": ones, "status": np.zeros(3, np.int32), "rate": ones,
             "late_rate": ones, "spinning": ones > 0,
             "recovery_time": np.array([1.0, 2.0, np.inf])}  # fmt: skip
    spec = {"duration": 2.0, "window": 1.0, "threshold": 0.5, "sample_every": 1.0}
    return slcp.SweepReport([case], table, [np.ones((3, 3), np.float32)], spec)


def report(complete: bool = True) -> slcp.Report:
    """Two policies in three worlds, one of them undisturbed, too."""
    scene, m = slcp.scenes.push_block(), slcp.measures
    measures = {"x": m.final("block.x"), "time": m.settled(m.state("block.x") > 1.0)}
    cost = slcp.costs.terms(scene, [slcp.costs.effort(1.0)])
    task = slcp.Task("push", scene, cost, 5, measures=measures, success=measures["x"] > 0.0)
    source = MemorySource()
    for policy, arm, count in (("a", "disturbed", 3), ("b", "disturbed", 3), ("b", "undisturbed", 1)):
        drawn = {"drawn_mass_0": np.linspace(0.9, 1.1, 3, dtype=np.float32)} if arm == "disturbed" else {}
        rows = {"world": np.arange(3), **drawn, "x": np.array([0.5, np.nan, -0.1]),
                "time": np.array([np.inf, np.nan, 2.0]), "success": np.array([True, False, False]),
                "status": np.array([0, 2, 0], np.int32)}  # fmt: skip
        source.add((policy, "hard", 0.05, arm), {name: column[:count] for name, column in rows.items()})
    return slcp.Report(task, source, complete)


def trajectory() -> Record:
    structure = PARTICLE.structure
    arrays = {"states": np.ones((2, 4, 2 * structure.nv)), "controls": np.zeros((2, 3, structure.nu)),
              "impulse": np.zeros((2, 3, structure.nr)), "status": np.zeros(2, np.int32),
              "contact_impulse": np.zeros((2, 3, len(structure.pairs), 2))}  # fmt: skip
    return Record("trajectory", arrays, simulated())


@functools.cache
def simulated() -> Simulated:
    return Simulated(PARTICLE, slcp.Options(), slcp.Parameters(PARTICLE))


def surface() -> Record:
    arrays = {f"axis{i}": np.arange(2.0) for i in range(3)} | {"gap": np.ones((2, 2, 2))}
    return Record("surface", arrays, simulated())


def plan() -> Record:
    scene = slcp.scenes.flicking_finger()
    shapes = {"xs": (3, 6), "us": (2, 2), "K": (2, 2, 6), "k": (2, 2), "Vx": (3, 6), "Vxx": (3, 6, 6),
              "cost": (), "iterations": (), "gradient": (), "min_pivot": (), "level_sigma": (1,),
              "level_cost": (1,)}  # fmt: skip
    arrays = {name: np.ones(shape) for name, shape in shapes.items()}
    arrays |= {f"trace_{name}": np.ones(4) for name in ddp.Trace.__dataclass_fields__}
    arrays |= {"status": np.array(int(ddp.Status.CONVERGED)), "trace_level": np.zeros(4, int)}
    known = Simulated(scene, slcp.Options(), slcp.Parameters(scene))
    return Record("plan", arrays, known, {"horizon": 2, "method": "gauss-newton"})


def in_columns(path: Path) -> None:
    pytest.importorskip("pyarrow")
    report().save(path)


def mjcf(path: Path) -> None:
    pytest.importorskip("mujoco")
    path.write_text(MJCF)


def saved_task(path: Path) -> None:
    slcp.save_task(slcp.tasks.catch(), path)


def saved_policy(path: Path) -> None:
    linear = slcp.policies.Linear(np.ones((1, 8)), np.zeros(8), [0.5], limits=(-1.0, 2.0), period=np.zeros(8))
    noise = {"pusher.shift": 0.01}
    slcp.policies.save_policy(slcp.policies.Around(linear, limits=(-1.0, 1.0), delay=2, noise=noise), path)


def results(path: Path) -> None:
    row = {"study": "contact", "problem": "a", "program": "b", "curve": "c", "knob": 0.1, "value": 2.0}
    write_csv(path, [row, row | {"note": "x, y"}])


def sizes(path: Path) -> None:
    write_csv(path, [dict.fromkeys(SIZE_COLUMNS, 0.5) | {"residual": "hard"}] * 2)


def stability(path: Path) -> None:
    row = dict.fromkeys(KEYS, "x") | dict.fromkeys(NUMBERS, 0.5) | {"sigma": 0.1, "verdict": "pass"}
    write_csv(path, [row])


def answer(columns: tuple[str, ...], **values: str) -> Any:
    return lambda path: write_csv(path, [dict.fromkeys(columns, 0.5) | values])


FORMATS = {
    "library": Format(".npz", lambda p: library().save(p), ddp.Library.load, ddp.LibraryError),
    "sweep": Format(".npz", lambda p: sweep_report().save(p), slcp.SweepReport.load, slcp.FileError),
    "report": Format(".npz", lambda p: report().save(p), slcp.Report.load, slcp.FileError),
    "report table": Format(".csv", lambda p: report().save(p), slcp.Report.load, slcp.FileError),
    "report in columns": Format(".parquet", in_columns, slcp.Report.load, slcp.FileError),
    "trajectory": Format(
        ".npz", lambda p: trajectory().save(p), lambda p: load_record(p, "trajectory"), RecordError
    ),
    "plan": Format(".npz", lambda p: plan().save(p), lambda p: load_record(p, "plan"), RecordError),
    "surface": Format(".npz", lambda p: surface().save(p), lambda p: load_record(p, "surface"), RecordError),
    "json": Format(
        ".json", lambda p: slcp.save_scene(slcp.scenes.hopper(), p), slcp.load_scene, slcp.SceneFileError
    ),
    "toml": Format(".toml", lambda p: p.write_text(TOML), slcp.load_scene, slcp.SceneFileError),
    "task": Format(".json", saved_task, slcp.load_task, slcp.TaskFileError),
    "task in toml": Format(
        ".toml", lambda p: p.write_text(SHOVE.read_text()), slcp.load_task, slcp.TaskFileError
    ),
    "policy": Format(".npz", saved_policy, slcp.policies.load_policy, slcp.FileError),
    "worlds": Format(".npz", lambda p: slcp.save_worlds(WORLDS, p), slcp.load_worlds, slcp.FileError),
    "mjcf": Format(".xml", mjcf, slcp.load_scene, slcp.MjcfError),
    "results": Format(".csv", results, read_results, slcp.FileError),
    "sensitivity": Format(".csv", answer(SENSITIVITY, drawn="mass_0"), read_sensitivity, slcp.FileError),
    "map": Format(".csv", answer(MAP, x="mass", y="friction"), read_map, slcp.FileError),
    "sizes": Format(".csv", sizes, read_sizes, slcp.FileError),
    "stability": Format(".csv", stability, lambda p: read_rows([p]), slcp.FileError),
}


def outcome(form: Format, path: Path) -> Any:
    """What loading gives: an object, or None for the one error, which must name the file in one line."""
    try:
        return form.load(path)
    except form.error as error:
        text = str(error)
        assert path.name in text and "\n" not in text and len(text) < 600, text
        return None


def rewritten(path: Path, fields: dict[str, Any] | None = None, **changes: Any) -> None:
    """An archive with other header fields or arrays; None leaves one out."""
    with np.load(path) as archive:
        data = {name: archive[name] for name in archive.files}
    header = json.loads(str(data["header"])) | (fields or {})
    data |= {"header": np.array(json.dumps({k: v for k, v in header.items() if v is not None}))} | changes
    with open(path, "wb") as file:
        np.savez(file, **{name: value for name, value in data.items() if value is not None})


PUSH = """
from dataclasses import replace
import numpy as np
import slcp_warp as slcp

SCENE = replace(slcp.scenes.push_block(), step_size=0.02, sigma=0.05)

def push():
    cost = slcp.costs.terms(SCENE, [slcp.costs.effort(1.0)])
    drawn = slcp.Disturbances(parameters={"mass": 0.1}, start={"pusher.shift": 0.02}, torque=0.3)
    x = slcp.measures.final("block.x")
    return slcp.Task("push", SCENE, cost, 60, measures={"x": x}, success=x > 0.4, disturbances=drawn)

gain = slcp.policies.Linear(np.zeros((1, 8)), SCENE.x0, [FORCE])

def asked():
    return slcp.policies.Callback(lambda x, time: np.full((len(x), 1), FORCE), period=0.6)
"""


def push_file(folder: Path, force: float = 3.0) -> Path:
    """Write a user's Python file: task `push`, policies `gain`, in kernels, and `asked`, on the host.

    Its kernels are those of the tests of tasks.
    """
    path = folder / "mine.py"
    path.write_text(PUSH.replace("FORCE", str(force)))
    return path
