"""Where the margin's tangent plane says that a policy fails: derivatives through contact.

The closed loop of a run is that of a tracking policy: the recorded controls, and the policy's slope by the
state in every step. Its adjoint (M31) gives the margin's slope by the start and the parameters. The nearest
point of the plane on which the margin is 0 to first order is the step of Hasofer and Lind 1974, Rackwitz and
Fiessler 1978.
"""

from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.ensembles.measures import NONE
from slcp_warp.kernels.policies.tracking import make_tracking

from ....gradients.tape import Recorded as Taped
from ....gradients.tape import adjoint, derivatives_exist
from ....inputs.limits import limit_rows
from ....measures.recorded import Recorded, counted_steps
from ....measures.reductions import Measure
from ....measures.signals import Signal
from ....options import OptionError
from ....parameters import Parameters
from ....policies import Around
from ....simulator import Simulator
from ....tasks.disturbances.follow import columns, followed
from ....tasks.task import Task
from .margin import Margin
from .numbers import Numbers
from .shells import Suggest

PART = (0.5, 0.8, 1.0)  # of the way to the plane
BEYOND = (1.0, 1.003, 1.01, 1.03, 1.1)  # sizes tried there
STEP = 1e-6  # difference of a state, for slopes of a policy
SAME = 1e-9  # by so much a control may differ that depends on the state alone
REDUCTIONS = ("initial", "final", "rate", "mean", "integral", "total", "largest", "smallest")


def slopes_of(task: Task, policy: Any, numbers: Numbers, judge: Margin, device: Any = None) -> Suggest | None:
    """Vectors worth trying around failing ones, of smoothed contact; None: there is no derivative.

    There is one by starts, parameters and kicks at the beginning, of measures of states, under policies that
    follow a plan with gains or depend on the state alone.
    """
    d = task.disturbances
    plain = not (d.pushes or d.dropouts or d.delay or d.hold or task.observation or task.failure)
    plain = plain and all(t == 0.0 for t in d.kick_times)
    known = all(m.reduction in REDUCTIONS and m.where is None and _smooth(m.of) for m in judge.measures)
    if not plain or not known or task.options.hard:
        return None
    sim = Simulator(task.scene, task.options, device=device, dtype="float64")
    try:
        derivatives_exist(task.options.method)
    except OptionError:
        return None
    loop = ClosedLoop(sim, task, policy)

    def suggest(best: np.ndarray) -> np.ndarray:
        margin, slope = loop.margins(best, numbers, judge)
        along = np.einsum("kd,kd->k", slope, slope)
        usable = np.isfinite(along) & (along > 0.0) & np.isfinite(margin)
        z, g, a = best[usable], slope[usable], along[usable]
        plane = g * ((np.einsum("kd,kd->k", g, z) - margin[usable]) / a)[:, None]
        near = np.concatenate([z + part * (plane - z) for part in PART])
        return np.concatenate([size * near for size in BEYOND])

    return suggest


def _smooth(of: Any) -> bool:
    """Whether it is a signal that derivatives are taken of here."""
    return isinstance(of, Signal) and of.kind in ("state", "cosine") and not (of.absolute or of.since_start)


class ClosedLoop:
    """Runs of a task under a policy, with slopes."""

    def __init__(self, sim: Simulator, task: Task, policy: Any) -> None:
        self.sim, self.task, self.follow = sim, task, task.disturbances.follow
        self.policy = policy if task.control_limits is None else Around(policy, limits=task.control_limits)
        gain = getattr(policy, "K", None)  # of a plan, by step: (worlds, steps, nu, nx)
        own = isinstance(gain, np.ndarray) and gain.ndim == 4
        steps = getattr(policy, "step_size", None) in (None, task.scene.step_size)
        self.gain = gain if own and steps else None

    def margins(self, z: np.ndarray, numbers: Numbers, judge: Margin) -> tuple[np.ndarray, np.ndarray]:
        """Margins (K,) and their slopes by z (K, d); NaN where there are none."""
        sim, worlds = self.sim, numbers.worlds(z).numpy()
        x0 = followed(sim.scene, self.follow, worlds.x0, worlds.params, sim.params.table()[0])
        if worlds.kicks is not None:
            x0[:, sim.nx // 2 :] += worlds.kicks.sum(axis=1)
        params = self._parameters(worlds.params)
        run = sim.rollout(x0, params=params, policy=self.policy, steps=self.task.steps, record="controls")
        states, controls = np.asarray(run.states), np.nan_to_num(run.controls)
        gains = self._gains(states, controls)
        steps = np.broadcast_to(params["step_size"], (len(z),))
        margin, weights = weighted(judge, Recorded(sim.scene, steps, states, controls))
        if gains is None:
            return margin, np.full(z.shape, np.nan)
        by_start, by_table = self._adjoint(x0, worlds.params, states, controls, gains, run.status, weights)
        for state, column, factor in columns(sim.scene, self.follow):
            by_table[:, column] += factor * by_start[:, state]
        out = np.zeros_like(z)
        by = {"x0": by_start, "params": by_table, "kicks": by_start[:, sim.nx // 2 :]}
        for name, slopes in numbers.slopes(z).items():
            for c, place in zip(*numbers.places(name)):
                out[:, place] += by[name][:, c % by[name].shape[1]] * slopes[:, c]
        return margin, out

    def _parameters(self, table: np.ndarray) -> Parameters:
        columns = [each for each in self.sim.params.layout.columns if np.prod(each[2], dtype=int)]
        rows = {
            name: table[:, start : start + int(np.prod(shape, dtype=int))].reshape(-1, *shape)
            for name, start, shape in columns
        }
        return self.sim.params.replace(**rows)

    def _adjoint(
        self, x0: np.ndarray, table: np.ndarray, states: np.ndarray, controls: np.ndarray, gains: np.ndarray,
        status: Any, weights: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Slopes by the start (K, nx) and the table of parameters (K, P) of what weights the states."""
        sim = self.sim

        def put(values: np.ndarray, wanted: bool = False) -> wp.array:
            return wp.array(
                np.ascontiguousarray(values), dtype=sim.dtype, device=sim.device, requires_grad=wanted
            )

        start, rows, us, xs = put(x0, True), put(table, True), put(controls), put(states)
        policy = make_tracking(sim.nx, sim.nu, sim.dtype).Struct()
        policy.us, policy.xs, policy.gain, policy.period = us, xs, put(gains), put(np.zeros(sim.nx))
        code: wp.array = wp.array(np.asarray(status), dtype=wp.int32, device=sim.device)
        run = Taped(sim.kernels.stepping, rows, start, us, sim.empty(0, 0), xs, code, policy)
        adjoint(run, put(weights))
        return start.grad.numpy(), rows.grad.numpy()

    def _gains(self, states: np.ndarray, controls: np.ndarray) -> np.ndarray | None:
        """Slopes (K, N, nu, nx) of the controls by the state; None: the policy depends on more than it."""
        count, steps, nu = controls.shape
        nx = states.shape[2]
        if self.gain is None:
            before = states[:, :-1].reshape(-1, nx)
            if np.abs(self._asked(before) - controls.reshape(-1, nu)).max() > SAME:
                return None
            shift = STEP * np.eye(nx)
            moved = before[:, None, None] + np.stack([shift, -shift])
            asked = self._asked(moved.reshape(-1, nx)).reshape(len(before), 2, nx, nu)
            slopes = (asked[:, 0] - asked[:, 1]) / (2.0 * STEP)
            return slopes.transpose(0, 2, 1).reshape(count, steps, nu, nx)
        own = self.gain[:, np.minimum(np.arange(steps), self.gain.shape[1] - 1)]
        gains: np.ndarray = np.broadcast_to(own, (count, steps, nu, nx)).copy()
        if self.task.control_limits is not None:
            lower, upper = limit_rows(self.task.control_limits, nu)
            gains[(controls <= lower) | (controls >= upper)] = 0.0
        return gains

    def _asked(self, states: np.ndarray) -> np.ndarray:
        """Controls (n, nu) at states (n, nx), each as in the first step of a run."""
        run = self.sim.rollout(states, policy=self.policy, steps=1, record="controls")
        return np.nan_to_num(run.controls)[:, 0]


def weighted(judge: Margin, run: Recorded) -> tuple[np.ndarray, np.ndarray]:
    """Margins (K,), and their slopes by the states (K, N+1, nx)."""
    weights = np.zeros_like(run.states)
    values = {measure: run.value(measure) for measure in judge.measures}
    margin, active = judge.active(values)
    for k, (measure, sign) in enumerate(active):
        signal = measure.of
        assert isinstance(signal, Signal)
        by_signal = sign * slope_of(measure, signal, run, k)
        place, less = signal.place(run.scene), signal.less(run.scene)
        if signal.kind == "cosine":
            weights[k, :, place] = -by_signal * np.sin(run.states[k, :, place])
            continue
        weights[k, :, place] = by_signal
        if less != NONE:
            weights[k, :, less] -= by_signal
    return margin, weights


def slope_of(measure: Measure, signal: Signal, run: Recorded, world: int) -> np.ndarray:
    """Slope (N+1,) of a measure's value by its signal in every step."""
    times, h = run.times[world], float(run.step_size[world])
    series = run.series(signal)[world]
    inside = np.flatnonzero(counted_steps(measure, times, h))
    out = np.zeros(len(times))
    if not inside.size:
        return out
    first, last = inside[0], inside[-1]
    if measure.reduction == "rate":
        if last > first:
            out[last], out[first] = np.array([1.0, -1.0]) / (times[last] - times[first])
    elif measure.reduction in ("mean", "integral", "total"):
        steps = inside[inside < len(times) - 1]
        out[steps] = {"mean": 1.0 / max(len(steps), 1), "integral": h, "total": 1.0}[measure.reduction]
    else:
        among = series[inside]
        at = {"initial": 0, "final": -1, "largest": int(np.argmax(among)), "smallest": int(np.argmin(among))}
        out[inside[at[measure.reduction]]] = 1.0
    return out
