"""Robustness sweeps: thousands of perturbed worlds under a policy, smoothed and hard, with statistics."""

import json
import time
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.device.launch import launch
from slcp_warp.kernels.ensembles.sweep import make_draw_kernel, make_sweep_kernel

from ..description.scene import Scene
from ..inputs import checks
from ..inputs.arrays import policy_arrays
from ..inputs.errors import ArgumentError
from ..options import Options, Status
from ..simulator import Simulator
from ..strategy import current_name
from . import generic_sweep
from .report import SweepReport
from .spec import SweepSpec
from .statistics import mean_interval, quantile_interval, share_interval, spin_statistics

CHUNK_BYTES = 128 * 2**20


def sweep(
    scene: Scene,
    policy: Any,
    spec: SweepSpec,
    *,
    scaling: str = "inertia",
    integrator: str = "euler",
    dtype: str = "float32",
    device: Any = None,
    strategy: str = "auto",
    chunk: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> SweepReport:
    """Run every case of a sweep in chunks of bounded memory.

    Args:
        policy: as for `Simulator.rollout`.
        chunk: worlds per launch, default by memory; results do not depend on it.
        strategy: as of a `Simulator`; with "generic", and "auto" where that takes it, a step is a launch.
        progress: called with (worlds done, worlds in all).

    A keyboard interrupt ends the sweep with what is finished (`complete` False).

    Raises:
        StrategyError: more rows than the kernels for these options take.
    """
    checks.instance("scene", scene, Scene, "a slcp_warp.Scene")
    checks.instance("spec", spec, SweepSpec, "a slcp_warp.SweepSpec")
    chunk = None if chunk is None else checks.whole("chunk", chunk)
    checks.function("progress", progress, 2, optional=True)
    strategy = current_name(strategy)
    cases, columns, samples = [], [], []
    total = spec.worlds * len(spec.residuals) * len(spec.step_sizes)
    done, complete = 0, True
    for residual in spec.residuals:
        options = Options(residual=residual, scaling=scaling, integrator=integrator)
        sim = Simulator(scene, options, device=device, dtype=dtype, strategy=strategy)
        for step_size in spec.step_sizes:
            case = _Case(sim, policy, spec, step_size, chunk)
            try:
                for count in case.run():
                    done += count
                    if progress is not None:
                        progress(done, total)
            except KeyboardInterrupt:
                complete = False
            if case.parts:
                table, trace = case.collect(residual)
                cases.append(_summary(residual, step_size, table, spec, case.seconds))
                columns.append(table)
                samples.append(trace)
            if not complete:
                break
        if not complete:
            break
    merged = {name: np.concatenate([c[name] for c in columns]) for name in columns[0]} if columns else {}
    return SweepReport(cases, merged, samples, _plain(spec), complete)


class _Case:
    """One (residual, step size): its launches and what they left."""

    def __init__(
        self, sim: Simulator, policy: Any, spec: SweepSpec, step_size: float, chunk: int | None
    ) -> None:
        self.sim, self.spec, self.step_size = sim, spec, step_size
        params = sim.params.replace(**spec.parameters).replace(step_size=step_size)
        if params.worlds is not None:
            raise ArgumentError(
                "SweepSpec.parameters must be shared by all worlds; use parameter_sd to vary them"
            )
        self.base = params.table()[0]
        self.name, self.struct = policy_arrays(policy, sim, None)
        self.count = int(round(spec.duration / spec.sample_every)) + 1
        kept = "SweepSpec.duration / sample_every: the samples"
        checks.memory(kept, spec.worlds * self.count, 4, sim.device)
        per_world = 8 * (len(self.base) + sim.nx) + 4 * self.count + 16
        if sim.strategy == "generic":
            per_world += generic_sweep.bytes_of_world(sim)
        self.chunk = chunk or max(1, min(spec.worlds, CHUNK_BYTES // per_world))
        self.parts: list[dict[str, np.ndarray]] = []
        self.seconds = 0.0

    def array(self, values: Any) -> wp.array:
        return wp.array(np.ascontiguousarray(values), dtype=self.sim.dtype, device=self.sim.device)

    def run(self) -> Any:
        """Launch chunk after chunk; yields the worlds finished."""
        spec, sim = self.spec, self.sim
        spread, group = _spread(sim, spec.parameter_sd)
        start = sim.scene.x0[None] if spec.start is None else np.atleast_2d(np.asarray(spec.start, float))
        if start.ndim != 2 or start.shape[1] != sim.nx or not np.all(np.isfinite(start)):
            raise ArgumentError(
                f"SweepSpec.start has shape {start.shape}; finite numbers (M, {sim.nx}) are needed"
            )
        if not 0 <= spec.observe < sim.nx:
            raise ArgumentError(
                f"SweepSpec.observe is {spec.observe}; a state component 0..{sim.nx - 1} is needed"
            )
        deviation = np.repeat([spec.position_sd, spec.velocity_sd], sim.nx // 2)
        shared: list[Any] = [
            self.array(self.base),
            self.array(spread),
            wp.array(group, dtype=wp.int32, device=sim.device),
        ]
        shared += [self.array(start), self.array(deviation), spec.sample_every]
        self.varied = np.flatnonzero(spread)
        kicks: wp.array = wp.array(np.array(spec.kick_times, float), dtype=wp.float64, device=sim.device)
        for world0 in range(0, spec.worlds, self.chunk):
            count = min(self.chunk, spec.worlds - world0)
            began = time.perf_counter()
            self.parts.append(self.launch(world0, count, shared, kicks))
            self.seconds += time.perf_counter() - began
            yield count

    def launch(self, world0: int, count: int, shared: list[Any], kicks: wp.array) -> dict[str, np.ndarray]:
        """One chunk of worlds."""
        sim, spec = self.sim, self.spec
        params, x0 = sim.empty(count, len(self.base)), sim.empty(count, sim.nx)
        launch(
            make_draw_kernel(sim.nx, sim.dtype), count, [world0, spec.seed, *shared, params, x0], sim.device
        )
        samples: wp.array = wp.zeros((count, self.count), dtype=wp.float32, device=sim.device)
        run = self.by_steps if sim.strategy == "generic" else self.at_once
        share, lowest, status = run(world0, params, x0, kicks, samples)
        out: dict[str, Any] = {
            "samples": samples,
            "contact_share": share,
            "lowest_gap": lowest,
            "status": status,
        }
        drawn = params.numpy()[:, self.varied].astype(np.float32)
        columns = {self.column(int(c)): drawn[:, i] for i, c in enumerate(self.varied)}
        return {name: array.numpy().copy() for name, array in out.items()} | columns

    def by_steps(self, world0: int, *arrays: wp.array) -> tuple[wp.array, wp.array, wp.array]:
        """Generic kernels: share of steps in contact, lowest gap and status of every world."""
        return generic_sweep.roll_out(self.sim, (self.name, self.struct), self.spec, world0, *arrays)

    def at_once(
        self, world0: int, params: wp.array, x0: wp.array, kicks: wp.array, samples: wp.array
    ) -> tuple[wp.array, wp.array, wp.array]:
        """The same with the specialised kernel."""
        sim, spec, count = self.sim, self.spec, len(x0)
        share, lowest = (wp.zeros(count, dtype=wp.float32, device=sim.device) for _ in range(2))
        status: wp.array = wp.zeros(count, dtype=wp.int32, device=sim.device)
        kernel = make_sweep_kernel(sim.spec, self.name)
        noise = [self.struct, spec.torque_sd, spec.kick_sd, kicks, spec.duration, spec.sample_every]
        outputs = [samples, share, lowest, status]
        inputs = [world0, spec.seed, params, x0, *noise, spec.observe, sim.empty(0, 0), *outputs]
        launch(kernel, count, inputs, sim.device, grain=1)
        return share, lowest, status

    def column(self, c: int) -> str:
        """Name of a parameter's column in the table: "drawn_mass_0", .."""
        name, start, shape = next(e for e in reversed(self.sim.params.layout.columns) if e[1] <= c)
        return f"drawn_{name}" + (f"_{c - start}" if shape else "")

    def collect(self, residual: str) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Tidy columns and samples of the finished worlds."""
        merged = {name: np.concatenate([p[name] for p in self.parts]) for name in self.parts[0]}
        samples, count = merged.pop("samples"), len(merged["status"])
        spec = self.spec
        spin = spin_statistics(samples, spec.sample_every, spec.window, spec.threshold, spec.kick_times)
        failed = merged["status"] != Status.SOLVED
        spin["spinning"] = spin["spinning"] & ~failed
        spin["recovery_time"] = np.where(failed, np.inf, spin["recovery_time"])
        head = {
            "residual": np.full(count, residual),
            "step_size": np.full(count, self.step_size),
            "world": np.arange(count),
        }
        return head | merged | spin, samples


def _spread(sim: Simulator, parameter_sd: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Per column of the parameters: standard deviation of its logarithm, and whose random number it takes."""
    width = sim.params.layout.width
    spread, group = np.zeros(width), np.arange(width, dtype=np.int32)
    first = {name: start for name, start, _ in sim.params.layout.columns}
    for name, start, shape in sim.params.layout.columns:
        size = int(np.prod(shape, dtype=int))
        if name in parameter_sd:
            spread[start : start + size] = parameter_sd[name]
        if name == "inertia":  # a heavier body of the same shape turns harder, too
            group[start : start + size] = first["mass"] + np.arange(size)
        if name == "radius":
            group[start : start + size] = start + 2 * (np.arange(size) // 2)
        if name in ("gravity", "sigma"):
            group[start : start + size] = start
    return spread, group


def _summary(
    residual: str, step_size: float, table: dict[str, np.ndarray], spec: SweepSpec, seconds: float
) -> dict[str, Any]:
    worlds = len(table["status"])
    above = (table["rate"] > spec.threshold) & (table["status"] == Status.SOLVED)
    recovered = np.isfinite(table["recovery_time"])
    return {
        "residual": residual,
        "step_size": step_size,
        "worlds": worlds,
        "seconds": seconds,
        "mean_rate": mean_interval(table["rate"]),
        "share_above": share_interval(int(above.sum()), worlds),
        "share_spinning": share_interval(int(table["spinning"].sum()), worlds),
        "share_recovered": share_interval(int(recovered.sum()), worlds),
        "median_recovery_time": quantile_interval(table["recovery_time"]),
        "contact_share": mean_interval(table["contact_share"]),
        "statuses": {s.name: int((table["status"] == s).sum()) for s in Status},
    }


def _plain(spec: SweepSpec) -> dict[str, Any]:
    values = asdict(spec)
    values["start"] = None if spec.start is None else list(np.shape(spec.start))
    return json.loads(json.dumps(values, default=lambda a: np.asarray(a).tolist()))
