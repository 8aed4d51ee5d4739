"""Study "derivatives": error of the step's Jacobians A, B of the finger against their cost.

Every program is judged against the converged derivative of its own model (differences.py): ours by
differences of sixth order in float64, MuJoCo's the same with its solver and its collisions at the tightest
tolerances (its distance of ellipsoids is iterative; with default tolerances its step has other derivatives).
States: `touching`, in which the program's own contact acts (MuJoCo's: a negative distance); `onset`, our
first step in which it acts, the gap still open; `edge`, onset states moved to a gap of less than 1e-6 m. In
the last two MuJoCo's step has no contact yet: its derivative is that of the free motion, and at the edge
differences reach across. Edge states are rare on a trajectory; what rests or lands passes through them.
"""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

import slcp_warp as slcp

from ..mechanics.scene import distance
from ..peers.mujoco_model import Peer, import_mujoco
from ..shared.differences import Step, central, converged, forward, relative
from ..shared.ours import PAPER, Ours
from ..shared.rows import ONE_THREAD, Rows, Say, report, timed
from ..shared.timing import Case
from ..shared.workload import make_workload

SIGMAS = (0.1, 0.02, 0.005)
EPSILONS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
SETTLED = 1e-3  # a state counts if its truth is known this well
EDGE = 1e-6  # [m]
TIGHT = {"tolerance": "1e-15", "ls_tolerance": "1e-6", "iterations": "200", "ls_iterations": "100",
         "ccd_tolerance": "1e-12", "ccd_iterations": "100"}  # fmt: skip
WHAT = "A and B, largest error relative to the largest entry, median over states"


def states(count: int, seed: int = 0) -> dict[str, np.ndarray]:
    """(x, u) of every kind, (count, nx + nu), float32's numbers."""
    scene = slcp.scenes.flicking_finger()
    ours = Ours(make_workload(scene, 1500, 50, seed), "float64")
    z = np.concatenate([ours.states[:, :-1], ours.work.controls], axis=2).astype(np.float32)
    acts = ours.touching
    gap = distance(scene, z[..., : scene.nv].reshape(-1, scene.nv).astype(float)).reshape(acts.shape)
    first = acts & (gap > 1e-3)
    first[:, 1:] &= ~acts[:, :-1]
    rng = np.random.default_rng(seed)
    chosen = {"touching": acts & (gap < 0.01), "onset": first}
    out = {name: rng.permutation(z[mask].astype(float))[:count] for name, mask in chosen.items()}
    out["edge"] = at_gap(scene, out["onset"], rng.uniform(0.0, EDGE, len(out["onset"])))
    return out


def at_gap(scene: Any, z: np.ndarray, target: np.ndarray) -> np.ndarray:
    """The states with their position moved along the distance's slope to a gap of `target` (B,)."""
    z, nv = z.copy(), scene.nv
    for _ in range(8):
        q = z[:, :nv]
        d = distance(scene, q)
        slope = np.stack(
            [(distance(scene, q + e) - distance(scene, q - e)) / 2e-6 for e in 1e-6 * np.eye(nv)], 1
        )
        z[:, :nv] -= ((d - target) / (slope**2).sum(1))[:, None] * slope
    return z


def our_step(sim: slcp.Simulator, params: Any) -> Step:
    """The step of a simulator on rows (x, u); NaN where it was not solved."""
    kind = np.dtype(sim.dtype.__name__)

    def step(z: np.ndarray) -> np.ndarray:
        z = z.astype(kind, copy=False)
        done = sim.rollout(np.ascontiguousarray(z[:, : sim.nx]), z[:, None, sim.nx :], params)
        after = done.states[:, 1]
        after[done.status != slcp.Status.SOLVED] = np.nan
        return after

    return step


def peer_step(peer: Peer, nx: int) -> Step:
    """MuJoCo's step on rows (x, u), each without a warm start."""

    def step(z: np.ndarray) -> np.ndarray:
        out, data = np.zeros((len(z), nx)), peer.data[0]
        for i, row in enumerate(z):
            peer.set_state(row[:nx], row[nx:])
            peer.mujoco.mj_step(peer.model, data)
            out[i, : nx // 2], out[i, nx // 2 :] = data.qpos, data.qvel
        return out

    return step


def peer_touching(count: int, seed: int = 0) -> np.ndarray:
    """(x, u) on the way of MuJoCo's own rollouts where its distance is negative, (count, nx + nu)."""
    scene = slcp.scenes.flicking_finger()
    peer, work = Peer(scene), make_workload(scene, 200, 50, seed)
    before = np.concatenate([work.x0[:, None], peer.rollout(work)[:, :-1]], axis=1)
    z = np.concatenate([before, work.controls], axis=2)[peer.touching(before)]
    return np.random.default_rng(seed).permutation(z)[:count]


def peer_truth(kind: str, z: np.ndarray, nx: int) -> tuple[np.ndarray, np.ndarray]:
    """MuJoCo's converged Jacobians and their uncertainty; at the edge those of its step without contact."""
    peer = Peer(slcp.scenes.flicking_finger(), 1, **TIGHT)
    if kind == "edge":  # differences would reach across here, too
        peer.model.opt.disableflags |= peer.mujoco.mjtDisableBit.mjDSBL_CONTACT
    return converged(peer_step(peer, nx), z)


def point(kind: str, curve: str, **facts: Any) -> dict[str, Any]:
    """The columns that all rows have."""
    return {"study": "derivatives", "problem": f"finger, {kind}", "curve": curve, "h": 0.05,
            "error_of": WHAT, "cost_of": "Jacobian", "threads": 1, "device": "cpu", **facts}  # fmt: skip


def judged(error: np.ndarray, uncertainty: np.ndarray) -> dict[str, Any]:
    """Median and 90 % of the errors of states whose truth is settled."""
    known = uncertainty <= SETTLED
    error = np.where(np.isfinite(error), error, np.inf)[known]
    return {"error": float(np.median(error)), "error_p90": float(np.quantile(error, 0.9)),
            "states": int(known.sum()), "unsettled": int((~known).sum()),
            "truth_p90": float(np.quantile(uncertainty[known], 0.9))}  # fmt: skip


def our_cases(
    kind: str, z: np.ndarray, sigma: float, epsilons: tuple[float, ...], dtypes: tuple[str, ...]
) -> list[Case]:
    """Exact Jacobians in each precision, float64 first, and differences of the step."""
    sims = {d: slcp.Simulator(slcp.scenes.flicking_finger(), PAPER, device="cpu", dtype=d)
            for d in dtypes}  # fmt: skip
    params = {d: sim.params.replace(sigma=sigma) for d, sim in sims.items()}
    truth, uncertainty = converged(our_step(sims["float64"], params["float64"]), z)
    cases = []

    def add(curve: str, dtype: str, run: Callable[[], np.ndarray], **facts: Any) -> None:
        shared = {"program": "slcp-warp", "sigma": sigma, "dtype": dtype, "residual": PAPER.residual,
                  "scaling": PAPER.scaling, **judged(relative(run(), truth), uncertainty)}  # fmt: skip
        name = f"{curve} {sigma} {facts.get('value', '')}"
        cases.append(Case(name, run, len(z), facts=point(kind, curve, **shared, **facts)))

    for dtype, sim in sims.items():
        kept = z.astype(dtype)
        x, u = np.ascontiguousarray(kept[:, : sim.nx]), np.ascontiguousarray(kept[:, sim.nx :])
        add(
            f"exact, {dtype}",
            dtype,
            functools.partial(exact, sim, x, u, params[dtype]),
            knob="sigma",
            value=sigma,
        )
        step = our_step(sim, params[dtype])
        for eps in epsilons:
            methods = {"centred": central} | ({"forward": forward} if dtype == "float64" else {})
            for name, method in methods.items():
                run = functools.partial(method, step, kept, eps)
                add(f"differences of ours, {name}, {dtype}", dtype, run, knob="eps", value=eps)
    return cases


def exact(sim: slcp.Simulator, x: np.ndarray, u: np.ndarray, params: Any) -> np.ndarray:
    """(A, B) by the implicit function theorem, (B, nx, nz)."""
    lin = sim.linearize(x, u, params)
    return np.concatenate([lin.A, lin.B], axis=2)


def peer_cases(kind: str, z: np.ndarray, epsilons: tuple[float, ...]) -> list[Case]:
    """mjd_transitionFD, forward and centred, with MuJoCo's default solver and with a tight one."""
    scene = slcp.scenes.flicking_finger()
    nx = 2 * scene.nv
    x, u = np.ascontiguousarray(z[:, :nx]), np.ascontiguousarray(z[:, nx:])
    truth, uncertainty = peer_truth(kind, z, nx)
    cases = []
    for label, centred, options in (
        ("forward", False, {}), ("centred", True, {}), ("centred, tight solver", True, TIGHT)
    ):  # fmt: skip
        peer = Peer(scene, 1, **options)

        def set_states(peer: Peer = peer) -> None:
            for state, control in zip(x, u):
                peer.set_state(state, control)

        for eps in epsilons:
            run = functools.partial(peer.finite_differences, x, u, centred, eps)
            found = judged(relative(run(), truth), uncertainty)
            facts = point(kind, f"MuJoCo, {label}", program="MuJoCo", version=peer.version, knob="eps",
                          value=eps, dtype="float64", **found,
                          note="" if kind == "touching" else "no contact in this step")  # fmt: skip
            cases.append(Case(f"{label} {eps}", run, len(z), overhead=set_states, facts=facts))
    return cases


def study(
    count: int,
    sigmas: tuple[float, ...],
    epsilons: tuple[float, ...],
    repeats: int,
    mujoco: bool = True,
    dtypes: tuple[str, ...] = ("float64", "float32"),
) -> Rows:
    """Rows of all kinds of states, one thread."""
    rows = []
    for kind, z in states(count).items():
        for sigma in sigmas:
            cases = our_cases(kind, z, sigma, epsilons, dtypes)
            if mujoco and sigma == sigmas[0]:
                some = max(count // 5, 1)
                cases += peer_cases(kind, peer_touching(some) if kind == "touching" else z[:some], epsilons)
            rows += timed(cases, repeats)
    return [row | {"clock": ONE_THREAD} for row in rows]


def rows(say: Say) -> Rows:
    """All of the study."""
    try:
        import_mujoco()
        mujoco = True
    except ModuleNotFoundError as error:
        say(f"without MuJoCo: {error}")
        mujoco = False
    done = study(1000, SIGMAS, EPSILONS, 3, mujoco)
    return report(
        say, done, "problem", "curve", "sigma", "value", "error", "error_p90", "seconds", "unsettled"
    )
