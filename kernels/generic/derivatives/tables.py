"""Tables and workspace of the generic derivatives, beside those of the step.

A group of bodies is a block of M: trees, and what springs and tendons that are met late tie to each other.
D = J M^-1 J' of a row depends on the configuration of the groups that it moves, and on nothing else.
"""

from typing import Any

import warp as wp

from ...factories import cached
from ...structure import WORLD, Structure
from ..topology import MOVES_A, MOVES_B, tables
from ..work import LANES, M33, V2, WORK, Lanes

Pair = V2
Share = wp.types.vector(4, WORK)
OfBody = wp.types.vector(6, WORK)  # of a chain's degree of freedom, see `bodies.py`
OfContact = wp.types.vector(13, WORK)  # of one that moves a pair, see `pairs.py`
OfSpring = wp.types.vector(13, WORK)  # of one that moves a spring, see `springs.py`


@wp.struct
class Groups:
    """Tables; a name ending in `_start` has one more entry than there are items."""

    width: int  # most degrees of freedom of the groups of one row
    most: int  # most degrees of freedom that move a pair
    body_group: wp.array(dtype=wp.int32)  # (nb)
    shape_group: wp.array(dtype=wp.int32)  # (shapes) of what moves its contacts, -1: nothing
    dof_group: wp.array(dtype=wp.int32)  # (nv)
    dof_local: wp.array(dtype=wp.int32)  # (nv) position in its group
    group_start: wp.array(dtype=wp.int32)  # degrees of freedom, ascending
    group_dof: wp.array(dtype=wp.int32)
    group_body_start: wp.array(dtype=wp.int32)
    group_body: wp.array(dtype=wp.int32)
    spring_start: wp.array(dtype=wp.int32)  # (springs + 1) what moves either end, ascending
    spring_dof: wp.array(dtype=wp.int32)
    spring_side: wp.array(dtype=wp.int32)  # MOVES_A, MOVES_B or both


@wp.struct
class Slopes:
    """Workspaces, (slots, items); a world has a slot while its step is differentiated."""

    velocity: wp.array2d(dtype=WORK)  # (nv) v' by dof
    change: wp.array2d(dtype=WORK)  # (nv) v' - v by dof
    answer: wp.array2d(dtype=WORK)  # (nv) M^-1 J_i' by dof
    of_body: wp.array2d(dtype=OfBody)  # by entries of the bodies' chains
    acceleration: wp.array2d(dtype=Pair)  # (nb)
    of_coriolis: wp.array2d(dtype=Share)  # by entries of the bodies' chains, of the leapfrog alone
    ahead: wp.array2d(dtype=Lanes)  # (3 blocks) d of what it predicts, by parts of LANES columns
    of_spring: wp.array2d(dtype=OfSpring)
    pull: wp.array2d(dtype=Lanes)  # (springs) G and its slopes
    of_contact: wp.array2d(dtype=OfContact)  # (pairs most)
    force: wp.array2d(dtype=Pair)  # (pairs) normal and tangential impulse
    pair: wp.array2d(dtype=wp.int32)  # (pairs) list of those with acting rows
    row: wp.array2d(dtype=wp.int32)  # (nr) list of the acting rows; what follows is by that list
    bunch: wp.array2d(dtype=wp.int32)  # (nr) ends of the parts of that list that share their blocks
    share: wp.array2d(dtype=Share)  # (nr) numbers of the acting rows, see `system.py`
    yielding: wp.array2d(dtype=WORK)  # (1) diag(A) dlambda by which a row yields in the factor
    slides: wp.array2d(dtype=wp.int32)  # (nr) 1: the row is that of a sliding contact with Coulomb's friction
    gap_by_q: wp.array2d(dtype=WORK)  # (nr most) of J_i v' + d/h, by entries of the pair
    before: wp.array2d(dtype=WORK)  # (nv) v, where pairs have a restitution
    bounced: wp.array2d(dtype=WORK)  # (most) of J_n v of one that bounces, by its entries
    scale_by_q: wp.array2d(dtype=WORK)  # (nr width) of D_i, by dofs of the groups
    upper: wp.array2d(dtype=M33)  # the transpose of U where the matrix is not symmetric
    known: wp.array2d(dtype=Lanes)  # (3 blocks) -F1 by the columns, what follows by place and row
    side: wp.array2d(dtype=Lanes)  # (3 blocks) right-hand sides and their solutions
    found: wp.array2d(dtype=Lanes)  # (3 blocks) dv'
    given: wp.array2d(dtype=Lanes)  # (nr) -F2
    root: wp.array2d(dtype=Lanes)  # (nr) dz
    push: wp.array2d(dtype=Lanes)  # (nr) what a row adds to -F1 along J


@cached
def group_tables(s: Structure) -> dict[str, list[int]]:
    """Every table of `Groups` by name."""
    block = _blocks(s)
    names = sorted(set(block))
    dofs = [[j for j in range(s.nv) if block[s.dof_body[j]] == name] for name in names]
    out: dict[str, list[int]] = {"body_group": [names.index(name) for name in block]}
    movers = [s.mover(i) for i in range(len(s.shapes))]
    out["shape_group"] = [-1 if body == WORLD else out["body_group"][body] for body in movers]
    out["dof_group"] = [out["body_group"][b] for b in s.dof_body]
    out["dof_local"] = [dofs[out["dof_group"][j]].index(j) for j in range(s.nv)]
    out["group_start"], out["group_dof"] = _ragged(dofs)
    bodies = [[b for b in range(s.nb) if block[b] == name] for name in names]
    out["group_body_start"], out["group_body"] = _ragged(bodies)
    moved = [
        [[body != WORLD and s.in_chain(body, j) for j in range(s.nv)] for body in ends] for ends in s.springs
    ]
    links = [[j for j in range(s.nv) if a[j] or b[j]] for a, b in moved]
    out["spring_start"], out["spring_dof"] = _ragged(links)
    out["spring_side"] = [
        MOVES_A * a[j] + MOVES_B * b[j] for (a, b), of in zip(moved, links, strict=True) for j in of
    ]
    return out


def _ragged(lists: list[list[int]]) -> tuple[list[int], list[int]]:
    start = [0]
    for items in lists:
        start.append(start[-1] + len(items))
    return start, [x for items in lists for x in items]


def _blocks(s: Structure) -> list[int]:
    """The block of M of every body, named by its first body."""
    block: list[int] = []
    for b, body in enumerate(s.bodies):
        block.append(b if body.parent == WORLD else block[body.parent])
    tied = [(s.dof_body[dofs[0]], s.dof_body[j]) for dofs in s.joined for j in dofs[1:]]
    for a, b in [*s.ties, *tied]:
        if a != WORLD and b != WORLD:
            low, high = sorted((block[a], block[b]))
            block = [low if name == high else name for name in block]
    return block


def widths(s: Structure) -> tuple[int, int]:
    """`width` and `most` of a structure's groups."""
    lists, found = tables(s)[0], group_tables(s)
    size = [end - start for start, end in zip(found["group_start"], found["group_start"][1:], strict=False)]
    most = max((b - a for a, b in zip(lists["pair_start"], lists["pair_start"][1:], strict=False)), default=0)
    widths = [0]
    for row in s.rows:
        if row.kind == "limit":
            widths.append(size[found["dof_group"][row.index]])
        else:
            pair = s.pairs[row.index]
            bodies = {s.mover(i) for i in (pair.shape_a, pair.shape_b)} - {WORLD}
            widths.append(sum(size[g] for g in {found["body_group"][b] for b in bodies}))
    return max(widths), most


def make_groups(s: Structure, device: Any) -> Groups:
    """The tables on a device."""
    out = Groups()
    out.width, out.most = widths(s)
    for name, values in group_tables(s).items():
        setattr(out, name, wp.array(values, dtype=wp.int32, device=device))
    return out


def lengths(s: Structure, leapfrog: bool = False) -> dict[str, tuple[int, Any]]:
    """Items of every workspace of a structure, and what they are."""
    (lists, sizes), found = tables(s), group_tables(s)
    width, most = widths(s)
    pairs = len(s.pairs)
    parts = -(-(2 * s.nv + s.nu) // LANES)
    return {
        **dict.fromkeys(("velocity", "change", "answer"), (s.nv, WORK)),
        "of_body": (len(lists["chain"]), OfBody),
        "acceleration": (s.nb, Pair),
        "of_coriolis": (len(lists["chain"]) * leapfrog, Share),
        "ahead": (3 * sizes.blocks * parts * leapfrog, Lanes),
        "of_spring": (len(found["spring_dof"]), OfSpring),
        "pull": (len(s.springs), Lanes),
        "of_contact": (pairs * most, OfContact),
        "force": (pairs, Pair),
        "pair": (pairs, wp.int32),
        "share": (s.nr, Share),
        "yielding": (1, WORK),
        **dict.fromkeys(("row", "bunch", "slides"), (s.nr, wp.int32)),
        "gap_by_q": (s.nr * most, WORK),
        "before": (s.nv * s.bounces, WORK),
        "bounced": (most * s.bounces, WORK),
        "scale_by_q": (s.nr * width, WORK),
        "upper": (sizes.matrix, M33),
        **dict.fromkeys(("known", "side", "found"), (3 * sizes.blocks, Lanes)),
        **dict.fromkeys(("given", "root", "push"), (s.nr, Lanes)),
    }


def allocate_slopes(s: Structure, leapfrog: bool, slots: int, device: Any) -> Slopes:
    """Workspaces of `slots` worlds."""
    out = Slopes()
    for name, (length, kind) in lengths(s, leapfrog).items():
        setattr(out, name, wp.zeros((slots, length), dtype=kind, device=device))
    return out


def bytes_per_world(s: Structure, leapfrog: bool) -> int:
    """Memory of one slot."""
    return sum(length * wp.types.type_size_in_bytes(kind) for length, kind in lengths(s, leapfrog).values())
