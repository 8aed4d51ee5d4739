"""The worlds of a sweep: parameters and starts, drawn by world, and the names of what is drawn."""

from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.device.launch import launch
from slcp_warp.kernels.ensembles.draws import make_draw_kernel, make_draws

from ..inputs.errors import ArgumentError
from ..simulator import Simulator
from .spec import SweepSpec


class Draws:
    """What the worlds of one case are drawn from.

    Attributes:
        width: columns of the table of parameters.
        varied: those that differ from world to world.

    Raises:
        ArgumentError: parameters of the spec that differ over worlds, or starts that are no states.
    """

    def __init__(
        self,
        sim: Simulator,
        spec: SweepSpec,
        step_size: float,
        deviation: np.ndarray | None = None,
        in_order: bool = False,
    ) -> None:
        """Args:
        deviation: (nx,) of the starts instead of the spec's.
        in_order: world i begins at start i instead of one that is drawn.
        """
        self.sim = sim
        if deviation is None:
            deviation = np.repeat([spec.position_sd, spec.velocity_sd], sim.nx // 2)
        params = sim.params.replace(**spec.parameters).replace(step_size=step_size)
        if params.worlds is not None:
            raise ArgumentError(
                "SweepSpec.parameters must be shared by all worlds; use parameter_sd to vary them"
            )
        spread, group = _spread(sim, spec.parameter_sd)
        start = _starts(sim, spec)
        self.width, self.varied = len(spread), np.flatnonzero(spread)
        numbers = self._numbers = make_draws(sim.dtype)()
        numbers.seed = spec.seed
        numbers.base, numbers.spread = self._put(params.table()[0]), self._put(spread)
        numbers.group = wp.array(group, dtype=wp.int32, device=sim.device)
        numbers.starts = self._put(start)
        numbers.deviation, numbers.in_order = self._put(deviation), int(in_order)
        numbers.longest = spec.sample_every

    def _put(self, values: Any) -> wp.array:
        return wp.array(np.ascontiguousarray(values), dtype=self.sim.dtype, device=self.sim.device)

    def worlds(self, world0: int, count: int) -> tuple[wp.array, wp.array]:
        """Parameters (count, P) and starts (count, nx) of worlds world0, world0 + 1, ..."""
        sim = self.sim
        params, x0 = sim.empty(count, self.width), sim.empty(count, sim.nx)
        kernel = make_draw_kernel(sim.nx, sim.dtype)
        launch(kernel, count, [world0, self._numbers, params, x0], sim.device)
        return params, x0

    def columns(self, params: wp.array) -> dict[str, np.ndarray]:
        """What was drawn of parameters, by the name of its column: "drawn_mass_0", ..."""
        drawn = params.numpy()[:, self.varied].astype(np.float32)
        return {self._name(int(c)): drawn[:, i] for i, c in enumerate(self.varied)}

    def _name(self, c: int) -> str:
        name, start, shape = next(e for e in reversed(self.sim.params.layout.columns) if e[1] <= c)
        return f"drawn_{name}" + (f"_{c - start}" if shape else "")


def _starts(sim: Simulator, spec: SweepSpec) -> np.ndarray:
    """The states (M, nx) that worlds begin near."""
    start = sim.scene.x0[None] if spec.start is None else np.atleast_2d(np.asarray(spec.start, float))
    if start.ndim != 2 or start.shape[1] != sim.nx or not np.all(np.isfinite(start)):
        raise ArgumentError(
            f"SweepSpec.start has shape {start.shape}; finite numbers (M, {sim.nx}) are needed"
        )
    return start


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
