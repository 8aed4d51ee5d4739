"""A watched run in a file: enough to show it again, and to compute it again step by step."""

from pathlib import Path
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp.results.simulated import Simulated
from slcp_warp.storage.archive import open_archive, write_archive
from slcp_warp.storage.files import FileError, reading

from .world import Worlds

FORMAT, VERSION = "slcp-warp-watch", 1
MOST_BYTES = 2**28  # of a record; then it ends by itself
ARRAYS = ("states", "controls", "forces", "warm", "values", "variant", "status")


class Record:
    """Steps as they are taken.

    Attributes:
        knobs: names of the columns of `values`.
    """

    def __init__(self, worlds: Worlds, knobs: tuple[str, ...]) -> None:
        self.worlds, self.knobs = worlds, knobs
        self.rows: list[dict[str, np.ndarray]] = []
        self.bytes = 0

    @property
    def full(self) -> bool:
        """Whether it holds as much as it may."""
        return self.bytes > MOST_BYTES

    def before(self, u: np.ndarray) -> None:
        """Keep what a step starts from; `after` completes it."""
        w, sim = self.worlds, self.worlds.sim
        width = sim.nr + 2 * len(sim.scene.structure.pairs)
        nothing = np.full((len(w.state), width), np.nan)
        warm = nothing if w.warm is None else np.asarray(w.warm)
        values = np.array([w.values[name] for name in self.knobs])
        variant = np.array(list(w.sims).index(w.variant))
        self._row = {"states": w.state, "controls": u, "warm": warm, "values": values, "variant": variant}

    def after(self) -> None:
        """Keep what it did."""
        row = self._row | {"forces": self.worlds.force.copy(), "status": self.worlds.status}
        self._end = self.worlds.state  # whatever is done with the worlds before the record is saved
        self.rows.append(row)
        self.bytes += sum(a.nbytes for a in row.values())

    def save(self, path: Path) -> Path:
        """Write it, whole or not at all."""
        stacked = {name: np.stack([row[name] for row in self.rows]) for name in ARRAYS}
        stacked["states"] = np.concatenate([stacked["states"], self._end[None]])
        known = Simulated.of(
            next(iter(self.worlds.sims.values()))
        )  # whichever steps: the others follow from it
        header = {"format": FORMAT, "version": VERSION, "knobs": list(self.knobs)}
        header |= {"variants": list(self.worlds.sims), "subject": self.worlds.subject.name}
        write_archive(path, header | known.header(), stacked | known.arrays())
        return path


class Replay:
    """A record that was saved.

    Attributes:
        simulated: scene, options and parameters.
        knobs, variants: names of what `values` and `variant` count.
        arrays: ARRAYS by name; states (T + 1, B, nx), the others (T, ...).
    """

    def __init__(self, path: Path) -> None:
        with reading(path, "a watched run", FileError), open_archive(path) as archive:
            archive.check_format(FORMAT, VERSION)
            self.simulated = Simulated.read(archive, 2)
            header = archive.header
            self.subject, self.knobs = str(header.get("subject")), _names(header, "knobs")
            self.variants = _names(header, "variants")
            self.arrays = archive.read_all(ARRAYS)
            self._check()

    def _check(self) -> None:
        """Raise FileError unless the arrays fit the scene and one another."""
        s = self.simulated.scene.structure
        states = self.arrays["states"]
        if states.ndim != 3 or states.shape[2] != 2 * s.nv or len(states) < 2 or not states.shape[1]:
            raise FileError(f"array 'states' has shape {states.shape}; (T + 1, B, {2 * s.nv}) is needed")
        steps, worlds = len(states) - 1, states.shape[1]
        need = {
            "controls": (steps, worlds, s.nu),
            "forces": (steps, worlds, s.nb, 3),
            "warm": (steps, worlds, s.nr + 2 * len(s.pairs)),
            "values": (steps, len(self.knobs)),
            "variant": (steps,),
            "status": (steps, worlds),
        }
        for name, shape in need.items():
            if self.arrays[name].shape != shape:
                raise FileError(f"array {name!r} has shape {self.arrays[name].shape}; {shape} is needed")
        for name in ("states", "controls", "forces", "values"):
            if not np.isfinite(self.arrays[name]).all():
                raise FileError(f"array {name!r} is not finite")
        if self.arrays["status"].dtype.kind not in "iu":
            raise FileError(f"array 'status' is of {self.arrays['status'].dtype}; whole numbers are needed")
        variant = self.arrays["variant"]
        if variant.dtype.kind not in "iu" or variant.min() < 0 or variant.max() >= len(self.variants):
            raise FileError(f"array 'variant' counts others than {', '.join(self.variants)}")

    def task(self) -> "tuple[str, slcp.Scene, slcp.Options]":
        """Name, scene and options of what was watched."""
        return self.subject, self.simulated.scene, self.simulated.options

    def again(self, worlds: Worlds) -> np.ndarray:
        """The states (T + 1, B, nx) that the same steps lead to, each from the recorded one before."""
        a, out = self.arrays, [self.arrays["states"][0]]
        for k in range(len(a["controls"])):
            worlds.choose(self.variants[a["variant"][k]])
            worlds.turn(dict(zip(self.knobs, a["values"][k].tolist())))
            worlds.state = a["states"][k]
            warm = None if np.isnan(a["warm"][k]).any() else a["warm"][k]
            worlds.advance(a["controls"][k], a["forces"][k], warm)
            out.append(worlds.state)
        return np.stack(out)


def _names(header: dict[str, Any], entry: str) -> tuple[str, ...]:
    names = header.get(entry)
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise FileError(f"{entry} of its header is {names!r:.60}; names are needed")
    return tuple(names)
