"""Which disturbance matters: Sobol indices of what a task's worlds are drawn from."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ...description.columns import places_of
from ...description.scene import Scene
from ...inputs import checks
from ...inputs.errors import ArgumentError
from ...options import Options
from ...parameters import Parameters
from ...tasks.disturbances import laws
from ...tasks.task import Task
from ..statistics.sensitivity import Sensitivity
from ..statistics.sobol import sobol_indices
from ..worlds import Worlds, draw_worlds
from .judged import Judge, column

NOISE = "noise of steps"


class Factor(NamedTuple):
    """Numbers of a world that are drawn together.

    Attributes:
        name: of its columns.
        places: columns of the tables of `Worlds` (an entry's axes as one), by the name of the table.
    """

    name: str
    places: dict[str, list[int]]


def factors_of(task: Task) -> list[Factor]:
    """What is drawn for a world independently of all else.

    Of several starts the choice and all noise around it are one factor; so is the noise of single steps,
    which follows from the world's number.
    """
    d, scene = task.disturbances, task.scene
    tables = {
        "params": laws.parameter_laws(scene, Parameters(scene).table()[0], d.parameters),
        "x0": d.start_laws(scene, task.start), "kicks": d.kick_laws(scene), "pushes": d.push_laws(),
        "dropouts": d.dropout_laws(), "timing": d.timing_laws(),
    }  # fmt: skip
    found: dict[tuple[int, int], Factor] = {}
    names: dict[tuple[int, int], list[str]] = {}
    for table, columns in tables.items():
        if table == "x0" and len(task.start) > 1:
            continue
        for c in columns.varied.tolist():
            address = int(columns.stream[c]), int(columns.step[c])  # who shares it shares the random number
            names.setdefault(address, []).append(columns.names[c])
            found.setdefault(address, Factor("", {})).places.setdefault(table, []).append(c)
    keys = _keys(scene, d.parameters, [factor.places.get("params", []) for factor in found.values()])
    out = [
        factor._replace(name=key or ", ".join(names[address]))
        for key, (address, factor) in zip(keys, found.items(), strict=True)
    ]
    if len(task.start) > 1:
        out.append(Factor("start", {"x0": list(range(2 * scene.nv))}))
    if d.torque or d.dropped or (any(d.sensor.values()) if isinstance(d.sensor, dict) else d.sensor):
        out.append(Factor(NOISE, {"numbers": [0]}))
    return out


def _keys(scene: Scene, given: Mapping[str, Any], draws: list[list[int]]) -> list[str | None]:
    """The name in the disturbances of each of several columns that one draw is of; None: of it there are
    several draws, or it is of one column, which has a name.
    """
    places = {
        key: {
            place
            for name in laws.names_in(key)
            for place in places_of(scene, name, "Disturbances.parameters")
        }
        for key in given
    }
    of = {
        key: [i for i, columns in enumerate(draws) if columns and set(columns) <= own]
        for key, own in places.items()
    }
    told = {drawn[0]: key for key, drawn in of.items() if len(drawn) == 1}
    return [told.get(i) if len(columns) > 1 else None for i, columns in enumerate(draws)]


def exchanged(a: Worlds, b: Worlds, factor: Factor) -> Worlds:
    """The worlds `a` with a factor's numbers of the worlds `b`."""
    changed: dict[str, np.ndarray] = {}
    for table, columns in factor.places.items():
        own, other = (np.array(getattr(worlds, table)) for worlds in (a, b))
        own.reshape(len(a), -1)[:, columns] = other.reshape(len(b), -1)[:, columns]
        changed[table] = own
    return replace(a, **changed)


def sensitivity(
    task: Task,
    policy: Any = None,
    *,
    measure: str = "success",
    samples: int = 1024,
    seed: int = 0,
    case: Options | None = None,
    dtype: str = "float32",
    device: Any = None,
    strategy: str = "auto",
    progress: Callable[[int, int], None] | None = None,
) -> Sensitivity:
    """Which drawn numbers matter: Sobol indices of a measure, on the distributions that a sweep draws from.

    Worlds A and B are drawn, and for every drawn number the worlds A with that number of B are run, too
    (Saltelli et al. 2010; `statistics.sobol` has the estimators). `Report.sensitivity` has indices of first
    order from a sweep that is there.

    Args:
        task: what is run, disturbed and measured.
        policy: one.
        measure: "success", or the name of one of the task's measures.
        samples: n; n (d + 2) worlds are run for d drawn numbers. The intervals are about 1 / sqrt(n) wide.
        seed: of all that is drawn.
        case: options of the steps; None: the task's.
        dtype, device, strategy: as of a `Simulator`.
        progress: called with (worlds done, worlds in all).

    Raises:
        ArgumentError: nothing is drawn in the task.
    """
    judge = Judge(task, policy, seed, case, progress, dtype=dtype, device=device, strategy=strategy)
    checks.choice("measure", measure, ("success", *task.measures))
    samples = checks.whole("samples", samples, 2, 2**24)
    factors = factors_of(task)
    if not factors:
        raise ArgumentError(f"task {task.name!r} has no disturbances; nothing is drawn")
    a, b = (draw_worlds(task, samples, seed, first, dtype=dtype, device=device) for first in (0, samples))
    total = samples * (len(factors) + 2)

    def of(worlds: Worlds) -> np.ndarray:
        return column(judge.run(worlds, total), measure)

    found = sobol_indices(of(a), of(b), np.array([of(exchanged(a, b, factor)) for factor in factors]), seed)
    names = tuple(factor.name for factor in factors)
    share = found.samples / samples
    judge.starts.tell(stacklevel=2)
    return Sensitivity(measure, judge.name, names, found.first, found.total, total, finite=share)
