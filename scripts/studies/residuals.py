"""`slcp residuals`: are the finger's plans and libraries under (15) and (17) alike, as the paper says?"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
import typer

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.planning import random_starts
from slcp_warp.ensembles.sweep import sweep_scene

from ..stages.library import build
from ..support.options import Device, Seed
from ..support.paper import OBSERVED
from ..support.screen import one_line_errors, show_rows

HORIZON, ENTRIES = 75, 4
PASSES, REPLAN_PASSES = 150, 20
OBJECT = 2  # theta_3
HIT = 0.05  # [N s] of normal impulse in a step that counts as contact
SPREAD = 1.8138  # standard deviation of a logistic variable of scale 1


@dataclass(frozen=True)
class Case:
    """A residual with its sigma (a logistic's scale, a normal's standard deviation)."""

    residual: str
    sigma: float

    def problem(self, device: str | None) -> ddp.Problem:
        """The paper's problem, section V."""
        scene = slcp.scenes.flicking_finger()
        sim = slcp.Simulator(scene, slcp.Options(residual=self.residual, scaling="none"), device=device)
        params = sim.params.replace(sigma=self.sigma)
        return ddp.Problem(sim, slcp.tasks.flicking_finger().cost, HORIZON, params)


CASES = (
    Case("rem-logistic", 0.1),
    Case("rem-normal", 0.1 * SPREAD),
    Case("erm-normal", 0.1 * SPREAD),
    Case("erm-normal", 0.1),
)


def hits(problem: ddp.Problem, result: ddp.Result) -> np.ndarray:
    """How often each plan begins to push, (B,): runs of steps with more than HIT of normal impulse."""
    sim = problem.dynamics
    impulse = sim.rollout(result.xs[:, 0], result.us, problem.params, record="impulse").impulse
    rows = [i for i, row in enumerate(sim.scene.structure.rows) if row.kind == "contact"]
    touching = impulse[:, :, rows].sum(-1) > HIT
    return np.asarray((np.diff(touching.astype(int), axis=1) > 0).sum(1) + touching[:, 0])


def plan_row(case: Case, result: ddp.Result, base: ddp.Result, pushes: np.ndarray) -> dict[str, Any]:
    """What a batch of plans is like, and how it goes with the plans of the first model that it came from."""
    fine = np.isfinite(result.cost)
    turned, before = (r.xs[fine, -1, OBJECT] - r.xs[fine, 0, OBJECT] for r in (result, base))
    apart = np.abs(result.xs[:, :, :3] - base.xs[:, :, :3]).max((1, 2))
    return {
        "residual": case.residual, "sigma": case.sigma, "median cost": float(np.median(result.cost[fine])),
        "best cost": float(result.cost.min()), "converged": int(result.converged.sum()),
        "turned [rad]": float(np.median(turned)), "pushes": float(pushes[fine].mean()),
        "costs correlate": float(np.corrcoef(result.cost[fine], base.cost[fine])[0, 1]),
        "turns correlate": float(np.corrcoef(turned, before)[0, 1]),
        "within .5 rad": float(np.mean(apart < 0.5)),
    }  # fmt: skip


def plan_rows(count: int, seed: int, device: str | None) -> list[dict[str, Any]]:
    """The same random starts solved in the first model; then each plan solved again in the other models."""
    options = ddp.Options(max_iterations=PASSES)
    base: ddp.Result | None = None
    rows = []
    for case in CASES:
        problem = case.problem(device)
        x0 = np.tile(problem.dynamics.scene.x0, (count, 1))
        if base is None:
            us = random_starts(count, HORIZON, 2, 1.0, seed)
            base = result = ddp.solve(problem, x0, us, options)
        else:
            result = ddp.solve(problem, x0, base.us, options, xs0=base.xs, K0=base.K)
        rows.append(plan_row(case, result, base, hits(problem, result)))
    return rows


def library_of(case: Case, plans: int, seed: int, device: str | None) -> ddp.Library:
    """A library as `slcp library` builds it."""
    problem = case.problem(device)
    return build(
        problem,
        problem.dynamics.scene.x0,
        plans,
        ddp.RecedingOptions(entries=ENTRIES, seed=seed),
        OBSERVED,
    )


def replanned(library: ddp.Library, device: str | None) -> Iterator[tuple[Case, ddp.Library]]:
    """The library's states planned anew, from its policy in the first model, thence in the others."""
    x0, base = library.x[library.age == 0], None
    options = ddp.Options(max_iterations=REPLAN_PASSES)
    for case in CASES:
        problem = case.problem(device)
        if base is None:
            run = problem.dynamics.rollout(x0, policy=library.policy(), steps=HORIZON, record="controls")
            base = result = ddp.solve(problem, x0, np.nan_to_num(run.controls), options)
        else:
            result = ddp.solve(problem, x0, base.us, options, xs0=base.xs, K0=base.K)
        count, n = len(x0), ENTRIES
        yield case, replace(
            library, x=result.xs[:, :n].reshape(n * count, -1), u=result.us[:, :n].reshape(n * count, -1),
            K=result.K[:, :n].reshape(n * count, 2, -1), cost=np.repeat(result.cost, n),
            gain=np.zeros(n * count), age=np.tile(np.arange(n), count), chain=np.zeros(n * count, int),
            plan=np.repeat(np.arange(count), n), lower=np.repeat(result.lower, n, 0),
            upper=np.repeat(result.upper, n, 0),
        )  # fmt: skip


def judged(library: ddp.Library, worlds: int, seed: int, device: str | None) -> dict[str, Any]:
    """The library's controller on kicked hard fingers for 20 s."""
    scene = slcp.scenes.flicking_finger()
    spec = slcp.SweepSpec(worlds=worlds, residuals=("hard",), observe=OBJECT, velocity_sd=2.0, seed=seed)
    case = sweep_scene(scene, library.policy(), spec, scaling="none", device=device).cases[0]
    return {"rate [rad/s]": case["mean_rate"][0], "above .5 rad/s [%]": 100.0 * case["share_above"][0]}


def library_rows(
    plans: int, seeds: range, worlds: int, device: str | None
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Libraries of their own, for every seed; and the first one's states planned anew in every model."""
    own: list[dict[str, Any]] = []
    anew: list[dict[str, Any]] = []
    for case in CASES:
        for seed in seeds:
            library = library_of(case, plans, seed, device)
            gain = float(np.median(library.gain[library.age == 0]))
            facts = {"residual": case.residual, "sigma": case.sigma, "seed": seed, "median gain": gain}
            own.append(facts | judged(library, worlds, seed, device))
            if not anew:
                anew = [
                    {"residual": c.residual, "sigma": c.sigma, "median cost": float(np.median(again.cost))}
                    | judged(again, worlds, seed, device)
                    for c, again in replanned(library, device)
                ]
    return own, anew


@one_line_errors
def residuals_command(
    starts: Annotated[int, typer.Option(min=2, help="Random starts of the single plans.")] = 32,
    plans: Annotated[int, typer.Option(min=1, help="Plans of a library.")] = 200,
    seeds: Annotated[int, typer.Option(min=1, help="Libraries of each residual.")] = 1,
    worlds: Annotated[int, typer.Option(min=1, help="Hard worlds of each library.")] = 1024,
    device: Device = None,
    seed: Seed = 0,
) -> None:
    """Compare the finger's plans and libraries under the residuals (15) and (17).

    It takes half an hour on two cores.
    """
    show_rows(f"{starts} plans of the first residual, each solved again with the others",
              plan_rows(starts, seed, device))  # fmt: skip
    own, anew = library_rows(plans, range(seed, seed + seeds), worlds, device)
    show_rows(f"libraries of {plans} plans, each of its own residual, on the hard finger", own)
    show_rows("the states of the first library, planned anew with each residual, on the hard finger", anew)
