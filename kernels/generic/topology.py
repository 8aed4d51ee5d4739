"""A structure as tables of integers: what the generic kernels read instead of being specialised.

The degrees of freedom of a tree, from its leaves to its root, are cut into *blocks* of up to three (what is
missing is padded: M has a one there, rows have nothing). Vectors of the solver are arrays of vec3 by block,
matrices arrays of mat33 by the rows of a lower envelope of blocks: block (i, j), j >= first[i], at index
at[i] + j. A *unit* is a diagonal part of M: a tree, or with implicit damping (M + h C stands for M
throughout) trees that springs and tendons tie to each other; its blocks follow one another. Blocks are
numbered in a static order (reverse Cuthill and McKee on the graph of all contact pairs); the order in which a
step eliminates them is made from the pairs that are near (`order.py`).
"""

import itertools
from dataclasses import dataclass

import warp as wp

from ..contact.shapes import oriented_ends, oriented_pair
from ..factories import cached
from ..structure import CAPSULE, DISC, HALFPLANE, PRISMATIC, RECTANGLE, RING, WORLD, Structure, layout
from .broad.items import bits_of, item_tables, items_first

TURN, AXIS, SHIFT_X, SHIFT_Y = 0, 1, 2, 3  # what a degree of freedom does
LOWER, UPPER, CONTACT = 0, 1, 2  # kinds of rows
# first shape of a pair: half-plane, capsule, ellipse or disc, rectangle, ring
PLANE, LONG, ROUND, BLOCK, HOLLOW = 0, 1, 2, 3, 4
KINDS = {HALFPLANE: PLANE, CAPSULE: LONG, RECTANGLE: BLOCK, RING: HOLLOW}
JOINT = {"revolute": 0, "prismatic": 1, "free": 2}
MOVES_A, MOVES_B = 1, 2  # which sides of a pair a degree of freedom moves
SMOOTHED = 2  # limits of force
RUNS_A, RUNS_B = 4, 8  # added to these: whose surface runs with it

NUMBERS = (
    "step_size", "gravity", "sigma", "mass", "inertia", "com", "anchor", "angle", "axis", "damping", "lower",
    "upper", "gear", "friction", "radius", "shape_offset", "shape_angle",
    "stiffness", "rest", "spring_stiffness", "spring_damping", "spring_length", "spring_point", "armature",
    "corner_radius", "restitution", "surface_ratio",
    "tendon_stiffness", "tendon_damping", "tendon_length", "tendon_coefficient", "tendon_force_limit",
    "tendon_force_sigma",
)  # fmt: skip


@wp.struct
class Topology:
    """Tables of one scene; a name ending in `_start` has one more entry than there are items."""

    nb: int
    nv: int
    nu: int
    nr: int
    pairs: int
    shapes: int
    blocks: int
    units: int
    limits: int  # rows of joint limits
    room: int  # blocks of a matrix M + J' W J that there is room for
    sprung: int  # dofs with a joint spring
    springs: int
    tendons: int
    limited: int  # 0: none of their forces has a limit; 1: clamps; SMOOTHED: means where there is a sigma
    width: int  # numbers of a world's parameters
    rotors: int  # dofs with an inertia of their own (armature)
    bounces: int  # 1: pairs have a restitution
    overlaps: int  # 1: they leave by no more than a speed, and may stay
    depenetration_speed: wp.float64  # this speed [m/s, rad/s]
    leapfrog: int  # 1: its free motion, (M63)
    inertia_scaling: int
    coulomb: int
    implicit_damping: int
    implicit_stiffness: int
    columns: wp.array(dtype=wp.int32)  # first column of every parameter, in the order of NUMBERS, -1: none
    parent: wp.array(dtype=wp.int32)  # (nb)
    joint: wp.array(dtype=wp.int32)  # (nb)
    first_dof: wp.array(dtype=wp.int32)  # (nb)
    free_block: wp.array(dtype=wp.int32)  # (nb) block of a body that is free in the world, else -1
    chain_start: wp.array(dtype=wp.int32)  # (nb + 1) dofs that move a body, ascending
    chain: wp.array(dtype=wp.int32)
    dof_body: wp.array(dtype=wp.int32)  # (nv)
    dof_kind: wp.array(dtype=wp.int32)  # (nv)
    dof_block: wp.array(dtype=wp.int32)  # (nv)
    dof_part: wp.array(dtype=wp.int32)  # (nv) 0, 1 or 2: where in its block
    block_dof: wp.array(dtype=wp.int32)  # (3 blocks) -1: padding
    block_unit: wp.array(dtype=wp.int32)  # (blocks)
    block_id: wp.array(dtype=wp.int32)  # (blocks) 0, 1, 2, ...: the static order
    unit_start: wp.array(dtype=wp.int32)  # (units + 1) first block
    mass_first: wp.array(dtype=wp.int32)  # (blocks) envelope of M
    mass_at: wp.array(dtype=wp.int32)
    actuator: wp.array(dtype=wp.int32)  # (nu) dof, or -1 less a tendon
    sprung_dof: wp.array(dtype=wp.int32)  # (sprung)
    spring_body: wp.array(dtype=wp.int32)  # (2 springs)
    tendon_start: wp.array(dtype=wp.int32)  # (tendons + 1) coefficients
    tendon_dof: wp.array(dtype=wp.int32)  # their dofs
    tendon_limited: wp.array(dtype=wp.int32)  # (tendons) 1: its force has a limit
    rotor_dof: wp.array(dtype=wp.int32)  # (rotors)
    shape_body: wp.array(dtype=wp.int32)
    shape_turned: wp.array(dtype=wp.int32)
    pair_kind: wp.array(dtype=wp.int32)  # (pairs) PLANE, LONG, ROUND, BLOCK or HOLLOW
    pair_a: wp.array(dtype=wp.int32)
    pair_b: wp.array(dtype=wp.int32)
    pair_ends: wp.array(dtype=wp.int32)  # (2 pairs) as in `PairStructure`; 0: the shape
    pair_unit: wp.array(dtype=wp.int32)  # (2 pairs) units of the bodies, -1: none
    pair_free: wp.array(dtype=wp.int32)  # (2 pairs) entry of a body free in the world, -1: none, -2: others
    pair_row: wp.array(dtype=wp.int32)  # (pairs + 1) first row
    pair_start: wp.array(dtype=wp.int32)  # (pairs + 1) dofs that move its sides, last first
    pair_dof: wp.array(dtype=wp.int32)
    pair_side: wp.array(dtype=wp.int32)  # MOVES_A, MOVES_B or both, and RUNS_A, RUNS_B
    pair_entry: wp.array(dtype=wp.int32)  # which of its rows' entries it is in
    row_kind: wp.array(dtype=wp.int32)  # (nr)
    row_index: wp.array(dtype=wp.int32)  # dof or pair
    row_sign: wp.array(dtype=wp.int32)
    row_start: wp.array(dtype=wp.int32)  # (nr + 1) entries of J's rows
    row_block: wp.array(dtype=wp.int32)  # their blocks, ascending
    row_key: wp.array(dtype=wp.int32)  # (nr) the same for rows of the same blocks
    limit_row: wp.array(dtype=wp.int32)  # (limits)
    items: int  # of the broad phase (`broad/items.py`); 0: it looks at all pairs
    planes: int  # half-planes beside them
    pair_bits: int  # of each of two digits of a pair's number
    item_body: wp.array(dtype=wp.int32)  # (items + planes)
    item_shape_start: wp.array(dtype=wp.int32)  # (items + planes + 1)
    item_shape: wp.array(dtype=wp.int32)
    item_reach: wp.array(dtype=wp.int32)  # how far these reach (`broad/items.py`)
    item_partner_start: wp.array(dtype=wp.int32)  # (items + planes + 1)
    item_partner: wp.array(dtype=wp.int32)  # of an item those after it, of a half-plane all, ascending
    item_pair_start: wp.array(dtype=wp.int32)  # by partner, + 1
    item_pair: wp.array(dtype=wp.int32)


@wp.func
def place(t: wp.ref[Topology], j: int):
    """Where a degree of freedom is in vectors by block."""
    return 3 * t.dof_block[j] + t.dof_part[j]


@dataclass(frozen=True)
class Sizes:
    """Lengths of the workspaces of one world."""

    items: int
    planes: int
    blocks: int
    mass: int  # blocks of M's envelope
    matrix: int  # blocks of the envelope of M + J' W J with all pairs
    entries: int  # of J, vectors of three
    numbers: int  # parameters


@cached
def tables(s: Structure) -> tuple[dict[str, list[int]], Sizes]:
    """Every table of `Topology` by name, and the sizes of a world's workspaces."""
    out: dict[str, list[int]] = {}
    lay = layout(s)
    out["columns"] = [lay.offset(name) if name in lay.names else -1 for name in NUMBERS]
    out["sprung_dof"] = list(s.sprung)
    out["rotor_dof"] = list(s.armature)
    out["tendon_start"], out["tendon_dof"] = _ragged([list(dofs) for dofs in s.tendons])
    out["tendon_limited"] = [int(i in s.limited) for i in range(len(s.tendons))]
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
    unit = _units(tree, ties)
    blocks = _cut(s, tree, ties, unit)
    block_of = {j: b for b, dofs in enumerate(blocks) for j in dofs}
    units = list(dict.fromkeys(unit[dofs[0]] for dofs in blocks))
    begin = [next(b for b, dofs in enumerate(blocks) if unit[dofs[0]] == u) for u in units]
    out["dof_block"] = [block_of[j] for j in range(s.nv)]
    out["dof_part"] = [blocks[block_of[j]].index(j) for j in range(s.nv)]
    out["block_dof"] = [j for dofs in blocks for j in (*dofs, -1, -1)[:3]]
    out["block_unit"] = [units.index(unit[dofs[0]]) for dofs in blocks]
    out["block_id"] = list(range(len(blocks)))
    out["unit_start"] = [*begin, len(blocks)]
    out["free_block"] = [
        block_of[body.dofs[0]] if body.parent == WORLD and body.joint == "free" else -1 for body in s.bodies
    ]
    start = {t: min(b for b, dofs in enumerate(blocks) if tree[dofs[0]] == t) for t in tree}
    mass_first = [min(start[t] for t in {tree[dofs[0]], *ties[tree[dofs[0]]]}) for dofs in blocks]
    _pair_tables(s, chains, out)
    lists = []
    for row in s.rows:
        dofs = [row.index]
        if row.kind != "limit":
            dofs = out["pair_dof"][out["pair_start"][row.index] : out["pair_start"][row.index + 1]]
        lists.append(sorted({block_of[j] for j in dofs}))
    _row_tables(s, lists, block_of, out)
    first = list(mass_first)
    for blocks_of_row in lists:
        for b in blocks_of_row:
            first[b] = min(first[b], blocks_of_row[0])
    out["mass_first"], out["mass_at"], mass = _envelope(mass_first)
    matrix = _envelope(first)[2]
    items, planes, of_items = item_tables(s)
    out |= of_items
    sizes = Sizes(items, planes, len(blocks), mass, matrix, len(out["row_block"]), lay.width)
    return out, sizes


def make_topology(
    s: Structure,
    inertia_scaling: bool,
    coulomb: bool,
    speed: float | None,
    device: object,
    leapfrog: bool = False,
    hard: bool = True,
) -> Topology:
    """The tables on a device; `speed`: of `Method.depenetration_speed`."""
    lists, sizes = tables(s)
    out = Topology()
    out.nb, out.nv, out.nu, out.nr, out.pairs = s.nb, s.nv, s.nu, s.nr, len(s.pairs)
    out.shapes, out.blocks, out.room = len(s.shapes), sizes.blocks, sizes.matrix
    out.units, out.limits = len(lists["unit_start"]) - 1, len(lists["limit_row"])
    out.items, out.planes = (sizes.items, sizes.planes) if items_first(s) else (0, 0)
    out.pair_bits = bits_of(len(s.pairs))
    out.sprung, out.springs, out.tendons = len(s.sprung), len(s.springs), len(s.tendons)
    out.rotors, out.width = len(s.armature), sizes.numbers
    out.limited = (1 if hard else SMOOTHED) if s.limited else 0
    out.bounces = int(s.bounces)
    out.inertia_scaling, out.coulomb, out.leapfrog = int(inertia_scaling), int(coulomb), int(leapfrog)
    out.overlaps, out.depenetration_speed = int(speed is not None), speed or 0.0
    out.implicit_damping, out.implicit_stiffness = int(s.implicit_damping), int(s.implicit_stiffness)
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
    """Trees that springs and tendons couple in what stands for M with each tree."""
    root = dict(zip(s.dof_body, tree, strict=True))
    out: dict[int, set[int]] = {t: set() for t in tree}
    tied = [(root[a], root[b]) for a, b in s.ties if a != WORLD and b != WORLD]
    tied += [(tree[i], tree[j]) for dofs in s.joined for i, j in itertools.combinations(dofs, 2)]
    for a, b in tied:
        if a != b:
            out[a].add(b)
            out[b].add(a)
    return out


def _units(tree: list[int], ties: dict[int, set[int]]) -> list[int]:
    """The unit of every dof, named by one of its trees."""
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


def _cut(s: Structure, tree: list[int], ties: dict[int, set[int]], unit: list[int]) -> list[list[int]]:
    """The dofs of every block, in reverse Cuthill-McKee order of the units; a tree's blocks go from leaves to
    root.
    """
    near: dict[int, set[int]] = {t: set() for t in unit}
    of_body = dict(zip(s.dof_body, unit, strict=True))
    for pair in s.pairs:
        a, b = (of_body.get(s.mover(i)) for i in (pair.shape_a, pair.shape_b))
        if a is not None and b is not None and a != b:
            near[a].add(b)
            near[b].add(a)
    inside = _cuthill_mckee(ties)
    unit_of = dict(zip(tree, unit, strict=True))
    blocks = []
    for t in (t for k in _cuthill_mckee(near) for t in inside if unit_of[t] == k):
        dofs = [j for j in range(s.nv) if tree[j] == t]
        blocks += [dofs[at : at + 3] for at in range(0, len(dofs), 3)]
    return blocks[::-1]


def _pair_tables(s: Structure, chains: list[list[int]], out: dict[str, list[int]]) -> None:
    dofs, sides = [], []
    pairs = [oriented_pair(s, k) for k in range(len(s.pairs))]
    for a, b in pairs:
        a_moves, b_moves = (
            set() if s.shapes[i].body == WORLD else set(chains[s.shapes[i].body]) for i in (a, b)
        )
        # what shifts both moves nothing between them
        moves = [j for j in a_moves | b_moves if j not in a_moves & b_moves or _dof_kind(s, j) == TURN]
        runs = [s.shapes[i].driver for i in (a, b)]
        dofs.append(sorted({*moves, *runs} - {-1}, reverse=True))
        sides.append([
            MOVES_A * (j in moves and j in a_moves) + MOVES_B * (j in moves and j in b_moves)
            + RUNS_A * (j == runs[0]) + RUNS_B * (j == runs[1])
            for j in dofs[-1]
        ])  # fmt: skip
    ends = [oriented_ends(s, k) for k in range(len(s.pairs))]
    kinds = [
        tuple(DISC if end else s.shapes[i].kind for i, end in zip(pair, at, strict=True))
        for pair, at in zip(pairs, ends, strict=True)
    ]
    out["shape_body"] = [shape.body for shape in s.shapes]
    out["shape_turned"] = [int(shape.turned) for shape in s.shapes]
    out["pair_kind"] = [KINDS.get(a, ROUND) for a, _ in kinds]
    out["pair_ends"] = [end for at in ends for end in at]
    out["pair_a"] = [a for a, _ in pairs]
    out["pair_b"] = [b for _, b in pairs]
    out["pair_start"], out["pair_dof"] = _ragged(dofs)
    out["pair_side"] = _ragged(sides)[1]
    starts = [i for i, row in enumerate(s.rows) if row.kind == "contact" and row.sign >= 0]
    out["pair_row"] = [*starts, s.nr]
    unit_of = dict(zip(s.dof_body, (out["block_unit"][b] for b in out["dof_block"]), strict=True))
    out["pair_unit"] = [unit_of.get(s.mover(i), -1) for pair in pairs for i in pair]


def _row_tables(
    s: Structure, lists: list[list[int]], block_of: dict[int, int], out: dict[str, list[int]]
) -> None:
    """What is known of rows, `lists` being the blocks of each, and where a pair's dofs are in its rows."""
    kinds = {("limit", 1): LOWER, ("limit", -1): UPPER}
    out["row_kind"] = [kinds.get((row.kind, row.sign), CONTACT) for row in s.rows]
    out["row_index"] = [row.index for row in s.rows]
    out["row_sign"] = [row.sign for row in s.rows]
    out["row_start"], out["row_block"] = _ragged(lists)
    keys = {blocks: i for i, blocks in enumerate(dict.fromkeys(map(tuple, lists)))}
    out["row_key"] = [keys[tuple(blocks)] for blocks in lists]
    out["limit_row"] = [i for i, row in enumerate(s.rows) if row.kind == "limit"]
    entries, free = [], []
    for pair in range(len(s.pairs)):
        blocks = lists[out["pair_row"][pair]]
        dofs = out["pair_dof"][out["pair_start"][pair] : out["pair_start"][pair + 1]]
        entries += [blocks.index(block_of[j]) for j in dofs]
        bodies = [s.shapes[out[name][pair]].body for name in ("pair_a", "pair_b")]
        runs = any(s.shapes[out[name][pair]].driver >= 0 for name in ("pair_a", "pair_b"))
        for body in bodies:
            block = -1 if body == WORLD else out["free_block"][body]
            simple = (body == WORLD or (block >= 0 and bodies[0] != bodies[1])) and not runs
            free.append((-1 if body == WORLD else blocks.index(block)) if simple else -2)
    out["pair_entry"], out["pair_free"] = entries, free
