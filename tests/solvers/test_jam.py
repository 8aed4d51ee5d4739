"""Sliders whose guides lie nearly along the surface they touch: friction may hold against whatever pushes.
What is SOLVED obeys the law on the scale of the data, and what has no solution says so: by trying all modes.
"""

import dataclasses
import functools
import math

import numpy as np
import pytest
import warp as wp
from oracle import Oracle
from oracle_coulomb import can_open, solutions, violation
from simulators import NUMPY, WIDTH, numbers, rounded

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape
from slcp_warp.scripts.benchmarks.fuzz.judged import judged
from slcp_warp.scripts.benchmarks.fuzz.tasks import Task

COULOMB = slcp.Options(residual="hard", friction="coulomb")
ROUND = {wp.float64: 2e-14, wp.float32: 1e-6}  # of a gap [m]
CLEAR = {wp.float64: 1e-11, wp.float32: 3e-6}  # a gap whose sign does not hang on rounding [m]
HELD = {wp.float64: 1e-10, wp.float32: 1e-4}
REACH = {wp.float64: np.inf, wp.float32: 30.0}  # impulses of so many times the data leave digits for `HELD`


def plane(name):
    return Shape(name, None, "halfplane", angle=math.pi / 2)


def slider() -> Scene:
    """A disc on a guide, over a plane."""
    body = Body("cart", 1.0, 0.1, joint="prismatic")
    return Scene("slider", (body,), (Shape("foot", "cart", "disc", 0.1), plane("ground")),
                 (Contact("ground", "foot", 0.5),), step_size=0.01)  # fmt: skip


def vice() -> Scene:
    """A disc on a guide, between two planes that may shut it in."""
    body = Body("cart", 1.0, 0.1, joint="prismatic")
    shapes = (Shape("foot", "cart", "disc", 0.1), plane("ground"), plane("wall"))
    return Scene("vice", (body,), shapes, (Contact("ground", "foot", 0.5), Contact("wall", "foot", 0.5)),
                 step_size=0.01)  # fmt: skip


def gantry() -> Scene:
    """A guide on a guide, a foot on either, over a plane each."""
    bodies = (Body("cart", 1.0, 0.1, joint="prismatic"),
              Body("tool", 0.5, 0.1, parent="cart", joint="prismatic", axis=(0.0, 1.0)))  # fmt: skip
    shapes = (Shape("foot", "cart", "disc", 0.1), Shape("tip", "tool", "disc", 0.1), plane("ground"),
              plane("wall"))  # fmt: skip
    return Scene("gantry", bodies, shapes, (Contact("ground", "foot", 0.5), Contact("wall", "tip", 0.5)),
                 step_size=0.01)  # fmt: skip


def wheel() -> Scene:
    """A disc all but centred on its own hinge between six planes, a limit far away, and a bystander: 13 rows
    of two velocities.
    """
    bodies = (Body("wheel", 1.0, 0.1, anchor=(0.3, 0.7), lower=-50.0), Body("other", 1.0, 0.1))
    planes = tuple(plane(f"plane{i}") for i in range(6))
    return Scene("wheel", bodies, (Shape("rim", "wheel", "disc", 0.1, offset=(1e-3, 0.0)), *planes),
                 tuple(Contact(p.name, "rim", 0.5) for p in planes), step_size=0.01)  # fmt: skip


MAKERS = {"slider": slider, "vice": vice, "gantry": gantry, "wheel": wheel}


@functools.cache
def simulator(name, dtype, strategy="specialised", options=COULOMB):
    return slcp.Simulator(MAKERS[name](), options, device="cpu", dtype=WIDTH[dtype], strategy=strategy)


def draw(scene, rng, count):
    """States at rest to fast, and numbers: planes along the guides and across, deep and touching."""
    shapes, contacts, bodies = (len(part) for part in (scene.shapes, scene.contacts, scene.bodies))
    turn, offset = np.zeros((count, shapes)), np.zeros((count, shapes, 2))
    for i, shape in enumerate(scene.shapes):
        if shape.kind != "halfplane":
            continue
        along = math.pi / 2 + rng.choice([-1, 1], count) * 10 ** rng.uniform(-3, -0.1, count)
        turn[:, i] = np.where(rng.random(count) < 0.7, along, rng.uniform(-math.pi, math.pi, count))
        gap = rng.choice([-0.1, -0.01, -1e-3, -1e-6, 0.0, 1e-4, 1e-2], count) * rng.uniform(0.5, 1.5, count)
        offset[:, i] = -np.stack([np.cos(turn[:, i]), np.sin(turn[:, i])], -1) * (0.1 + gap)[:, None]
    axis = rng.uniform(-math.pi, math.pi, (count, bodies))
    axis[:, 0] = 0.0
    changes = {
        "shape_angle": turn,
        "shape_offset": offset,
        "friction": rng.choice([0, 0.05, 0.2, 0.5, 1.0, 2.0], (count, contacts)),
        "step_size": rng.choice([0.001, 0.01, 0.05], count),
        "mass": 10 ** rng.uniform(-2, 2, (count, bodies)),
        "inertia": np.full((count, bodies), 0.1),
        "axis": np.stack([np.cos(axis), np.sin(axis)], -1),
    }
    x = np.zeros((count, 2 * scene.nv))
    x[:, scene.nv :] = rng.choice([0, 0.1, 1, 10], (count, 1)) * rng.standard_normal((count, scene.nv))
    return x, changes


def posed(scene, dtype, x, changes):
    """M, J with rows (n, t), v_free, d/h and mu of every world, as the kernel sees the numbers."""
    oracle = Oracle(scene, **numbers(scene, dtype, **changes))
    (x,) = rounded(dtype, x)
    q, problem = x[:, : scene.nv], oracle.problem(x)
    contacts = [oracle.contact_jacobian(q, k) for k in range(len(scene.contacts))]
    jac = np.stack([part for c in contacts for part in (c[1], c[2])], 1)
    gap = np.stack([part for c in contacts for part in (c[0], 0.0 * c[0])], 1)
    for i in range(len(x)):
        mu = [part for k in range(len(contacts)) for part in (None, oracle.p["friction"][i, k])]
        yield problem["M"][i], jac[i], problem["vfree"][i], gap[i] / problem["h"][i], mu, problem["h"][i]


def impulses(found, mass, jac, free, rate):
    """The least impulses of the solutions, as changes of the rows' velocities, beside the data."""
    root = np.sqrt(np.einsum("ri,ij,rj->r", jac, np.linalg.inv(mass), jac))
    return min(np.abs(lam * root).max() for _, lam in found) / np.abs([rate, jac @ free]).max()


def verdicts(name, dtype, strategy, count):
    """Of every world: what there is (a solution, none though the rows open, none), the status, the error."""
    scene, sim = MAKERS[name](), simulator(name, dtype, strategy)
    x, changes = draw(scene, np.random.default_rng(1), count)
    step = sim.step(x.astype(NUMPY[dtype]), None, sim.params.replace(**changes))
    truth, error = [], np.zeros(count)
    for i, (mass, jac, free, rate, mu, h) in enumerate(posed(scene, dtype, x, changes)):
        args = (mass, jac, free, rate, mu)
        if np.abs(rate[::2] * h).min() <= CLEAR[dtype]:
            truth.append("touching")
        elif found := solutions(*args):
            truth.append("solvable" if impulses(found, *args[:4]) < REACH[dtype] else "far fetched")
        else:
            truth.append("jammed" if can_open(jac[::2], rate[::2]) else "shut")
        if step.status[i] == slcp.Status.SOLVED:
            v, impulse = np.asarray(step.state[i, scene.nv :], float), np.asarray(step.impulse[i], float)
            error[i] = violation(*args, v, impulse, noise=ROUND[dtype] / h)
    return np.array(truth), step.status, error


NAMES = [("slider", wp.float64), ("slider", wp.float32), ("vice", wp.float64), ("gantry", wp.float64),
         ("gantry", wp.float32)]  # fmt: skip
IDS = [f"{name}-{WIDTH[dtype]}" for name, dtype in NAMES]


@pytest.mark.slow
@pytest.mark.parametrize("name,dtype", NAMES, ids=IDS)
def test_every_slider_is_solved_or_says_why_not(name, dtype):
    truth, status, error = verdicts(name, dtype, "specialised", 2000)
    s = slcp.Status
    assert error.max() < HELD[dtype]
    assert {"solvable", "jammed"} <= set(truth) and ("shut" in truth) == (name == "vice")
    wide = dtype is wp.float64
    solved = status[truth == "solvable"] == s.SOLVED
    assert solved.all() if wide else solved.mean() > 0.995
    assert np.isin(status[truth == "solvable"], (s.SOLVED, s.NOT_CONVERGED)).all()
    assert np.isin(status[truth == "far fetched"], (s.SOLVED, s.NOT_CONVERGED)).all()
    assert np.isin(status[truth == "jammed"], (s.JAMMED, s.NOT_CONVERGED)).all()
    assert (status[truth == "jammed"] == s.JAMMED).mean() > (0.99 if wide else 0.95)
    assert (status[truth == "shut"] == s.INFEASIBLE).all()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "solved", "jammed"), [("slider", 0.99, 0.95), ("vice", 0.99, 0.95),
                                                        ("gantry", 0.9, 0.25)])  # fmt: skip
def test_the_kernels_for_large_scenes_call_a_jam_so(name, solved, jammed):
    truth, status, error = verdicts(name, wp.float64, "generic", 1000)
    s = slcp.Status
    assert error[truth != "touching"].max() < HELD[wp.float64]
    # what has none, and how: the fixed point may give up, but calls nothing what it is not; a jam is proved
    for kind, name, share in (("solvable", s.SOLVED, solved), ("jammed", s.JAMMED, jammed),
                              ("shut", s.INFEASIBLE, 0.99)):  # fmt: skip
        assert np.isin(status[truth == kind], (name, s.NOT_CONVERGED)).all()
        assert (status[truth == kind] == name).sum() >= share * (truth == kind).sum()


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
def test_a_slider_in_the_cone_of_its_own_guide_is_jammed(strategy):
    """mu = .5 against tan(.0734), 1 mm deep, at rest: every push along the guide presses it in further."""
    turn = math.pi / 2 + 0.0734
    changes = {"shape_angle": np.array([0.0, turn]), "friction": 0.5, "step_size": 0.01}
    sim = simulator("slider", wp.float64, strategy)
    for depth, mu, status in ((1e-3, 0.5, slcp.Status.JAMMED), (1e-3, 0.07, slcp.Status.SOLVED),
                              (0.0, 0.5, slcp.Status.SOLVED)):  # fmt: skip
        x = np.array([[(depth - 0.1) / math.sin(0.0734), 0.0]])
        step = sim.step(x, None, sim.params.replace(**changes | {"friction": mu}))
        assert step.status[0] == status
        if status == slcp.Status.SOLVED:  # out of the plane in one step, or where it was
            assert step.state[0, 1] * 0.01 * math.sin(0.0734) == pytest.approx(-depth, abs=1e-12)


def wheels(scene, rng, count):
    """States and numbers of `wheel`: two planes deep, touching or apart, four apart."""
    turn, gap = rng.uniform(-math.pi, math.pi, (count, 7)), rng.uniform(0.5, 1.5, (count, 7))
    gap[:, :3] *= rng.choice([-1e-2, -1e-3, 0.0, 1e-4, 1e-2, 0.1, 1.0], (count, 3))
    gap[:, 3:] *= rng.choice([1e-4, 1e-2, 0.1, 1.0], (count, 4))
    offset = [0.3, 0.7] - np.stack([np.cos(turn), np.sin(turn)], -1) * (0.1 + gap)[..., None]
    turn[:, 0], offset[:, 0] = 0.0, (1e-3, 0.0)
    changes = {"shape_angle": turn, "shape_offset": offset, "step_size": np.full(count, 0.01),
               "friction": rng.choice([0, 0.05, 0.2, 0.5, 1.0, 2.0], (count, 6)),
               "mass": 10 ** rng.uniform(-2, 2, (count, 2)), "inertia": np.full((count, 2), 0.1)}  # fmt: skip
    x = rng.standard_normal((count, 2 * scene.nv))
    x[:, scene.nv :] *= rng.choice([0, 0.1, 1, 10], (count, 1))
    return x, changes


@pytest.mark.slow
def test_a_limit_far_away_is_no_measure_of_a_jam():
    """Its d/h of 5,000 rad/s made all that a contact misses small: nearly a solution, so never JAMMED. Where
    modes fit to roundings of impulses of 5,000 times the data, single precision knows of no jam.
    """
    scene, sim = wheel(), simulator("wheel", wp.float32)
    x, changes = wheels(scene, np.random.default_rng(3), 400)
    status = sim.step(x.astype(np.float32), None, sim.params.replace(**changes)).status
    jammed = np.flatnonzero(status == slcp.Status.JAMMED)
    assert len(jammed) > 60 and (status == slcp.Status.NOT_CONVERGED).mean() < 0.15
    some = jammed[::8]
    for mass, jac, free, rate, mu, _ in posed(
        scene, wp.float32, x[some], {k: v[some] for k, v in changes.items()}
    ):
        assert solutions(mass, jac, free, rate, mu) == [] and can_open(jac[::2], rate[::2])


@pytest.mark.full
def test_what_presses_may_free_what_is_jammed_without_it():
    """Rows join as they come within reach: a jam of some is none before all are in the system."""
    truth, status, _ = verdicts("gantry", wp.float64, "specialised", 4000)
    assert (status[truth == "solvable"] == slcp.Status.SOLVED).all()


@pytest.mark.slow
def test_what_takes_impulses_of_30_000_times_the_data_is_no_jam():
    """Three bodies of one tree wedged by springs of up to 3e7 N/m: in double precision it has a solution. Its
    own modes miss by a rounding of such impulses in single precision, which proves nothing.
    """
    task = Task(90010, 29, "specialised")
    scene, ((options, dtype),) = task.make_scene(), task.methods()
    chunk, place = divmod(1950, task.per_chunk)
    one = task.worlds(chunk, scene).part([place])
    shaken = one.x * (1.0 + 1e-4 * np.random.default_rng(5).standard_normal((60, one.x.shape[1])))
    worlds = dataclasses.replace(one.part(np.zeros(60, int)), x=shaken.astype(np.float32).astype(float))
    sim = slcp.Simulator(scene, options, device="cpu", dtype=dtype, strategy="specialised")
    found = judged(worlds, sim)[0]
    assert dtype == "float32" and set(found.verdict) <= {"holds", "status"}


def test_what_opens_at_ten_thousand_times_the_speeds_is_not_infeasible():
    """Two rows of a contact that oppose each other but for .1 % open at 1e6 rad/s of a damped coordinate that
    is 1e5 times as heavy as the other.
    """
    task = Task(90011, 33, "specialised")
    scene, ((options, dtype),) = task.make_scene(), task.methods()
    worlds = task.worlds(0, scene).part([2])
    sim = slcp.Simulator(scene, options, device="cpu", dtype=dtype, strategy="specialised")
    found = judged(worlds, sim)[0]
    assert dtype == "float32" and found.verdict[0] == "status" and "NOT_CONVERGED" in found.reason[0]
