"""Controls that were sent and do not act yet, and the state that they lead to."""

import numpy as np

from ..problem import Problem


class OnTheWay:
    """The last controls of a block of worlds, as many as steps pass before one acts; `Problem.before` until
    the first does.

    Args:
        problem: whose dynamics foretell.
        lag: steps from a control to its action.
        worlds: how many.

    Attributes:
        path: (B, lag + 1, nx) the states from the last that was met on; the last is where the next one acts.
    """

    def __init__(self, problem: Problem, lag: int, worlds: int) -> None:
        self._problem, self._us = problem, np.tile(problem.rest_control(), (worlds, lag, 1))
        self._last: int | None = None
        self.path = np.zeros((worlds, lag + 1, problem.nx))

    def arrive(self, step: int, x: np.ndarray) -> np.ndarray:
        """Where worlds that are at x (B, nx) in a step will be when the next control acts.

        What was not asked for since the last one was held.
        """
        for _ in range(0 if self._last is None else step - self._last - 1):
            self.send(self._us[:, -1])
        self._last = step
        run = self._problem.dynamics.rollout(x, self._us, self._problem.params)
        self.path = np.asarray(run.states, np.float64)
        return self.path[:, -1]

    def send(self, u: np.ndarray) -> None:
        """One control (B, nu) more is on its way."""
        self._us = np.concatenate([self._us[:, 1:], u[:, None]], axis=1)
