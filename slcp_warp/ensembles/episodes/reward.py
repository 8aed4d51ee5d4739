"""What a learner is paid: what grows of a measure from one of its steps to the next."""

from typing import Any, NamedTuple

from ...costs import NO_COST
from ...inputs.checks import instance
from ...inputs.errors import ArgumentError
from ...measures import Measure, cost
from ...tasks.task import Task

SUMS = ("total", "integral", "accumulated")  # reductions that add up over the steps


class Reward(NamedTuple):
    """The measure whose growth is paid, and its sign."""

    measure: Measure
    sign: float


def reward_of(task: Task, given: Any) -> Reward:
    """A measure that adds up over the steps, as it is; None: the task's cost, negative.

    Raises:
        ArgumentError: a measure that does not add up, or one of a cost where the task has none.
    """
    what = "a measure that adds up (measures.total, integral, impulse)"
    if given is None:
        if task.cost is NO_COST:
            raise ArgumentError(
                f"reward is None, less than the task's cost, and the task has none; {what} is needed"
            )
        return _checked(task, Reward(cost(), -1.0))
    measure = instance("reward", given, Measure, what)
    if measure.reduction not in SUMS:
        raise ArgumentError(f"reward is {measure!r}, which does not add up over the steps; {what} is needed")
    return _checked(task, Reward(measure, 1.0))


def _checked(task: Task, reward: Reward) -> Reward:
    """As a measure of the task, whose errors name it."""
    name = "reward"
    while name in task.measures:
        name += "_"
    task.replace(measures={**task.measures, name: reward.measure})
    return reward
