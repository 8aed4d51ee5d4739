"""A network of PyTorch as a policy, evaluated inside the kernels."""

from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.policies.contract import PolicyKernel
from slcp_warp.kernels.policies.network import BLOCK, Layer, make_network, network_kernel

from ..inputs.checks import shown
from ..inputs.errors import ArgumentError, ArgumentTypeError
from ..simulator import Simulator
from .saved import Content

WIDEST = 1024
ACTIVATIONS = {  # of torch.nn: the name in the kernels, and the attributes that are its numbers
    "Identity": ("identity",), "Tanh": ("tanh",), "ReLU": ("relu",),
    "LeakyReLU": ("leaky_relu", "negative_slope"), "ELU": ("elu", "alpha"), "Sigmoid": ("sigmoid",),
    "Softplus": ("softplus", "beta", "threshold"), "SiLU": ("silu",), "GELU": ("gelu",),
}  # fmt: skip


class Network:
    """u = module(x), of a torch.nn.Sequential of Linear layers, each with an activation after it or none.

    The weights are read when a rollout or a sweep begins, in the simulator's precision: the module may go on
    learning. Networks of the same sizes and activations share their kernels. No gradient flows through a
    `Simulator.rollout` under it; `slcp_warp.torch.closed_loop` is one that has it.

    Args:
        module: of at most 1024 numbers a layer; Identity, Tanh, ReLU, LeakyReLU, ELU, Sigmoid, Softplus, SiLU
            and GELU are known.

    Raises:
        ArgumentTypeError, ArgumentError: another module, or one that does not fit the scene.
    """

    alike = True  # in all worlds: by state and time alone

    def __init__(self, module: Any) -> None:
        self.module = module
        self._linear, layers = _layers(module)
        self.layers = tuple(layers)

    def kernel(self, sim: Simulator) -> tuple[PolicyKernel, Any]:
        """Kernel and struct for a simulator."""
        size = self.layers[0].inputs, self.layers[-1].outputs
        if size != (sim.nx, sim.nu):
            raise ArgumentError(
                f"module takes {size[0]} numbers and gives {size[1]}; scene {sim.scene.name!r} needs "
                f"{sim.nx} states and {sim.nu} controls"
            )
        struct = make_network(self.layers, sim.nx, sim.nu, sim.dtype).Struct()
        rows = np.concatenate([_rows(linear) for linear in self._linear])
        if not np.isfinite(rows).all():
            raise ArgumentError("module has weights that are not finite")
        row = wp.types.vector(BLOCK, sim.dtype)
        struct.weights = wp.array(rows.astype(wp.dtype_to_numpy(sim.dtype)), dtype=row, device=sim.device)
        return network_kernel(self.layers), struct

    def content(self) -> Content:
        """What it is made from now, see `saved`."""
        arrays = {}
        for i, linear in enumerate(self._linear):
            arrays[f"weight{i}"] = linear.weight.detach().double().cpu().numpy().copy()
            if linear.bias is not None:
                arrays[f"bias{i}"] = linear.bias.detach().double().cpu().numpy().copy()
        return Content({"activations": [list(layer.activation) for layer in self.layers]}, arrays)

    @classmethod
    def of_content(cls, content: Content) -> "Network":
        """From what `content` gave, with a module of double precision."""
        import torch

        parts: list[Any] = []
        for i, (name, *numbers) in enumerate(content.values["activations"]):
            weight, bias = (content.arrays.get(f"{key}{i}") for key in ("weight", "bias"))
            assert weight is not None
            linear = torch.nn.Linear(weight.shape[1], weight.shape[0], bias is not None, dtype=torch.float64)
            linear.weight.data = torch.from_numpy(weight)
            if bias is not None:
                linear.bias.data = torch.from_numpy(bias)
            parts += [linear, _module(name, numbers)]
        return cls(torch.nn.Sequential(*parts))


def _layers(module: Any) -> tuple[list[Any], list[Layer]]:
    """Linear modules, and their layers."""
    import torch

    if not isinstance(module, torch.nn.Sequential):
        raise ArgumentTypeError(f"module is a {type(module).__name__}; a torch.nn.Sequential is needed")
    linear: list[Any] = []
    layers: list[Layer] = []
    open_end = False
    for part in _flat(module, torch.nn.Sequential):
        if type(part) is torch.nn.Linear:
            given, wanted = part.in_features, part.out_features
            if layers and layers[-1].outputs != given:
                raise ArgumentError(f"module gives {layers[-1].outputs} numbers to {shown(part)}")
            if not 0 < min(given, wanted) <= max(given, wanted) <= WIDEST:
                raise ArgumentError(f"module has {shown(part)}; 1 to {WIDEST} numbers a layer are possible")
            linear.append(part)
            layers.append(Layer(given, wanted))
        elif open_end and type(part) is getattr(torch.nn, type(part).__name__, None):
            layers[-1] = layers[-1]._replace(activation=_activation(part))
        else:
            raise ArgumentTypeError(
                f"module has {shown(part)} after {len(linear)} Linear; Linear layers are needed, each with "
                f"one of {', '.join(ACTIVATIONS)} after it, or none"
            )
        open_end = type(part) is torch.nn.Linear
    if not layers:
        raise ArgumentError("module is empty; at least one Linear layer is needed")
    return linear, layers


def _flat(module: Any, group: type) -> list[Any]:
    return [leaf for part in module for leaf in (_flat(part, group) if isinstance(part, group) else [part])]


def _activation(part: Any) -> Any:
    kind = type(part).__name__
    if kind not in ACTIVATIONS:
        raise ArgumentTypeError(f"module has {shown(part)}; known are {', '.join(ACTIVATIONS)}")
    name, *numbers = ACTIVATIONS[kind]
    if kind == "GELU" and part.approximate == "tanh":
        name = "gelu_tanh"
    return (name, *(float(getattr(part, number)) for number in numbers))


def _module(name: str, numbers: list[float]) -> Any:
    """The module of an activation; `_activation` backwards."""
    import torch

    if name == "gelu_tanh":
        return torch.nn.GELU(approximate="tanh")
    kind, names = next((kind, names) for kind, (own, *names) in ACTIVATIONS.items() if own == name)
    return getattr(torch.nn, kind)(**dict(zip(names, numbers)))


def _rows(linear: Any) -> np.ndarray:
    """Biases and weights of a layer in rows of BLOCK outputs, filled up with zeros."""
    weight = linear.weight.detach().double().cpu().numpy()
    bias = np.zeros(len(weight)) if linear.bias is None else linear.bias.detach().double().cpu().numpy()
    full = np.concatenate([bias[None], weight.T])
    padded = np.pad(full, ((0, 0), (0, -full.shape[1] % BLOCK)))
    return padded.reshape(-1, BLOCK)
