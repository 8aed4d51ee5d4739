"""A page under a policy that plans: what it intends, and what is said where a plan fails."""

import numpy as np
import pytest

pytest.importorskip("websockets", reason="the extra 'watch' is not installed")

from test_engine import ME, finger_engine, stepped

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.scripts.watch.engine import Engine
from slcp_warp.scripts.watch.world import Subject


def test_a_planning_policy_shows_what_it_intends():
    """The path of the free ellipse's centre is its anchor; the finger's links move along theirs."""
    task = slcp.tasks.flicking_finger()
    policy = ddp.MPC(ddp.problem_of(task), passes=1, starts=["shift", "zero"])
    engine = stepped(Engine(Subject.of(task), {"mpc": policy}), 3)
    assert engine.policy == "mpc" and engine.said == ""
    paths = np.array(engine.picture(1.0)["plan"])
    assert paths.shape[0] == 3 and np.ptp(paths[0], axis=0).max() > 0.05
    np.testing.assert_allclose(paths[2], np.tile([0.0, -3.0], (paths.shape[1], 1)), atol=1e-3)
    engine.send(ME, {"do": "policy", "name": "zero"})
    engine.advance(0.0)
    assert engine.picture(1.0)["plan"] == []


def test_a_plan_that_fails_is_said_and_the_last_one_goes_on():
    """In the middle of a run no start has a finite cost; where one has again nothing more is counted."""
    wild = []

    def start(s):
        return np.full((10, 2), 1e200 if wild else 0.5)

    task = slcp.tasks.flicking_finger()
    problem = ddp.Problem(task.simulator(), task.cost, 10)
    engine = finger_engine(policies={"mpc": ddp.MPC(problem, passes=1, starts=[start])})
    assert stepped(engine, 2).said == ""
    wild.append(True)
    assert stepped(engine, 2).said == "mpc: 2 plans failed, the last ones go on"
    assert engine.policy == "mpc" and engine.controls.any() and np.isfinite(engine.worlds.state).all()
    wild.clear()
    assert stepped(engine, 2).said == "mpc: 2 plans failed, the last ones go on"
    engine.send(ME, {"do": "policy", "name": "mpc"})
    assert stepped(engine, 1).said == ""
