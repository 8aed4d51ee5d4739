"""What a scene's broad phase looks at: items that may touch, and the pairs between any two of them.

An *item* is a body with its round shapes (all but half-planes and rings) that are in pairs, or such a shape
of the world. Half-planes and rings are no items: each is tested against all items that it has pairs with.
"""

from ...factories import cached
from ...structure import CAPSULE, RECTANGLE, RING, WALLS, WORLD, Structure

FEWEST = 64  # pairs
# of both numbers of a shape's size: how far it reaches from its centre; or that it holds in what is in it
LARGER, SUM, DIAGONAL, AROUND = 0, 1, 2, 3
REACHES = {CAPSULE: SUM, RECTANGLE: DIAGONAL, RING: AROUND}


@cached
def item_tables(s: Structure) -> tuple[int, int, dict[str, list[int]]]:
    """Items, half-planes and rings, and the tables of `Topology` that begin with `item`; items come first."""
    used = sorted({i for p in s.pairs for i in (p.shape_a, p.shape_b)})
    planes = [i for i in used if s.shapes[i].kind in WALLS]
    shapes: dict[tuple[int, int], list[int]] = {}
    for i in used:
        if s.shapes[i].kind not in WALLS:
            body = s.shapes[i].body
            shapes.setdefault((body, i if body == WORLD else 0), []).append(i)
    groups = [*shapes.values(), *([i] for i in planes)]
    item = {i: n for n, group in enumerate(groups) for i in group}
    between: list[dict[int, list[int]]] = [{} for _ in groups]
    for k, p in enumerate(s.pairs):
        low, high = sorted((item[p.shape_a], item[p.shape_b]))
        if high >= len(shapes):  # a half-plane or ring looks at the items
            low, high = high, low
        between[low].setdefault(high, []).append(k)
    out: dict[str, list[int]] = {
        "item_body": [s.shapes[group[0]].body for group in groups],
        "item_shape_start": [0], "item_shape": [], "item_reach": [],
        "item_partner_start": [0], "item_partner": [], "item_pair_start": [0], "item_pair": [],
    }  # fmt: skip
    for group, partners in zip(groups, between, strict=True):
        out["item_shape"] += group
        out["item_reach"] += [REACHES.get(s.shapes[i].kind, LARGER) for i in group]
        out["item_shape_start"].append(len(out["item_shape"]))
        for partner in sorted(partners):
            out["item_partner"].append(partner)
            out["item_pair"] += partners[partner]
            out["item_pair_start"].append(len(out["item_pair"]))
        out["item_partner_start"].append(len(out["item_partner"]))
    return len(shapes), len(planes), out


def bits_of(pairs: int) -> int:
    """Bits of each of the two digits that the number of a pair has."""
    return (max(pairs - 1, 1).bit_length() + 1) // 2


def items_first(s: Structure) -> bool:
    """Whether it is worth while to look at items before pairs: there are many, and each has several."""
    if s.runs:  # what comes by the speed of a surface is not counted there
        return False
    items, planes, tables = item_tables(s)
    partners = tables["item_partner_start"]
    by_planes = partners[-1] - partners[items]
    return len(s.pairs) >= max(FEWEST, 2 * (items + planes) + by_planes // 2)
