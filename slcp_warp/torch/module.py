"""A rollout as a `torch.nn.Module` with learnable physical parameters."""

from collections.abc import Collection, Sequence

import numpy as np
import torch
import warp as wp
from torch import Tensor

from ..inputs.checks import instance, names, whole
from ..parameters import ParameterError
from ..simulator import Simulator
from .functions import Outcome, rollout


def _key(name: str) -> str:
    """As PyTorch takes it."""
    return name.replace(".", ":")


def _first(sim: Simulator, name: str) -> np.ndarray:
    """Where a parameter begins; of a name of several parts, which learn one number, their own one.

    Raises:
        ParameterError: an unknown name, or parts that differ.
    """
    value = np.asarray(sim.params[name])
    if "." in name and value.ndim:
        if np.ptp(value):
            raise ParameterError(f"learn names {name!r}, which is {value.tolist()}; one number is needed")
        value = value[0]
    return value


class Rollout(torch.nn.Module):
    """Rollouts with learnable physical parameters.

    Args:
        sim: a simulator.
        learn: names of the parameters that become `torch.nn.Parameter` of this module, one value for all
            worlds, beginning where `sim.params` is: of all parts, "mass", or one number of one, "box.mass"
            (in `physical` and the state's dict under "box:mass").
        checkpoint: as in `rollout`.
    """

    def __init__(self, sim: Simulator, learn: Sequence[str] = (), checkpoint: int | None = None) -> None:
        super().__init__()
        self.sim: Simulator = instance("sim", sim, Simulator, "a slcp_warp.Simulator")
        self.checkpoint = None if checkpoint is None else whole("checkpoint", checkpoint)
        learn = (learn,) if isinstance(learn, str) else learn
        parts = [n for n in learn if isinstance(n, str) and "." in n] if isinstance(learn, Collection) else []
        known = (*sim.params.names, *parts)
        learn = names("learn", learn, known, error=ParameterError)
        dtype, device = getattr(torch, sim.dtype.__name__), wp.device_to_torch(sim.device)
        self.physical = torch.nn.ParameterDict(
            {
                _key(n): torch.nn.Parameter(torch.tensor(_first(sim, n), dtype=dtype, device=device))
                for n in learn
            }
        )

    def forward(self, x0: Tensor, controls: Tensor) -> Outcome:
        """States and status, as `rollout`."""
        return rollout(self.sim, x0, controls, self.values(), checkpoint=self.checkpoint)

    def values(self) -> dict[str, Tensor]:
        """The learned parameters by name.

        A disc has one radius, twice: its gradient is that of the first number.
        """
        out = {key.replace(":", "."): value for key, value in self.physical.items()}
        if "radius" in out:
            discs = [[shape.kind == "disc"] for shape in self.sim.scene.shapes]
            both = torch.tensor(discs, device=out["radius"].device)
            out["radius"] = torch.where(both, out["radius"][:, :1], out["radius"])
        return out
