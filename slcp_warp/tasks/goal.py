"""What a task's cost asks of the state: the targets of its terms."""

from typing import Any

import numpy as np

from slcp_warp.kernels.control.cost_terms import KINDS, make_terms, make_timed_terms

from ..costs.terms import numbers_of_term

TO_A_TARGET = ("square", "cosine", "absolute")  # terms that are least at it


def goal(task: Any) -> np.ndarray | None:
    """The first start of a `Task` with every position at its term's target, the last term's of it.

    Terms that end before the run does ask for nothing here. (2 nv,) with zero velocities; None where the
    cost asks for no place, or is no sum of terms.
    """
    nv, cost = task.scene.nv, task.cost
    if cost.make not in (make_terms, make_timed_terms) or cost.weights.ndim > 1:
        return None
    rows = cost.weights[1:].reshape(-1, numbers_of_term(cost))
    running = int(cost.weights[0])
    ends = [] if cost.windows is None else [end for _, end in cost.windows.spans]
    last = task.duration - task.scene.step_size
    lasting = [row for row, end in zip(rows, ends or [None] * running) if end is None or end > last]
    x, asked = task.start[0].copy(), False
    x[nv:] = 0.0
    later = []
    for kind, component, weight, target, _, minus, *_ in (*lasting, *rows[running:]):
        if weight > 0.0 and component < nv and KINDS[int(kind)] in TO_A_TARGET:
            later += [(int(component), target, int(minus))] if minus >= 0 else []
            if minus < 0:
                x[int(component)] = target
            asked = True
    for component, target, minus in later:
        x[component] = x[minus] + target
    return x if asked else None
