"""A structure as tables of integers: what the generic kernels read instead of being specialised.

Two orders of the degrees of freedom occur. `dof` is the scene's. `place` is the order of elimination: trees
one after the other (reverse Cuthill and McKee on the graph of the contact pairs), so that the matrix M + J' W
J has a narrow envelope. Vectors of the solver are in places; q, v and parameters in dofs. A symmetric matrix
is stored by the rows of its lower envelope, entry (i, j), j >= first[i], at index at[i] + j; M's envelope
lies within that of M + J' W J, and ends at the trees' borders. With implicit damping M + h C stands for M
throughout: trees that a spring ties to each other are one block of it.
"""

from dataclasses import dataclass

import warp as wp

from ..contact.shapes import oriented_ends, oriented_pair
from ..factories import cached
from ..structure import CAPSULE, DISC, HALFPLANE, PRISMATIC, WORLD, Structure, layout

TURN, AXIS, SHIFT_X, SHIFT_Y = 0, 1, 2, 3  # what a degree of freedom does
LOWER, UPPER, CONTACT = 0, 1, 2  # kinds of rows
PLANE, LONG, ROUND = 0, 1, 2  # first shape of a pair: half-plane, capsule, ellipse or disc
JOINT = {"revolute": 0, "prismatic": 1, "free": 2}
MOVES_A, MOVES_B = 1, 2  # which sides of a pair a degree of freedom moves

NUMBERS = (
    "step_size", "gravity", "sigma", "mass", "inertia", "com", "anchor", "angle", "axis", "damping", "lower",
    "upper", "gear", "friction", "radius", "shape_offset", "shape_angle",
    "stiffness", "rest", "spring_stiffness", "spring_damping", "spring_length", "spring_point",
)  # fmt: skip


@wp.struct
class Topology:
    """Tables of one scene; a name ending in `_start` has one more entry than there are items."""

    nb: int
    nv: int
    nu: int
    nr: int
    pairs: int
    sprung: int  # dofs with a joint spring
    springs: int
    inertia_scaling: int
    coulomb: int
    implicit_damping: int
    columns: wp.array(dtype=wp.int32)  # first column of every parameter, in the order of NUMBERS, -1: none
    parent: wp.array(dtype=wp.int32)  # (nb)
    joint: wp.array(dtype=wp.int32)  # (nb)
    first_dof: wp.array(dtype=wp.int32)  # (nb)
    chain_start: wp.array(dtype=wp.int32)  # (nb + 1) dofs that move a body, ascending
    chain: wp.array(dtype=wp.int32)
    dof_body: wp.array(dtype=wp.int32)  # (nv)
    dof_kind: wp.array(dtype=wp.int32)  # (nv)
    place: wp.array(dtype=wp.int32)  # (nv)
    actuator: wp.array(dtype=wp.int32)  # (nu) dof
    sprung_dof: wp.array(dtype=wp.int32)  # (sprung)
    spring_body: wp.array(dtype=wp.int32)  # (2 springs)
    mass_first: wp.array(dtype=wp.int32)  # (nv) envelope of M
    mass_at: wp.array(dtype=wp.int32)
    first: wp.array(dtype=wp.int32)  # (nv) envelope of M + J' W J
    at: wp.array(dtype=wp.int32)
    shape_body: wp.array(dtype=wp.int32)
    shape_turned: wp.array(dtype=wp.int32)
    pair_kind: wp.array(dtype=wp.int32)  # (pairs) PLANE, LONG or ROUND
    pair_exact: wp.array(dtype=wp.int32)  # 1: the bound of the distance is the distance
    pair_a: wp.array(dtype=wp.int32)
    pair_b: wp.array(dtype=wp.int32)
    pair_ends: wp.array(dtype=wp.int32)  # (2 pairs) +1, -1: the disc at that end of a capsule; 0: the shape
    pair_row: wp.array(dtype=wp.int32)  # (pairs + 1) first row
    pair_start: wp.array(
        dtype=wp.int32
    )  # (pairs + 1) dofs that move the pair's sides against each other, by place
    pair_dof: wp.array(dtype=wp.int32)
    pair_side: wp.array(dtype=wp.int32)  # MOVES_A, MOVES_B or both
    row_kind: wp.array(dtype=wp.int32)  # (nr)
    row_index: wp.array(dtype=wp.int32)  # dof or pair
    row_sign: wp.array(dtype=wp.int32)
    row_start: wp.array(dtype=wp.int32)  # (nr + 1) entries of J's rows
    row_place: wp.array(dtype=wp.int32)  # their columns
    row_trees: wp.array(dtype=wp.int32)  # (4 nr) first and end place of the blocks of M a row touches


@dataclass(frozen=True)
class Sizes:
    """Lengths of the workspaces of one world."""

    mass: int  # entries of M's envelope
    matrix: int  # entries of the envelope of M + J' W J
    entries: int  # entries of J


@cached
def tables(s: Structure) -> tuple[dict[str, list[int]], Sizes]:
    """Every table of `Topology` by name, and the sizes of a world's workspaces."""
    out: dict[str, list[int]] = {}
    lay = layout(s)
    out["columns"] = [lay.offset(name) if name in lay.names else -1 for name in NUMBERS]
    out["sprung_dof"] = list(s.sprung)
    out["spring_body"] = [body for spring in s.springs for body in spring]
    chains = [[j for j in range(s.nv) if s.in_chain(b, j)] for b in range(s.nb)]
    out["parent"] = [b.parent for b in s.bodies]
    out["joint"] = [JOINT[b.joint] for b in s.bodies]
    out["first_dof"] = [b.dofs[0] for b in s.bodies]
    out["chain_start"], out["chain"] = _ragged(chains)
    out["dof_body"] = list(s.dof_body)
    out["dof_kind"] = [_dof_kind(s, j) for j in range(s.nv)]
    out["actuator"] = list(s.actuators)
    tree = _trees(s)
    ties = _ties(s, tree)
    block = _blocks(tree, ties)
    place = _places(s, tree, ties, block)
    out["place"] = place
    extent = {t: (min(p), max(p) + 1) for t in set(block)
              for p in [[place[j] for j in range(s.nv) if block[j] == t]]}  # fmt: skip
    begin = {t: min(place[j] for j in range(s.nv) if tree[j] == t) for t in set(tree)}
    mass_first = [0] * s.nv
    for j in range(s.nv):
        mass_first[place[j]] = min(begin[t] for t in {tree[j], *ties[tree[j]]})
    _pair_tables(s, chains, place, out)
    first = list(mass_first)
    columns = []
    trees = []
    for row in s.rows:
        if row.kind == "limit":
            columns.append([place[row.index]])
            dofs = [row.index]
        else:
            dofs = out["pair_dof"][out["pair_start"][row.index] : out["pair_start"][row.index + 1]]
            columns.append([place[j] for j in dofs])
        for p in columns[-1]:
            first[p] = min(first[p], columns[-1][0])
        touched = sorted({extent[block[j]] for j in dofs})
        trees += [x for start_end in (*touched, (0, 0), (0, 0))[:2] for x in start_end]
    kinds = {("limit", 1): LOWER, ("limit", -1): UPPER}
    out["row_kind"] = [kinds.get((row.kind, row.sign), CONTACT) for row in s.rows]
    out["row_index"] = [row.index for row in s.rows]
    out["row_sign"] = [row.sign for row in s.rows]
    out["row_start"], out["row_place"] = _ragged(columns)
    out["row_trees"] = trees
    out["mass_first"], out["mass_at"], mass = _envelope(mass_first)
    out["first"], out["at"], matrix = _envelope(first)
    return out, Sizes(mass, matrix, len(out["row_place"]))


def make_topology(s: Structure, inertia_scaling: bool, coulomb: bool, device: object) -> Topology:
    """The tables on a device."""
    lists, _ = tables(s)
    out = Topology()
    out.nb, out.nv, out.nu, out.nr, out.pairs = s.nb, s.nv, s.nu, s.nr, len(s.pairs)
    out.sprung, out.springs = len(s.sprung), len(s.springs)
    out.inertia_scaling, out.coulomb = int(inertia_scaling), int(coulomb)
    out.implicit_damping = int(s.implicit_damping)
    for name, values in lists.items():
        setattr(out, name, wp.array(values, dtype=wp.int32, device=device))
    return out


def _ragged(lists: list[list[int]]) -> tuple[list[int], list[int]]:
    start = [0]
    for items in lists:
        start.append(start[-1] + len(items))
    return start, [x for items in lists for x in items]


def _envelope(first: list[int]) -> tuple[list[int], list[int], int]:
    at, used = [], 0
    for i, start in enumerate(first):
        at.append(used - start)
        used += i - start + 1
    return first, at, used


def _dof_kind(s: Structure, dof: int) -> int:
    body = s.bodies[s.dof_body[dof]]
    if s.dof_kind[dof] != PRISMATIC:
        return TURN
    if body.joint == "prismatic":
        return AXIS
    return SHIFT_X if dof == body.dofs[0] else SHIFT_Y


def _trees(s: Structure) -> list[int]:
    """The root body of every dof."""
    root: list[int] = []
    for b, body in enumerate(s.bodies):
        root.append(b if body.parent == WORLD else root[body.parent])
    return [root[b] for b in s.dof_body]


def _ties(s: Structure, tree: list[int]) -> dict[int, set[int]]:
    """Trees that springs couple in M + h C with each tree."""
    root = dict(zip(s.dof_body, tree, strict=True))
    out: dict[int, set[int]] = {t: set() for t in tree}
    for a, b in s.springs if s.implicit_damping else ():
        if a != WORLD and b != WORLD and root[a] != root[b]:
            out[root[a]].add(root[b])
            out[root[b]].add(root[a])
    return out


def _blocks(tree: list[int], ties: dict[int, set[int]]) -> list[int]:
    """The block of M of every dof, named by one of its trees."""
    block: dict[int, int] = {}
    for start in sorted(ties):
        found = [] if start in block else [start]
        while found:
            t = found.pop()
            block[t] = start
            found += [other for other in ties[t] if other not in block]
    return [block[t] for t in tree]


def _cuthill_mckee(near: dict[int, set[int]]) -> list[int]:
    """Order of Cuthill and McKee of a graph's nodes."""
    order: list[int] = []
    for start in sorted(near, key=lambda t: (len(near[t]), t)):
        queue = [] if start in order else [start]
        while queue:
            t = queue.pop(0)
            order.append(t)
            known = set(order) | set(queue)
            queue += sorted(near[t] - known, key=lambda x: (len(near[x]), x))
    return order


def _places(s: Structure, tree: list[int], ties: dict[int, set[int]], block: list[int]) -> list[int]:
    """Reverse Cuthill-McKee order of the blocks; the dofs of each of its trees go from leaves to root."""
    near: dict[int, set[int]] = {t: set() for t in block}
    of_body = dict(zip(s.dof_body, block, strict=True))
    for pair in s.pairs:
        a, b = (of_body.get(s.shapes[i].body) for i in (pair.shape_a, pair.shape_b))
        if a is not None and b is not None and a != b:
            near[a].add(b)
            near[b].add(a)
    inside = _cuthill_mckee(ties)
    block_of = dict(zip(tree, block, strict=True))
    order = [t for k in _cuthill_mckee(near) for t in inside if block_of[t] == k]
    place = [0] * s.nv
    places = [j for t in reversed(order) for j in range(s.nv - 1, -1, -1) if tree[j] == t]
    for position, j in enumerate(places):
        place[j] = position
    return place


def _pair_tables(s: Structure, chains: list[list[int]], place: list[int], out: dict[str, list[int]]) -> None:
    dofs, sides = [], []
    pairs = [oriented_pair(s, k) for k in range(len(s.pairs))]
    for a, b in pairs:
        a_moves, b_moves = (
            set() if s.shapes[i].body == WORLD else set(chains[s.shapes[i].body]) for i in (a, b)
        )
        # what shifts both moves nothing between them
        moves = [j for j in a_moves | b_moves if j not in a_moves & b_moves or _dof_kind(s, j) == TURN]
        dofs.append(sorted(moves, key=lambda j: place[j]))
        sides.append([MOVES_A * (j in a_moves) + MOVES_B * (j in b_moves) for j in dofs[-1]])
    ends = [oriented_ends(s, k) for k in range(len(s.pairs))]
    kinds = [
        tuple(DISC if end else s.shapes[i].kind for i, end in zip(pair, at, strict=True))
        for pair, at in zip(pairs, ends, strict=True)
    ]
    out["shape_body"] = [shape.body for shape in s.shapes]
    out["shape_turned"] = [int(shape.turned) for shape in s.shapes]
    out["pair_kind"] = [{HALFPLANE: PLANE, CAPSULE: LONG}.get(a, ROUND) for a, _ in kinds]
    out["pair_exact"] = [int(a in (HALFPLANE, CAPSULE) or a == b == DISC) for a, b in kinds]
    out["pair_ends"] = [end for at in ends for end in at]
    out["pair_a"] = [a for a, _ in pairs]
    out["pair_b"] = [b for _, b in pairs]
    out["pair_start"], out["pair_dof"] = _ragged(dofs)
    out["pair_side"] = _ragged(sides)[1]
    starts = [i for i, row in enumerate(s.rows) if row.kind == "contact" and row.sign >= 0]
    out["pair_row"] = [*starts, s.nr]
