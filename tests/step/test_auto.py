"""Scenes in which everything may touch everything: their motion is that of all pairs."""

import dataclasses

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp.kernels.generic import topology

HARD, SMOOTH = slcp.Options(residual="hard"), slcp.Options()


def rolled(scene, x, steps, options=HARD, record=(), strategy="generic"):
    sim = slcp.Simulator(scene, options, device="cpu", strategy=strategy)
    run = sim.rollout(x, steps=steps, record=record)
    assert (run.status == slcp.Status.SOLVED).all()
    return run


def thrown(scene, worlds, seed):
    """The scene's start with random velocities; in the second half of the worlds its last body comes from
    10 m above so fast that it passes several others in a step.
    """
    rng = np.random.default_rng(seed)
    x = np.tile(scene.x0, (worlds, 1))
    x[:, scene.nv :] += rng.standard_normal((worlds, scene.nv))
    far, last = slice(worlds // 2, None), scene.nv - 3
    x[far, last : last + 2] = (-0.1, 10.0)
    x[far, scene.nv + last : scene.nv + last + 2] = (0.0, -100.0)
    return x


@pytest.mark.parametrize("name, options", [
    ("heap", HARD), ("walls", HARD), ("walls", SMOOTH), ("boxes", HARD), ("ellipses", SMOOTH)
])  # fmt: skip
def test_the_motion_is_that_of_all_pairs(name, options, monkeypatch):
    scene = {
        "heap": slcp.scenes.heap(12),
        "walls": slcp.scenes.heap(14, width=1.0, variety=0.4, spacing=1.2),
        "boxes": slcp.scenes.tumbling_boxes(3),
        "ellipses": ellipses(12),
    }[name]
    x = thrown(scene, 4, 0)
    assert topology.items_first(scene.structure)
    near = rolled(scene, x, 40, options, record="impulse")
    monkeypatch.setattr(topology, "items_first", lambda s: False)
    every = rolled(scene, x, 40, options)
    # discs and ellipses have the same rows to the last bit; of capsules all pairs' bound lets in more
    np.testing.assert_allclose(near.states, every.states, rtol=0.0, atol=1e-9 if name == "boxes" else 0.0)
    s, last = scene.structure, len(scene.bodies) - 1
    ends = [{s.shapes[p.shape_a].body, s.shapes[p.shape_b].body} for p in s.pairs]
    with_last = [k for k, pair in enumerate(ends) if last in pair and -1 not in pair]
    hit = near.contact_impulse[2:, :, with_last, 0].max(axis=(1, 2))
    assert (hit > 20.0).all()  # what came from afar met the others


def ellipses(count):
    """A heap of ellipses instead of discs."""
    heap = slcp.scenes.heap(count, width=1.0, spacing=1.2)
    shapes = [dataclasses.replace(s, kind="ellipse", radius=(0.1, 0.06)) if s.kind == "disc" else s
              for s in heap.shapes]  # fmt: skip
    return dataclasses.replace(heap, shapes=tuple(shapes))


def test_no_disc_passes_another():
    """Distances of all 1,000 pairs after every step, from the places of the discs alone."""
    scene = slcp.scenes.heap(40, width=1.4, variety=0.3)
    run = rolled(scene, thrown(scene, 2, 3), 30)
    radius = scene.default_parameters()["radius"][3:, 0]
    q = run.states[:, :, : scene.nv].reshape(2, 31, 40, 3)
    apart = np.linalg.norm(q[:, :, :, None, :2] - q[:, :, None, :, :2], axis=-1)
    gap = apart - radius[:, None] - radius
    gap[:, :, np.arange(40), np.arange(40)] = np.inf
    # linearised distances hold at the end of a step: discs that roll on each other may be a little closer
    moved = np.abs(run.states[:, :-1, scene.nv :]).max() * scene.step_size
    assert gap.min() > -(moved**2) / radius.min() and gap.min() > -0.05
    low = np.minimum(q[..., 1] - radius, 0.7 - np.abs(q[..., 0]) - radius)
    assert low.min() > -1e-9
    assert (gap[:, -1] < 1e-3).sum() > 40  # it is a heap


def test_gaps_of_all_pairs_are_exact():
    """In steps and where a rollout records them, those of pairs that are far, too."""
    scene = slcp.scenes.heap(12, width=0.8, spacing=2.0)
    x = thrown(scene, 2, 1)
    run = rolled(scene, x, 3, record=("gap", "impulse"))
    step = slcp.Simulator(scene, HARD, device="cpu", strategy="generic").step(x)
    np.testing.assert_allclose(step.gap, run.gap[:, 0], atol=1e-12)
    q = x[:, : scene.nv].reshape(2, 12, 3)
    for k, name in enumerate(scene.pair_names):
        first, second = name.split("/")
        j = int(second.removeprefix("disc"))
        if first.startswith("disc"):
            truth = np.linalg.norm(q[:, j, :2] - q[:, int(first.removeprefix("disc")), :2], axis=-1) - 0.2
        elif first == "ground":
            truth = q[:, j, 1] - 0.1
        else:
            truth = 0.4 - 0.1 + np.where(first == "left_wall", 1.0, -1.0) * q[:, j, 0]
        np.testing.assert_allclose(step.gap[:, 2 * k], truth, atol=1e-12)
        np.testing.assert_allclose(step.gap[:, 2 * k + 1], truth, atol=1e-12)
    assert run.contact_impulse.shape == (2, 3, len(scene.pair_names), 2)


def test_what_is_recorded_does_not_change_the_motion():
    """Ellipses, whose distance is looked for from where it was last."""
    scene = ellipses(12)
    x = thrown(scene, 6, 4)
    plain, recorded = (rolled(scene, x, 40, SMOOTH, record) for record in ((), ("gap", "impulse")))
    np.testing.assert_array_equal(recorded.states, plain.states)


def test_a_small_scene_has_kernels_of_its_own():
    """One box is few enough: every pair is unrolled, as if it were listed."""
    scene = slcp.scenes.tumbling_boxes()
    assert slcp.Simulator(scene).strategy == "specialised"
    assert scene.structure == scene.with_listed_contacts().structure
