"""`slcp truth`: the smoothed step beside the mean of the hard step under noise, units, costs under noise."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import slcp_warp as slcp
from slcp_warp import Contact, Scene, Shape, ddp

from ..support.options import Seed
from ..support.screen import one_line_errors, show_rows
from ..support.tables import write_csv

HEIGHTS = (-0.002, 0.0, 0.002, 0.005)  # gap [m]
SD = 0.1  # of the noise on b [m/s]
H = 0.02
HORIZON = 75
SIGMAS = (0.2, 0.1, 0.05, 0.01, 0.003)  # of the plans
NOISE = (0.0, 0.02, 0.05, 0.1)  # on every velocity, before every step [rad/s]
UNITS = ((1e3, 1.0, "gram"), (1.0, 1e3, "millimetre"), (1e3, 1e3, "gram, millimetre"))


def column(count: int) -> Scene:
    """Point masses over each other on one vertical line, touching: every row couples with its neighbours."""
    bodies = tuple(
        slcp.Body(f"mass{i}", 1.0, 1.0, joint="prismatic", axis=(0.0, 1.0), anchor=(0.0, 0.2 * i))
        for i in range(count)
    )
    shapes = tuple(Shape(b.name, b.name, "disc", 0.1) for b in bodies)
    ground = Shape("ground", None, "halfplane", offset=(0.0, -0.1), angle=np.pi / 2)
    pairs = [Contact("ground", "mass0")]
    pairs += [Contact(a.name, b.name) for a, b in zip(bodies, bodies[1:])]
    return Scene(f"column{count}", bodies, (*shapes, ground), tuple(pairs), step_size=H)


def cases() -> dict[str, tuple[Scene, np.ndarray]]:
    """Scenes with a state at rest or sliding, at gap 0."""
    slide = np.array([0.0, 0.0, 0.0, 0.3, 0.0, 0.0])
    return {
        "one row": (slcp.scenes.particle(), np.zeros(6)),
        "friction .5, at rest": (slcp.scenes.particle(friction=0.5), np.zeros(6)),
        "friction .5, sliding": (slcp.scenes.particle(friction=0.5), slide),
        "stack of 3": (column(3), np.zeros(6)),
    }


def against_particles(count: int, seed: int) -> list[dict[str, Any]]:
    """The vertical impulse on the ground, smoothed by eq. (18) and as the mean over particles."""
    rows = []
    for name, (scene, start) in cases().items():
        vertical = [1] if scene.bodies[0].joint == "free" else list(range(scene.nv))
        hard = slcp.Simulator(scene, slcp.Options(residual="hard"))
        smooth = {
            residual: slcp.Simulator(scene, slcp.Options(residual=residual, noise="state"))
            for residual in ("rem-normal", "rem-logistic")
        }
        spread = np.zeros((2 * scene.nv, 2 * scene.nv))
        spread[vertical, vertical] = (H * SD) ** 2
        for height in HEIGHTS:
            x = start.copy()
            x[vertical] = height
            for residual, sim in smooth.items():
                logistic = residual == "rem-logistic"
                cloud = slcp.particles(hard, x, params=hard.params.replace(step_size=H), covariance=spread,
                                       count=count, logistic=logistic, seed=seed)  # fmt: skip
                params = sim.params.replace(
                    step_size=H, position_covariance=spread[: scene.nv, : scene.nv], velocity_covariance=0.0
                )
                ground = [i for i, row in enumerate(scene.structure.rows) if row.index == 0]
                smoothed = float(sim.step(x, None, params).impulse[ground].sum())
                rows.append({
                    "case": name, "residual": residual, "gap": height,
                    "mean of hard": float(cloud.impulse[ground].sum()),
                    "error": float(np.sqrt((cloud.impulse_error[ground] ** 2).sum())), "smoothed": smoothed,
                })  # fmt: skip
    return rows


def in_units(sim: slcp.Simulator, mass: float, length: float, sigma_too: bool) -> slcp.Parameters:
    """The finger's numbers in other units of mass and length; torques and angles keep their meaning."""
    p, torque = sim.params, mass * length**2
    contact = [row.kind == "contact" for row in sim.scene.structure.rows]
    sigma = np.where(contact, length if sigma_too else 1.0, 1.0) * p["sigma"]
    scaled = {"gravity", "com", "anchor", "radius", "shape_offset"}
    return p.replace(
        mass=mass * p["mass"], inertia=torque * p["inertia"], damping=torque * p["damping"],
        gear=torque * p["gear"], sigma=sigma, **{name: length * p[name] for name in scaled},
    )  # fmt: skip


def unit_differences(worlds: int, seed: int) -> list[dict[str, Any]]:
    """How far a step of the finger moves when only the units change, relative to the change of velocity."""
    rng = np.random.default_rng(seed)
    scene = slcp.scenes.flicking_finger()
    start = np.array([-2.2, -0.6, 0.4, 1.0, -1.0, 0.0])  # the tip near the ellipse
    x, u = start + 0.3 * rng.standard_normal((worlds, 6)), rng.standard_normal((worlds, 2))
    rows = []
    for scaling in ("inertia", "none"):
        sim = slcp.Simulator(scene, slcp.Options(scaling=scaling))
        base = sim.step(x, u)
        size = np.abs(base.state[:, 3:] - x[:, 3:]).max()
        for mass, length, unit in UNITS:
            for sigma_too in (True, False):
                other = sim.step(x, u, in_units(sim, mass, length, sigma_too))
                ok = (base.status == 0) & (other.status == 0)
                change = np.abs(other.state - base.state)[ok].max() / size
                rows.append({"scaling": scaling, "unit": unit, "sigma in the unit": sigma_too,
                             "change": float(change), "unsolved": int((~ok).sum())})  # fmt: skip
    return rows


def costs_under_noise(count: int, seed: int) -> list[dict[str, Any]]:
    """Plans for the finger made at several noise levels, on the hard system with noise on the velocity."""
    scene = slcp.scenes.flicking_finger()
    problem = ddp.Problem(slcp.Simulator(scene), slcp.tasks.flicking_finger().cost, horizon=HORIZON)
    hard = slcp.Simulator(scene, slcp.Options(residual="hard"))
    options = ddp.Options(max_iterations=300)
    plans = ddp.solve_continuation(problem, scene.x0, np.zeros((HORIZON, 2)), SIGMAS, options)
    rows = []
    for sigma, plan in zip(SIGMAS, plans):
        feedback: dict[str, Any] = {"xs": plan.xs, "K": plan.K}
        for sd in NOISE:
            spread = np.diag([0.0] * 3 + [sd**2] * 3)
            for name, policy in (("open loop", dict[str, Any]()), ("feedback", feedback)):
                run = slcp.particle_rollout(
                    hard,
                    scene.x0,
                    plan.us,
                    covariance=spread,
                    count=count,
                    seed=seed,
                    control_limits=(plan.lower, plan.upper),
                    **policy,
                )
                effort = 0.05 * (run.controls**2).sum((1, 2))
                cost = effort - run.states[:, :-1, 2].sum(1)  # as the task has it
                rows.append({
                    "sigma": sigma, "predicted": float(plan.cost), "noise": sd, "policy": name,
                    "mean": float(cost.mean()), "error": float(cost.std() / np.sqrt(count)),
                    "95 %": float(np.quantile(cost, 0.95)), "unsolved": int((run.status != 0).sum()),
                })  # fmt: skip
    return rows


@one_line_errors
def truth_command(
    count: Annotated[int, typer.Option(min=2, help="Particles of each state.")] = 100000,
    worlds: Annotated[int, typer.Option(min=1, help="States of the comparison of units.")] = 1000,
    seed: Seed = 0,
    csv: Annotated[Path | None, typer.Option(help="Also write the particles' rows here.")] = None,
) -> None:
    """Compare the smoothed step with the mean of the hard one under noise, units, and plans under noise."""
    rows = against_particles(count, seed)
    show_rows(f"impulse on the ground [N s]: noise of {SD} m/s on b, h = {H}", rows)
    show_rows("finger: largest change of a step by the units alone", unit_differences(worlds, seed))
    costs = costs_under_noise(max(count // 50, 2), seed)
    show_rows(f"finger: cost of {HORIZON} hard steps, the velocity disturbed before each", costs)
    if csv is not None:
        write_csv(csv, rows)
        typer.echo(f"wrote {csv}")
