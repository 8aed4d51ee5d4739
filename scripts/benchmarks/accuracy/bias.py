"""Study "bias": distance between smoothed and hard solutions as sigma falls, and the cost of a step.

Two scenes: the finger's impacts (`slcp impact`), state after two seconds against the hard problem's at the
same step size; and a ball that rests on the ground, whose gap is 0 in the hard problem and has a closed form
in the smoothed ones (of one row the REM and ERM residuals have the same solution). Sigma is a logistic
residual's scale (its standard deviation is 1.81 sigma), a normal's deviation.
"""

import functools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp import Scene

from ..shared.ours import PAPER
from ..shared.rows import Rows, Say, report, timed
from ..shared.scenes import IMPACTS_DURATION as DURATION
from ..shared.scenes import IMPACTS_SPREAD as SPREAD
from ..shared.scenes import IMPACTS_START as START
from ..shared.timing import Case

SIGMAS = (0.3, 0.1, 0.03, 0.01, 0.003, 0.001, 3e-4, 1e-4)
RESIDUALS = ("rem-logistic", "rem-normal", "erm-logistic", "erm-normal")
SCENES: dict[str, Callable[[], Scene]] = {
    "finger impact": slcp.scenes.flicking_finger,
    "resting ball": slcp.scenes.ball_drop,
}
STEP_SIZE, FINE, STARTS, COPIES = 0.02, 0.001, 32, 8
REST = 4.0  # [s] until the ball rests


def simulator(scene: Scene, residual: str) -> slcp.Simulator:
    """In float64, unscaled as in the paper (the ball's mass is 1, so that scaling would change nothing)."""
    return slcp.Simulator(scene, replace(PAPER, residual=residual), device="cpu", dtype="float64")


def final(sim: slcp.Simulator, x0: np.ndarray, duration: float, h: float, **numbers: float) -> np.ndarray:
    """States (B, nx) after a duration without controls; NaN where a world was not solved."""
    params = sim.params.replace(step_size=h, **numbers)
    done = sim.rollout(x0, np.zeros((len(x0), round(duration / h), sim.nu)), params)
    out = done.states[:, -1].copy()
    out[done.status != slcp.Status.SOLVED] = np.nan
    return out


def starts(count: int = STARTS) -> np.ndarray:
    """The impact's starts (count, nx)."""
    return START + SPREAD * np.random.default_rng(0).uniform(-1.0, 1.0, (count, len(START)))


def resting_gap(residual: str, sigma: float, push: float) -> float:
    """w of a row at rest under an impulse `push` per step (D = 1): s(z) = push, w = s(-z); times h the gap.

    Logistic: -sigma log(1 - e^(-push/sigma)); normal: Newton's method on z Phi(z/sigma) + sigma phi(z/sigma).
    """
    if residual.endswith("logistic"):
        return -sigma * math.log(-math.expm1(-push / sigma))
    x, target = push / sigma, push / sigma
    for _ in range(60):
        small = 0.5 * math.erfc(x / math.sqrt(2.0))
        density = math.exp(-0.5 * x * x) / math.sqrt(2.0 * math.pi)
        x -= (x * (1.0 - small) + density - target) / (1.0 - small)
    return sigma * (
        math.exp(-0.5 * x * x) / math.sqrt(2.0 * math.pi) - x * 0.5 * math.erfc(x / math.sqrt(2.0))
    )


def closed_form(scene: Scene, residual: str, sigma: float, h: float) -> float:
    """The resting ball's gap [m]."""
    return h * resting_gap(residual, sigma, -scene.gravity[1] * h)


def finger_errors(sims: dict[str, slcp.Simulator], residual: str, sigma: float, count: int) -> dict[str, Any]:
    """Distance to the hard state, and of that to the hard state at a fine step, over the starts."""
    hard, fine = hard_states(sims["hard"], count)
    error = np.abs(final(sims[residual], starts(count), DURATION, STEP_SIZE, sigma=sigma) - hard).max(axis=1)
    return {
        "error": float(np.nanmedian(error)), "error_p90": float(np.nanquantile(error, 0.9)),
        "error_of": "state after 2 s against hard, largest component [rad, rad/s], median over starts",
        "solved_share": float(np.isfinite(error).mean()),
        "discretisation": float(np.nanmedian(np.abs(hard - fine).max(axis=1))),
    }  # fmt: skip


@functools.cache
def hard_states(sim: slcp.Simulator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The hard problem's states at the study's step size and at a fine one."""
    return tuple(final(sim, starts(count), DURATION, h) for h in (STEP_SIZE, FINE))  # type: ignore[return-value]


def ball_errors(sim: slcp.Simulator, residual: str, sigma: float) -> dict[str, Any]:
    """The gap at which the ball rests, and how fast it still is."""
    x0 = sim.scene.x0[None].copy()
    x0[:, 1] = 0.1 + 1e-3  # its radius and a gap
    x = final(sim, x0, REST, STEP_SIZE, sigma=sigma)[0]
    return {
        "error": float(x[1] - 0.1), "error_of": "gap at rest [m]; the hard one is 0",
        "speed": float(abs(x[4])), "closed_form": closed_form(sim.scene, residual, sigma, STEP_SIZE),
        "solved_share": float(np.isfinite(x).all()),
    }  # fmt: skip


def study(chosen: dict[str, tuple[str, ...]], sigmas: tuple[float, ...], count: int, repeats: int) -> Rows:
    """Rows of the residuals chosen for each scene of SCENES."""
    rows: Rows = []
    for name, residuals in chosen.items():
        scene = SCENES[name]()
        sims = {residual: simulator(scene, residual) for residual in ("hard", *residuals)}
        cases = []
        for residual in residuals:
            sim = sims[residual]
            for sigma in sigmas:
                found = (finger_errors(sims, residual, sigma, count) if name == "finger impact"
                         else ball_errors(sim, residual, sigma))  # fmt: skip
                cases.append(cost(sim, name, sigma, found | {"residual": residual, "curve": residual}))
        if name == "finger impact":
            cases.append(cost(sims["hard"], name, None, {"residual": "hard", "curve": "hard"}))
        rows += timed(cases, repeats)
    return rows


def cost(sim: slcp.Simulator, problem: str, sigma: float | None, facts: dict[str, Any]) -> Case:
    """A rollout of many worlds on the scene's way, to time a step."""
    x0 = np.tile(starts() if problem == "finger impact" else sim.scene.x0[None], (COPIES, 1))
    steps = round(DURATION / STEP_SIZE)
    params = sim.params.replace(step_size=STEP_SIZE, **({} if sigma is None else {"sigma": sigma}))
    shared = {
        "study": "bias", "problem": problem, "program": "slcp-warp", "knob": "sigma", "value": sigma or "",
        "sigma": sigma or 0.0, "h": STEP_SIZE, "scaling": PAPER.scaling, "dtype": "float64", "device": "cpu",
        "threads": 1, "cost_of": "step",
    }  # fmt: skip
    run = functools.partial(sim.rollout, x0, np.zeros((len(x0), steps, sim.nu)), params)
    return Case(f"{problem} {facts['curve']} {sigma}", run, len(x0) * steps, facts=shared | facts)


def rows(say: Say) -> Rows:
    """All of the study."""
    done = study({"finger impact": RESIDUALS, "resting ball": RESIDUALS[:2]}, SIGMAS, STARTS, 3)
    shown = ("problem", "curve", "value", "error", "error_p90", "closed_form", "speed", "discretisation",
             "solved_share", "seconds")  # fmt: skip
    return report(say, done, *shown)
