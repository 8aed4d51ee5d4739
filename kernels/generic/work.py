"""Workspace of the generic kernels: everything a world needs between two loops, in global memory.

The work is done in double precision whatever the precision of the states and parameters ("given"): a heap of
unequal masses needs it. `Work` holds the arrays of all worlds, [slot, item]; a kernel takes the views of its
world once (`view`) and works with `Slot`. What is "by row" is indexed by r = 0, 1, ... over the rows of the
near pairs and the limits (`order.py`), in the order of their islands; row[r] is the scene's row.
"""

from typing import Any

import warp as wp

from ..structure import Structure
from .broad.items import bits_of
from .topology import tables

WORK = wp.float64
V2, V3, V4 = (wp.types.vector(n, WORK) for n in (2, 3, 4))
M33 = wp.types.matrix((3, 3), WORK)
WORD, LINE = 8, 64  # bytes
WIDTH = 8  # rows that a CPU takes at once: what is by row begins and ends at multiples of them there
LANES = 16  # right-hand sides that are solved at once: two registers of a CPU halve what a loop costs
Lanes = wp.types.vector(LANES, WORK)
(
    NEAR, ROWS, GROUPS, ISLANDS, ORDERS, LISTED, AXIS_OF_ITEMS, LOOKS, LED, BESIDE, ASIDE, ROUNDED, SETTLED
) = range(13)  # fmt: skip
# in `count`; orders: 0, 1; rounded: 1 where paths ended for what impulses round by, 2 where they may not


@wp.struct
class Slot:
    """The workspace of one world."""

    numbers: wp.array(dtype=WORK)  # the parameters; behind them what `motion/tendons.py` keeps
    q: wp.array(dtype=WORK)  # (nv) by dof
    v0: wp.array(dtype=WORK)  # (nv) by dof, v before the step
    frame: wp.array(dtype=V4)  # (nb) cos, sin, x, y of every body
    twist: wp.array(dtype=V3)  # (nb) velocity of the body's joint, rate of turning, at k.v; first its angle
    column: wp.array(dtype=V2)  # (nv) Jacobian of one centre of mass
    shape: wp.array(dtype=V4)  # (2 shapes) centre and axis in the world; in their bodies
    before: wp.array(dtype=V3)  # (blocks), this and what follows by block: v before the step
    vfree: wp.array(dtype=V3)  # (2 blocks) second half: where the leapfrog predicts the velocity
    v: wp.array(dtype=V3)  # v'
    best_v: wp.array(dtype=V3)
    inner_v: wp.array(dtype=V3)  # v' of an interior point that was left
    balance: wp.array(dtype=V3)  # M (v' - v_free) - J' lambda
    move: wp.array(dtype=V3)  # right hand sides and their solutions
    most: wp.array(dtype=V3)  # momentum that a step can exchange, as the data have it
    momentum: wp.array(dtype=V3)  # in the data
    lost: wp.array(dtype=V3)  # rounding of M (v' - v_free)
    unseen: wp.array(dtype=V3)  # what of it the rows do not see
    mass: wp.array(dtype=M33)  # envelope of M
    mass_factor: wp.array(dtype=M33)  # and of its factor
    factor: wp.array(dtype=M33)  # envelope of M + J' W J, then of its factor, in the order of elimination
    upper: wp.array(dtype=M33)  # the other triangle of what is not symmetric (`lu.py`); A of `held.py`
    jac: wp.array(dtype=V3)  # entries of J's rows
    gap: wp.array(dtype=WORK)  # d/h, this and what follows by row
    rate: wp.array(dtype=WORK)  # d/h, plus what Coulomb friction lifts it by
    sigma: wp.array(dtype=WORK)
    scale: wp.array(dtype=WORK)  # D
    inverse: wp.array(dtype=WORK)  # 1/D
    diag: wp.array(dtype=WORK)  # diag(A)
    alone: wp.array(dtype=WORK)  # impulse of the row if it were the only one
    own: wp.array(dtype=WORK)  # size of the terms that the data set of J v' + d/h
    unit: wp.array(dtype=WORK)  # the largest of these, its own or of closing rows of one body with it
    passed: wp.array(dtype=WORK)  # impulse that what closes brings by itself, and the row may pass on
    z: wp.array(dtype=WORK)
    best_z: wp.array(dtype=WORK)
    lam: wp.array(dtype=WORK)
    least: wp.array(dtype=WORK)  # lambda where rows yield; the step's own where derivatives hold a vertex
    a: wp.array(dtype=WORK)  # D lambda > 0
    w: wp.array(dtype=WORK)  # J v' + d/h > 0
    res: wp.array(dtype=WORK)  # J v' + d/h - w
    excess: wp.array(dtype=WORK)  # a w - m(a - w)
    cross: wp.array(dtype=WORK)  # what a straight step leaves of it, of second order
    p: wp.array(dtype=WORK)  # weight of dz in da
    slack: wp.array(dtype=WORK)  # weight of dz in -dw
    total: wp.array(dtype=WORK)  # what both were divided by
    dz: wp.array(dtype=WORK)
    divisor: wp.array(dtype=WORK)  # what a direction multiplies the row's misses by
    aimed: wp.array(dtype=WORK)  # e of the last direction
    weight: wp.array(dtype=WORK)  # in M + J' W J; impulse of a direction; by pair while these are looked for
    normal: wp.array(dtype=V2)  # (pairs) last normals
    lift: wp.array(dtype=WORK)  # by first row of a pair: mu |J_t v'| of Coulomb friction, as it is assumed
    target: wp.array(dtype=WORK)  # and as it came out last
    miss: wp.array(dtype=WORK)  # difference of the two
    warm: wp.array(dtype=WORK)  # (nr) by the scene's rows: z while rows move
    row: wp.array(dtype=wp.int32)  # the scene's row
    entry: wp.array(dtype=wp.int32)  # (+ 1) first entry in jac
    pattern: wp.array(dtype=wp.int32)  # first entry in the table of blocks
    acting: wp.array(dtype=wp.int32)  # 1 or 2: the row is in the system
    mode: wp.array(dtype=wp.int32)  # of Coulomb's friction; the list of rows that are held
    known: wp.array(dtype=wp.int32)  # (pairs) 1: near
    bounce: wp.array(dtype=WORK)  # (pairs) restitution of a near pair that bounces in this step, else 0
    stays: wp.array(dtype=wp.int32)  # (nr) by the scene's rows: the part whose overlaps stay, negative: open
    apart: wp.array(dtype=WORK)  # (nr) the gap that these have
    fixed: wp.array(dtype=wp.int32)  # (nr) not 0: what its row holds does not change with it (`overlaps.py`)
    beside: wp.array(dtype=WORK)  # (pairs) added to d/h in a try beside the data
    near: wp.array(dtype=wp.int32)  # (pairs) list of the near pairs, ascending
    count: wp.array(dtype=wp.int32)
    group: wp.array(dtype=wp.int32)  # (groups + 1) first rows of groups, which share their blocks
    island_group: wp.array(dtype=wp.int32)  # (islands + 1) first groups; before, of units, first arrows
    island_block: wp.array(dtype=wp.int32)  # (islands + 1) and first places of their blocks
    place: wp.array(dtype=wp.int32)  # (blocks) of the order of elimination
    block: wp.array(dtype=wp.int32)  # (blocks) by place
    first: wp.array(dtype=wp.int32)  # (blocks) by place: envelope of M + J' W J
    at: wp.array(dtype=wp.int32)  # while places are looked for by unit: how many units it touches
    link: wp.array(dtype=wp.int32)  # (2 pairs) its arrows; where the rows of A of `held.py` begin
    island: wp.array(dtype=wp.int32)  # (units) -1: none
    queue: wp.array(dtype=wp.int32)  # (units) in the order of elimination; names of what hangs together
    disc: wp.array(dtype=V4)  # (2 items) bounding discs: centre, radius, radius of acting; in their bodies
    item_speed: wp.array(dtype=V2)  # (items + planes) that the list is made for, and rate of turning
    item_order: wp.array(dtype=wp.int32)  # (items) along the axis on which they are spread more
    item_low: wp.array(dtype=WORK)  # (items) where they begin there, in this order
    listed: wp.array(dtype=wp.int32)  # (pairs) that are looked at
    bucket: wp.array(dtype=wp.int32)
    bound: wp.array(dtype=WORK)  # (5) see `broad/phase.py`
    sorted: wp.array(dtype=wp.int32)  # (nr) rows that begin a pair or are a limit, by islands; pairs before


@wp.struct
class Island:
    """Where an island's blocks (places), groups and rows begin and end."""

    start: int
    end: int
    group: int
    last_group: int
    row: int
    last_row: int


@wp.func
def island(k: wp.ref[Slot], i: int):
    """The i-th island."""
    o = Island()
    o.start = k.island_block[i]
    o.end = k.island_block[i + 1]
    o.group = k.island_group[i]
    o.last_group = k.island_group[i + 1]
    o.row = k.group[o.group]
    o.last_row = k.group[o.last_group]
    return o


def _of_all_worlds() -> type:
    """`Slot` with a dimension more."""
    fields = {name: wp.array2d(dtype=array.dtype) for name, array in Slot.cls.__annotations__.items()}
    made = type(
        "Work", (), {"__annotations__": fields, "__module__": __name__, "__doc__": "Slots of worlds."}
    )
    return wp.struct(made)


Work = _of_all_worlds()


@wp.func
def view_rows(k: wp.ref[Slot], work: wp.ref[Work], b: int):
    """What is by row, by pair or of the order."""
    k.gap = work.gap[b]
    k.rate = work.rate[b]
    k.sigma = work.sigma[b]
    k.scale = work.scale[b]
    k.diag = work.diag[b]
    k.alone = work.alone[b]
    k.own = work.own[b]
    k.unit = work.unit[b]
    k.passed = work.passed[b]
    k.z = work.z[b]
    k.best_z = work.best_z[b]
    k.lam = work.lam[b]
    k.least = work.least[b]
    k.a = work.a[b]
    k.w = work.w[b]
    k.res = work.res[b]
    k.excess = work.excess[b]
    k.p = work.p[b]
    k.slack = work.slack[b]
    k.total = work.total[b]
    k.dz = work.dz[b]
    k.divisor = work.divisor[b]
    k.weight = work.weight[b]
    k.normal = work.normal[b]
    k.lift = work.lift[b]
    k.target = work.target[b]
    k.miss = work.miss[b]
    k.warm = work.warm[b]
    k.row = work.row[b]
    k.entry = work.entry[b]
    k.pattern = work.pattern[b]
    k.acting = work.acting[b]
    k.known = work.known[b]
    k.bounce = work.bounce[b]
    k.stays = work.stays[b]
    k.apart = work.apart[b]
    k.fixed = work.fixed[b]
    k.beside = work.beside[b]
    k.near = work.near[b]
    k.count = work.count[b]
    k.group = work.group[b]
    k.island_group = work.island_group[b]
    k.island_block = work.island_block[b]
    k.place = work.place[b]
    k.block = work.block[b]
    k.first = work.first[b]
    k.at = work.at[b]
    k.link = work.link[b]
    k.island = work.island[b]
    k.queue = work.queue[b]
    k.disc = work.disc[b]
    k.item_speed = work.item_speed[b]
    k.item_order = work.item_order[b]
    k.item_low = work.item_low[b]
    k.listed = work.listed[b]
    k.bucket = work.bucket[b]
    k.bound = work.bound[b]
    k.sorted = work.sorted[b]


@wp.func
def view(work: wp.ref[Work], b: int):
    """The arrays of slot b."""
    k = Slot()
    k.numbers = work.numbers[b]
    k.q = work.q[b]
    k.v0 = work.v0[b]
    k.frame = work.frame[b]
    k.twist = work.twist[b]
    k.column = work.column[b]
    k.shape = work.shape[b]
    k.before = work.before[b]
    k.vfree = work.vfree[b]
    k.v = work.v[b]
    k.best_v = work.best_v[b]
    k.inner_v = work.inner_v[b]
    k.balance = work.balance[b]
    k.move = work.move[b]
    k.most = work.most[b]
    k.momentum = work.momentum[b]
    k.lost = work.lost[b]
    k.unseen = work.unseen[b]
    k.mass = work.mass[b]
    k.mass_factor = work.mass_factor[b]
    k.factor = work.factor[b]
    k.jac = work.jac[b]
    k.upper = work.upper[b]
    k.cross = work.cross[b]
    k.mode = work.mode[b]
    k.inverse = work.inverse[b]
    k.aimed = work.aimed[b]
    view_rows(k, work, b)
    return k


BY_ROW = (
    "gap", "rate", "sigma", "scale", "diag", "alone", "own", "unit", "passed", "z", "best_z", "lam", "least",
    "a", "w", "res", "excess", "cross", "p", "slack", "total", "dz", "divisor", "aimed", "weight", "lift",
    "inverse", "target", "miss", "warm", "row", "pattern", "acting", "mode", "sorted",
)  # fmt: skip


def lengths(s: Structure) -> dict[str, int]:
    """Items of every workspace of a structure."""
    sizes = tables(s)[1]
    pairs, shapes, units = len(s.pairs), len(s.shapes), sizes.blocks  # no more units than blocks
    out = dict.fromkeys(("frame", "twist"), s.nb) | {"count": SETTLED + 1}
    kept = 1 + 3 * len(s.tendons) + 18 * sizes.mass + 3 * sizes.blocks if s.limited else 0
    out |= {"numbers": sizes.numbers + kept}
    out |= dict.fromkeys(("q", "v0", "column"), s.nv) | {"shape": 2 * shapes}
    matrices = dict.fromkeys(("mass", "mass_factor"), sizes.mass) | {"jac": sizes.entries}
    matrices |= dict.fromkeys(("factor", "upper"), sizes.matrix)
    blocks = ("before", "vfree", "v", "best_v", "inner_v", "balance", "move", "most", "momentum", "lost",
              "unseen", "place", "block", "first", "at")  # fmt: skip
    out |= matrices | dict.fromkeys(blocks, sizes.blocks) | dict.fromkeys(BY_ROW, s.nr)
    out |= dict.fromkeys(("entry", "group"), s.nr + 1) | {"vfree": 2 * sizes.blocks}
    out |= dict.fromkeys(("normal", "known", "near", "beside"), pairs) | {"link": 2 * pairs}
    out["bounce"] = pairs if s.bounces else 0
    out |= dict.fromkeys(("stays", "apart", "fixed"), s.nr)
    out |= dict.fromkeys(("island", "queue"), units)
    out |= dict.fromkeys(("item_order", "item_low"), sizes.items) | {"disc": 2 * sizes.items}
    out |= {"listed": pairs, "bucket": 2 ** bits_of(pairs) + 1, "bound": 5}
    out["item_speed"] = sizes.items + sizes.planes
    return out | dict.fromkeys(("island_group", "island_block"), units + 1)


def allocate_work(s: Structure, slots: int, device: Any) -> Work:
    """Workspaces of `slots` worlds: neighbours in memory are worlds on a GPU. On a CPU a world has a block of
    whole cache lines to itself: of what two worlds share, threads that step them rob each other.
    """
    work = Work()
    if wp.get_device(device).is_cpu:
        stride, begin = _places(s)
        block = wp.zeros(slots * stride + LINE, dtype=wp.uint8, device=device)
        start = -(-block.ptr // LINE) * LINE
    for name, length in lengths(s).items():
        kind = Slot.cls.__annotations__[name].dtype
        if wp.get_device(device).is_cpu:
            steps = (stride, wp.types.type_size_in_bytes(kind))
            at = start + begin[name]
            array = wp.array(ptr=at, dtype=kind, shape=(slots, length), strides=steps, device=device)
            array._ref = block  # as of Warp's own views
        else:
            array = wp.zeros((length, slots), dtype=kind, device=device).transpose()
        setattr(work, name, array)
    return work


def _places(s: Structure) -> tuple[int, dict[str, int]]:
    """Bytes from a world's block to the next one's, and where in it its arrays begin."""
    begin, end = {}, 0
    for name, length in lengths(s).items():
        size = wp.types.type_size_in_bytes(Slot.cls.__annotations__[name].dtype)
        whole = WIDTH * size if name in BY_ROW else WORD
        begin[name] = -(-end // whole) * whole
        end = begin[name] + -(-length * size // whole) * whole
    return -(-end // LINE) * LINE, begin


def bytes_per_world(s: Structure) -> int:
    """Memory of one slot."""
    return _places(s)[0]
