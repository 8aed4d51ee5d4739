"""The run-time numbers of a scene: one value for all worlds, or one per world."""

import copy
import functools
import threading
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.device.tables import make_table
from slcp_warp.kernels.structure import DISC, RECTANGLE, RING, Layout, layout

from .description.acting import BUILT, acting, parts_of
from .description.columns import parameter_of, places_of, places_of_all
from .description.scene import Scene
from .inputs import rules
from .inputs.arrays import ArrayError
from .inputs.checks import flag, instance, shown
from .inputs.errors import ArgumentError, ArgumentTypeError
from .inputs.rules import COVARIANCES
from .storage.printed import Printed, Table, counted

_uploading = threading.Lock()


class ParameterError(ArgumentError):
    """A parameter with an unknown name, wrong shape or illegal value."""


class Parameters(Printed):
    """Named parameters of one scene, immutable; `replace` makes a changed copy.

    Names and units: step_size h [s]; sigma per row [m/s, rad/s]; gravity [m/s^2]; mass [kg]; inertia [kg
    m^2]; com, anchor, axis per body [m]; angle per body [rad]; damping, lower, upper per degree of freedom,
    and stiffness, rest, armature where the scene has such; gear per actuator; friction per contact; radius
    (2), shape_offset (2) [m], shape_angle [rad] per shape, surface_ratio where one runs; spring_stiffness
    [N/m], spring_damping [N s/m], spring_length [m], spring_point (2 ends, 2) [m] per spring;
    tendon_stiffness, tendon_damping, tendon_length per tendon, tendon_coefficient per tendon and coordinate,
    tendon_force_limit and tendon_force_sigma per tendon where one has a limit [N, N m].
    """

    def __init__(
        self, scene: Scene, values: Mapping[str, Any] | None = None, requires_grad: bool = False
    ) -> None:
        instance("scene", scene, Scene, "a slcp_warp.Scene")
        self.scene = scene
        self.layout: Layout = layout(scene.structure)
        self._values = dict(scene.default_parameters())
        self.requires_grad = flag("requires_grad", requires_grad)
        self._uploaded: dict[tuple[Any, str], wp.array] = {}
        if values is not None:
            for name in instance("values", values, Mapping, "a dict"):
                if not isinstance(name, str):
                    self._known(name)
            self._values = self.replace(**values)._values

    def _with(self, values: dict[str, np.ndarray], requires_grad: bool) -> "Parameters":
        """A copy with values that were checked."""
        out = copy.copy(self)
        out.__dict__.pop("worlds", None)  # looked up once an object: a step asks for it
        out._values, out.requires_grad, out._uploaded = values, requires_grad, {}
        return out

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_uploaded": {}}  # what is on devices is put there again

    def _line(self) -> str:
        of = "shared by all worlds" if self.worlds is None else f"for {counted(self.worlds, 'world')}"
        tracked = "; tracked" if self.requires_grad else ""
        return f"of {self.scene.name!r}: {counted(len(self.names), 'name')}, {of}{tracked}"

    def _tables(self) -> list[Table]:
        rows = []
        for name in self.names:
            value, shape = self[name], self.layout.shape(name)
            if value.size:
                whose = "every world's own" if value.ndim > len(shape) else "shared"
                rows.append((name, shape or "()", whose, float(value.min()), float(value.max())))
        head = ("parameter", "shape", "worlds", "lowest", "highest")
        return [Table("", head, rows, left=3, most=len(rows))]

    @property
    def names(self) -> tuple[str, ...]:
        """All parameter names."""
        return self.layout.names

    def __getitem__(self, name: str) -> np.ndarray:
        """A parameter's value, read-only: its own shape, or (B, *shape); of one part, "box.mass", its number
        or numbers, with B in front where worlds differ.
        """
        if isinstance(name, str) and "." in name:
            self._check_parts([name])
            places = places_of(self.scene, name, "parameters")
            rows = self.table()[:, places if len(places) > 1 else places[0]]
            return rows[0] if self.worlds is None else rows
        self._known(name)
        value = np.asarray(self._values[name]).view()
        value.flags.writeable = False
        return value

    def _known(self, name: Any) -> None:
        if not isinstance(name, str) or name not in self._values:
            raise ParameterError(f"no parameter {shown(name)}; there are {list(self.names)}")

    @functools.cached_property
    def worlds(self) -> int | None:
        """Number of worlds that the parameters differ over, None if shared by all."""
        sizes = {len(v) for n, v in self._values.items() if np.ndim(v) > len(self.layout.shape(n))}
        return sizes.pop() if sizes else None

    def replace(self, **changes: Any) -> "Parameters":
        """A copy with some parameters changed.

        Args:
            changes: name=value, and of one part **{"box.mass": value}, a number or (B,) one a world, after
                those of all, or of a part of several its own (n,) or (B, n), as `params["box.com"]` gives
                them. These are a scalar (for every component that the scene was built with), the
                parameter's own shape, (B, *shape), or (B, 1, ..) for a number of every world, for all
                components; (B,) is that, too, where B is not the length of the parameter, whose components
                they are then. A disc has one radius, twice; an axis is of unit length; lower above upper is a
                world without a solution (its status says so); what was built without a limit, spring or
                friction has none.

        Raises:
            ParameterError: unknown name, shape that does not fit, non-finite or illegal value.
        """
        values = dict(self._values)
        self._check_parts([name for name in changes if "." in name])
        for name in sorted(changes, key=lambda name: "." in name):  # of parts last, in the order given
            whole = parameter_of(name)[1] if "." in name else name
            self._known(whole)
            values[whole] = self._fit(whole, self._of_part(name, values[whole], changes[name]))
        sizes = {n: len(v) for n, v in values.items() if np.ndim(v) > len(self.layout.shape(n))}
        if len(set(sizes.values())) > 1:
            raise ParameterError(f"parameters disagree on the number of worlds: {sizes}")
        if "corner_radius" in values:
            for i, part in enumerate(self.scene.shapes):
                both = values["radius"][..., i, :], values["corner_radius"][..., i]
                label = f"corner_radius of {part.name!r}"
                rules.check_corners(label, part.kind, *both, ParameterError)
        self._check_rings(values)
        return self._with(values, self.requires_grad)

    def _check_rings(self, values: Mapping[str, np.ndarray]) -> None:
        """Raise ParameterError for a ring that is no larger than what is in it."""
        shapes = self.scene.shapes
        for pair in self.scene.structure.pairs:
            for ring, other in ((pair.shape_a, pair.shape_b), (pair.shape_b, pair.shape_a)):
                if shapes[ring].kind != RING:
                    continue
                size = values["radius"][..., other, 0]
                if shapes[other].kind == RECTANGLE:
                    size = values["corner_radius"][..., other]
                size, hole = np.broadcast_arrays(size, values["radius"][..., ring, 0])
                if (wrong := size >= hole).any():
                    raise ParameterError(
                        f"radius of {shapes[other].name!r} is {size[wrong].flat[0]:g}, and of ring "
                        f"{shapes[ring].name!r} {hole[wrong].flat[0]:g}; what is in a ring is smaller"
                    )

    def matching(self, other: "Parameters | None", worlds: int) -> "Parameters":
        """Other parameters of this scene, for a number of worlds; None: these.

        Raises:
            ArgumentTypeError, ArgumentError: no parameters, or another scene's.
            ArrayError: they are for another number of worlds.
        """
        given = self if other is None else other
        if not isinstance(given, Parameters):
            raise ArgumentTypeError(f"params is a {type(given).__name__}; use sim.params.replace(...)")
        if given.scene.structure != self.scene.structure:
            raise ArgumentError(
                f"params belong to scene {given.scene.name!r}; this simulator has {self.scene.name!r}"
            )
        if given.worlds not in (None, worlds):
            shapes = [(n, self.layout.shape(n)) for n, v in given._values.items()
                      if np.ndim(v) > len(self.layout.shape(n))]  # fmt: skip
            several = ", ".join(f"{n} (a world's has shape {shape})" for n, shape in shapes)
            raise ArrayError(f"params are given for {given.worlds} worlds, the arrays for {worlds}; "
                             f"one a world are: {several}")  # fmt: skip
        return given

    def track(self) -> "Parameters":
        """A copy whose gradients steps and rollouts on a `wp.Tape` collect; see `gradient`."""
        return self._with(self._values, True)

    def gradient(self, name: str) -> np.ndarray:
        """The gradient collected by backward passes of tapes, of the shape that the parameter has: its own
        where all worlds share the table (then the sum over worlds), else (B, *shape); of one part, as
        "box.mass", that of its number or numbers.

        Raises:
            ParameterError: unknown name, or parameters that are not tracked.
        """
        part = isinstance(name, str) and "." in name
        self._check_parts([name]) if part else self._known(name)
        if not self.requires_grad:
            raise ParameterError("these parameters are not tracked; use params.track() in the rollout")
        table = sum((a.grad.numpy() for a in self._uploaded.values()), np.zeros_like(self.table()))
        if part:
            places = places_of(self.scene, name, "parameters")
            rows = table[:, places if len(places) > 1 else places[0]]
            return rows[0] if self.worlds is None else rows
        start, shape = self.layout.offset(name), self.layout.shape(name)
        block = table[:, start : start + int(np.prod(shape, dtype=int))].reshape((len(table), *shape))
        return block[0] if self.worlds is None else block

    def zero_gradient(self) -> None:
        """Forget the gradients collected so far (`wp.Tape.zero` does so too)."""
        for array in self._uploaded.values():
            array.grad.zero_()

    def _fit(self, name: str, value: Any) -> np.ndarray:
        self._known(name)
        shape = self.layout.shape(name)
        array = rules.numbers(name, value, ParameterError, name)
        if name in COVARIANCES:
            return rules.covariance(name, array, shape[0], ParameterError)
        if len(shape) == 2 and array.shape == shape[:1]:  # of each item, not of each world
            array = np.broadcast_to(array[:, None], shape)
        single = array.shape == shape or array.shape[1:] == shape and array.ndim == len(shape) + 1
        if single:
            array = array.copy()
        elif array.ndim == 0:
            array = np.full(shape, array)
        elif array.ndim == len(shape) + 1 and array.shape[1:] == (1,) * len(shape):
            array = np.broadcast_to(array, (len(array), *shape)).copy()
        elif array.ndim == 1 and shape:
            array = np.broadcast_to(array.reshape((-1,) + (1,) * len(shape)), (len(array), *shape)).copy()
        else:
            raise ParameterError(f"{name} has shape {array.shape}; give {rules.shapes_of(shape)}")
        if name == "axis":
            rules.check_axis(name, array, ParameterError)
        if name == "radius":
            for i, part in enumerate(self.scene.shapes):
                label = f"radius of {part.kind} {part.name!r}"
                rules.check_radius(label, part.kind, array[..., i, :], ParameterError)
        return self._of_parts(name, array, single) if name in BUILT else array

    def _check_parts(self, names: Sequence[str]) -> None:
        """Raise ParameterError for names of parts that there are not, or that are of the same numbers."""
        for name in names:
            self._known(parameter_of(name)[1])
        try:
            places_of_all(self.scene, names, "parameters")
        except ArgumentError as error:
            raise ParameterError(str(error)) from None

    def _of_part(self, name: str, whole: np.ndarray, value: Any) -> Any:
        """The numbers of all parts with those of one, "box.mass"; `value` where all parts are named."""
        if "." not in name:
            return value
        given = rules.numbers(name, value, ParameterError, parameter_of(name)[1])
        places = places_of(self.scene, name, "parameters")
        count = len(places)
        own = count > 1 and given.ndim > 0 and given.shape[-1] == count and self._differ(name, places)
        if given.ndim - own > 1 or (given.ndim == 2 and not own):
            several = f", ({count},) or (B, {count})" if count > 1 else ""
            raise ParameterError(
                f"{name} has shape {given.shape}; a number, or (B,) one a world{several}, is needed"
            )
        if not own:
            given = given[..., None]
        worlds = given.shape[:-1]
        start, shape = self.layout.offset(parameter_of(name)[1]), self.layout.shape(parameter_of(name)[1])
        all_of = (*worlds, *shape) if whole.ndim == len(shape) else whole.shape
        if worlds and all_of[0] != worlds[0]:
            raise ParameterError(f"{name} is for {worlds[0]} worlds, other numbers are for {all_of[0]}")
        out = np.broadcast_to(whole, all_of).reshape(*all_of[: len(all_of) - len(shape)], -1).copy()
        out[..., np.array(places) - start] = given
        return out.reshape(all_of)

    def _differ(self, name: str, places: Sequence[int]) -> bool:
        """Whether a part's numbers may differ: both of a disc's radius are one."""
        if parameter_of(name)[1] != "radius":
            return True
        start = self.layout.offset("radius")
        return all(self.scene.shapes[(at - start) // 2].kind not in (DISC, RING) for at in places)

    def _of_parts(self, name: str, array: np.ndarray, single: bool) -> np.ndarray:
        """Numbers with the scene's own where no kernel reads one; others, given singly, are an error."""
        own, ndim = np.asarray(self.scene.default_parameters()[name], float), len(self.layout.shape(name))
        for i, acts in enumerate(acting(self.scene.structure, name)):
            rows = np.moveaxis(array, -ndim, 0)
            changed = np.asarray(rows[i])[np.asarray(rows[i] != own[i])]
            if acts or not changed.size:
                continue
            if single or name == "shape_angle":
                part = parts_of(self.scene, name)[i]
                raise ParameterError(
                    f"{name} of {part!r} is {changed.flat[0]}; it was built {BUILT[name]}: build another"
                )
            rows[i] = own[i]
        return array

    def table(self) -> np.ndarray:
        """All columns, (1 or B, width), float64."""
        rows = 1 if self.worlds is None else self.worlds
        table = np.empty((rows, self.layout.width))
        for name, start, shape in self.layout.columns:
            size = int(np.prod(shape, dtype=int))
            table[:, start : start + size] = np.reshape(self._values[name], (-1, size) if size else (1, 0))
        return table

    def from_table(self, table: Any) -> "Parameters":
        """A copy with the numbers of a table's rows, as `table` and `Worlds.params` hold them: worlds that a
        sweep draws, by name. What is the same as here in all rows stays shared.

        Args:
            table: (B, width), of this scene.

        Raises:
            ParameterError: a table of another shape, or non-finite or illegal values.
        """
        rows = rules.numbers("table", table, ParameterError, "table")
        if rows.ndim != 2 or rows.shape[1] != self.layout.width or not len(rows):
            raise ParameterError(f"table has shape {rows.shape}; (B, {self.layout.width}) is needed")
        single = getattr(table, "dtype", None) == np.float32  # then what is shared was rounded, too
        others = self.worlds not in (None, len(rows))  # then no row is of a world here
        own = self.table()[: 1 if others else None].astype(np.float32 if single else float)
        same, changes = (rows == own).all(0), {}
        for name, start, shape in self.layout.columns:
            end = start + int(np.prod(shape, dtype=int))
            if not same[start:end].all() or (others and np.ndim(self._values[name]) > len(shape)):
                changes[name] = rows[:, start:end].reshape(-1, *shape)
        return self.replace(**changes)

    def _check_range(self, table: np.ndarray, dtype: Any) -> None:
        """Raise ParameterError for a number that is infinite, 0 or denormal in the kernels' precision: a mass
        whose last digits are gone falls at another rate.
        """
        with np.errstate(over="ignore", under="ignore"):
            kept = table.astype(dtype)
        lost = ~np.isfinite(kept) | ((np.abs(kept) < np.finfo(dtype).tiny) & (table != 0.0))
        if lost.any():
            row, at = np.argwhere(lost)[0]
            name = next(n for n, start, _ in reversed(self.layout.columns) if start <= at)
            raise ParameterError(f"{name} is {table[row, at]}; {np.dtype(dtype)} does not hold that number")

    def array(self, dtype: Any, device: Any) -> wp.array:
        """The table on a device, uploaded once."""
        key = (dtype, str(device))
        with _uploading:  # a second table would take gradients of its own
            if key not in self._uploaded:
                table = self.table()
                self._check_range(table, wp.dtype_to_numpy(dtype))
                self._uploaded[key] = make_table(table, dtype, device, self.requires_grad)
            return self._uploaded[key]
