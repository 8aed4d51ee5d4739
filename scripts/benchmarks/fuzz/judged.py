"""A step of the package's on random worlds, and what the oracle says of it."""

import dataclasses
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp import Scene, StrategyError
from slcp_warp.description.acting import BUILT, acting
from slcp_warp.description.kinematics import Array
from slcp_warp.options import Options, Status

from ..mechanics.yielding import yielding
from .draws import Worlds
from .judge import Outcome
from .problem import EPSILON, Problem, Truth
from .proofs import least_motion, least_push
from .verdicts import HOLDS, Verdicts

WELL_POSED = 1e4  # condition of a mass matrix in units of its diagonal


def numbers_for(sim: Any, worlds: Worlds, seed: int = 0) -> dict[str, Array]:
    """The parameters that the simulator takes, with covariances where it has noise of the state."""
    numbers = dict(worlds.numbers)
    if "position_covariance" in sim.params.names:
        nv, rng = sim.scene.nv, np.random.default_rng(seed)
        for name, size in (("position_covariance", 1e-3), ("velocity_covariance", 0.1)):
            root = size * np.asarray(rng.standard_normal((nv, nv)), np.float32).astype(float)
            numbers[name] = np.broadcast_to(
                (root @ root.T).astype(np.float32).astype(float), (len(worlds.x), nv, nv)
            )
    if not sim.nr:
        numbers.pop("sigma")
    return numbers


def simulator(scene: Scene, options: Options, dtype: str, strategy: str, device: str = "cpu") -> Any:
    """What steps a scene: "relay" has the specialised kernels without last resorts, and those that make what
    they leave.
    """
    fast = True if strategy == "relay" else None
    strategy = "specialised" if fast else strategy
    return slcp.Simulator(scene, options, device=device, dtype=dtype, strategy=strategy, fast_path=fast)


def kind_of(sim: Any) -> Any:
    """The NumPy type of a simulator's numbers."""
    return {"float64": np.float64, "float32": np.float32}[sim.dtype.__name__]


def parameters(sim: Any, numbers: dict[str, Array]) -> Any:
    """The worlds' numbers as a simulator takes them."""
    return sim.params.replace(**{n: _read(sim, n, v) for n, v in numbers.items() if np.size(v)})


def _read(sim: Any, name: str, value: Array) -> Array:
    """Numbers of a parameter with those that the scene has in the place of what no kernel reads."""
    if name not in BUILT:
        return value
    return np.where(acting(sim.scene.structure, name), value, sim.params[name])


def step(sim: Any, worlds: Worlds, numbers: dict[str, Array], external: Array | None = None) -> Any:
    """The package's step of the worlds."""
    u = worlds.u.astype(kind_of(sim)) if sim.nu else None
    return sim.step(worlds.x.astype(kind_of(sim)), u, parameters(sim, numbers), external_force=external)


def judged(worlds: Worlds, sim: Any, push: Array | None = None, truth: Truth | None = None,
           force: Array | None = None, out: Outcome | None = None,
           reached: Array | None = None) -> tuple[Verdicts, Any]:  # fmt: skip
    """Verdicts on one step of the worlds, and the step, where `out` does not say what came of it. `push`: of
    the trapezoidal method, see `predicted`; `force` (B, nv): more generalised forces; `reached`: of the
    leapfrog, see `led`.
    """
    numbers, dtype = numbers_for(sim, worlds), sim.dtype.__name__
    full = dataclasses.replace(worlds, numbers=numbers | {"sigma": worlds.numbers["sigma"]})
    method, nv = sim.options.method, sim.scene.nv
    inner = "float64" if sim.strategy == "generic" else dtype

    def pose(keep: Array | None) -> Problem:
        out = of_some(keep)
        if whole is not None:
            out.whole = whole if keep is None else whole[keep]
        return out

    def of_some(keep: Array | None) -> Problem:
        if keep is None and truth is not None and not method.state_noise:
            here = truth
        elif keep is None:
            here = Truth(sim.scene, full, force)
        else:
            here = Truth(sim.scene, full.part(keep), None if force is None else force[keep])
        if meets is not None:
            here.meets = meets if keep is None else meets[keep]
        force_there = push if keep is None or push is None else push[keep]
        if reached is not None:
            return Problem(here, here.leap(reached if keep is None else reached[keep]), method, dtype, inner)
        return Problem(here, here.drive(force_there), method, dtype, inner)

    whole: Array | None = None
    meets: Array | None = None
    problem, done = pose(None), None
    if out is None:
        external = None if force is None else problem.truth.mech.wrenches(worlds.x[:, :nv], force)
        done = step(sim, worlds, numbers, external)
        out = Outcome.of(done)
    if sim.scene.structure.limited:  # as the step's own end has them
        rounding = EPSILON[dtype]
        if sim.scene.structure.bounces:
            meets = _unhindered(sim.scene, full, force, not method.hard)
        (full, force), truth = yielding(sim.scene, full, force, out.x, not method.hard, rounding), None
        whole = problem.diag
        problem = pose(None)
    with np.errstate(all="ignore"):
        return Verdicts(problem, out, pose), done


def _unhindered(scene: Scene, worlds: Worlds, force: Array | None, smoothed: bool) -> Array:
    """v_free (B, nv) where forces have limits: by what they are at its end."""
    nv, end = scene.nv, worlds.x.copy()
    for k in range(200):
        there, push = yielding(scene, worlds, force, end, smoothed, 0.0)
        move = Truth(scene, there, push).drive().free - end[:, nv:]
        end[:, nv:] += move * (1.0 if k < 20 else 0.5)
        if (np.abs(move) <= 1e-12 * (1.0 + np.abs(end[:, nv:]))).all():
            break
    out: Array = end[:, nv:]
    return out


def led(sim: Any, worlds: Worlds) -> tuple[Array, Array]:
    """Where the Euler step of the worlds that a simulator's leapfrog begins with leads (B, nv), which other
    parts judge, and which are solved.
    """
    options = dataclasses.replace(sim.options, integrator="euler")
    euler = simulator(sim.scene, options, "float64", "generic", sim.device.alias)
    found = step(euler, worlds, numbers_for(euler, worlds))
    return np.asarray(found.state, float)[:, sim.scene.nv :], np.asarray(found.status) == int(Status.SOLVED)


def predicted(scene: Scene, worlds: Worlds, options: Options, dtype: str) -> tuple[Array, Array]:
    """N^-1 J' lambda (B, nv) that the trapezoidal method predicts, and in which worlds it is known: where no
    row can act, where the hard problem is solved by least distances, and where without dampers the common
    kernels solve Euler's problem under a force that gives it the same free velocity and the oracle confirms
    it. Mass matrices that amplify what is left of an error are left out, Coulomb's friction, which may have
    several solutions, gaps at the end, whose predictor bends its rows, and what hangs on a rounding of gaps
    or of the normal between two points that are nearly one.
    """
    none = np.zeros((len(worlds.x), scene.nv))
    truth = Truth(scene, worlds)
    drive = truth.drive(none)
    method = dataclasses.replace(options, noise="row", gap="start").method
    p, rounded = Problem(truth, drive, method, "float64"), Problem(truth, drive, method, dtype)
    rounded.start_from(rounded.rate - rounded.tolerance * rounded.loose * rounded.size)
    known = np.full(len(worlds.x), method.hard) & (p.free > 0.0).all(1)
    push = none.copy()
    if method.coulomb or options.gap == "end":
        return push, known & (options.gap == "start")
    if method.hard:
        other = push.copy()
        for i in np.flatnonzero(~known).tolist():
            found = least_motion(p, i)
            if found is not None and p.condition[i] < WELL_POSED:
                push[i] = least_push(p, i, found[1])
                known[i] = not (rounded.turned[i] & (found[1] > 0.0)).any()
                found = least_motion(rounded, i)
                other[i] = push[i] if found is None else least_push(rounded, i, found[1])
        change = np.abs(truth.drive(other).rhs - truth.drive(push).rhs)
        return push, known & (change <= rounded.tolerance * drive.size).all(1)
    euler = dataclasses.replace(options, integrator="euler", gap="start")
    plain = dataclasses.replace(scene, implicit_stiffness=False)  # impulses act through M in both methods
    try:
        sim = slcp.Simulator(plain, euler, device="cpu", strategy="generic")
    except StrategyError:
        return push, known
    start = Truth(plain, worlds).drive()
    force = np.einsum("bij,bj->bi", start.h_mass, drive.free - start.free) / truth.h[:, None]
    verdicts, done = judged(worlds, sim, force=force)
    sure = (verdicts.verdict == HOLDS) & (np.asarray(done.status) == Status.SOLVED)
    sure &= ~known & ~truth.motion.damping.any((1, 2))
    sure &= (p.condition < WELL_POSED) & ~(rounded.turned & (np.asarray(done.impulse) > 0.0)).any(1)
    found = np.asarray(done.state, float)[:, scene.nv :] - drive.free
    return np.where(sure[:, None], found, push), known | sure
