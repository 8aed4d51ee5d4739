"""What a task's cost asks of the state: the targets of its terms."""

from typing import Any

import numpy as np

from slcp_warp.kernels.control.cost_terms import KINDS

from ..costs.terms import SUMS, numbers_of_term

TO_A_TARGET = ("square", "cosine", "absolute")  # terms that are least at it


def goal(task: Any) -> np.ndarray | None:
    """The first start of a `Task` with every position at its term's target, the last term's of it, and
    others where terms of differences put them beside those.

    Terms that end before the run does ask for nothing here, nor do those of points. (2 nv,) with zero
    velocities; None where the cost asks for no place, or is no sum of terms.
    """
    nv, cost = task.scene.nv, task.cost
    if cost.make not in SUMS or cost.weights.ndim > 1:
        return None
    width = numbers_of_term(cost)
    count = int(cost.weights[-1]) if cost.points else (len(cost.weights) - 1) // width
    rows = cost.weights[1 : 1 + width * count].reshape(count, width)
    running = int(cost.weights[0])
    ends = [] if cost.windows is None else [end for _, end in cost.windows.spans]
    last = task.duration - task.scene.step_size
    lasting = [row for row, end in zip(rows, ends or [None] * running) if end is None or end > last]
    x, asked = task.start[0].copy(), False
    x[nv:] = 0.0
    later, told = list[tuple[int, float, int]](), set[int]()
    for kind, component, weight, target, _, minus, *_ in (*lasting, *rows[running:]):
        if weight > 0.0 and component < nv and KINDS[int(kind)] in TO_A_TARGET:
            later += [(int(component), target, int(minus))] if minus >= 0 else []
            if minus < 0:
                x[int(component)] = target
                told.add(int(component))
            asked = True
    _join(x, told, {(component, minus): target for component, target, minus in later})
    return x if asked else None


def _join(x: np.ndarray, known: set[int], apart: dict[tuple[int, int], float]) -> None:
    """Positions that differences lead to from those that are known; of a chain without such a one the second
    of its first difference stays where it is. What is known at both ends stays.
    """
    left = dict(apart)
    while left:
        reached = [pair for pair in left if not known.isdisjoint(pair)]
        if not reached:
            known.add(next(iter(left))[1])
            continue
        component, minus = reached[0]
        target = left.pop(reached[0])
        if component not in known:
            x[component] = x[minus] + target
        elif minus not in known:
            x[minus] = x[component] - target
        known |= {component, minus}
