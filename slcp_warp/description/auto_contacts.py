"""`contacts="auto"`: everything may touch everything, but what a scene leaves out.

The rules are those of MuJoCo's geoms, whose names the fields have. Two shapes may touch unless

- both are on the same body, or both on the world;
- one's body is the parent of the other's (`Body.touches_parent` says otherwise); the world is no parent;
- their bodies are among the scene's `excluded`;
- `contype` of neither has a bit in common with `conaffinity` of the other;
- both are half-planes or rings.

Friction is the larger one of the two shapes', each its own or else the scene's; so is restitution.
"""

from collections.abc import Sequence
from typing import Any

from slcp_warp.kernels.structure import CAPSULE, ELLIPSE, RING, SIDED, WALLS

from ..inputs.checks import shown
from ..inputs.errors import SceneError
from .parts import Body, Contact, Shape

AUTO = "auto"
MOST_PAIRS = 32_768  # of contacts="auto": every pair has parameters, and a place in impulses and gaps

SIDES = ("01", "12", "23", "30")  # of `parts.box`, by the corners that they join

Names = tuple[str, str]


def auto_contacts(
    bodies: Sequence[Body],
    shapes: Sequence[Shape],
    friction: float | None = None,
    excluded: Sequence[Names] = (),
    restitution: float | None = None,
) -> tuple[Contact, ...]:
    """Every two shapes that may touch, in the order of the shapes.

    Raises:
        SceneError: an ellipse and a ring or what has sides among them, which cannot touch, or more than
            `MOST_PAIRS`.
    """
    apart = _apart(bodies, excluded)
    out, idle = list[Contact](), dict[str, str]()
    for i, a in enumerate(shapes):
        for b in shapes[i + 1 :]:
            if a.body == b.body or (a.kind in WALLS and b.kind in WALLS):
                continue
            if not (a.contype & b.conaffinity or b.contype & a.conaffinity):
                continue
            if (a.body, b.body) in apart:
                idle |= {shape.name: other.name for shape, other in ((a, b), (b, a)) if shape.kind == RING}
                continue
            _check_kinds(a, b, shapes)
            both = (
                _larger(a.friction, b.friction, friction),
                None if a.restitution == b.restitution == 0.0 else
                _larger(a.restitution, b.restitution, restitution),
            )  # fmt: skip
            out.append(Contact(a.name, b.name, *both))
        if len(out) > MOST_PAIRS:
            raise SceneError(
                f"contacts 'auto' of {len(shapes)} shapes are more than {MOST_PAIRS:,} pairs, the most there "
                "may be; leave some out by contype and conaffinity, or list those that can meet"
            )
    _check_rings(out, idle)
    return tuple(out)


def _check_rings(contacts: Sequence[Contact], idle: dict[str, str]) -> None:
    """Raise SceneError for a ring that holds in nothing, but would what its joint or `excluded` keeps out."""
    held = {name for contact in contacts for name in (contact.shape_a, contact.shape_b)}
    for ring, other in idle.items():
        if ring not in held:
            raise SceneError(
                f"contacts 'auto': ring {ring!r} holds in nothing: a joint, or excluded, keeps its body and "
                f"that of {other!r} from touching; where a joint does, touches_parent=True lets them"
            )


def _apart(bodies: Sequence[Body], excluded: Sequence[Names]) -> set[tuple[str | None, str | None]]:
    """Pairs of bodies, in both orders, that never touch."""
    joined = [(body.name, body.parent) for body in bodies if body.parent and not body.touches_parent]
    one_way = [*joined, *excluded]
    return {*one_way, *((b, a) for a, b in one_way)}


def _larger(a: float | None, b: float | None, common: float | None) -> float | None:
    """The larger coefficient of two shapes, which have their own or else the scene's; None: neither has."""
    own = [common if each is None else each for each in (a, b)]
    return max((each for each in own if each is not None), default=None)


def _check_kinds(a: Shape, b: Shape, shapes: Sequence[Shape]) -> None:
    if ELLIPSE in (a.kind, b.kind) and {a.kind, b.kind} & {*SIDED, RING}:
        side = b.kind if a.kind == ELLIPSE else a.kind
        what = "discs, capsules, rectangles" if side == RING else "half-planes, discs, capsules, rectangles"
        raise SceneError(
            f"contacts 'auto': {_told(a, shapes)} and {_told(b, shapes)} cannot touch; a {side} touches "
            f"{what}; leave the pair out by contype and conaffinity: an "
            "ellipse with contype=2, conaffinity=3 meets no side of a box"
        )


def _told(shape: Shape, shapes: Sequence[Shape]) -> str:
    """A shape in words: its kind and name, and of a box's side which one it is."""
    box, side = shape.name[:-2], shape.name[-2:]
    corners = {other.name for other in shapes if other.body == shape.body}
    of_box = shape.kind == CAPSULE and side in SIDES and {f"{box}{i}" for i in range(4)} <= corners
    return f"{shape.kind} {shape.name!r}" + (f" (side {side} of box {box!r})" if of_box else "")


def check_excluded(label: str, value: Any, bodies: Sequence[Body]) -> tuple[Names, ...]:
    """Pairs of names of different bodies."""
    if not isinstance(value, list | tuple):
        raise SceneError(f"{label} is {shown(value)}; pairs of names of bodies are needed")
    names = {body.name for body in bodies}
    for i, pair in enumerate(value):
        if not (isinstance(pair, list | tuple) and len(pair) == 2 and all(isinstance(n, str) for n in pair)):
            raise SceneError(f"{label}[{i}] is {shown(pair)}; two names of bodies are needed")
        for name in pair:
            if name not in names:
                raise SceneError(f"{label}[{i}]: no body named {name!r}; there are {shown(sorted(names))}")
        if pair[0] == pair[1]:
            raise SceneError(f"{label}[{i}] names {pair[0]!r} twice; two different bodies are needed")
    return tuple((a, b) for a, b in value)
