"""Study "solver": error of the smoothed problem's own solution against its cost.

One step from touching states of the finger, and of a chain under four rows of contact. Error: largest
component of v' relative to 1 + |v'|, from the same states (rounded to float32), against the other strategy in
float64 at its finest tolerance: specialised and generic kernels eliminate other unknowns and share no
solver. Knobs: `Options.tolerance`, precision, residual and strategy, for three noise levels.
"""

import functools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp import Scene
from slcp_warp.kernels.solvers.newton import RESOLUTION
from slcp_warp.simulator import DTYPES

from ..shared.ours import PAPER, Ours
from ..shared.rows import Rows, Say, report, timed
from ..shared.scenes import chain_on_ground
from ..shared.timing import Case
from ..shared.workload import make_workload

SIGMAS = (0.1, 0.02, 0.005)
TOLERANCES = {"float32": (1e-2, None), "float64": (1e-2, 1e-4, 1e-8, None)}


@dataclass(frozen=True)
class Variant:
    """How a step is solved."""

    dtype: str = "float64"
    tolerance: float | None = None
    residual: str = "rem-logistic"
    strategy: str = "specialised"

    @property
    def curve(self) -> str:
        """Everything but the tolerance, in words."""
        words = [self.dtype] + [self.residual] * (self.residual != "rem-logistic")
        return ", ".join(words + ["generic"] * (self.strategy == "generic"))

    @property
    def judge(self) -> "Variant":
        """What it is compared with: the other strategy."""
        strategy = "specialised" if self.strategy == "generic" else "generic"
        return Variant(residual=self.residual, strategy=strategy)

    @property
    def reached(self) -> float:
        """The tolerance in numbers."""
        return max(self.tolerance or 0.0, RESOLUTION[DTYPES[self.dtype]])


def variants(tolerances: dict[str, tuple[float | None, ...]], residuals: tuple[str, ...]) -> list[Variant]:
    """Every tolerance of every precision; the other residuals and the other strategy at their finest."""
    out = [Variant(dtype, tolerance) for dtype, levels in tolerances.items() for tolerance in levels]
    out += [Variant(residual=residual) for residual in residuals]
    return out + [Variant(dtype, strategy="generic") for dtype in tolerances]


def simulator(scene: Scene, variant: Variant) -> slcp.Simulator:
    """The scene's simulator of a variant, scaled as in the paper."""
    options = replace(PAPER, residual=variant.residual, tolerance=variant.tolerance)
    return slcp.Simulator(scene, options, device="cpu", dtype=variant.dtype, strategy=variant.strategy)


def finger_case(count: int, seed: int = 0) -> tuple[Scene, np.ndarray, np.ndarray]:
    """The finger, states (count, nx) whose next steps touch, and controls (count, nu), float32's numbers."""
    scene = slcp.scenes.flicking_finger()
    work = Ours(make_workload(scene, 400, 50, seed), "float64").touching_windows
    index = np.resize(np.random.default_rng(seed).permutation(len(work.x0)), count)
    return scene, work.x0[index].astype(np.float32), work.controls[index, 0].astype(np.float32)


def chain_case(count: int, seed: int = 0) -> tuple[Scene, np.ndarray, np.ndarray]:
    """A chain of three links under four rows of contact, moved a little, with speeds of .3."""
    scene = chain_on_ground(3, 4)
    rng = np.random.default_rng(seed)
    spread = np.repeat([1e-3, 0.3], scene.nv)
    x = scene.x0 + spread * rng.standard_normal((count, 2 * scene.nv))
    return scene, x.astype(np.float32), np.zeros((count, scene.nu), np.float32)


def velocities(
    sim: slcp.Simulator, x: np.ndarray, u: np.ndarray, params: Any
) -> tuple[np.ndarray, np.ndarray]:
    """v' (B, nv) in float64, NaN where it was not solved, and the status (B,)."""
    done = sim.rollout(x.astype(float), u[:, None].astype(float), params)
    v = done.states[:, 1, sim.scene.nv :].astype(float)
    v[done.status != slcp.Status.SOLVED] = np.nan
    return v, done.status


def study(
    problem: str,
    case: tuple[Scene, np.ndarray, np.ndarray],
    chosen: list[Variant],
    sigmas: tuple[float, ...],
    repeats: int,
) -> Rows:
    """A row per variant and noise level, timed in turn."""
    scene, x, u = case
    rows = []
    for sigma in sigmas:
        cases = []
        for variant in chosen:
            exact = simulator(scene, variant.judge)
            truth, _ = velocities(exact, x, u, exact.params.replace(sigma=sigma))
            sim = simulator(scene, variant)
            params = sim.params.replace(sigma=sigma)
            v, status = velocities(sim, x, u, params)
            error = np.abs(v - truth).max(axis=1) / (1.0 + np.abs(truth).max(axis=1))
            error = np.maximum(error[np.isfinite(error)], np.finfo(float).eps)  # it was found to the last bit
            facts = {
                "study": "solver", "problem": problem, "program": "slcp-warp", "curve": variant.curve,
                "knob": "tolerance", "value": variant.reached, "tolerance": variant.tolerance or "rounding",
                "sigma": sigma, "h": scene.step_size, "residual": variant.residual, "scaling": PAPER.scaling,
                "dtype": variant.dtype, "strategy": variant.strategy, "device": "cpu", "threads": 1,
                "batch": len(x), "error": float(np.median(error)),
                "error_p90": float(np.quantile(error, 0.9)), "error_max": float(error.max()),
                "error_of": "v' relative to 1 + |v'|, largest component, median over states",
                "solved_share": float((status == slcp.Status.SOLVED).mean()), "cost_of": "step",
            }  # fmt: skip
            kind = np.dtype(variant.dtype)
            run = functools.partial(sim.rollout, x.astype(kind), u[:, None].astype(kind), params)
            name = f"{variant.curve} {variant.tolerance}"
            cases.append(Case(name, run, len(x), facts=facts))
        rows += timed(cases, repeats)
    return rows


def rows(say: Say) -> Rows:
    """All of the study."""
    shown = ("problem", "sigma", "curve", "tolerance", "error", "error_p90", "seconds")
    chosen = variants(TOLERANCES, ("rem-normal",))
    out = report(say, study("finger, touching", finger_case(2000), chosen, SIGMAS, 7), *shown)
    few = variants({"float32": (None,), "float64": (1e-2, None)}, ())
    return out + report(say, study("chain on the ground", chain_case(2000), few, SIGMAS, 5), *shown)
