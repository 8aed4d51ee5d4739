"""The task files of `examples/tasks` that no other test runs: what happens in them is what they say."""

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import ddp

FOLDER = Path(__file__).parents[2] / "examples" / "tasks"


def test_what_is_tossed_flies_and_lies_in_the_bin(device):
    """Balls that touch neither wall land when they would without them; others fall short or bounce."""
    task = slcp.load_task(FOLDER / "toss.toml")
    assert task.scene.nu == 0 and task.horizon is None
    worlds = slcp.draw_worlds(task, 400, 1, dtype="float64", device=device)
    found = slcp.sweep(task, worlds=worlds, seed=1, dtype="float64", device=device).part("none")
    vx, vy = worlds.x0[:, 3], worlds.x0[:, 4]
    fall = (vy + np.sqrt(vy**2 + 2.0 * 9.81 * 0.475)) / 9.81
    free = (found["rim"] == 0.0) & (0.55 < vx * fall) & (vx * fall < 0.74)
    assert 200 < free.sum() < 400 and not found["status"].any()
    assert np.abs(found["landed"] - fall)[free].max() < 0.01  # two steps
    assert found["success"][free].all() and 0.85 < found["success"].mean() < 0.99
    short = ~found["success"] & (found["place"] < 0.5)
    assert short.any() and vx[short].max() < np.median(vx)


def test_a_door_stays_shut_until_its_catch_gives_way(device):
    """The finger's force that opens it grows with the bolt's spring."""
    task = slcp.load_task(FOLDER / "door.toml")
    sim = task.simulator(slcp.Options("hard"), device=device)
    door, bolt = task.scene.state_index("door.angle"), task.scene.state_index("bolt.shift")
    force, spring = np.array([1.0, 6.0, 6.0]), np.array([1.0, 1.0, 6.0])
    stiffness = sim.params["stiffness"] * spring[:, None]
    pushes = np.broadcast_to(force[:, None, None], (3, 100, 1))
    run = sim.rollout(np.repeat(task.start, 3, 0), pushes, sim.params.replace(stiffness=stiffness))
    assert not run.status.any()
    last = run.states[:, -1, door]
    assert last[0] < 0.1 < 1.0 < last[1] and last[2] < 0.1
    assert run.states[1, :, bolt].min() < -0.01 and abs(run.states[1, -1, bolt]) < 5e-3  # in, and out again


def test_boxes_on_a_tray_ride_along_until_friction_holds_no_more(device):
    """Coulomb: up to mu g they move with the cart, beyond they are left behind with mu g on their way."""
    task = slcp.load_task(FOLDER / "tray.toml")
    scene = task.scene
    sim = task.simulator(slcp.Options("hard", friction="coulomb"), device=device)
    lower, upper, cart = (scene.state_index(name) for name in ("lower.vx", "upper.vx", "cart.vshift"))
    limit = 0.4 * 9.81
    forces = np.array([0.5, 0.95, 2.0]) * 3.5 * limit  # of what moves all three at mu g
    run = sim.rollout(np.repeat(task.start, 3, 0), np.broadcast_to(forces[:, None, None], (3, 30, 1)))
    assert not run.status.any()
    speed = run.states[:, -1]
    for world in (0, 1):
        assert speed[world, cart] > 0.4 * limit * 0.3
        np.testing.assert_allclose(speed[world, [lower, upper]], speed[world, cart], rtol=1e-6)
    np.testing.assert_allclose(speed[2, [lower, upper]], limit * 0.3, rtol=1e-6)
    assert speed[2, cart] > 1.5 * limit * 0.3
    away = slcp.measures.state("lower.x", "cart.shift")
    assert (run.measure(slcp.measures.excursion(away)) > 0.05).tolist() == [False, False, True]


@pytest.mark.slow
def test_a_switch_is_flipped_by_starts_that_reach_it(device):
    """It stays at its end by itself; starts of a fifth of the limits alone left it there, CONVERGED."""
    task = slcp.load_task(FOLDER / "switch.toml")
    sim = task.simulator(device=device)
    still = sim.rollout(task.start[0], np.zeros((task.steps, 2)))
    assert still.status == 0 and still.states[-1, task.scene.state_index("lever.angle")] > 0.45
    plan = ddp.plan(task, 8, sim=sim).best
    run = sim.rollout(
        task.start[0], policy=ddp.TrackingPolicy(plan), steps=task.steps, record=("controls", "impulse")
    )
    assert run.measure(task.success) and plan.cost < 50.0 < 108.0
    assert run.measure(task.measures["nearest"]) < 0.03 and run.measure(task.measures["impact"]) > 0.0


@pytest.mark.slow
def test_a_ball_on_a_string_is_swung_up_and_caught(device):
    """Left alone it hangs by its weight, a minimum by symmetry; a random start leads into the cup."""
    task = slcp.load_task(FOLDER / "cup.toml")
    sim = task.simulator(device=device)
    run = sim.rollout(task.start[0], np.zeros((400, 2)), record="impulse")
    string = task.scene.pair_names.index("string/knot")
    pull = run.contact_impulse[-50:, string, 0].mean() / task.scene.step_size
    assert run.status == 0 and pull == pytest.approx(0.05 * 9.81, rel=1e-3)
    plan = ddp.plan(task, 4, sim=sim).best
    run = sim.rollout(
        task.start[0], policy=ddp.TrackingPolicy(plan), steps=task.steps, record=("controls", "impulse")
    )
    assert plan.cost < 2.0 and run.measure(task.success) and run.measure(task.measures["pull"]) > 0.005
    q = run.states[:, :5]
    reach = np.hypot(q[:, 2] - q[:, 1], q[:, 3] - q[:, 0])
    assert reach.max() < 0.305 and q[-1, 3] > q[-1, 0]


def test_a_grip_holds_what_its_friction_can_carry(device):
    """2 mu F against m g, and against m (g + a) while the lift speeds up; what holds does not slip."""
    made = runpy.run_path(str(FOLDER / "lift.py"))
    force, task = 6.0, made["lift"]
    calm = task.replace(disturbances=replace(task.disturbances, pushes=()))
    report = slcp.sweep(calm, made["script"](force), worlds=120, cases=task.options, device=device)
    found = report.part("policy")
    assert not found["status"].any() and found["start_overlap"].max() < 1e-6
    carries = 2.0 * force * found["drawn_pad_left/box.friction"] / found["drawn_box.mass"]
    holds, falls = carries > 1.03 * (9.81 + 6.0 * 0.15 / 0.8**2), carries < 0.97 * 9.81
    assert holds.sum() > 50 and falls.sum() > 5
    assert found["success"][holds].all() and found["slid"][holds].max() < 1e-5
    assert not found["success"][falls].any() and found["slid"][falls].min() > 0.01
    assert np.isfinite(found["dropped"][falls]).all() and np.isinf(found["dropped"][holds]).all()
    np.testing.assert_allclose(found["grip"][holds], force, rtol=0.02)
    np.testing.assert_allclose(np.ptp(found["drawn_box.radius_0"]), 0.3 * 0.03, rtol=0.15)


def test_parcels_are_drawn_apart_by_a_faster_belt(device):
    """By the ratio of the speeds, less what they slip; on one belt they stay as near as they were."""
    task = runpy.run_path(str(FOLDER / "conveyor.py"))["conveyor"]
    scene = task.scene
    sim = task.simulator(task.options, device=device)
    run = sim.rollout(scene.x0, steps=task.steps)
    places = run.states[-1, [scene.state_index(f"{name}.x") for name in ("first", "second", "third")]]
    assert not run.status
    np.testing.assert_allclose(-np.diff(places), 0.25 * 0.5 / 0.3, rtol=0.01)
    even = sim.rollout(scene.state({"sorter.vshift": 0.3}), steps=task.steps).states[-1]
    near = even[[scene.state_index(f"{name}.x") for name in ("first", "second", "third")]]
    np.testing.assert_allclose(-np.diff(near), 0.25, rtol=0.03)
    report = slcp.sweep(task, worlds=100, cases=task.options, device=device)
    found = report.part("none")
    assert found["success"].mean() > 0.95 and not found["status"].any() and not found["start_overlap"].any()


def test_a_peg_goes_in_where_its_corner_slides(device):
    """Two rounded corners slide on each other where the normal leans by more than the friction angle."""
    made = runpy.run_path(str(FOLDER / "peg.py"))
    task = made["insertion"](stiffness=1e3, turning=200.0, centre=0.0)
    drawn = {name: law for name, law in task.disturbances.parameters.items() if name != "rail.angle"}
    drawn["rail.anchor_x"] = slcp.Uniform(0.0012, 0.0022)
    task = task.replace(disturbances=replace(task.disturbances, parameters=drawn), duration=0.25)
    report = slcp.sweep(task, made["push"](10.0), worlds=150, cases=task.options, device=device)
    found = report.part("policy")
    beyond = found["drawn_rail.anchor_x"] + found["drawn_pin.radius_0"] - 0.006
    sine = np.clip(1.0 - beyond / 0.002, -1.0, 1.0)
    ratio = sine / np.sqrt(1.0 - sine**2 + 1e-12) / found["drawn_left/pin.friction"]
    meets = beyond > 0.0
    slides, sticks = meets & (ratio > 1.1), meets & (ratio < 0.9)
    assert slides.sum() > 30 and sticks.sum() > 10 and not found["status"].any()
    assert found["depth"][slides].max() < -0.002 and np.abs(found["depth"][sticks]).max() < 0.002
