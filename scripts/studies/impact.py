"""`slcp impact`: derivatives chained through two seconds of impacts of the finger, beside MuJoCo's."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import slcp_warp as slcp

from ..benchmarks.peers.mujoco_model import Peer
from ..benchmarks.shared.scenes import IMPACTS_DURATION as DURATION
from ..benchmarks.shared.scenes import IMPACTS_SPREAD as SPREAD
from ..benchmarks.shared.scenes import IMPACTS_START as START
from ..support.options import Seed
from ..support.screen import console, one_line_errors, prepared, show_rows

STEP_SIZES = (0.05, 0.02, 0.01, 0.005, 0.002, 0.001, 0.0005)
SIGMAS = (0.1, 0.05, 0.02)
SHIFT = 0.002  # of the ensemble's starts
CHUNK = 64  # worlds whose Jacobians are in memory at a time
NX = 6


def chained(sim: slcp.Simulator, params: slcp.Parameters, starts: np.ndarray, steps: int) -> np.ndarray:
    """dx(T)/dx0 of each start (B, NX): (B, NX, NX), the product of the steps' exact Jacobians."""
    out = []
    for first in range(0, len(starts), CHUNK):
        x0 = starts[first : first + CHUNK]
        traj = sim.rollout(x0, np.zeros((len(x0), steps, sim.nu)), params)
        if traj.status.any():
            raise RuntimeError(f"{np.count_nonzero(traj.status)} of {len(x0)} rollouts were not solved")
        flat = traj.states[:, :-1].reshape(-1, NX)
        jacobians = sim.linearize(flat, None, params).A.reshape(len(x0), steps, NX, NX)
        product = np.broadcast_to(np.eye(NX), (len(x0), NX, NX))
        for k in range(steps):
            product = jacobians[:, k] @ product
        out.append(product)
    return np.concatenate(out)


def shifted_mean(sim: slcp.Simulator, params: slcp.Parameters, starts: np.ndarray, steps: int) -> np.ndarray:
    """Differences of the ensemble's mean x(T) by shifts of all its starts, (NX, NX)."""

    def mean(shift: np.ndarray) -> np.ndarray:
        x0 = starts + shift
        us = np.zeros((CHUNK, steps, sim.nu))
        parts = [sim.rollout(x0[i : i + CHUNK], us[: len(x0[i : i + CHUNK])], params).states[:, -1]
                 for i in range(0, len(x0), CHUNK)]  # fmt: skip
        return np.concatenate(parts).mean(0)

    columns = [(mean(e) - mean(-e)) / (2.0 * SHIFT) for e in SHIFT * np.eye(NX)]
    return np.stack(columns, -1)


def ours(members: int, seed: int) -> list[dict[str, Any]]:
    """Norms and agreement for every noise level and step size."""
    scene = slcp.scenes.flicking_finger()
    spread = SPREAD * np.random.default_rng(seed).uniform(-1.0, 1.0, (members, NX))
    rows = []
    for sigma in (*SIGMAS, None):
        sim = slcp.Simulator(scene, slcp.Options(residual="hard") if sigma is None else slcp.Options())
        for h in STEP_SIZES:
            steps = round(DURATION / h)
            numbers = {"step_size": h} | ({} if sigma is None else {"sigma": sigma})
            params = sim.params.replace(**numbers)
            single = chained(sim, params, START[None], steps)[0]
            each = chained(sim, params, START + spread, steps)
            mean, differences = each.mean(0), shifted_mean(sim, params, START + spread, steps)
            rows.append({
                "model": "hard" if sigma is None else f"sigma {sigma}", "h": h,
                "norm": np.linalg.norm(single),
                "largest of ensemble": np.linalg.norm(each, axis=(1, 2)).max(),
                "norm of mean": np.linalg.norm(mean),
                "off differences of mean": np.linalg.norm(mean - differences) / np.linalg.norm(differences),
            })  # fmt: skip
    return rows


def peers() -> list[dict[str, Any]]:
    """MuJoCo's chained differences, with its default options and with those it recommends against slip."""
    rows = []
    for name, option in (
        ("MuJoCo, default", {}),
        ("MuJoCo, elliptic cones", {"cone": "elliptic", "impratio": "10"}),
    ):
        for h in STEP_SIZES:
            peer = Peer(slcp.scenes.flicking_finger(), 1, **option)
            peer.model.opt.timestep = h
            x, product = START.copy(), np.eye(NX)
            for _ in range(round(DURATION / h)):
                product = (
                    peer.finite_differences(x[None], np.zeros((1, 2)), centred=True)[0, :, :NX] @ product
                )
                peer.set_state(x, np.zeros(2))
                peer.mujoco.mj_step(peer.model, peer.data[0])
                x = np.r_[peer.data[0].qpos, peer.data[0].qvel]
            rows.append({"model": name, "h": h, "norm": np.linalg.norm(product)})
    return rows


def draw(rows: list[dict[str, Any]], out: Path) -> Path:
    """Norm of dx(T)/dx0 over the step size."""
    from ..charts.style import CASES, GREY, plt, save  # it loads matplotlib

    figure, axes = plt.subplots(figsize=(7, 4.2), layout="constrained")
    models = list(dict.fromkeys(row["model"] for row in rows))
    for i, model in enumerate(models):
        points = [(row["h"], row["norm"]) for row in rows if row["model"] == model]
        dashed = model.startswith("MuJoCo")
        axes.loglog(*zip(*points), "o--" if dashed else "o-", color=CASES[i % len(CASES)], label=model)
    axes.axhline(10.0, color=GREY, linewidth=0.8)
    axes.set(
        xlabel="step size h [s]",
        ylabel="|dx(2 s)/dx0|, Frobenius",
        title="derivatives chained through impacts",
    )
    axes.legend()
    return save(figure, out)


@one_line_errors
def impact_command(
    members: Annotated[int, typer.Option(min=2, help="Starts of the ensemble.")] = 256,
    seed: Seed = 0,
    mujoco: Annotated[bool, typer.Option(help="Also chain MuJoCo's differences (extra `bench`).")] = True,
    out: Annotated[Path | None, typer.Option(help="Draw the norms here (PNG).")] = None,
) -> None:
    """Chain derivatives through two seconds of the finger's impacts, over step sizes and noise levels."""
    out = None if out is None else prepared(out, ".png")
    rows = ours(members, seed)
    show_rows(f"dx({DURATION:g} s)/dx0, {members} starts within +-{SPREAD}", rows)
    beside = peers() if mujoco else []
    if beside:
        show_rows("chained mjd_transitionFD, centred", beside)
    if out is not None:
        console.print(f"wrote {draw(rows + beside, out)}")
