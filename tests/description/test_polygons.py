"""Polygons of discs and capsules: their outline, mass and rest against geometry and statics."""

import numpy as np
import pytest

import slcp_warp as slcp

UP = np.pi / 2
PENTAGON = np.array([(0.0, 0.0), (0.12, 0.0), (0.14, 0.05), (0.06, 0.1), (0.0, 0.06)])
ELL = np.array([(0.0, 0.0), (0.3, 0.0), (0.3, 0.1), (0.1, 0.1), (0.1, 0.3), (0.0, 0.3)])  # not convex
R = 0.004
NOTCH = [(0, 0), (1, 0), (1, 1), (0.6, 1), (0.5, 0.2), (0.4, 1), (0, 1)]  # deep and sharp
NECK = [(0, 0), (0.4, 0), (0.4, 0.4), (0.8, 0.4), (0.8, 0), (1.2, 0), (1.2, 1), (0.8, 1), (0.8, 0.45),
        (0.4, 0.45), (0.4, 1), (0, 1)]  # fmt: skip


def signed_distance(points, corners):
    """To an outline, negative inside: the least over its sides, and the winding angle."""
    a, b = corners, np.roll(corners, -1, axis=0)
    out = []
    for p in points:
        t = np.clip(np.sum((p - a) * (b - a), 1) / np.sum((b - a) ** 2, 1), 0.0, 1.0)
        away = np.hypot(*(p - a - t[:, None] * (b - a)).T).min()
        angles = np.arctan2(*(corners - p).T[::-1])
        turned = (np.roll(angles, -1) - angles + np.pi) % (2.0 * np.pi) - np.pi
        out.append(away if abs(turned.sum()) < 1.0 else -away)
    return np.array(out)


def distance_to(shapes, points):
    """Of points to discs and capsules."""
    found = []
    for s in shapes:
        radius, half = (s.radius, 0.0) if s.kind == "disc" else s.radius
        along = np.array([np.cos(s.angle), np.sin(s.angle)])
        rel = points - np.array(s.offset)
        t = np.clip(rel @ along, -half, half)
        found.append(np.hypot(*(rel - t[:, None] * along).T) - radius)
    return np.min(found, axis=0)


@pytest.mark.parametrize(
    ("corners", "radius"), [(PENTAGON, R), (PENTAGON[::-1], R), (ELL, R), (np.array(NOTCH), 0.02),
                            (np.array(NECK), 0.02)],
)  # fmt: skip
def test_nothing_sticks_out(corners, radius):
    """Points of the surface of every part are inside of the outline, or on it."""
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    for s in slcp.polygon("p", None, corners, radius):
        size, half = (s.radius, 0.0) if s.kind == "disc" else s.radius
        along = np.array([np.cos(s.angle), np.sin(s.angle)])
        for end in (-half, half, 0.3 * half):
            around = np.array(s.offset) + end * along + size * np.stack([np.cos(turn), np.sin(turn)], 1)
            assert signed_distance(around, corners).max() < 1e-9


@pytest.mark.parametrize("corners", [PENTAGON, PENTAGON[::-1], ELL])
def test_the_outline_is_the_polygon_with_round_corners(corners):
    """Outside of it, and as far inside as a side is thick, distances are those to the polygon, but for the
    roundings, which are within the radius over the sine of half of the sharpest corner.
    """
    shapes = slcp.polygon("p", None, corners, R)
    rng = np.random.default_rng(0)
    points = rng.uniform(corners.min(0) - 0.1, corners.max(0) + 0.1, (3000, 2))
    exact, found = signed_distance(points, corners), distance_to(shapes, points)
    outside = exact > 0.0
    assert (found[outside] >= exact[outside] - 1e-12).all()
    assert (found[outside] <= exact[outside] + R).all()
    near = (np.abs(points[:, None] - corners).max(2).min(1) > 0.03) & outside & (exact < 0.02)
    assert near.sum() > 40
    np.testing.assert_allclose(found[near], exact[near], atol=1e-12)
    assert (found[~outside] < 0.0).any()


def test_names_follow_the_vertices_and_corners_that_turn_in_have_no_disc():
    names = [s.name for s in slcp.polygon("p", "b", ELL, R)]
    assert names[:5] == ["p0", "p1", "p2", "p4", "p5"]
    assert names[5:] == ["p0_1", "p1_2", "p2_3", "p3_4", "p4_5", "p5_0", "p_core"]
    back = slcp.polygon("p", "b", ELL[::-1], R, core=False)
    assert sorted(s.name for s in back) == sorted(["p0", "p1", "p3", "p4", "p5", "p0_1", "p1_2", "p2_3",
                                                   "p3_4", "p4_5", "p5_0"])  # fmt: skip
    for side in (s for s in back if s.kind == "capsule"):
        one, two = (ELL[::-1][int(i)] for i in side.name[1:].split("_"))
        assert np.hypot(*(np.array(side.offset) - 0.5 * (one + two))) < 3.0 * R


def test_the_disc_in_the_middle_is_the_largest_there_is():
    square = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    *_, core = slcp.polygon("p", None, square, 0.01)
    assert core.name == "p_core" and core.radius == pytest.approx(0.75 * 0.5, rel=2e-3)
    np.testing.assert_allclose(core.offset, (0.5, 0.5), atol=2e-3)
    *_, core = slcp.polygon("p", None, ELL, R)
    grid = np.stack(np.meshgrid(*[np.linspace(0.0, 0.3, 301)] * 2), -1).reshape(-1, 2)
    best = -signed_distance(grid, ELL).min()
    assert core.radius == pytest.approx(0.75 * best, rel=0.02)


def test_mass_inertia_and_centre():
    """Of a rectangle and two that make an L by their formulas, of a random polygon by points in it."""
    mass, inertia, com = slcp.polygon_mass([(1.0, 1.0), (1.4, 1.0), (1.4, 1.3), (1.0, 1.3)], 5.0)
    assert mass == pytest.approx(0.6) and com == pytest.approx((1.2, 1.15))
    assert inertia == pytest.approx(0.6 * (0.4**2 + 0.3**2) / 12.0)
    mass, inertia, com = slcp.polygon_mass(ELL[::-1], 10.0)
    parts = [(0.3, (0.15, 0.05), 0.3, 0.1), (0.2, (0.05, 0.2), 0.1, 0.2)]
    middle = np.sum([m * np.array(c) for m, c, _, _ in parts], axis=0) / 0.5
    about = sum(m * ((w**2 + h**2) / 12 + np.sum((np.array(c) - middle) ** 2)) for m, c, w, h in parts)
    assert (mass, inertia) == (pytest.approx(0.5), pytest.approx(about)) and com == pytest.approx(middle)
    rng = np.random.default_rng(1)
    points = rng.uniform(PENTAGON.min(0), PENTAGON.max(0), (20000, 2))
    inside = points[signed_distance(points, PENTAGON) < 0.0]
    mass, inertia, com = slcp.polygon_mass(PENTAGON, 100.0)
    area = np.prod(np.ptp(PENTAGON, axis=0)) * len(inside) / 20000
    assert mass == pytest.approx(100.0 * area, rel=0.02) and com == pytest.approx(inside.mean(0), abs=1e-3)
    assert inertia == pytest.approx(mass * np.mean(np.sum((inside - inside.mean(0)) ** 2, 1)), rel=0.03)


LEANS = np.array([(0.0, 0.0), (0.06, 0.0), (0.2, 0.1), (0.13, 0.1)])  # its centre is beyond its foot


def part(corners=PENTAGON, **start):
    mass, inertia, com = slcp.polygon_mass(corners, 50.0)
    return slcp.Scene(
        "part",
        (slcp.Body("part", mass, inertia, com=com, joint="free"),
         slcp.Body("ball", 0.1, 1e-5, joint="free")),
        (slcp.Shape("floor", None, "halfplane", angle=UP, contype=0),
         *slcp.polygon("part", "part", corners, R), slcp.Shape("ball", "ball", "disc", 0.01)),
        "auto",
        friction=0.5,
        step_size=0.002,
        initial_state={"ball.x": 0.06, "ball.y": 0.2} | start,
    )  # fmt: skip


@pytest.mark.parametrize("corners", [PENTAGON, LEANS])
def test_it_rests_on_the_sides_that_its_weight_is_over(corners):
    """Put down on each side it stays where its centre is over that side, and tips over where it is not."""
    scene = part(corners)
    sim = slcp.Simulator(scene, slcp.Options("hard", friction="coulomb"), dtype="float64")
    com, stays = np.array(scene.bodies[0].com), []
    for i, a in enumerate(corners):
        along = corners[(i + 1) % len(corners)] - a
        angle = -np.arctan2(along[1], along[0])
        c, s = np.cos(angle), np.sin(angle)
        low = (np.array([[c, -s], [s, c]]) @ corners.T)[1].min()
        x0 = scene.state({"part.y": -low, "part.angle": angle, "ball.x": 3.0, "ball.y": 0.01})
        run = sim.rollout(x0, steps=300)
        stays.append(bool(abs(run.states[-1, 2] - angle) < 1e-6))
        foot, length = (com - a) @ along / np.hypot(*along), np.hypot(*along)
        assert stays[-1] == (R < foot < length - R)
    assert sum(stays) == (5 if corners is PENTAGON else 2)


def test_it_carries_what_falls_on_it():
    scene = part(**{"ball.x": 0.03, "ball.y": 0.2})
    sim = slcp.Simulator(scene, slcp.Options("hard", friction="coulomb"), dtype="float64")
    run = sim.rollout(scene.x0, steps=400)
    assert run.status == slcp.Status.SOLVED
    away = signed_distance(run.states[:, 3:5] - run.states[:, :2], PENTAGON)
    still = np.abs(run.states[:, 2]) < 1e-3
    assert still.all() and away.min() == pytest.approx(0.01, abs=1e-5)
    assert (run.states[-1, 4] < 0.011) and (np.abs(away - 0.01) < 1e-5).sum() > 10  # it rolls off a side


def test_what_starts_inside_is_seen():
    inside = part(**{"ball.x": 0.065, "ball.y": 0.045})
    sim = slcp.Simulator(inside, slcp.Options("hard"), dtype="float64")
    step = sim.step(inside.x0)
    assert min(step.gap[i] for i, n in enumerate(inside.row_names) if "core" in n and "ball" in n) < -0.01
    hollow = slcp.Simulator(
        slcp.Scene("hollow", inside.bodies, tuple(s for s in inside.shapes if "core" not in s.name), "auto",
                   friction=0.5, step_size=0.002), slcp.Options("hard"), dtype="float64",
    )  # fmt: skip
    assert hollow.step(inside.x0).gap.min() > -1e-9


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"vertices": PENTAGON[:2]}, r"vertices has shape \(2, 2\); \(n, 2\) with at least 3"),
        ({"vertices": PENTAGON[[0, 2, 1, 3, 4]]}, r"sides from vertices\[\d\] and from vertices\[\d\] meet"),
        ({"vertices": PENTAGON[[0, 1, 1, 3, 4]]}, r"vertices\[1\] and vertices\[2\] are one point"),
        ({"vertices": [(0, 0), (2, 0), (1, 0), (1, 1)]}, r"sides from vertices\[0\] and from vertices\[1\]"),
        ({"vertices": [(0, 0), (1, 0), (1, float("nan"))]}, "vertices"),
        ({"corner_radius": 0.0}, "corner_radius is 0"),
        (
            {"corner_radius": 0.05},
            r"corner_radius is 0.05; the side between vertices\[\d\]",
        ),
        (
            {"vertices": NOTCH, "corner_radius": 0.05},
            r"too narrow for it beside vertices\[3\] and vertices\[4\]",
        ),
        ({"vertices": NECK, "corner_radius": 0.04}, "too narrow for it beside vertices"),
        ({"vertices": 1e200 * PENTAGON}, r"numbers of up to 1.4e\+199 m"),
        ({"name": ""}, "a name is needed"),
        ({"core": 1}, "core is 1"),
    ],
)
def test_what_is_no_polygon_is_said(given, says):
    with pytest.raises(slcp.InputError, match=says):
        slcp.polygon(**({"name": "p", "body": None, "vertices": PENTAGON, "corner_radius": R} | given))
    with pytest.raises(slcp.SceneError, match="density is -1"):
        slcp.polygon_mass(PENTAGON, -1.0)
