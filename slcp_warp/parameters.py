"""The run-time numbers of a scene: one value for all worlds, or one per world."""

from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.structure import ELLIPSE, Layout, layout

from .scene import Scene

POSITIVE = ("step_size", "sigma", "mass", "inertia")
COVARIANCES = ("position_covariance", "velocity_covariance")
NONNEGATIVE = ("friction", "radius", "spring_damping", "spring_length")


class ParameterError(ValueError):
    """A parameter with an unknown name, wrong shape or illegal value."""


class Parameters:
    """Named parameters of one scene, immutable; `replace` makes a changed copy.

    Names and units: step_size h [s]; sigma per row [m/s, rad/s]; gravity [m/s^2]; mass [kg]; inertia [kg
    m^2]; com, anchor, axis per body [m]; angle per body [rad]; damping, lower, upper per degree of freedom,
    and stiffness, rest where the scene has joint springs; gear per actuator; friction per contact; radius
    (2), shape_offset (2) [m], shape_angle [rad] per shape; spring_stiffness [N/m], spring_damping [N s/m],
    spring_length [m], spring_point (2 ends, 2) [m] per spring.
    """

    def __init__(
        self, scene: Scene, values: dict[str, np.ndarray] | None = None, requires_grad: bool = False
    ) -> None:
        self.scene = scene
        self.layout: Layout = layout(scene.structure)
        self._values = dict(scene.default_parameters()) if values is None else values
        self.requires_grad = requires_grad
        self._uploaded: dict[tuple[Any, str], wp.array] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """All parameter names."""
        return self.layout.names

    def __getitem__(self, name: str) -> np.ndarray:
        """A parameter's value: its own shape, or (B, *shape)."""
        if name not in self._values:
            raise ParameterError(f"no parameter {name!r}; there are {list(self.names)}")
        return self._values[name]

    @property
    def worlds(self) -> int | None:
        """Number of worlds that the parameters differ over, None if shared by all."""
        sizes = {len(v) for n, v in self._values.items() if np.ndim(v) > len(self.layout.shape(n))}
        return sizes.pop() if sizes else None

    def replace(self, **changes: Any) -> "Parameters":
        """A copy with some parameters changed.

        Args:
            changes: name=value; a scalar (for every component), the parameter's own shape, (B,) or (B,
            *shape).

        Raises:
            ParameterError: unknown name, shape that does not fit, non-finite or illegal value.
        """
        values = dict(self._values)
        for name, value in changes.items():
            values[name] = self._fit(name, value)
        sizes = {n: len(v) for n, v in values.items() if np.ndim(v) > len(self.layout.shape(n))}
        if len(set(sizes.values())) > 1:
            raise ParameterError(f"parameters disagree on the number of worlds: {sizes}")
        return Parameters(self.scene, values, self.requires_grad)

    def track(self) -> "Parameters":
        """A copy whose gradients steps and rollouts on a `wp.Tape` collect; see `gradient`."""
        return Parameters(self.scene, self._values, True)

    def gradient(self, name: str) -> np.ndarray:
        """The gradient collected by backward passes of tapes, of the shape that the parameter has: its own
        where all worlds share the table (then the sum over worlds), else (B, *shape).

        Raises:
            ParameterError: unknown name, or parameters that are not tracked.
        """
        if name not in self.names:
            raise ParameterError(f"no parameter {name!r}; there are {list(self.names)}")
        if not self.requires_grad:
            raise ParameterError("these parameters are not tracked; use params.track() in the rollout")
        start, shape = self.layout.offset(name), self.layout.shape(name)
        table = sum((a.grad.numpy() for a in self._uploaded.values()), np.zeros_like(self.table()))
        block = table[:, start : start + int(np.prod(shape, dtype=int))].reshape((len(table), *shape))
        return block[0] if self.worlds is None else block

    def zero_gradient(self) -> None:
        """Forget the gradients collected so far (`wp.Tape.zero` does so too)."""
        for array in self._uploaded.values():
            array.grad.zero_()

    def _fit(self, name: str, value: Any) -> np.ndarray:
        if name not in self.names:
            raise ParameterError(f"no parameter {name!r}; there are {list(self.names)}")
        shape = self.layout.shape(name)
        try:
            array = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise ParameterError(f"{name} is {value!r}; numbers are needed") from error
        if not np.all(np.isfinite(array)):
            raise ParameterError(f"{name} contains {array[~np.isfinite(array)].flat[0]}; it must be finite")
        if name in POSITIVE and not np.all(array > 0.0):
            hint = '; for the problem without noise use Options(residual="hard")' if name == "sigma" else ""
            raise ParameterError(f"{name} is {array.min()}; it must be positive{hint}")
        if name in NONNEGATIVE and not np.all(array >= 0.0):
            raise ParameterError(f"{name} is {array.min()}; it must not be negative")
        if name in COVARIANCES:
            return _covariance(name, array, shape)
        if array.shape == shape or array.shape[1:] == shape and array.ndim == len(shape) + 1:
            array = array.copy()
        elif array.ndim == 0:
            array = np.full(shape, array)
        elif array.ndim == 1 and shape:
            array = np.broadcast_to(array.reshape((-1,) + (1,) * len(shape)), (len(array), *shape)).copy()
        else:
            need = ", ".join(["B", *map(str, shape)])
            raise ParameterError(f"{name} has shape {array.shape}; give a scalar, {shape}, (B,) or ({need})")
        if name == "radius":
            for i, shape_ in enumerate(self.scene.shapes):
                if shape_.kind == ELLIPSE and not np.all(array[..., i, :] > 0.0):
                    raise ParameterError(f"radius of ellipse {shape_.name!r} is 0; it must be positive")
        if name == "shape_angle":
            for i, kind in enumerate(self.scene.structure.shapes):
                if not kind.turned and np.any(array[..., i] != 0.0):
                    given = np.ravel(array[..., i])[0]
                    raise ParameterError(
                        f"shape_angle of {self.scene.shapes[i].name!r} is {given}; it was built with the "
                        "angle 0, which the kernels leave out: build the scene with another angle"
                    )
        return array

    def table(self) -> np.ndarray:
        """All columns, (1 or B, width), float64."""
        rows = self.worlds or 1
        table = np.empty((rows, self.layout.width))
        for name, start, shape in self.layout.columns:
            size = int(np.prod(shape, dtype=int))
            table[:, start : start + size] = np.reshape(self._values[name], (-1, size) if size else (1, 0))
        return table

    def array(self, dtype: Any, device: Any) -> wp.array:
        """The table on a device, uploaded once."""
        key = (dtype, str(device))
        if key not in self._uploaded:
            self._uploaded[key] = wp.array(
                self.table(), dtype=dtype, device=device, requires_grad=self.requires_grad
            )
        return self._uploaded[key]


def _covariance(name: str, array: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """A checked covariance from a number (times the identity), (B,) numbers, a matrix or (B, nv, nv)."""
    if array.ndim < 2:
        array = array[..., None, None] * np.eye(shape[0])
    if array.shape[-2:] != shape or array.ndim > 3:
        need = f"a scalar (times the identity), {shape}, (B,) or (B, {shape[0]}, {shape[1]})"
        raise ParameterError(f"{name} has shape {array.shape}; give {need}")
    if not np.allclose(array, np.swapaxes(array, -1, -2), rtol=1e-9, atol=0.0):
        raise ParameterError(f"{name} is not symmetric: {array.tolist()}")
    lowest = np.linalg.eigvalsh(array).min(axis=-1)
    if np.any(lowest < -1e-12 * np.abs(array).max(axis=(-1, -2))):
        raise ParameterError(f"{name} has the eigenvalue {lowest.min()}; a covariance has none below 0")
    return array.copy()
