"""Running the stability battery: launches, the independent check, and a verdict per cell.

pass: every step's equations hold and the criterion is met. degrades: the equations hold, the criterion is
missed (a limit of the method, not of the solver). status: the solver says that it failed, and the world keeps
its last valid state. silent: the solver says SOLVED and the check disagrees. unchecked: the check knows no
equations of the method.
"""

import functools
import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp import StrategyError
from slcp_warp.options import CHOICES, OptionError, Options, Status

from .case import Case, Grid, Run
from .check import Checker

PASS, DEGRADES, STATUS, SILENT, UNCHECKED = "pass", "degrades", "status", "silent", "unchecked"
VERDICTS = (PASS, DEGRADES, STATUS, SILENT, UNCHECKED)
TOLERANCE = {"float64": 1e-10, "float32": 2e-5}  # of the size of the terms; float32: the documented accuracy
FAMILY = ("residual", "scaling", "friction", "integrator")  # options that the battery combines
ERM_SLACK = 10.0  # of TOLERANCE: a vanishing gradient of squares has the square of a residual's condition
CHECKED_STEPS = 400  # of a run at most: the first half of them, the rest evenly
Row = dict[str, Any]


@dataclass(frozen=True)
class Selection:
    """What to run: empty means all."""

    cases: tuple[str, ...] = ()
    residuals: tuple[str, ...] = ()
    dtypes: tuple[str, ...] = ("float64", "float32")
    sigmas: tuple[float, ...] = ()
    step_sizes: tuple[float, ...] = ()
    everything: bool = False

    def wants(self, options: Options, dtype: str) -> bool:
        """Whether a method runs in a precision: unless `everything`, what differs from the library's default
        in several ways is left out, and float32 is for the main methods.
        """
        main = options.residual in ("hard", "rem-logistic") and options.integrator == "euler"
        several = options.scaling != "inertia" and options.integrator != "euler"
        return dtype in self.dtypes and (self.everything or main or not several and dtype == "float64")


def methods(selection: Selection) -> list[Options]:
    """Every combination of the options that the library offers; scaling does not matter without noise."""
    out = []
    for choice in itertools.product(*(CHOICES[name] for name in FAMILY)):
        values: Any = dict(zip(FAMILY, choice))
        if selection.residuals and values["residual"] not in selection.residuals:
            continue
        if values["residual"] == "hard" and values["scaling"] != CHOICES["scaling"][0]:
            continue
        try:
            out.append(Options(**values))
        except OptionError:
            continue
    return out


def checked_steps(steps: int) -> np.ndarray:
    """Indices of the steps that are checked."""
    if steps <= CHECKED_STEPS:
        return np.arange(steps)
    half = CHECKED_STEPS // 2
    return np.unique(np.r_[np.arange(half), np.linspace(half, steps - 1, half).astype(int)])


def run_case(case: Case, options: Options, dtype: str, selection: Selection) -> list[Row]:
    """All cells of a case under one method and precision."""
    method = options.method
    if not case.only(method):
        return []
    try:
        strategy = "generic" if case.generic else "auto"
        sim = slcp.Simulator(case.scene(), options, device="cpu", dtype=dtype, strategy=strategy)
    except (OptionError, StrategyError, ValueError):
        return []
    rows: list[Row] = []
    sigmas = (
        (np.nan,) if method.hard else tuple(s for s in case.sigmas if s in (selection.sigmas or case.sigmas))
    )
    for h in case.step_sizes:
        if h not in (selection.step_sizes or case.step_sizes):
            continue
        pairs = list(itertools.product(case.variants, sigmas))
        grid = Grid(h, np.array([s for _, s in pairs]), np.array([v for v, _ in pairs]), method)
        rows += _run_grid(case, sim, grid, dtype)
    return rows


def _run_grid(case: Case, sim: Any, grid: Grid, dtype: str) -> list[Row]:
    steps = case.count(grid.h)
    start = case.start(grid, steps)
    numbers: dict[str, Any] = {"step_size": np.full(grid.size, grid.h)} | start.numbers
    if not grid.method.hard:
        numbers["sigma"] = np.repeat(grid.sigma[:, None], sim.nr, 1)
    params = sim.params.replace(**numbers)
    controls = np.zeros((grid.size, steps, sim.nu)) if start.controls is None else start.controls
    number = np.float32 if dtype == "float32" else np.float64
    traj = sim.rollout(start.x0.astype(number), controls.astype(number), params, record=("impulse",))
    states, impulse = np.asarray(traj.states, float), np.asarray(traj.impulse, float)
    failed = np.asarray(traj.status) != Status.SOLVED
    impulse[failed] = np.nan_to_num(impulse[failed])
    rounded = {n: params[n].astype(number).astype(float) for n in params.names}
    return judge(case, grid, dtype, sim.scene, rounded, states, controls, impulse, np.asarray(traj.status))


def judge(
    case: Case,
    grid: Grid,
    dtype: str,
    scene: Any,
    numbers: dict[str, np.ndarray],
    states: np.ndarray,
    controls: np.ndarray,
    impulse: np.ndarray,
    status: np.ndarray,
) -> list[Row]:
    """A row per world: its verdict, the measured number, and the worst error of its equations."""
    kept = checked_steps(states.shape[1] - 1)
    finite = np.isfinite(states).all((1, 2)) & np.isfinite(impulse).all((1, 2))
    with np.errstate(all="ignore"):
        verdict = Checker(scene, numbers).judge(
            states[:, kept], states[:, kept + 1], impulse[:, kept], controls[:, kept], grid.method
        )
        run = Run(grid, states, impulse, verdict.gap, verdict.energy)
        value, limit = case.measure(run), case.bound(grid, dtype)
        error = np.maximum(verdict.motion, verdict.contact).max(1)
    rows = []
    for i in range(grid.size):
        solved = Status(int(status[i])) == Status.SOLVED
        if not solved:
            kind = PASS if case.expect == status[i] else STATUS
        elif not finite[i] or case.expect != Status.SOLVED:
            kind = SILENT
        elif np.isnan(error[i]):
            kind = UNCHECKED
        elif not error[i] <= TOLERANCE[dtype] * (ERM_SLACK if grid.method.erm else 1.0):
            kind = SILENT
        else:
            kind = PASS if value[i] <= limit[i] else DEGRADES
        rows.append({
            "case": case.name, "scene": scene.name,
            **{name: getattr(grid.method, name) for name in FAMILY}, "dtype": dtype, "h": grid.h,
            "sigma": "" if np.isnan(grid.sigma[i]) else grid.sigma[i], "variable": case.label,
            "variant": grid.variant[i], "verdict": kind, "value": value[i], "limit": limit[i],
            "unit": case.unit, "error": error[i], "status": Status(int(status[i])).name,
            "steps": states.shape[1] - 1,
        })  # fmt: skip
    return rows


def run_battery(cases: Iterable[Case], selection: Selection, say: Any = print) -> list[Row]:
    """Every case under every method and precision."""
    rows: list[Row] = []
    for case in cases:
        if selection.cases and case.name not in selection.cases:
            continue
        for options in methods(selection):
            for dtype in filter(functools.partial(selection.wants, options), selection.dtypes):
                new = run_case(case, options, dtype, selection)
                if new:
                    counts = {v: sum(r["verdict"] == v for r in new) for v in VERDICTS}
                    label = f"{case.name}: " + " ".join([*(getattr(options, n) for n in FAMILY), dtype])
                    say(f"{label}: " + ", ".join(f"{n} {v}" for v, n in counts.items() if n))
                rows += new
    return rows
