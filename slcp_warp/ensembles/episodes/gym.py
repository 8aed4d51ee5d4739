"""An environment of a task as Gymnasium's, many worlds at once. Needs Gymnasium (extra `gym`)."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector.utils import batch_space

from ...inputs.checks import shown
from ...inputs.errors import ArgumentError


class TaskVectorEnv(gymnasium.vector.VectorEnv):
    """A task's worlds as a `gymnasium.vector.VectorEnv`.

    Of episodes that ended `final_obs` and `final_info` (world, success, status, measures, return, steps, ...)
    are in the step's info, with `_final_obs` and `_final_info` saying whose.

    Args:
        environment: a `slcp_warp.Environment`, which is stepped.
    """

    def __init__(self, environment: Any) -> None:
        self.environment = environment
        mode = gymnasium.vector.AutoresetMode[environment.autoreset.upper()]
        self.metadata = {"autoreset_mode": mode, "render_modes": []}
        self.num_envs = environment.worlds
        dtype: Any = environment.dtype
        self.single_observation_space = gymnasium.spaces.Box(
            -np.inf, np.inf, (environment.observations,), dtype
        )
        low, high = (side.astype(dtype) for side in environment.limits)
        self.single_action_space = gymnasium.spaces.Box(low, high, dtype=dtype)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Observations of all worlds at the start of an episode, as `Environment.reset`.

        Raises:
            ArgumentError: options, of which there are none.
        """
        if options:
            raise ArgumentError(f"options is {shown(options)}; there are none")
        super().reset(seed=seed)
        return self.environment.reset(seed), {}

    def step(self, actions: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Observations, rewards, terminations, truncations and info of a period under actions (B, nu)."""
        moment = self.environment.step(actions)
        return (
            moment.observation, moment.reward, moment.terminated, moment.truncated, self._info(moment)
        )  # fmt: skip

    def _info(self, moment: Any) -> dict[str, Any]:
        slots = moment.ended["slot"]
        if not len(slots):
            return {}
        over = np.zeros(self.num_envs, bool)
        over[slots] = True
        last = np.full(self.num_envs, None, dtype=object)
        for slot in slots:
            last[slot] = moment.last[slot]
        final: dict[str, Any] = {}
        for name, values in moment.ended.items():
            if name != "slot":
                final[name] = np.zeros(self.num_envs, values.dtype)
                final[name][slots] = values
                final[f"_{name}"] = over.copy()
        return {"final_obs": last, "_final_obs": over, "final_info": final, "_final_info": over.copy()}
