"""Capsules and rectangles on the page: where they touch, and where they are caught."""

import numpy as np
import pytest
from oracle import Oracle

from slcp_warp import Body, Scene, Shape
from slcp_warp.results.pictures.contacts import contact_points
from slcp_warp.results.pictures.mechanism import Mechanism
from slcp_warp.scripts.watch.pull import catch


def scene():
    shapes = (
        Shape("ground", None, "halfplane", angle=np.pi / 2),
        Shape("block", "a", "rectangle", (0.2, 0.1), offset=(0.02, 0.0), angle=0.1, corner_radius=0.03),
        Shape("rod", "b", "capsule", (0.02, 0.2)),
        Shape("ball", "b", "disc", 0.05, offset=(0.3, 0.0)),
    )
    bodies = (Body("a", 1.0, 0.02, joint="free"), Body("b", 0.5, 0.01, joint="free"))
    return Scene("blocks", bodies, shapes, contacts="auto", friction=0.5)


def test_every_end_touches_where_the_oracle_says():
    """Each corner on the ground at its own place, not all at the lowest one."""
    sc = scene()
    mechanism, oracle = Mechanism(sc, sc.default_parameters()), Oracle(sc)
    rng, pairs = np.random.default_rng(0), range(len(sc.structure.pairs))
    for _ in range(10):
        q = np.concatenate([rng.uniform([-0.5, 0.5, -3.0], [0.5, 1.0, 3.0]) for _ in range(2)])
        q[3] += 1.5  # apart: inside of each other a direction is not unique
        points, normals = contact_points(mechanism, q, pairs)
        for k in pairs:
            gap, angle, pa, pb, _ = oracle.contact(q, k)
            np.testing.assert_allclose(normals[k], [np.cos(angle), np.sin(angle)], atol=1e-3)
            pair, kinds = sc.structure.pairs[k], [shape.kind for shape in sc.structure.shapes]
            round_a, round_b = (
                end or kinds[shape] == "disc"
                for shape, end in ((pair.shape_a, pair.end_a), (pair.shape_b, pair.end_b))
            )
            on_a = kinds[pair.shape_b] == "halfplane" or (round_a and not round_b)
            across = np.array([-normals[k][1], normals[k][0]])
            off = points[k] - (pa if on_a else pb)
            assert normals[k] @ off == pytest.approx(0.0, abs=2e-4)
            if round_a if on_a else round_b:
                assert across @ off == pytest.approx(0.0, abs=2e-4)


@pytest.mark.parametrize("at, near", [((0.0, 0.0), True), ((0.22, 0.0), True), ((0.215, 0.095), True),
                                      ((0.0, 0.2), False), ((0.3, 0.0), False)])  # fmt: skip
def test_a_rectangle_is_caught_within_reach_of_its_sides(at, near):
    block = Shape("block", "a", "rectangle", (0.2, 0.1), corner_radius=0.03)
    sc = Scene("one", (Body("a", 1.0, 0.02, joint="free"),), (block,))
    mechanism = Mechanism(sc, sc.default_parameters())
    pull = catch(mechanism, np.zeros(3), np.array(at), 0.2)
    assert (pull is not None) == near
