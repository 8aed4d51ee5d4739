"""Names of a scene's states, controls, contact pairs and rows, as tables, files, charts and errors use them.

A degree of freedom is named after its body: `finger1.angle` of a revolute joint, `cart.shift` of a prismatic
one, `block.x`, `block.y`, `block.angle` of a free body; its velocity has a v before the last word,
`block.vx`, `finger1.vangle`. A control is named after the degree of freedom or the tendon that it drives.
"""

import difflib
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from slcp_warp.kernels.structure import CORNERS, PairStructure, Structure

from ..inputs.checks import shown
from ..inputs.errors import ArgumentError, ArgumentTypeError

if TYPE_CHECKING:
    from .parts import Body, Shape, Spring, Tendon

DOFS = {"revolute": ("angle",), "prismatic": ("shift",), "free": ("x", "y", "angle")}
UNITS = {"angle": "rad", "shift": "m", "x": "m", "y": "m"}
FEW = 40  # names that an error lists
WORLD_NAME = "world"  # at the end of a spring
SIDES = {1: "+", -1: "-"}  # of the tangent, in the two rows n + mu t and n - mu t of a contact with friction
ENDS = SIDES | {end: str(i) for i, end in enumerate(CORNERS)}  # of capsules, and corners of rectangles
END = re.compile(r"\((?:" + "|".join(map(re.escape, ENDS.values())) + r")\)(?=/|$)")  # behind a name


def dofs_of(bodies: Sequence["Body"]) -> list[tuple[str, str]]:
    """(body, word) of every degree of freedom."""
    return [(body.name, word) for body in bodies for word in DOFS[body.joint]]


def state_names(bodies: Sequence["Body"]) -> tuple[str, ...]:
    """Names of the 2 nv components of a state (q, v)."""
    dofs = dofs_of(bodies)
    return tuple([f"{body}.{word}" for body, word in dofs] + [f"{body}.v{word}" for body, word in dofs])


def state_units(bodies: Sequence["Body"]) -> tuple[str, ...]:
    """Units of the 2 nv components of a state (q, v)."""
    units = [UNITS[word] for _, word in dofs_of(bodies)]
    return tuple(units + [f"{unit}/s" for unit in units])


def control_names(
    bodies: Sequence["Body"], structure: Structure, tendons: Sequence["Tendon"] = ()
) -> tuple[str, ...]:
    """Names of the nu controls; the second one on a degree of freedom or tendon has a #2 behind it, and so
    on.
    """
    positions = (*state_names(bodies)[: structure.nv], *(tendon.name for tendon in reversed(tendons)))
    names: list[str] = []
    for place, dof in enumerate(structure.actuators):
        before = structure.actuators[:place].count(dof)
        names.append(positions[dof] + (f"#{before + 1}" if before else ""))
    return tuple(names)


def pair_names(shapes: Sequence["Shape"], pairs: Sequence[PairStructure]) -> tuple[str, ...]:
    """Names of the pairs that may touch: `shape_a/shape_b`; ends of capsules have (+) or (-) behind them,
    corners of rectangles (0) to (3), counter-clockwise from the lower left.
    """

    def end(shape: int, which: int) -> str:
        return shapes[shape].name + (f"({ENDS[which]})" if which else "")

    return tuple(f"{end(p.shape_a, p.end_a)}/{end(p.shape_b, p.end_b)}" for p in pairs)


def spring_names(springs: Sequence["Spring"]) -> tuple[str, ...]:
    """Names of the springs: `body_a/body_b`, or `world`; further ones between the same have #2, #3, .."""
    names: list[str] = []
    for spring in springs:
        ends = f"{spring.body_a or WORLD_NAME}/{spring.body_b or WORLD_NAME}"
        same = sum(name.partition("#")[0] == ends for name in names)
        names.append(f"{ends}#{same + 1}" if same else ends)
    return tuple(names)


def row_names(bodies: Sequence["Body"], shapes: Sequence["Shape"], structure: Structure) -> tuple[str, ...]:
    """Names of the nr rows: `body.word lower`, `body.word upper`, and of contacts the pair.

    With friction there are two rows a pair, `pair +` and `pair -`: n + mu t and n - mu t, with Coulomb's
    friction the normal and the tangent.
    """
    positions, pairs = state_names(bodies), pair_names(shapes, structure.pairs)
    names = []
    for row in structure.rows:
        if row.kind == "limit":
            names.append(f"{positions[row.index]} {'lower' if row.sign > 0 else 'upper'}")
        else:
            names.append(pairs[row.index] + (f" {SIDES[row.sign]}" if row.sign else ""))
    return tuple(names)


def index_of(label: str, which: int | str, names: Sequence[str]) -> int:
    """The place of a component that is given by its name or its place.

    Raises:
        ArgumentError: there is none.
        ArgumentTypeError: it is neither a name nor a whole number.
    """
    if isinstance(which, str):
        if which in names:
            return names.index(which)
        raise ArgumentError(f"{label} is {shown(which)}; {some(which, names)}")
    if isinstance(which, bool) or not isinstance(which, int):
        raise ArgumentTypeError(f"{label} is {shown(which)}; a name or a whole number is needed")
    if not names:
        raise ArgumentError(f"{label} is {which}; there are none")
    if not 0 <= which < len(names):
        raise ArgumentError(f"{label} is {which}; a number from 0 to {len(names) - 1} is needed")
    return which


def pair_index(label: str, which: int | str, pairs: Sequence[str]) -> int:
    """As `index_of` of a contact pair; its two shapes may be named in either order."""
    if isinstance(which, str) and which not in pairs:
        which = turned(which) if turned(which) in pairs else which
    return index_of(label, which, pairs)


def pairs_named(
    label: str,
    which: int | str,
    names: Sequence[str],
    shapes: Sequence["Shape"],
    pairs: Sequence[PairStructure],
) -> tuple[int, ...]:
    """The contact pairs that a name means: one, as `pair_index`; all of two shapes, "left/box"; or all
    between two bodies or shapes, "hand/box", or of one, "box".
    """
    if isinstance(which, str) and which not in names and turned(which) not in names:
        plain = [END.sub("", name) for name in names]
        found = [i for i, name in enumerate(plain) if name in (which, turned(which))]
        found = found or between(shapes, pairs, which)
        if found:
            return tuple(found)
        there = some(which, list(dict.fromkeys(plain)))
        raise ArgumentError(f"{label} is {shown(which)}, no pair, body or shape; {there}")
    return (pair_index(label, which, names),)


def between(shapes: Sequence["Shape"], pairs: Sequence[PairStructure], part: str) -> list[int]:
    """Pairs of shapes of one and, after a stroke, of another, each the name of a body or of a shape."""

    def own(name: str) -> set[int]:
        return {i for i, shape in enumerate(shapes) if name in (shape.name, shape.body)}

    first, stroke, second = part.partition("/")
    one, other = own(first), own(second) if stroke else set(range(len(shapes)))
    ends = ((p.shape_a, p.shape_b) for p in pairs)
    return [i for i, (a, b) in enumerate(ends) if (a in one and b in other) or (b in one and a in other)]


def turned(pair: str) -> str:
    """`shape_b/shape_a` of `shape_a/shape_b`."""
    return "/".join(pair.split("/")[::-1])


def some(which: str, names: Sequence[str]) -> str:
    """What there is: all names, or those that are like one that is not among many."""
    if len(names) <= FEW:
        return f"there are {', '.join(names) or 'none'}"
    near = difflib.get_close_matches(which, names, 3)
    return f"there are {len(names):,}, " + (f"{' and '.join(near)} like it" if near else f"as {names[0]}")
