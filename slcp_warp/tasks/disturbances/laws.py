"""How every number of a world is drawn: a row of columns, each with its law and its address."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from slcp_warp.kernels.ensembles import disturbances as kernels
from slcp_warp.kernels.ensembles.draws import LAWS
from slcp_warp.kernels.structure import layout

from ...description.acting import BUILT, OF_DOFS, OF_PAIRS, OF_SHAPES, acting, parts_of
from ...description.columns import COMPONENTS, column_of, like, parameter_of, places_of_all
from ...description.scene import Scene
from ...inputs.checks import shown
from ...inputs.errors import ArgumentError
from ...inputs.rules import NONNEGATIVE, PERTURBABLE, POSITIVE
from .distributions import BODIES, Distribution, LogNormal, Normal, Uniform, UniformFactor, row_of
from .events import Drawn

FACTORS = ("gravity", "radius")  # parameters that keep their directions and shapes: factors only
TWO_SIZES = ("ellipse", "capsule", "rectangle")
ONE_SIZE = ("disc", "ring")
LENGTHS = (*("radius", "corner_radius", "com", "anchor", "shape_offset", "spring_length", "tendon_length"),)
COORDINATES = ("angle", "lower", "upper", "rest")
MEASURED_IN = {"mass": "kg", "inertia": "kg m^2"} | dict.fromkeys(LENGTHS, "m")
MEASURED_IN |= dict.fromkeys(COORDINATES, "rad or m")  # all others by units of their own
SHARES = ("restitution",)  # in [0, 1]
# what may be of either sign
SIGNED = ("com", "anchor", "angle", "lower", "upper", "rest", "shape_offset", "tendon_length")
NAMES = (*PERTURBABLE, *SIGNED)
OF_NO_BODY = (
    *("step_size", "gravity", "sigma", "spring_stiffness", "spring_damping", "spring_length"),
    *("tendon_stiffness", "tendon_damping", "tendon_length", "tendon_coefficient", "tendon_force_limit"),
    "tendon_force_sigma",
)


class Laws(NamedTuple):
    """The columns of a table of numbers (C,), see `make_columns` of the kernels.

    Attributes:
        base: what a number is drawn around; (M, C) where worlds choose among rows.
        law: one of `LAWS`, by its place.
        first, second: the law's numbers.
        step, stream: address of the random number beside seed and world.
        names: of the columns.
    """

    base: np.ndarray
    law: np.ndarray
    first: np.ndarray
    second: np.ndarray
    step: np.ndarray
    stream: np.ndarray
    names: tuple[str, ...]

    @property
    def varied(self) -> np.ndarray:
        """Columns that differ from world to world: no factor changes a number that is 0."""
        even, factor = (self.law == LAWS.index(law) for law in ("uniform", "log-normal"))
        spread = np.where(even, self.second - self.first, self.first)
        spread = np.where(factor & (np.atleast_2d(self.base) == 0.0).all(axis=0), 0.0, spread)
        return np.flatnonzero((self.law > 0) & (spread != 0.0))

    def alike(self, columns: Sequence[int]) -> bool:
        """Whether columns hold the same number in every world."""
        rows = (*np.atleast_2d(self.base), self.law, self.first, self.second, self.step, self.stream)
        return not any(np.ptp(row[list(columns)]) for row in rows)

    def put(self, column: int, drawn: Drawn) -> None:
        """The law of a column, around the numbers that are there."""
        law, base, self.first[column], self.second[column] = row_of(drawn, self.base[..., column])
        self.law[column], self.base[..., column] = law, base


def still(base: Any, step: Any, stream: Any, names: Sequence[str]) -> Laws:
    """Columns of numbers that are not drawn."""
    values, none = np.array(base, float), np.zeros(len(names))
    address = np.array(step, np.int32), np.array(stream, np.int32)
    return Laws(values, np.zeros(len(names), np.int32), none, none.copy(), *address, tuple(names))


def parameter_laws(scene: Scene, base: np.ndarray, given: Mapping[str, Distribution]) -> Laws:
    """Columns of the table of parameters, from numbers (P,) without a draw.

    Raises:
        ArgumentError: a name that the scene has not got, or a distribution that it cannot have.
    """
    columns = layout(scene.structure).columns
    names, group = _parameter_names(scene, columns), _groups(columns)
    laws = still(base, group, [kernels.PARAMETER] * len(names), names)
    given, leader = _by_name(given)
    found, inert = places_of_all(scene, given, "Disturbances.parameters"), _inert(scene)
    for key, places in found.items():
        if inert.keys() >= set(places):
            raise ArgumentError(f"Disturbances.parameters names {key!r}; it was built {inert[places[0]]}")
    # what is said of one part, or one component, counts
    rank = {key: (*_precision(key), -len(found[key])) for key in given}
    _check_ranks(found, rank, names)
    for key in sorted(given, key=lambda key: rank[key]):
        drawn, places = given[key], found[key]
        joined = list(leader.values()).count(leader[key]) > 1
        first = _first(scene, places, joined or drawn.shared)
        if leader[key] != key:
            first = _led(scene, key, places, leader[key], found[leader[key]])
        alone = _is_one_size(scene, leader[key], found[leader[key]])
        _is_one_size(scene, key, places)
        _check_one_number(scene, key, places, drawn)
        for column in (place for place in places if place not in inert):
            laws.base[..., column] = np.asarray(base)[..., column]  # alone
            laws.put(column, drawn)
            laws.step[column] = first[column] if alone else group[first[column]]
    return laws


def _check_ranks(found: Mapping[str, Sequence[int]], rank: Mapping[str, Any], names: Sequence[str]) -> None:
    """Raise ArgumentError for a number of which two names, as narrow as each other, say different things."""
    of = {key: set(places) for key, places in found.items()}
    for place in set[int]().union(*of.values()):
        keys = [key for key, places in of.items() if place in places]
        most = [key for key in keys if rank[key] == max(rank[each] for each in keys)]
        if len(most) > 1:
            raise ArgumentError(
                f"Disturbances.parameters names {most[0]!r} and {most[1]!r}, which both are of "
                f"{names[place]!r}; a law of that one, or one law of both names ({', '.join(most[:2])!r}), "
                "is needed"
            )


def names_in(key: str) -> tuple[str, ...]:
    """The names that one draw is of: "left.mass, right.mass" are two."""
    return tuple(name.strip() for name in key.split(","))


def _by_name(given: Mapping[str, Distribution]) -> tuple[dict[str, Distribution], dict[str, str]]:
    """The law of every name, and whose random number it takes: that of the first of several, or its own.

    Raises:
        ArgumentError: a name that comes twice.
    """
    out, leader = dict[str, Distribution](), dict[str, str]()
    for key, drawn in given.items():
        several = names_in(key)
        for name in several:
            if name in out:
                raise ArgumentError(
                    f"Disturbances.parameters has {name!r} twice; one law of a name is needed"
                )
            out[name], leader[name] = drawn, several[0]
    return out, leader


def _is_one_size(scene: Scene, key: str, places: Sequence[int]) -> bool:
    """Whether a name is of one of the two sizes of shapes, "box.radius_0", which has a number of its own.

    Raises:
        ArgumentError: some of them are discs or half-planes, which have one or none.
    """
    _, name, component = parameter_of(key)
    if name != "radius" or component is None:
        return False
    _, start, _ = column_of(scene, places[0])
    for shape in (scene.shapes[(column - start) // 2] for column in places):
        if shape.kind not in TWO_SIZES:
            raise ArgumentError(
                f"Disturbances.parameters names {key!r}; {shape.name!r} is a {shape.kind}, without two sizes"
            )
    return True


def _check_one_number(scene: Scene, key: str, places: Sequence[int], drawn: Distribution) -> None:
    """Raise ArgumentError for sizes that take a uniform number where one does not say them."""
    part, name, component = parameter_of(key)
    if name != "radius" or component is not None or not isinstance(drawn, Uniform):
        return
    _, start, _ = column_of(scene, places[0])
    for shape in (scene.shapes[(column - start) // 2] for column in places):
        if shape.kind not in ONE_SIZE:
            one = f"; one of them is '{shape.name}.radius_0'" if shape.kind in TWO_SIZES else ""
            raise ArgumentError(
                f"Disturbances.parameters[{key!r}] is {shown(drawn)}; {shape.name!r} is a {shape.kind}, "
                f"whose size is not one number{one}"
            )
        if not part and not np.any(shape.radius):
            raise ArgumentError(
                f"Disturbances.parameters[{key!r}] is {shown(drawn)}; {shape.name!r} is a point, which only "
                f"its own name, '{shape.name}.radius', makes a disc"
            )


def _precision(key: str) -> tuple[bool, bool]:
    part, _, component = parameter_of(key)
    return bool(part), component is not None


def _first(scene: Scene, places: Sequence[int], shared: bool | str) -> dict[int, int]:
    """Per column of a parameter the column whose random number it takes."""
    if shared is False:
        return {column: column for column in places}
    if shared is True:  # by all parts; both components of a place are drawn
        component = {column: _component(scene, column) for column in places}
        least = {i: column for column, i in reversed(component.items())}
        return {column: least[i] for column, i in component.items()}
    found: dict[Any, int] = {}
    owner = {column: _bodies(scene, column) for column in places}
    return {column: found.setdefault(owner[column], column) for column in places}


def _led(scene: Scene, key: str, places: Sequence[int], leader: str, lead: Sequence[int]) -> dict[int, int]:
    """Per column of a parameter that of the first of several names whose random number it takes: the same
    component, or the only one.
    """

    def component(name: str, column: int) -> int:
        return _component(scene, column) if parameter_of(name)[2] is None else 0

    by: dict[int, int] = {}
    for column in lead:
        by.setdefault(component(leader, column), column)
    return {column: by.get(component(key, column), by[0]) for column in places}


def _component(scene: Scene, column: int) -> int:
    """Which of a place's two components a column is; 0 of all else."""
    name, start, _ = column_of(scene, column)
    return (column - start) % 2 if f"{name}_x" in COMPONENTS else 0


def _bodies(scene: Scene, column: int) -> Any:
    """Which body, or which two, a column of the parameters is of, with its place among its part's numbers."""
    name, start, shape = column_of(scene, column)
    structure, width = scene.structure, max(1, int(np.prod(shape[1:], dtype=int)))
    row, place = divmod(column - start, width)
    if name in OF_DOFS:
        return structure.dof_body[row], place
    if name in OF_SHAPES:
        return structure.shapes[row].body, place
    if name == "gear":
        driven = structure.driven(row)
        return (structure.dof_body[driven[0]] if len(driven) == 1 else name, row), place
    if name in OF_PAIRS:
        pair = structure.pairs[row]
        return frozenset(structure.shapes[s].body for s in (pair.shape_a, pair.shape_b)), place
    return row, place


def check_parameters(key: str, drawn: Distribution) -> None:
    """Raise ArgumentError for a name, or several that one draw is of, that cannot be drawn, or not so."""
    for name in names_in(key):
        check_parameter(name, drawn)
    named = {parameter_of(name)[1] for name in names_in(key)}
    measured = {MEASURED_IN.get(name, f"units of {name}") for name in named}
    if isinstance(drawn, Uniform) and len(measured) > 1:
        raise ArgumentError(
            f"Disturbances.parameters[{key!r}] is {shown(drawn)}, one number for what is measured in "
            f"{' and in '.join(sorted(measured))}; a UniformFactor or LogNormal, whose factor they "
            "share, is needed"
        )


def check_parameter(key: str, drawn: Distribution) -> None:
    """Raise ArgumentError for a parameter that cannot be drawn, or not so."""
    label, name = f"Disturbances.parameters[{key!r}]", parameter_of(key)[1]
    if name not in NAMES:
        known = sorted({*NAMES, *COMPONENTS})
        raise ArgumentError(
            f"Disturbances.parameters names {key!r}{like(key, known)}; choose from {', '.join(known)}, of "
            "all parts, or of one, as 'box.mass'"
        )
    alone = name == "radius" and parameter_of(key)[2] is not None  # one of two sizes
    kinds = {"uniform", "normal"} if name in SIGNED else set(LAWS)
    if name in FACTORS and not alone:
        kinds = {"log-normal", "uniform"} if name == "radius" else {"log-normal"}
    if name in POSITIVE or name in NONNEGATIVE:
        kinds.discard("normal")
    if name in SHARES:
        kinds.discard("log-normal")  # whose factors have no bound
    if drawn.shared == BODIES and name in OF_NO_BODY:
        raise ArgumentError(
            f"{label} is {shown(drawn)}; {name} is of no body: shared True or False is needed"
        )
    if (LogNormal.law if isinstance(drawn, UniformFactor) else drawn.law) not in kinds:
        need = " or ".join(sorted(kinds - {"none"}))
        raise ArgumentError(f"{label} is {shown(drawn)}; {name} takes {need}")
    if isinstance(drawn, Uniform):
        above = name in POSITIVE or name == "radius"
        low = drawn.low <= 0.0 if above else name in NONNEGATIVE and drawn.low < 0.0
        if low:
            sign = "positive" if above else "no negative"
            raise ArgumentError(f"{label} is {shown(drawn)}; {sign} numbers are needed")
        if name in SHARES and drawn.high > 1.0:
            raise ArgumentError(f"{label} is {shown(drawn)}; numbers of at most 1 are needed")


def _parameter_names(scene: Scene, columns: Sequence[tuple[str, int, tuple[int, ...]]]) -> list[str]:
    """A name for every column: "block.mass", "block.com_x"; of what has no parts "gravity_x"."""
    names = []
    for name, _, shape in columns:
        size = int(np.prod(shape, dtype=int))
        parts = parts_of(scene, name)
        if not shape:
            names.append(name)
        elif not parts:
            names += [f"{name}_{'xy'[i] if name == 'gravity' else i}" for i in range(size)]
        else:
            ends = ["_0", "_1"] if name == "radius" else ["_x", "_y"]
            ends = {1: [""], 2: ends, 4: ["_ax", "_ay", "_bx", "_by"]}[size // len(parts)]
            names += [f"{part}.{name}{end}" for part in parts for end in ends]
    return names


def _groups(columns: Sequence[tuple[str, int, tuple[int, ...]]]) -> np.ndarray:
    """Per column whose random number it takes."""
    first = {name: start for name, start, _ in columns}
    group = np.arange(sum(int(np.prod(shape, dtype=int)) for _, _, shape in columns), dtype=np.int32)
    for name, start, shape in columns:
        size = int(np.prod(shape, dtype=int))
        if name == "inertia":  # a heavier body of the same shape turns harder, too
            group[start : start + size] = first["mass"] + np.arange(size)
        if name == "radius":
            group[start : start + size] = start + 2 * (np.arange(size) // 2)
        if name in ("gravity", "sigma"):
            group[start : start + size] = start
    return group


def _inert(scene: Scene) -> dict[int, str]:
    """Columns that no kernel reads, and what their parts were built without."""
    found: dict[int, str] = {}
    for name, start, shape in layout(scene.structure).columns:
        if name in BUILT and np.prod(shape, dtype=int):
            acts = acting(scene.structure, name)
            found |= {start + row: BUILT[name] for row, each in enumerate(acts) if not each}
    return found


def key_of(scene: Scene, column: int) -> str:
    """The name that a column of the parameters is drawn by: "block.mass", or "gravity" where no part owns it.

    Both radii of a capsule have the same one, components of places their own: "hand.shape_offset_x".
    """
    name, start, shape = column_of(scene, column)
    parts = parts_of(scene, name)
    if not parts or not shape:
        return name
    row, place = divmod(column - start, int(np.prod(shape, dtype=int)) // shape[0])
    component = f"{name}_{'xy'[place % 2]}"
    return f"{parts[row]}.{component if component in COMPONENTS else name}"


def start_laws(scene: Scene, starts: Any, spread: np.ndarray, given: Mapping[str, Distribution]) -> Laws:
    """Columns of the start (M, nx): normal of some standard deviation (nx,), or as given by name.

    Raises:
        ArgumentError: a name that the scene has not got.
    """
    nx = len(spread)
    laws = still(starts, range(nx), [kernels.START] * nx, scene.state_names)
    for i, sd in enumerate(spread):
        laws.put(i, Normal(float(sd)))
    for name, drawn in given.items():
        laws.put(scene.state_index(name), drawn)
    return laws


def kick_laws(scene: Scene, times: Sequence[float], sd: float, given: Mapping[str, Distribution]) -> Laws:
    """Columns (K nv) of what kicks add to the velocities.

    Raises:
        ArgumentError: a name that is no velocity's.
    """
    nv, velocities = scene.nv, scene.state_names[scene.nv :]
    drawn: list[Distribution] = [Normal(sd)] * nv
    for name, each in given.items():
        if name not in velocities:
            raise ArgumentError(
                f"Disturbances.kicks names {shown(name)}; velocities are kicked: {', '.join(velocities)}"
            )
        drawn[velocities.index(name)] = each
    count = len(times) * nv
    steps, streams = np.repeat(range(len(times)), nv), np.tile(kernels.KICK + np.arange(nv), len(times))
    names = [f"kick_{k}_{velocity}" for k in range(len(times)) for velocity in velocities]
    laws = still(np.zeros(count), steps, streams, names)
    for i in range(count):
        laws.put(i, drawn[i % nv])
    return laws


def event_laws(word: str, fields: Sequence[str], stream: int, events: Sequence[Sequence[Drawn]]) -> Laws:
    """Columns (Q F) of what is drawn of events, in the order of their fields."""
    rows = [row_of(drawn) for event in events for drawn in event]
    steps = np.repeat(range(len(events)), len(fields))
    streams = np.tile(stream + np.arange(len(fields)), len(events))
    names = [f"{word}_{n}_{field}" for n in range(len(events)) for field in fields]
    laws = still(np.zeros(len(rows)), steps, streams, names)
    for i, (law, base, first, second) in enumerate(rows):
        laws.law[i], laws.base[i], laws.first[i], laws.second[i] = law, base, first, second
    return laws
