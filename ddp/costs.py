"""The costs of `slcp_warp.costs`, and by their names, as they were before tasks, those of named tasks."""

import warnings
from collections.abc import Callable
from typing import Any

from slcp_warp.costs import Cost, CostFunctions, Term, effort, plain, quadratic, terms
from slcp_warp.tasks import NAMED

__all__ = ["Cost", "CostFunctions", "Term", "effort", "plain", "quadratic", "terms"]


def __getattr__(name: str) -> Callable[..., Cost]:
    """The cost of a named task, called with the task's arguments."""
    if name not in NAMED:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    text = f"ddp.costs.{name}(...) is slcp_warp.tasks.{name}(...).cost now"
    warnings.warn(text, DeprecationWarning, stacklevel=2)

    def cost(*arguments: Any, **named: Any) -> Cost:
        """The task's."""
        return NAMED[name](*arguments, **named).cost

    return cost
