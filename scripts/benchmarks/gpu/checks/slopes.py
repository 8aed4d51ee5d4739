"""Derivatives on the device: A and B against differences and the CPU's, gradients, a few passes of DDP."""

import numpy as np

import slcp_warp as slcp

from ...fuzz.differences import LIMIT, jacobian_errors
from ..record import Found
from ..setting import CPU, DOUBLE, Setting, cast
from ..uses import workspace

CLOSE = {"float64": 1e-6, "float32": 3e-2}  # of the largest entry of a world: roundings, after contact
SHARE = {"float64": 1e-3, "float32": 2e-2}  # of worlds that may be further off
COST = {"float64": 1e-6, "float32": 1e-2}  # of the cost after three passes of DDP
COMPARED, PASSES, LENGTH = 200, 3, 20


def run(setting: Setting, found: Found) -> None:
    """In both precisions; differences in double precision only."""
    for dtype in setting.sizes.dtypes:
        _linearize(setting, found, dtype)
        _generic(setting, found, dtype)
        _gradients(setting, found, dtype)
        _planned(setting, found, dtype)
    _differences(setting, found)


def _linearize(setting: Setting, found: Found, dtype: str) -> None:
    work = setting.workload(setting.sizes.states)
    x, u = cast(dtype, work.x0, work.controls[:, 0])
    mine, cpu = (setting.finger(dtype, device=device).linearize(x, u) for device in (setting.device, CPU))
    solved = (mine.status == 0) & (cpu.status == 0)
    for name in ("A", "B"):
        _beside(found, f"{name}, {dtype}", dtype, getattr(mine, name)[solved], getattr(cpu, name)[solved])


def _generic(setting: Setting, found: Found, dtype: str) -> None:
    """A, B and gradients of the stack, about its rest, from generic kernels."""
    scene = setting.stack(dtype).scene
    x0, h = scene.x0, scene.step_size
    rng = np.random.default_rng(setting.seed)
    (x,) = cast(dtype, x0 + 1e-3 * rng.standard_normal((setting.sizes.gradients, len(x0))))
    mine, cpu = (setting.stack(dtype, device).linearize(x) for device in (setting.device, CPU))
    solved = (mine.status == 0) & (cpu.status == 0)
    found.at_most(f"stack of 3, {dtype}: without derivatives", float(1.0 - solved.mean()), 0.05)
    _beside(found, f"stack of 3: A, {dtype}", dtype, mine.A[solved], cpu.A[solved])
    us, weights = cast(dtype, np.zeros((len(x), 2, 0)), rng.standard_normal((len(x), 3, x.shape[1])))
    pulled, other = (
        slcp.vjp(setting.stack(dtype, device), x, us, weights, parameters="mass")
        for device in (setting.device, CPU)
    )
    solved = (pulled.status == 0) & (other.status == 0)
    a, b = (each.parameters["mass"][solved] for each in (pulled, other))
    # of boxes that rest it is zero, a difference of what weight and contact do in a step
    terms = float(
        h * np.abs(scene.gravity).max() * np.abs(weights).max() / min(body.mass for body in scene.bodies)
    )
    _beside(found, f"stack of 3: gradient by mass over 2 steps, {dtype}", dtype, a, b, terms)


def _gradients(setting: Setting, found: Found, dtype: str) -> None:
    """By starts, controls and masses, of random weights on the states of a rollout."""
    count, steps = setting.sizes.gradients, min(LENGTH, setting.sizes.steps)
    work = setting.workload(count, steps)
    weights = np.random.default_rng(setting.seed).standard_normal((count, steps + 1, work.x0.shape[1]))
    x, us, w = cast(dtype, work.x0, work.controls, weights)
    mine, cpu = (
        slcp.vjp(setting.finger(dtype, device=device), x, us, w, parameters="mass")
        for device in (setting.device, CPU)
    )
    solved = (mine.status == 0) & (cpu.status == 0)
    pairs = {"x0": (mine.x0, cpu.x0), "controls": (mine.controls, cpu.controls),
             "mass": (mine.parameters["mass"], cpu.parameters["mass"])}  # fmt: skip
    for name, (a, b) in pairs.items():
        _beside(found, f"gradient by {name} over {steps} steps, {dtype}", dtype, a[solved], b[solved])


def _beside(
    found: Found, case: str, dtype: str, mine: np.ndarray, cpu: np.ndarray, terms: float = 1e-30
) -> None:
    """Relative to the largest entry of a world, or the size of the `terms` that entries are sums of."""
    a, b = (np.asarray(each, float).reshape(len(each), -1) for each in (mine, cpu))
    apart = np.abs(a - b).max(1) / np.maximum(np.abs(b).max(1), terms)
    figures = {"median": np.median(apart), "largest": apart.max(), "same_bits": (a == b).mean()}
    share = float(np.mean(~(apart <= CLOSE[dtype])))
    found.at_most(f"{case}: further than {CLOSE[dtype]:g} from the CPU's", share, SHARE[dtype], **figures)


def _planned(setting: Setting, found: Found, dtype: str) -> None:
    """Costs after the first rollout and after three passes from zero controls, of starts of their own."""
    count = min(16, setting.sizes.gradients)
    starts, zeros = setting.near_start(count), np.zeros((count, setting.sizes.horizon, 2))
    mine, cpu = (
        workspace(setting, dtype, count, PASSES, device).solve(starts, zeros)
        for device in (setting.device, CPU)
    )
    first = mine.trace.cost[:, 0], cpu.trace.cost[:, 0]
    for name, (a, b), most in (
        ("the first rollout", first, COST[dtype] * 1e-2),
        (f"{PASSES} passes", (mine.cost, cpu.cost), COST[dtype]),
    ):
        apart = np.abs(a - b) / (1.0 + np.abs(b))
        share = float(np.mean(~(apart <= most)))
        found.at_most(f"cost after {name}, {dtype}: further than {most:g} from the CPU's", share, 0.2,
                      largest=apart.max(), median=np.median(apart))  # fmt: skip
    rose = float(np.mean(mine.cost > first[0]))
    found.at_most(f"problems whose cost rose, {dtype}", rose, 0.0, fell=np.mean(mine.cost < first[0]))


def _differences(setting: Setting, found: Found) -> None:
    """A and B against central differences of the device's own steps."""
    sim = setting.finger(DOUBLE)
    work = setting.workload(min(COMPARED, setting.sizes.states))
    error, trusted = jacobian_errors(sim, work.x0, work.controls[:, 0], sim.params)
    worst = float(error[trusted].max(initial=0.0))
    found.at_most("A and B against differences of steps, float64", worst, LIMIT, compared=trusted.sum())
