"""A rollout as a `torch.nn.Module` with learnable physical parameters."""

import math
from collections.abc import Sequence

import numpy as np
import torch
import warp as wp
from torch import Tensor

from ..description.columns import parameter_of
from ..inputs.checks import instance, names, shown, whole
from ..parameters import ParameterError
from ..simulator import Simulator
from .functions import Outcome, rollout


def _first(sim: Simulator, name: str) -> np.ndarray:
    """Where a parameter begins; of a name of several parts, which learn one number, their own one.

    Raises:
        ParameterError: an unknown name, parts that differ, or parts of several numbers.
    """
    try:
        value = np.asarray(sim.params[name])
    except ParameterError as error:
        raise ParameterError(f"learn names {name!r}: {error}") from None
    if "." not in name or not value.ndim:
        return value
    _, whole, component = parameter_of(name)
    width = math.prod(sim.params.layout.shape(whole)[1:])
    if width > 1 and component is None and not (whole == "radius" and not np.ptp(value)):
        raise ParameterError(
            f"learn names {name!r}, which has {width} numbers; name one, as "
            f"{name + ('_0' if whole == 'radius' else '_x')!r}"
        )
    if np.ptp(value):
        raise ParameterError(f"learn names {name!r}, which is {value.tolist()}; one number is needed")
    return np.asarray(value[0])


class Rollout(torch.nn.Module):
    """Rollouts with learnable physical parameters.

    Args:
        sim: a simulator.
        learn: names of the parameters that become `torch.nn.Parameter` of this module, one value for all
            worlds, beginning where `sim.params` is: of all parts, "mass", or one number of one, "box.mass"
            (in `physical` and the state's dict under "box:mass").
        checkpoint: as in `rollout`.
        log: those of `learn` of which `physical` has the logarithms: steps of an optimiser are factors then,
            the same for grams and tonnes, and never lead to what is not positive.
    """

    def __init__(
        self,
        sim: Simulator,
        learn: Sequence[str] = (),
        checkpoint: int | None = None,
        log: Sequence[str] = (),
    ) -> None:
        super().__init__()
        self.sim: Simulator = instance("sim", sim, Simulator, "a slcp_warp.Simulator")
        self.checkpoint = None if checkpoint is None else whole("checkpoint", checkpoint)
        learn = (learn,) if isinstance(learn, str) else learn
        several = isinstance(learn, list | tuple | set | frozenset)
        parts = [n for n in learn if isinstance(n, str) and "." in n] if several else []
        known = (*sim.params.names, *parts)
        learn = names("learn", learn, known, error=ParameterError)
        dtype, device = getattr(torch, sim.dtype.__name__), wp.device_to_torch(sim.device)
        self._names = {n.replace(".", ":"): n for n in learn}  # PyTorch takes no dots
        if len(self._names) < len(set(learn)):
            raise ParameterError(f"learn names {shown(learn)}; two of them are the same but for . and :")
        self._log = set(names("log", log, known, error=ParameterError))
        if not self._log <= set(learn):
            raise ParameterError(
                f"log names {shown(sorted(self._log - set(learn)))}, which learn does not name"
            )
        first = {
            key: torch.tensor(self._begin(n), dtype=dtype, device=device) for key, n in self._names.items()
        }
        self.physical = torch.nn.ParameterDict({key: torch.nn.Parameter(at) for key, at in first.items()})

    def _begin(self, name: str) -> np.ndarray:
        value = _first(self.sim, name)
        if name not in self._log:
            return value
        if not (value > 0.0).all():
            raise ParameterError(
                f"log names {name!r}, which is {shown(value.tolist())}; only what is positive has a logarithm"
            )
        return np.log(value)

    def forward(self, x0: Tensor, controls: Tensor) -> Outcome:
        """States and status, as `rollout`."""
        return rollout(self.sim, x0, controls, self.values(), checkpoint=self.checkpoint)

    def values(self) -> dict[str, Tensor]:
        """The learned parameters by name.

        A disc or ring has one radius, twice: its gradient is that of the first number.
        """
        out = {
            name: self.physical[key].exp() if name in self._log else self.physical[key]
            for key, name in self._names.items()
        }
        if "radius" in out:
            discs = [[shape.kind in ("disc", "ring")] for shape in self.sim.scene.shapes]
            both = torch.tensor(discs, device=out["radius"].device)
            out["radius"] = torch.where(both, out["radius"][:, :1], out["radius"])
        return out
