"""What a search for the smallest failure disturbs, from a task and what is given beside it."""

from dataclasses import replace

from test_task_sweep import SCENE, task

import slcp_warp as slcp
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
