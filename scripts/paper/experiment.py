"""The stages in turn, each into a file: the experiment of section V at several scales."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.planning import Late, random_starts

from ..stages.library import Interrupted, build
from ..stages.plan import optimise
from ..stages.size import size_rows
from ..stages.surface import surface
from ..stages.sweep import cycle_states, run_sweep
from ..stages.trajectory import simulate
from ..support.paper import OBSERVED, RANGE, SCENE
from ..support.records import Record
from ..support.rules import HARD_RULE
from ..support.screen import progress_bar
from ..support.simulators import make_params, make_simulator, named_scene, start_states
from ..support.tables import write_csv

NO_GAP = ("controls", "impulse")  # a kernel that also records gaps would have to be compiled


@dataclass(frozen=True)
class Scale:
    """How much of everything.

    Attributes:
        starts: of the first optimisation, times eight schedules.
        plans: of the library.
        cycle_worlds, cycle_time, skip: rollouts that settle on the limit cycle [s].
        worlds, duration: of the sweep [s].
        disturbed: worlds of the second one.
        sizes: numbers of plans of the size study.
        size_worlds: its worlds.
        resolution: grid points of the contact surface per axis.
    """

    starts: int = 8
    passes: int = 200
    plans: int = 400
    cycle_worlds: int = 256
    cycle_time: float = 30.0
    skip: float = 10.0
    worlds: int = 4096
    duration: float = 20.0
    disturbed: int = 1024
    sizes: tuple[int, ...] = ()
    size_worlds: int = 1024
    resolution: int = 61


STANDARD = Scale()
FULL = Scale(sizes=(12, 25, 50, 100, 200, 400))
QUICK = Scale(
    starts=1, passes=5, plans=6, cycle_worlds=8, cycle_time=4.0, skip=1.0, worlds=32, duration=8.0,
    disturbed=16, sizes=(3, 6), size_worlds=16, resolution=13,
)  # fmt: skip


class Run:
    """One quickstart: where its files go, and how long its stages took."""

    def __init__(self, out: Path, scale: Scale, seed: int, device: str | None) -> None:
        self.data, self.figures, self.report = out / "data", out / "figures", out / "report.md"
        self.scale, self.seed, self.device = scale, seed, device
        self.scene = named_scene(SCENE)
        self.times: dict[str, float] = {}
        for folder in (self.data, self.figures):
            folder.mkdir(parents=True, exist_ok=True)

    def file(self, name: str) -> Path:
        """Path of a data file."""
        return self.data / name

    def plan(self) -> tuple[Record, list[ddp.Result]]:
        """DDP from the canonical start: the best of a batch of starts and schedules."""
        problem = finger_problem(device=self.device)
        starts = random_starts(self.scale.starts, problem.horizon, problem.nu, 1.0, self.seed)
        options = ddp.Options(max_iterations=self.scale.passes)
        record, results = optimise(Late.of(problem, 0), self.scene.x0, starts, options, schedules=True)
        record.save(self.file("plan.npz"))
        return record, results

    def library(self) -> ddp.Library:
        """The trajectory library."""
        options = ddp.RecedingOptions(entries=4, seed=self.seed)
        problem = finger_problem(device=self.device)
        with progress_bar("controllers") as progress:
            try:
                library = build(
                    problem, self.scene.x0, self.scale.plans, options, OBSERVED, progress=progress
                )
            except Interrupted as stopped:
                stopped.library.save(self.file("library.npz"))
                raise
        library.save(self.file("library.npz"))
        return library

    def cycle(self) -> None:
        """Smoothed worlds on the limit cycle, and one hard world at h = .03 that starts on it."""
        scale = self.scale
        smoothed = make_simulator(self.scene, device=self.device, dtype="float32")
        x0 = start_states(self.scene, None, scale.cycle_worlds, 0.3, self.seed)
        steps = round(scale.cycle_time / self.scene.step_size)
        starts = simulate(smoothed, smoothed.params, x0, steps, self.file("library.npz"), NO_GAP)
        starts.save(self.file("starts.npz"))
        hard = make_simulator(self.scene, HARD_RULE, device=self.device, dtype="float32")
        x0 = cycle_states(starts, self.scene, scale.skip)[:: max(1, steps // 16)][:64]
        params = make_params(hard, step_size=0.03)
        worlds = simulate(hard, params, x0, round(scale.cycle_time / 0.03), self.file("library.npz"), NO_GAP)
        _typical_world(worlds).save(self.file("cycle.npz"))

    def surface(self) -> None:
        """Signed distances of finger tip and ellipse on a grid."""
        sim = make_simulator(self.scene, device=self.device, dtype="float32")
        surface(sim, RANGE, self.scale.resolution).save(self.file("surface.npz"))

    def spec(self, **changes: Any) -> slcp.SweepSpec:
        """A sweep from the limit cycle with the velocities kicked by a standard deviation of 2."""
        starts = slcp.Trajectory.load(self.file("starts.npz"))
        values: dict[str, Any] = {
            "worlds": self.scale.worlds, "duration": self.scale.duration, "step_sizes": (0.05, 0.03),
            "start": cycle_states(starts, self.scene, self.scale.skip), "velocity_sd": 2.0,
            "observe": OBSERVED, "seed": self.seed,
        }  # fmt: skip
        return slcp.SweepSpec(**(values | changes))

    def sweep(self, name: str, spec: slcp.SweepSpec) -> slcp.SweepReport:
        """Sweep the library and save table and report."""
        with progress_bar("worlds") as progress:
            policy = self.file("library.npz")
            report = run_sweep(self.scene, policy, spec, device=self.device, progress=progress)
        report.save(self.file(f"{name}.npz"))
        report.save(self.file(f"{name}.csv"))
        if not report.complete:
            raise KeyboardInterrupt
        return report

    def disturbed(self) -> slcp.SweepReport:
        """Every world with its own masses, friction and damping, torque noise, and a second kick half way."""
        spec = self.spec(
            worlds=self.scale.disturbed, kick_times=(self.scale.duration / 2.0,), kick_sd=2.0, torque_sd=0.1,
            parameter_sd={"mass": 0.1, "inertia": 0.1, "friction": 0.2, "damping": 0.2},
        )  # fmt: skip
        return self.sweep("disturbed", spec)

    def sizes(self) -> None:
        """How the share of spinning worlds grows with the library."""
        library = ddp.Library.load(self.file("library.npz"))
        spec = self.spec(worlds=self.scale.size_worlds)
        with progress_bar("sizes") as progress:
            rows = size_rows(self.scene, library, list(self.scale.sizes), spec, self.device, progress)
        write_csv(self.file("size.csv"), rows)

    def to_draw(self) -> list[Path]:
        """The saved files that figures are made of."""
        names = ["surface.npz", "library.npz", "cycle.npz", "plan.npz", "sweep.npz", "disturbed.npz"]
        names += ["size.csv"] if self.scale.sizes else []
        return [self.file(name) for name in names]


def finger_problem(device: str | None = None) -> ddp.Problem:
    """The paper's problem (section V)."""
    sim = make_simulator(named_scene(SCENE), device=device)
    return ddp.Problem(sim, slcp.tasks.NAMED[SCENE]().cost, horizon=75)


def _typical_world(run: slcp.Trajectory) -> slcp.Trajectory:
    """The one world of median turn among the solved ones."""
    turn = run.states[:, -1, 2] - run.states[:, 0, 2]
    solved = np.flatnonzero(run.status == slcp.Status.SOLVED)
    if not len(solved):
        raise ValueError("no world of the controlled hard system was solved")
    return run[solved[np.argsort(turn[solved])[[len(solved) // 2]]]]
