"""The nearest of many points, in a tree of boxes that a processor looks at eight at a time.

A group is eight boxes, a leaf eight points, both stored coordinate by coordinate, so that the loops over
them become vector instructions on a CPU. On a GPU they stay loops, for the sake of registers. There are no
links: group n has the children WIDTH n + 1 to WIDTH n + WIDTH; those beyond the groups are leaves.

The search is exact to the last bit: a box is left out only where its distance, of which every partial sum
is at most that of a point inside, exceeds the least one by more than the rounding of both.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached

WIDTH = 8  # children of a group, points of a leaf
FAR = 1e30  # squared distance beyond which nothing is found
NATIVE = {  # a number, a whole number of as many bits, the largest of these; from 1 to the next number
    wp.float32: ("float", "int", "0x7fffffff", 2.0**-23),
    wp.float64: ("double", "long long", "0x7fffffffffffffffLL", 2.0**-52),
}


@cached
def make_search(stack: int, nx: int, dtype: type, turns: tuple[int, int] = (0, 0)) -> SimpleNamespace:
    """search(tree, y): the entry of the point nearest to y, of several the lowest; and its struct Tree.

    `stack` children wait at once, see `waiting`. What is not finite is nearest to the first point. `turns`:
    how many coordinates, and from which on, tell which image of a periodic point is within half a period:
    they are C d of the periodic differences d, C upper triangular. Other images are none.
    """
    VX, VB = wp.types.vector(nx, dtype), wp.types.vector(WIDTH, dtype)
    Nodes, Gaps = wp.types.vector(stack + 1, wp.int32), wp.types.vector(stack + 1, dtype)
    NOWHERE, ZERO = dtype(FAR), dtype(0.0)
    periodic, start = turns
    real, key, largest, epsilon = NATIVE[dtype]
    SLACK = dtype(1.0 + 4.0 * (nx + 2) * epsilon)

    far_images = f"""
        {real} turned[{periodic}];
        #pragma unroll
        for (int j = {periodic - 1}; j >= 0; --j) {{
            {real} rest = y.c[{start} + j] - point[{start} + j].c[i];
            #pragma unroll
            for (int k = j + 1; k < {periodic}; ++k) rest -= wp::index(near, j, k) * turned[k];
            turned[j] = rest * wp::index(near, j, j);
            const {real} half = wp::index(near, j, {periodic}), none = {2.0 * FAR};
            sum = turned[j] > half || turned[j] < -half ? none : sum;
        }}
    """ if periodic else ""  # fmt: skip

    @wp.struct
    class Tree:
        boxes: wp.array2d(dtype=VB)  # (G, 2 nx) lower corners, then upper ones; beyond the last child +-inf
        points: wp.array2d(dtype=VB)  # (P, nx) leaves; where points are fewer, the first one again
        entry: wp.array2d(dtype=wp.int32)  # (P, WIDTH) of the points
        near: wp.array2d(dtype=dtype)  # (turns, turns + 1) C, 1/C_jj on its diagonal; half a period last

    @wp.func_native(f"""
    const auto* box = &wp::index(boxes, n, 0);
    wp::vec_t<{WIDTH}, {real}> d;
    #pragma unroll 1
    for (int i = 0; i < {WIDTH}; ++i) {{
        {real} sum = 0;
        #pragma unroll
        for (int k = 0; k < {nx}; ++k) {{
            const {real} below = box[k].c[i] - y.c[k], above = y.c[k] - box[{nx} + k].c[i];
            const {real} out = below > above ? below : above;
            const {real} gap = out <= 0 ? 0 : out;  // NaN stays
            sum += gap * gap;
        }}
        d.c[i] = sum;
    }}
    return d;
    """)
    def to_boxes(boxes: wp.array2d(dtype=VB), n: int, y: VX) -> VB:
        """Squared distances to the boxes of a group."""
        ...

    @wp.func_native(f"""
    const auto* point = &wp::index(points, n, 0);
    wp::vec_t<{WIDTH}, {real}> d;
    #pragma unroll 1
    for (int i = 0; i < {WIDTH}; ++i) {{
        {real} sum = 0;
        #pragma unroll
        for (int k = 0; k < {nx}; ++k) {{
            const {real} delta = y.c[k] - point[k].c[i];
            sum += delta * delta;
        }}
        {far_images}
        d.c[i] = sum;
    }}
    return d;
    """)
    def to_points(points: wp.array2d(dtype=VB), n: int, y: VX, near: wp.array2d(dtype=dtype)) -> VB:
        """Squared distances to the points of a leaf."""
        ...

    @wp.func_native(f"""
    int mask = 0;
    #pragma unroll 1
    for (int i = 0; i < {WIDTH}; ++i) mask |= (d.c[i] <= bound ? 1 : 0) << i;
    return mask;
    """)
    def within(d: VB, bound: dtype) -> int:
        """A bit for each that is at most the bound."""
        ...

    @wp.func_native(f"""
    {key} least = {largest};
    #pragma unroll 1
    for (int i = 0; i < {WIDTH}; ++i) {{
        union {{ {real} value; {key} bits; }} of;
        of.value = d.c[i];
        const {key} ranked = (of.bits & ~{WIDTH - 1}) | i;
        least = ranked < least ? ranked : least;
    }}
    return least & {WIDTH - 1};
    """)
    def least_of(d: VB) -> int:
        """Which is least, but for three bits: numbers that are not negative are ordered as their bits."""
        ...

    @wp.func
    def search(tree: Tree, y: VX):
        node = Nodes()
        gap = Gaps()
        groups = tree.boxes.shape[0]
        depth = int(1)
        best = tree.entry[0, 0]
        least = ZERO + NOWHERE
        while depth > 0:
            depth -= 1
            bound = least * SLACK
            n = node[depth]
            if gap[depth] > bound:
                continue
            while 0 <= n and n < groups:
                d = to_boxes(tree.boxes, n, y)
                rest = within(d, bound)
                nearest = least_of(d)
                first = WIDTH * n + 1
                n = wp.where(rest == 0, -1, first + nearest)
                rest = rest & ~(1 << nearest)
                for i in range(wp.static(WIDTH)):  # what is not kept is written over
                    node[depth] = first + i
                    gap[depth] = d[i]
                    depth += (rest >> i) & 1
            if n >= 0:
                leaf = n - groups
                d = to_points(tree.points, leaf, y, tree.near)
                closer = within(d, least)
                i = int(0)
                while closer != 0:
                    if (closer & 1) != 0:
                        entry = tree.entry[leaf, i]
                        if d[i] < least or (d[i] == least and entry < best):
                            least = d[i]
                            best = entry
                    closer = closer >> 1
                    i += 1
        return best

    return SimpleNamespace(Tree=Tree, search=search)


def groups_of(leaves: int) -> int:
    """How many groups have so many leaves."""
    return max(1, -(-(leaves - 1) // (WIDTH - 1)))


def waiting(points: int) -> int:
    """How many children wait at once, at most, in a tree of so many points: all but one of every level."""
    last, levels = groups_of(-(-points // WIDTH)) - 1, 1
    while last > 0:
        last, levels = (last - 1) // WIDTH, levels + 1
    return (WIDTH - 1) * levels
