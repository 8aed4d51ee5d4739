"""The stability battery: its judge against the oracle, planted failures, and a few cells of it."""

import dataclasses

import numpy as np
import pytest
from oracle import Oracle
from random_scenes import near_contact
from scipy.integrate import quad
from simulators import scene as named_scene

import slcp_warp as slcp
from slcp_warp.kernels.method import Method
from slcp_warp.scripts.benchmarks.mechanics.complementarity import complementarity, expected_square_slopes
from slcp_warp.scripts.benchmarks.stability import mujoco as stability_mujoco
from slcp_warp.scripts.benchmarks.stability import scenes
from slcp_warp.scripts.benchmarks.stability.case import Grid
from slcp_warp.scripts.benchmarks.stability.cases import CASES
from slcp_warp.scripts.benchmarks.stability.check import Checker
from slcp_warp.scripts.benchmarks.stability.report import axes, markdown
from slcp_warp.scripts.benchmarks.stability.run import (
    DEGRADES,
    PASS,
    SILENT,
    STATUS,
    TOLERANCE,
    Selection,
    judge,
    methods,
    run_battery,
)

HARD, SMOOTH = Method("hard"), Method("rem-logistic")
BY_NAME = {case.name: case for case in CASES}


def steps(scene, method, count=40, seed=0, **numbers):
    """States, next states and impulses of the oracle, near contact: (1, count, ...) each."""
    oracle = Oracle(scene, **numbers)
    x = near_contact(scene, np.random.default_rng(seed), count)
    after, impulse = oracle.step(x, np.zeros((count, scene.nu)), hard=method.hard)
    return x[None], after[None], impulse[None]


@pytest.mark.parametrize("method", [HARD, SMOOTH], ids=["hard", "rem-logistic"])
@pytest.mark.parametrize("name", ["flicking_finger", "grasp", "sliding_block", "moving_plane"])
def test_judge_accepts_the_oracle(name, method):
    scene = named_scene(name)
    x, after, impulse = steps(scene, method)
    kept = np.isfinite(impulse).all(-1)[0]
    verdict = Checker(scene, {}).judge(x[:, kept], after[:, kept], impulse[:, kept], None, method)
    assert kept.mean() > 0.8 and (impulse > 1e-3).any()
    assert verdict.motion.max() < 1e-12
    assert verdict.contact.max() < 1e-10


def test_energy_is_the_oracles():
    scene = named_scene("flicking_finger")
    x, after, impulse = steps(scene, SMOOTH)
    verdict = Checker(scene, {}).judge(x, after, impulse, None, SMOOTH)
    np.testing.assert_allclose(
        verdict.energy[0, :-1], Oracle(scene).energy(x[0, :, :3], x[0, :, 3:]), rtol=1e-12
    )


def test_normal_residual_is_an_expectation():
    """E[min(a, b + sigma noise)], by quadrature on either side of its kink."""

    def expected(a, b, sigma):
        def mean(z):
            return min(a, b + sigma * z) * np.exp(-0.5 * z * z) / np.sqrt(2 * np.pi)

        return quad(mean, -12, 12, points=[(a - b) / sigma], limit=400, epsabs=1e-13)[0]

    for a, b, sigma in [(0.3, 0.1, 0.2), (1.0, 0.5, 0.1), (0.0, 0.01, 0.05)]:
        got = complementarity(np.array(a), np.array(b), np.array(sigma), Method("rem-normal"))
        assert got == pytest.approx(expected(a, b, sigma), abs=1e-12)


@pytest.mark.parametrize("residual", ["erm-logistic", "erm-normal"])
def test_slopes_of_the_expected_square(residual):
    """Against differences of E[min(a, b + noise)^2] by quadrature."""
    logistic = residual == "erm-logistic"

    def expected(a, b, sigma):
        def square(z):
            density = 0.25 / np.cosh(z / 2) ** 2 if logistic else np.exp(-0.5 * z * z) / np.sqrt(2 * np.pi)
            return min(a, b + sigma * z) ** 2 * density

        return quad(square, -40, 40, points=[(a - b) / sigma, 0.0], limit=400, epsabs=1e-13)[0]

    for a, b, sigma in [(0.3, 0.1, 0.2), (0.2, 0.5, 0.1), (0.0, 0.01, 0.05)]:
        got = expected_square_slopes(np.array(a), np.array(b), np.array(sigma), Method(residual))
        e = 1e-4
        by_a = (expected(a + e, b, sigma) - expected(a - e, b, sigma)) / (2 * e)
        by_b = (expected(a, b + e, sigma) - expected(a, b - e, sigma)) / (2 * e)
        np.testing.assert_allclose(got, [by_a, by_b], atol=2e-7)


def world(spoil=None):
    """A cell of a resting disc (hard): the verdict of a correct step, or of one that `spoil` has changed."""
    case = dataclasses.replace(BY_NAME["sink"], steps=4)
    scene, h = scenes.disc(), 0.01
    grid = Grid(h, np.array([np.nan]), np.array([1.0]), HARD)
    numbers = {**scene.default_parameters(), "step_size": np.array(h)}
    states, impulse = np.zeros((1, 5, 6)), np.full((1, 4, 2), 0.5 * 9.81 * h)
    status = np.zeros(1, int)
    if spoil is not None:
        spoil(states, impulse, status)
    rows = judge(case, grid, "float64", scene, numbers, states, np.zeros((1, 4, 0)), impulse, status)
    return rows[0]["verdict"]


def wrong_impulse(states, impulse, status):
    impulse[:, 2] *= 1.0 + 1e-8


def penetration(states, impulse, status):
    states[:, 3:, 1] = -1e-6


def pulled(states, impulse, status):
    impulse[:, 2] = [2 * 9.81 * 0.01, -9.81 * 0.01]


def not_a_number(states, impulse, status):
    states[:, -1, 5] = np.nan


def jumped(states, impulse, status):
    states[:, 3:, 0] = 1e-4


def test_planted_failures_are_silent_unless_reported():
    assert world() == PASS
    for spoil in (wrong_impulse, penetration, pulled, not_a_number, jumped):
        assert world(spoil) == SILENT, spoil.__name__

    def reported(states, impulse, status):
        penetration(states, impulse, status)
        status[:] = slcp.Status.NOT_CONVERGED

    assert world(reported) == STATUS


def test_a_jam_that_is_called_solved_is_silent():
    case = BY_NAME["jam"]
    scene, grid = case.scene(), Grid(0.01, np.array([np.nan]), np.array([0.1]), HARD)
    zero = np.zeros((1, 4, 2)), np.zeros((1, 3, 1)), np.zeros((1, 3, 2))
    for status, verdict in ((slcp.Status.SOLVED, SILENT), (slcp.Status.INFEASIBLE, PASS)):
        row = judge(case, grid, "float64", scene, scene.default_parameters(), *zero, np.array([status]))[0]
        assert row["verdict"] == verdict


def test_runaway_impulses_excuse_nothing():
    """A jammed slider that is thrown out at 3.5 m/s by impulses of 3e17 against each other."""
    case, method = BY_NAME["slider jams"], Method("hard", friction="coulomb")
    grid = Grid(0.01, np.array([np.nan]), np.array([10.0]), method)
    start, scene = case.start(grid, 1), case.scene()
    numbers = scene.default_parameters() | start.numbers | {"step_size": np.array(0.01)}
    checker, x = Checker(scene, numbers), start.x0[:, None]
    _, normal, tangent, _ = checker.contacts(x[..., :1])
    after = x + np.array([-0.0347, -3.47])
    impulse = 3e17 * np.stack([np.ones((1, 1)), -(normal / tangent)[..., 0, 0]], -1)
    verdict = checker.judge(x, after, impulse, None, method)
    assert verdict.motion.max() > 1e4 * TOLERANCE["float64"] < verdict.contact.max()


def test_trapezoidal_steps_of_springs_are_judged():
    """Of one joint on a spring, by its own formula. What is off is noticed; with contact it is not known."""
    method, h = Method("hard", integrator="trapezoidal"), 0.01
    q, v = np.random.default_rng(0).standard_normal((2, 1, 50))
    for ring in (0.1, 1.0, 1e3):
        k = (ring / h) ** 2
        checker = Checker(scenes.sprung(), {"stiffness": np.array([k]), "step_size": np.array(h)})
        v1 = v - (h * k * q + 0.5 * h**2 * k * v) / (1.0 + 0.25 * h**2 * k)
        x, after = np.stack([q, v], -1), np.stack([q + 0.5 * h * (v + v1), v1], -1)
        none = np.zeros((1, 50, 2))
        verdict = checker.judge(x, after, none, None, method)
        assert verdict.motion.max() < 1e-14 and verdict.contact.max() < 1e-14
        for wrong in ([1e-8, 0.0], [0.0, 1e-8]):
            off = wrong * (np.abs(x) + np.abs(after))
            verdict = checker.judge(x, after + off, none, None, method)
            assert (verdict.motion > TOLERANCE["float64"]).all()
    none[0, :20, 0] = 1.0
    x[0, 20:25] = 99.0, 1e6  # beyond its limit within the step
    checker.numbers["stiffness"] = np.array([1.0])
    known = ~np.isnan(checker.judge(x, after, none, None, method).motion[0])
    assert not known[:25].any() and known[25:].all()


@pytest.mark.full
def test_stiff_dampers_slow_down_springs_stay_and_guides_along_a_surface_are_judged():
    names = (
        "stiff damping",
        "stiff joint spring",
        "stiff spring",
        "slider strikes",
        "slider leaves",
        "slider jams",
        "slider wedged",
        "guide along",
    )
    rows = run_battery(CASES, Selection(names, ("hard",), ("float64",), (), (0.01,)), lambda line: None)
    assert {row["case"] for row in rows} == set(names)
    assert {row["integrator"] for row in rows} == {"euler", "leapfrog", "trapezoidal"}
    assert {row["verdict"] for row in rows} == {PASS}


def test_heaps_and_chains_are_judged():
    """What generic kernels step: thrown heaps gain no energy, a chain stays before its wall."""
    names = ("heap of 8, thrown", "heavy on a heap", "long chain")
    selection = Selection(names, ("hard",), ("float64",), (), (0.01,))
    rows = [row for row in run_battery(CASES, selection, lambda line: None) if row["friction"] == "anitescu"]
    assert {row["case"] for row in rows} == set(names) and SILENT not in {row["verdict"] for row in rows}
    kept = [row for row in rows if row["variant"] < 1e3 and row["status"] != "NONFINITE"]
    found = {rule: [row for row in kept if row["integrator"] == rule] for rule in ("euler", "leapfrog")}
    assert len(found["euler"]) == 14 and {row["verdict"] for row in found["euler"]} == {PASS}
    leaps = [row["verdict"] for row in found["leapfrog"] if row["case"] != "long chain"]  # no turning there
    assert len(leaps) == 12 and set(leaps) == {PASS}


@pytest.mark.slow
def test_no_cell_fails_silently():
    """The cheapest kernels of the quick battery: joint limits, and a lever with noise."""
    slider, numbers = ("opposing limits", "jam", "torque spike"), (("float64",), (0.1, 1e-4), (1e-3, 0.05))
    rows = run_battery(CASES, Selection(slider, ("hard", "rem-logistic"), *numbers), lambda line: None)
    rows += run_battery(CASES, Selection(("lever to 0",), ("rem-logistic",), *numbers), lambda line: None)
    assert {row["case"] for row in rows} == {*slider, "lever to 0"}
    assert [row for row in rows if row["verdict"] == SILENT] == []
    assert sum(row["verdict"] == PASS for row in rows) > 0.8 * len(rows)
    assert all(row["verdict"] == PASS for row in rows if row["residual"] == "hard")
    cases, columns = axes(rows)
    assert len(markdown(rows).splitlines()) == len(cases) + 2 and "hard 64" in columns


@pytest.mark.full
def test_a_disc_rests_creeps_sticks_and_stops():
    selection = Selection(("rest", "creep", "stop", "threshold"), ("hard",), ("float64",), (), (1e-3, 0.05))
    rows = run_battery(CASES, selection, lambda line: None)
    assert {row["verdict"] for row in rows} == {PASS}
    hop = run_battery(CASES, Selection(("hop",), ("hard",), ("float64",), (), (0.05,)), lambda line: None)
    assert {r["verdict"] for r in hop if r["friction"] == "anitescu"} == {DEGRADES}


def test_every_offered_method_is_in_the_battery():
    offered = methods(Selection())
    assert len(offered) == len(set(offered)) and {o.residual for o in offered} == set(
        slcp.options.CHOICES["residual"]
    )


def test_mujoco_runs_the_same_scenes():
    pytest.importorskip("mujoco")
    rows = stability_mujoco.compare(0.05, [])
    names = {case.name for case in CASES}
    assert {row["case"] for row in rows} <= names
    assert all(row["MuJoCo, default"] >= 0.0 for row in rows)
    wrong = dataclasses.replace(stability_mujoco.scenarios(0.05)[0], gap=0.01)
    with pytest.raises(RuntimeError, match="differs"):
        stability_mujoco.simulate(wrong, 0.05, "default")
