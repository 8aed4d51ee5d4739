"""The tree in which a library's nearest entry is found: what lies where, how much waits."""

import numpy as np
import pytest

from slcp_warp.ddp.library.tree import boxes_of
from slcp_warp.kernels.policies.nearest import STACKS, nearest_kernel
from slcp_warp.kernels.policies.tree import WIDTH, groups_of, waiting


@pytest.mark.parametrize("count", [1, 7, 8, 9, 64, 65, 400, 1001])
def test_every_point_is_in_a_leaf_and_every_leaf_in_its_boxes(count):
    points = np.random.default_rng(count).standard_normal((count, 3))
    low, high, leaves = boxes_of(points)
    assert len(leaves) == -(-count // WIDTH) and len(low) == groups_of(len(leaves))
    assert sorted(set(leaves.ravel())) == list(range(count))
    assert sum(len(set(leaf)) for leaf in leaves) == count
    for leaf, rows in enumerate(leaves):
        child = len(low) + leaf
        while child > 0:
            group, place = divmod(child - 1, WIDTH)
            inside = points[rows]
            assert (low[group, :, place] <= inside).all() and (inside <= high[group, :, place]).all()
            child = group
    children = len(low) - 1 + len(leaves)
    assert np.isfinite(low).all(axis=1).sum() == children == np.isfinite(high).all(axis=1).sum()


@pytest.mark.parametrize("points", [1, 8, 9, 64, 65, 512, 3200, 32_768, 32_769, 1_000_000])
def test_children_that_wait_fit_in_the_stack(points):
    """Of a search that leaves nothing out and always goes on where the tree is deepest."""
    leaves = -(-points // WIDTH)
    groups, node, depth = groups_of(leaves), 0, 0
    while node < groups:
        depth += min(WIDTH, groups + leaves - 1 - WIDTH * node) - 1
        node = WIDTH * node + 1
    kernel = nearest_kernel(points)
    few = kernel is nearest_kernel(1)
    assert depth <= waiting(points) <= (STACKS[0] if few else STACKS[1])
    assert few == (points <= 32_768)
