"""`slcp grip`: how hard to hold an object (section II), with and without noise in the optimiser's model."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ensembles.statistics import share_interval
from slcp_warp.ensembles.sweep import sweep_scene

from ..support.options import Device, Seed
from ..support.screen import console, one_line_errors, prepared, show_rows

SIGMAS = (0.1, 0.05, 0.02, 0.01, 0.002)
HORIZON = 60
EFFORT, SLIP = 1e-3, 200.0  # weights of the forces [1/N^2] and of the object's vertical velocity [s^2/m^2]
OBJECT_X, OBJECT_Y = 2, 3
DROP = 0.005  # [m]; a world holds if the object sank less within DURATION
DURATION = 2.0  # [s]
SPREAD = {"friction": 0.15, "mass": 0.1}  # standard deviations of the logarithm
FORCE_SD, KICK_TIMES, KICK_SD = 1.0, (0.5, 1.0, 1.5), 0.02  # [N] every step; [m/s, rad/s]


def cone_edge(scene: slcp.Scene) -> float:
    """The least force f of either finger that holds the object, 2 mu f = m g [N]."""
    values = scene.default_parameters()
    weight = -values["mass"][-1] * values["gravity"][1]
    return float(weight / values["friction"].sum())


def creep(force: Any, scene: slcp.Scene, sigma: float) -> Any:
    """Downward velocity [m/s] at which the smoothed contacts carry the object at its fingers' height.

    Logistic REM: D lambda = s(z) and w = s(-z) give w = -sigma log(1 - exp(-D lambda / sigma)); the normal
    force and the weight fix the impulses of a contact's two rows, and mu v_t is half the difference of their
    w. Infinite at the cone's edge and beyond; D is the diagonal of the inertia seen by either row, in which a
    finger's damper counts as mass h c.
    """
    values, h = scene.default_parameters(), scene.step_size
    mu, (finger, _, mass), radius = values["friction"][0], values["mass"], values["radius"][2, 0]
    finger = finger + h * values["damping"][0] * scene.implicit_damping
    D = 1.0 / finger + (1.0 + mu**2) / mass + (mu * radius) ** 2 / values["inertia"][2]
    edge, force = cone_edge(scene), np.asarray(force, float)
    inside = np.maximum(force - edge, 1e-300)
    x_up, x_down = D * h * (force + edge) / (2.0 * sigma), D * h * inside / (2.0 * sigma)
    speed = sigma / (2.0 * mu) * (np.log(-np.expm1(-x_up)) - np.log(-np.expm1(-x_down)))
    return np.where(force > edge, speed, np.inf)


def cost_of_grip() -> ddp.Cost:
    """Effort of both fingers against the object's velocity; a little weight keeps it in the middle."""
    Q = np.zeros(10)
    Q[OBJECT_X] = Q[5 + OBJECT_X] = 1.0
    Q[5 + OBJECT_Y] = SLIP
    return ddp.costs.quadratic(np.diag(Q), EFFORT * np.eye(2), np.diag(10.0 * Q))


def optimal_grip(sim: slcp.Simulator, sigma: float) -> ddp.Result:
    """DDP from a grip of twice the edge."""
    problem = ddp.Problem(sim, cost_of_grip(), HORIZON, params=sim.params.replace(sigma=sigma))
    force = 2.0 * cone_edge(sim.scene)
    start = np.tile([force, -force], (HORIZON, 1))
    return ddp.solve(problem, sim.scene.x0, start, ddp.Options(max_iterations=300))


def held(plan: ddp.Result, feedback: bool) -> ddp.TrackingPolicy:
    """The middle of a plan, away from both ends, as a stationary policy about the state of rest.

    Not about the plan's own states: those creep, and a hard object, which does not, would be held less firmly
    for it.
    """
    k = HORIZON // 2
    gain = plan.K[k : k + 1] if feedback else 0.0 * plan.K[:1]
    return ddp.TrackingPolicy(replace(plan, us=plan.us[k : k + 1], xs=0.0 * plan.xs[:2], K=gain))


def constant(plan: ddp.Result, force: float) -> ddp.TrackingPolicy:
    """A grip of one force; `plan` gives only the form of a result."""
    still = replace(plan, us=np.array([[force, -force]]), xs=0.0 * plan.xs[:2], K=0.0 * plan.K[:1])
    return ddp.TrackingPolicy(still)


def edge_by_simulation(scene: slcp.Scene, device: str | None) -> float:
    """The least of 200 forces around the cone's edge that holds the object for DURATION in hard steps."""
    sim = slcp.Simulator(scene, slcp.Options(residual="hard"), device=device)
    force = cone_edge(scene) * np.linspace(0.9, 1.1, 201)
    controls = np.repeat(np.stack([force, -force], 1)[:, None], round(DURATION / scene.step_size), 1)
    drop = -sim.rollout(np.zeros((len(force), 10)), controls).states[:, -1, OBJECT_Y]
    return float(force[drop < DROP].min())


def holding(
    scene: slcp.Scene, policies: Sequence[Any], worlds: int, seed: int, device: str | None
) -> list[tuple[float, float, float]]:
    """Share of perturbed hard worlds in which each policy holds, with its 95 % interval."""
    spec = slcp.SweepSpec(
        worlds=worlds, duration=DURATION, residuals=("hard",), step_sizes=(scene.step_size,),
        parameter_sd=SPREAD, torque_sd=FORCE_SD, kick_times=KICK_TIMES, kick_sd=KICK_SD, window=0.5,
        observe=OBJECT_Y, sample_every=0.1, seed=seed,
    )  # fmt: skip
    shares = []
    for policy in policies:
        report = sweep_scene(scene, policy, spec, dtype="float64", device=device)
        kept = (report.samples[0][:, -1] > -DROP) & (report.table["status"] == slcp.Status.SOLVED)
        shares.append(share_interval(int(kept.sum()), worlds))
    return shares


def cone_share(force: float, scene: slcp.Scene, samples: int = 200_000) -> float:
    """Share of the drawn frictions and masses for which the force lies inside the cone: statics alone."""
    rng = np.random.default_rng(0)
    values = scene.default_parameters()
    mu = values["friction"] * np.exp(SPREAD["friction"] * rng.standard_normal((samples, 2)))
    mass = values["mass"][-1] * np.exp(SPREAD["mass"] * rng.standard_normal(samples))
    return float(np.mean(mu.sum(1) * force > -mass * values["gravity"][1]))


@one_line_errors
def grip_command(
    worlds: Annotated[int, typer.Option(min=1, help="Perturbed worlds of each grip.")] = 4000,
    out: Annotated[Path, typer.Option(help="The picture.")] = Path("grip.png"),
    device: Device = None,
    seed: Seed = 0,
) -> None:
    """Optimise the grip of the scene `grasp` at falling noise, and let thousands of hard worlds judge it."""
    from .grip_chart import grip_chart  # it loads matplotlib

    path = prepared(out, ".png")
    scene = slcp.scenes.grasp()
    sim = slcp.Simulator(scene, device=device)
    edge = cone_edge(scene)
    console.print(f"edge of the cone m g / 2 mu = {edge:.3f} N; hard steps hold from "
                  f"{edge_by_simulation(scene, device):.3f} N")  # fmt: skip
    plans = [optimal_grip(sim, sigma) for sigma in SIGMAS]
    forces = [float(plan.us[HORIZON // 2, 0]) for plan in plans]
    policies = [held(plan, feedback) for feedback in (False, True) for plan in plans]
    shares = holding(scene, policies, worlds, seed, device)
    rows = [
        {"sigma": sigma, "grip [N]": force, "grip / edge": force / edge, "passes": int(plan.iterations),
         "status": ddp.Status(int(plan.status)).name, "inside the cone": cone_share(force, scene),
         "holds": shares[i][0], "holds with feedback": shares[i + len(plans)][0]}
        for i, (sigma, force, plan) in enumerate(zip(SIGMAS, forces, plans, strict=True))
    ]  # fmt: skip
    show_rows(f"grips found, and {worlds} perturbed hard worlds each", rows)
    grid = edge * np.append(np.linspace(0.8, 1.6, 17), np.linspace(1.7, 2.4, 8))
    curve = holding(scene, [constant(plans[0], float(f)) for f in grid], worlds, seed, device)
    grip_chart(path, edge, list(SIGMAS), forces, [s[0] for s in shares[: len(plans)]], grid, np.array(curve),
               lambda f, sigma: EFFORT * f**2 + 0.5 * SLIP * creep(f, scene, sigma) ** 2)  # fmt: skip
    typer.echo(f"wrote {path}")


__all__ = ["cone_edge", "creep", "grip_command", "optimal_grip"]
