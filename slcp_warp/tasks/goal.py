"""What a task's cost asks of the state: the targets of its terms."""

from typing import Any

import numpy as np

from slcp_warp.kernels.control.cost_terms import KINDS

from ..costs.terms import SUMS, numbers_of_term

TO_A_TARGET = ("square", "cosine", "absolute")  # terms that are least at it


def goal(task: Any) -> np.ndarray | None:
    """The first start of a `Task` with every position at its term's target, the last term's of it. Terms of a
    difference come then: they move the second position where the first has a target of its own and it has
    none, else the first one.

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
    later, told = [], set[int]()
    for kind, component, weight, target, _, minus, *_ in (*lasting, *rows[running:]):
        if weight > 0.0 and component < nv and KINDS[int(kind)] in TO_A_TARGET:
            later += [(int(component), target, int(minus))] if minus >= 0 else []
            if minus < 0:
                x[int(component)] = target
                told.add(int(component))
            asked = True
    for component, target, minus in later:
        if component not in told:
            x[component] = x[minus] + target
        elif minus not in told:
            x[minus] = x[component] - target
    return x if asked else None
