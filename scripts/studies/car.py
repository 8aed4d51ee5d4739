"""`slcp car`: a car on a slippery bend (the paper's [18]), planned with and without noise, driven in both."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from slcp_warp import ddp
from slcp_warp.ensembles.statistics import share_interval

from ..support.options import Device, Seed
from ..support.screen import one_line_errors, prepared, show_rows
from .car_model import (
    FRICTION,
    HALF_WIDTH,
    LIMITS,
    START,
    STEPS,
    car_problem,
    cautious_drive,
    drive,
    offset,
    slip,
    with_noise,
)

SIGMAS = (0.5, 0.35, 0.2, 0.14, 0.1, 0.07, 0.05, 0.035, 0.02)  # of the continuation [m/s]
SHOWN = (0.5, 0.2, 0.1, 0.05, 0.02)
REACTION = 0.5  # [s]; the position's standard deviation is sigma times this
PASSES = 600
CRASH = 0.1  # [m] beyond a wall
FRICTION_SD, GUST_SD, START_SD = 0.1, 0.05, 0.1  # log of the road's friction; [m/s] per step; [m]


@dataclass(frozen=True)
class Plan:
    """A plan with the noise it was made for."""

    sigma: float
    position_sd: float
    result: ddp.Result

    @property
    def name(self) -> str:
        """Its noise in words."""
        return f"{self.sigma:g} m/s, {self.position_sd:g} m"


def plans_at(device: str | None) -> list[Plan]:
    """DDP at falling noise, each level from the policy of the one before; then the two noises apart."""
    problem = car_problem(SIGMAS[0], REACTION * SIGMAS[0], device)
    options = ddp.Options(max_iterations=PASSES, gradient_tolerance=1e-4)
    first = ddp.solve(problem, START, cautious_drive(), options)
    chain = [Plan(SIGMAS[0], REACTION * SIGMAS[0], first)]
    for sigma in SIGMAS[1:]:
        chain.append(_next(problem, chain[-1], sigma, REACTION * sigma, options))
    apart = [_next(problem, chain[0], SIGMAS[0], REACTION * SIGMAS[-1], options),
             _next(problem, chain[0], SIGMAS[-1], REACTION * SIGMAS[0], options)]  # fmt: skip
    return [p for p in chain if p.sigma in SHOWN] + apart


def _next(problem: ddp.Problem, last: Plan, sigma: float, sd: float, options: ddp.Options) -> Plan:
    """A plan at another noise, from the last one's policy.

    Where DDP could not get further its regularisation has grown and shrunk the gains: they are made anew by
    one more backward pass, as little regularised as can be.
    """
    level, old = with_noise(problem, sigma, sd), last.result
    found = ddp.solve(level, START, old.us, options, xs0=old.xs, K0=old.K)
    fresh = ddp.solve(level, START, found.us, replace(options, max_iterations=0))
    return Plan(sigma, sd, replace(found, K=fresh.K))


def outcomes(
    plan: ddp.Result, worlds: int, seed: int, noise: float = 1.0, feedback: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Hard cars on roads of unknown friction, pushed about, under a plan and its feedback.

    Returns states (worlds, STEPS + 1, 5), and how far each was at most beyond a wall [m], (worlds,).
    """
    rng = np.random.default_rng(seed)
    x = np.tile(START, (worlds, 1))
    x[:, 1] += noise * START_SD * rng.standard_normal(worlds)
    friction = FRICTION * np.exp(noise * FRICTION_SD * rng.standard_normal(worlds))
    states = [x]
    for k in range(STEPS):
        u = np.tile(plan.us[k], (worlds, 1))
        if feedback:
            u += (x - plan.xs[k]) @ plan.K[k].T
        x = drive(x, np.clip(u, *LIMITS), friction)
        x[:, 3:] += noise * GUST_SD * rng.standard_normal((worlds, 2))
        states.append(x)
    trajectories = np.stack(states, 1)
    return trajectories, (np.abs(offset(trajectories)) - HALF_WIDTH).max(1)


def row(plan: Plan, worlds: int, seed: int) -> dict[str, object]:
    """A plan's line of the table."""
    result = plan.result
    calm, calm_excess = outcomes(result, 1, seed, noise=0.0)
    rough, excess = outcomes(result, worlds, seed)
    _, open_excess = outcomes(result, worlds, seed, feedback=False)
    kept = excess < CRASH
    share, low, high = share_interval(int(kept.sum()), worlds)
    return {
        "noise planned for": plan.name,
        "DDP": f"{int(result.iterations)} {ddp.Status(int(result.status)).name.lower()}",
        "max |Q_u|": float(result.gradient),
        "wall nearest [m]": float((HALF_WIDTH - np.abs(offset(result.xs))).min()),
        "largest slip [m/s]": float(np.abs(slip(result.xs)).max()),
        "calm [m]": float(-calm[0, -1, 0]) if calm_excess[0] < CRASH else "crash",
        "through [%]": f"{100 * share:.1f} ({100 * low:.1f} to {100 * high:.1f})",
        "those through [m]": float(-rough[kept, -1, 0].mean()) if kept.any() else "",
        "open loop [%]": 100.0 * float(np.mean(open_excess < CRASH)),
    }


@one_line_errors
def car_command(
    worlds: Annotated[int, typer.Option(min=1, help="Perturbed cars of each plan.")] = 4000,
    out: Annotated[Path, typer.Option(help="The picture.")] = Path("car.png"),
    device: Device = None,
    seed: Seed = 0,
) -> None:
    """Plan a fast drive through a slippery hairpin at falling noise.

    The plans are driven in a calm world and in thousands of noisy ones.
    """
    from .car_chart import car_chart  # it loads matplotlib

    path = prepared(out, ".png")
    plans = plans_at(device)
    show_rows(f"plans, a calm hard car, and {worlds} noisy ones each", [row(p, worlds, seed) for p in plans])
    chosen = [next(p for p in plans if p.sigma == sigma) for sigma in (SIGMAS[0], SIGMAS[-1])]
    tracks = [outcomes(p.result, 60, seed + 1) for p in chosen]
    car_chart(path, [p.name for p in chosen], [p.result for p in chosen], tracks, CRASH)
    typer.echo(f"wrote {path}")
