"""Copies and pickles of public objects: the same numbers come out, or one error says why there are none."""

import copy
import pickle

import numpy as np
import pytest
from test_properties import library

import slcp_warp as slcp
from slcp_warp import ddp, measures, policies

WAYS = (copy.copy, copy.deepcopy, lambda each: pickle.loads(pickle.dumps(each)))


@pytest.fixture(scope="module")
def task():
    return slcp.tasks.flicking_finger().replace(horizon=4, duration=0.2, measures={}, success=None)


@pytest.fixture(scope="module")
def sim(task):
    return task.simulator(device="cpu")


def starts(task):
    return np.repeat(task.start[:1], 2, axis=0)


@pytest.mark.parametrize("way", WAYS, ids=["copy", "deepcopy", "pickle"])
def test_simulators_and_what_they_give_come_out_the_same(task, sim, way):
    sim = slcp.Simulator(task.scene, slcp.Options("hard"), device="cpu")
    sim.params = sim.params.replace(friction=0.3)
    other = way(sim)
    assert (other.options, other.dtype, other.strategy) == (sim.options, sim.dtype, sim.strategy)
    us = np.full((2, 4, 2), 0.1)
    runs = [each.rollout(starts(task), us, record=("controls", "impulse", "gap")) for each in (sim, other)]
    again = way(runs[0])
    for run in (runs[1], again):
        np.testing.assert_array_equal(run.states, runs[0].states)
    assert (other.params["friction"] == 0.3).all() and (again.params["friction"] == 0.3).all()
    step = sim.step(starts(task), us[:, 0])
    np.testing.assert_array_equal(way(step).contact_impulse, step.contact_impulse)
    moved = way(sim.params).replace(mass=2.0)
    assert not np.array_equal(sim.step(starts(task), us[:, 0], moved).state, step.state)


@pytest.mark.parametrize("way", WAYS, ids=["copy", "deepcopy", "pickle"])
def test_problems_plans_and_planners_come_out_the_same(task, sim, way):
    problem = ddp.problem_of(task, sim)
    options = ddp.Options(max_iterations=2)
    plans = [ddp.solve(each, task.start[0], np.zeros((4, 2)), options) for each in (problem, way(problem))]
    np.testing.assert_array_equal(plans[0].us, plans[1].us)
    np.testing.assert_array_equal(way(plans[0]).simulated.parameters["mass"], sim.params["mass"])
    mpc, worlds = (
        ddp.MPC(problem, passes=1, starts=["zero", ddp.Sampling(samples=4, iterations=1)]),
        np.arange(2),
    )
    mpc.begin(sim, worlds)
    first = mpc.act(starts(task), 0.0, worlds)
    other = way(mpc)
    with pytest.raises(slcp.InputError, match="in no run yet; begin"):
        other.act(starts(task), 0.05, worlds)
    other.begin(sim, worlds)
    np.testing.assert_array_equal(other.act(starts(task), 0.0, worlds), first)
    linear = ddp.linear_system(np.eye(2), np.ones((2, 1)), device="cpu")
    assert way(linear).params.values.keys() == linear.params.values.keys() and way(linear).nx == 2


def test_all_else_comes_out(task, sim):
    law = policies.Linear(np.zeros((2, 6)), task.start[0], np.zeros(2))
    given = [
        task, task.scene, task.cost, task.disturbances, slcp.Options(), ddp.Options(), ddp.Sampling(), law,
        measures.final(0) > 1.0, policies.Around(law, delay=1), library(), library().policy(),
        sim.linearize(task.start[0], np.zeros(2)), slcp.draw_worlds(task, 3, 0, device="cpu"),
        ddp.RecedingOptions(), ddp.plan(task, 1, sim=sim, options=ddp.Options(max_iterations=1)),
    ]  # fmt: skip
    solution = slcp.solve_complementarity(2.0 * np.eye(2)[None], -np.ones((1, 2)))
    for way in WAYS:
        for own, other in zip(solution.vjp(np.ones((1, 2))), way(solution).vjp(np.ones((1, 2)))):
            np.testing.assert_array_equal(own, other)
    for each in given:
        assert [type(way(each)) for way in WAYS] == [type(each)] * 3


@pytest.mark.parametrize("way", WAYS, ids=["copy", "deepcopy", "pickle"])
@pytest.mark.parametrize("kind", [ddp.Workspace, ddp.Sampler])
def test_what_is_on_a_device_says_that_it_cannot(task, sim, kind, way):
    with pytest.raises(slcp.InputError, match=f"a {kind.__name__} cannot be copied or pickled, its arrays"):
        way(kind(ddp.problem_of(task, sim), 1))
