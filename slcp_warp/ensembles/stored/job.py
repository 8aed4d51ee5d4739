"""A sweep of a task as a job: what decides its table, and how it travels to other processes."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import warp as wp

from ...inputs.errors import ArgumentError
from ...options import Options, Status
from ...runs.job import Columns, Job, Plain, makes_jobs, reference_to
from ...runs.origin import device_kind
from ...runs.store import Store
from ..chunks import ARMS, KEYS
from ..launch import NOT_RECORDED
from ..statistics.source import DRAWN
from ..tasks import TaskSweep
from .identity import policy_identity, task_identity, worlds_identity
from .layout import chunks_of, layout_of
from .travel import pack, packing_list, unpack, unpack_worlds, whole

KIND = "sweep"


class SweepJob(Job):
    """A sweep whose chunks other processes may run.

    Attributes:
        work: the sweep.
    """

    kind = KIND

    def __init__(self, work: TaskSweep, folder: Path, texts: Mapping[str, str] | None = None) -> None:
        """Args:
        folder: of the store.
        texts: how the task and policies were given as texts, `file.py:name`: "task", "policy NAME".
        """
        self.work, self.folder = work, Path(folder)
        self.texts = {what: whole(text) for what, text in (texts or {}).items()}
        first = next(iter(work.simulators.values()))
        self.device = device_kind(first.device)
        self._specification = self._tell()
        self._columns: dict[str, np.dtype] = {}

    @property
    def count(self) -> int:  # type: ignore[override]
        """Chunks."""
        return len(self.work.chunks)

    def _tell(self) -> Plain:
        work = self.work
        first = next(iter(work.simulators.values()))
        parts = work.chunks.parts
        return {
            "task": task_identity(work.task),
            "policies": {
                name: policy_identity(policy, first, self.texts.get(f"policy {name}"))
                for name, policy in work.policies.items()
            },
            "worlds": max(part.worlds for part in parts if part.arm == ARMS[0]),
            "seed": work.seed,
            "cases": {label: dataclasses.asdict(options) for label, options in work.cases.items()},
            "step_sizes": list(dict.fromkeys(part.step_size for part in parts)),
            "dtype": first.dtype.__name__,
            "strategy": {label: sim.strategy for label, sim in work.simulators.items()},
            **({} if work.given is None else {"given": worlds_identity(work.given)}),
            **({"record": [list(work.record.states), work.record.every]} if work.record.states else {}),
        }

    def specification(self) -> Plain:
        """Task but for its plans, policies by their numbers, worlds, seed, cases, step sizes, precision."""
        return self._specification

    def layout(self) -> Plain:
        """Every part with its worlds and those of a chunk, see `Part`."""
        return layout_of(self.work.chunks)

    def reference(self) -> Plain:
        """Of `saved_sweep`, with the store's folder and what `pack` puts there."""
        where = packing_list(self.work.task, self.work.policies, self.texts, self.work.given)
        return reference_to(
            saved_sweep, folder=str(self.folder.resolve()), strategy=self.work.strategy, **where
        )

    def pack(self) -> None:
        """Put task and policies into the store for other processes, if they are data.

        Raises:
            FileError: they cannot be written.
        """
        given = self.work.task, self.work.policies, self.texts, self.work.given
        try:
            packing_list(*given)
        except ArgumentError:
            return
        pack(self.folder, *given)

    def run(self, index: int) -> Columns:
        """Rows of a chunk: `KEYS`, world, what was drawn, measures, success, status."""
        part, world0, count = self.work.chunks[index]
        rows = self.work.rows(part, world0, count)
        found: Columns = {name: np.full(count, key) for name, key in zip(KEYS, part.keys)}
        for name, dtype in self._row_columns().items():
            found[name] = rows[name].astype(dtype) if name in rows else np.full(count, np.nan, dtype)
        return found

    def _row_columns(self) -> dict[str, np.dtype]:
        """Names and types of a row's columns: those of a disturbed world, where everything is drawn. What is
        drawn is none of an undisturbed one, which whole numbers cannot say.
        """
        if not self._columns:
            part = self.work.chunks.parts[0]
            self._columns = {
                name: np.dtype(float) if name.startswith(DRAWN) and a.dtype.kind in "iu" else a.dtype
                for name, a in self.work.rows(part, 0, 1).items()
            }
        return self._columns

    def tally(self, columns: Columns) -> dict[str, int]:
        """Worlds, those without success, and those that were not solved."""
        failures = np.count_nonzero(~columns["success"])
        unsolved = np.count_nonzero(columns["status"] != Status.SOLVED)
        return {"rows": len(columns["world"]), "failures": int(failures), "unsolved": int(unsolved)}

    def prepare(self) -> None:
        """Compile the kernels of every case under every policy."""
        for part in self.work.chunks.parts:
            if part.arm == ARMS[0]:
                self.work.rows(part, 0, 1)

    def provenance(self) -> Plain:
        """The task's name, and where task and policies came from as far as they were given as texts."""
        return {"task": self.work.task.name, **self.texts}


@makes_jobs
def saved_sweep(
    folder: str, task: str, policies: dict[str, str], strategy: str, worlds: str | None = None
) -> SweepJob:
    """The sweep of a store.

    Args:
        task, policies, worlds: as `packing_list` gives them.

    Raises:
        FileNotFoundError: there is none.
        FileError: what it would need is damaged or not there.
    """
    store = Store(folder)
    said, parts = store.manifest.specification, chunks_of(store.manifest.layout).parts
    in_order = {part.policy: policies[part.policy] for part in parts}  # JSON's keys may come sorted
    found, named, texts = unpack(store.folder, task, in_order)
    device = wp.get_preferred_device()
    states, every = said.get("record", NOT_RECORDED)
    given = said["worlds"] if worlds is None else unpack_worlds(store.folder, worlds)
    work = TaskSweep(
        found, named, worlds=given, seed=said["seed"], step_sizes=said["step_sizes"],
        cases={part.case: Options(**said["cases"][part.case]) for part in parts}, dtype=said["dtype"],
        record=states, record_every=every,
        device=device if device_kind(device) == store.manifest.device else "cpu", strategy=strategy,
    )  # fmt: skip
    work.cut([part.at_once for part in parts])
    return SweepJob(work, store.folder, texts)
