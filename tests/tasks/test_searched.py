"""What a search for the smallest failure disturbs, from a task and what is given beside it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from test_task_sweep import SCENE, task

import slcp_warp as slcp
from slcp_warp.ensembles.questions.rare.falsification import Falsification
from slcp_warp.ensembles.questions.rare.numbers import Numbers
from slcp_warp.ensembles.questions.rare.space import searched


def test_a_searched_push_is_the_tasks_first_but_for_what_is_given():
    weight = tuple(slcp.Normal(9.81 * body.mass) for body in SCENE.bodies)
    pusher = [body.name for body in SCENE.bodies].index("pusher")
    first = slcp.Push("pusher", 0.3, 0.2, (slcp.Normal(3.0), 0.0), at=(0.01, 0.0))
    own = task(disturbances=slcp.Disturbances(pushes=(first, slcp.Push("block", 0.5, 0.1))))

    def push(of=own, time=None, body=None, duration=None, at=None):
        (found,) = searched(of, "push", time, body, duration, at).pushes
        return found

    assert push() == first
    assert push(time=0.1) == replace(first, start=0.1) and push(at=(0.0, 0.02)) == replace(
        first, at=(0.0, 0.02)
    )
    assert push(duration=0.4, body="pusher") == replace(first, duration=0.4)
    other = push(body="block")
    assert (other.body, other.start, other.duration) == ("block", 0.3, 0.2) and other.at is not None
    assert other.force == (weight[1 - pusher],) * 2
    none = push(task(disturbances=slcp.Disturbances()))
    assert (none.body, none.start, none.duration) == (SCENE.bodies[-1].name, 0.0, 0.1)


def test_a_kick_of_what_no_start_disturbs_is_of_its_own_unit():
    """m/s are no rad/s: of a velocity that neither kicks nor starts disturb, the widest start of its unit."""
    drawn = {"block.vx": 0.02, "block.vy": 0.05}
    found = searched(task(disturbances=slcp.Disturbances(start=drawn)), "kick", None, None, None, None).kicks
    units = dict(zip(SCENE.state_names, SCENE.state_units))
    assert set(found) == set(SCENE.state_names[SCENE.nv :])
    for name, law in found.items():
        assert law.sd == drawn.get(name, 0.05 if units[name] == "m/s" else 1.0)
    assert {"m/s", "rad/s"} <= {units[name] for name in found}


def test_of_many_parts_an_error_names_those_that_are_like_it():
    shapes = [slcp.Shape(f"disc{i}", f"disc{i}", "disc", 0.1) for i in range(12)]
    bodies = [slcp.Body(f"disc{i}", 1.0, 0.01, joint="free") for i in range(12)]
    scene = slcp.Scene("discs", tuple(bodies), tuple(shapes), contacts="auto", friction=0.3)
    with pytest.raises(
        slcp.InputError, match=r"there are 66, disc\d+/disc\d+.friction and .* like it"
    ) as found:
        slcp.Task("many", scene, duration=1.0,
                  disturbances=slcp.Disturbances(parameters={"disc1/disk2.friction": 0.1}))  # fmt: skip
    assert len(str(found.value)) < 300


def test_a_number_that_several_parts_share_counts_once():
    """In the size, and in the table that the chart is drawn from: its length over all rows is the size."""
    shared = slcp.Disturbances(parameters={"friction": slcp.LogNormal(0.3, shared=True), "mass": 0.1})
    own = task(disturbances=shared, success=slcp.measures.final("block.x") > 1e9)
    numbers = Numbers(own.simulator(device="cpu"), own, own.scene.step_size)
    pairs = [name for name in numbers.told(np.ones(numbers.dimension)) if name.endswith("friction")]
    groups = numbers.shared()
    assert len(pairs) > 1 and tuple(pairs) in groups and len(groups) == numbers.dimension
    z = np.arange(1.0, numbers.dimension + 1.0)
    found = Falsification(
        own, float(np.linalg.norm(z)), numbers.told(z), None, None, -1.0, slcp.Status.SOLVED, 32.0,
        np.array([1.0]), np.array([False]), 1, 1, 0, 0, own.options, shared=groups,
    )  # fmt: skip
    rows = found.table["role"] == "found"
    assert np.linalg.norm(found.table["sd"][rows]) == pytest.approx(found.size)
    assert f"{pairs[0]} (of {len(pairs)})" in found.table["name"].tolist() and str(found).count("(of ") == 1


@pytest.mark.parametrize(
    ("by", "given", "said"),
    [("push", {"at": (0.01, -0.2), "duration": 0.4},
      "by push of 'block' at (0.01, -0.2) from 0.3 s for 0.4 s: "),
     ("push", {}, "by push of 'block' at its centre of mass from 0.3 s for 0.2 s: "),
     ("kick", {"time": 0.5}, "by kick at 0.5 s: ")],
)  # fmt: skip
def test_what_is_pushed_where_and_when_is_told(by, given, said):
    push = slcp.Disturbances(pushes=(slcp.Push("block", 0.3, 0.2, (slcp.Normal(3.0), 0.0)),))
    own = task(disturbances=push)
    given = dict.fromkeys(("time", "body", "duration")) | {"point": given.pop("at", None)} | given
    own = replace(own, disturbances=searched(own, by, **given))
    nothing = Falsification(
        own, math.inf, {}, None, None, math.nan, slcp.Status.SOLVED, 32.0, np.array([1.0]),
        np.array([False]), 1, 1, 0, 0, own.options, by=(by,),
    )  # fmt: skip
    assert said in repr(nothing)
