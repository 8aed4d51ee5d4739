"""Libraries of runs: what is kept of `MPC` in disturbed worlds, and the policy that asks by the step."""

from dataclasses import replace

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import ddp

STEPS, REPLAN, WORLDS = 10, 4, 3


@pytest.fixture(scope="module")
def task():
    """Half a second of the finger, which plans look as far as; nothing fails."""
    spins = slcp.measures.rate("ellipse.angle")
    return slcp.tasks.flicking_finger().replace(
        duration=0.5, horizon=STEPS, disturbances=slcp.Disturbances(velocity=0.5),
        measures={"rate": spins}, success=spins > -1e9,
    )  # fmt: skip


def planner(task, **more):
    return ddp.MPC(ddp.problem_of(task), passes=2, replan=REPLAN, starts=["shift", "zero"], end=STEPS, **more)


@pytest.fixture(scope="module")
def library(task):
    return ddp.library_of_runs(task, planner(task), WORLDS, seed=4)


def test_every_step_of_every_world_has_an_entry(task, library):
    assert len(library) == STEPS * WORLDS and library.header["end"] == STEPS
    order = np.lexsort((library.step, library.chain))
    np.testing.assert_array_equal(library.step[order], np.tile(np.arange(STEPS), WORLDS))
    np.testing.assert_array_equal(library.age, library.step % REPLAN)
    assert np.isfinite(library.cost).all() and (library.gain >= -1e-9).all()


def test_entries_are_controllers_of_plans(task, library):
    """From the first entry of a plan its model passes through the others; the cost is the plan's own."""
    problem = ddp.problem_of(task)
    first = (library.age == 0) & (library.plan < 2)
    after = np.isin(library.age, [1]) & (library.plan < 2)
    sim = problem.dynamics
    moved = sim.step(library.x[first], library.u[first]).state
    np.testing.assert_allclose(moved, library.x[after], atol=1e-9)
    begins = library.select((library.age == 0) & (library.plan == 0))
    plans = ddp.solve(problem, begins.x, np.zeros((WORLDS, STEPS, 2)), ddp.Options(max_iterations=0))
    np.testing.assert_allclose(begins.gain, plans.cost - begins.cost, rtol=1e-9)


def test_where_it_was_recorded_it_does_what_was_done(task, library):
    """From a run's own start, on the model itself, the library's policy makes the controls of the plans."""
    problem = ddp.problem_of(task)
    own = library.select(library.chain == 1)
    order = np.argsort(own.step)
    run = problem.dynamics.rollout(own.x[order][0], policy=own.policy(), steps=REPLAN, record="controls")
    np.testing.assert_allclose(run.controls, own.u[order][:REPLAN], atol=1e-9)


def test_entries_of_controls_that_act_late_are_of_where_they_are_sent(task):
    """From the states met: in an undisturbed world with that delay the library sends what was sent."""
    h = task.scene.step_size
    late = task.replace(disturbances=replace(task.disturbances, delay=2 * h))
    library = ddp.library_of_runs(late, planner(task, lag=2), 2, seed=4)
    own = library.select(library.chain == 1)
    own = own.select(np.argsort(own.step))
    np.testing.assert_array_equal(own.step, np.arange(STEPS))
    sim = ddp.problem_of(task).dynamics
    run = sim.rollout(own.x[0], np.concatenate([np.zeros((2, 2)), own.u[: REPLAN - 2]]))
    np.testing.assert_allclose(run.states[:REPLAN], own.x[:REPLAN], atol=1e-9)


def test_its_worlds_are_not_those_of_a_sweep_of_the_same_seed(task, library):
    swept = slcp.draw_worlds(task, WORLDS, 4).x0
    started = library.x[library.step == 0]
    assert np.abs(started[:, None] - swept[None]).max(axis=2).min() > 1e-3


def test_runs_that_fail_are_left_out(task):
    impossible = task.replace(success=slcp.measures.rate("ellipse.angle") > 1e9)
    with pytest.raises(slcp.InputError, match="mpc brings none of 2 worlds to success"):
        ddp.library_of_runs(impossible, planner(task), 2)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"entries": 5}, "entries is 5; at most those until the next plan, 4"),
        ({"worlds": 0}, "worlds is 0"),
        ({"task": slcp.tasks.hopper_hop()}, "mpc plans for scene 'flicking_finger', not 'hopper'"),
    ],
)
def test_what_does_not_fit_is_refused(task, changes, message):
    with pytest.raises(slcp.InputError, match=message):
        ddp.library_of_runs(**{"task": task, "mpc": planner(task), **changes})


def test_mpc_asks_a_library_of_runs_at_its_step(task, library):
    """The start "library" of a cycle follows it from the step of the run, not from its beginning."""
    policy = ddp.MPC(ddp.problem_of(task), library, passes=0, starts=["library"], end=STEPS)
    policy.begin(task.simulator(), np.arange(1))
    own = library.select(library.chain == 1)
    at = int(np.flatnonzero(own.step == REPLAN)[0])
    found = policy.act(own.x[at][None], REPLAN * 0.05, np.arange(1))
    np.testing.assert_allclose(found[0], own.u[at], atol=1e-9)


def test_a_plan_before_the_first_state_is_refused(task):
    with pytest.raises(slcp.InputError, match="no plans yet"):
        planner(task).plans()


def test_a_library_of_another_step_size_is_no_part_of_it(library):
    other = replace(library, header=library.header | {"end": STEPS + 1})
    with pytest.raises(ddp.LibraryError, match="steps of different runs"):
        ddp.concatenate([library, other])
