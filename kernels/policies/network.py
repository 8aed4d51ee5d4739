"""A dense network as a policy: u = W_L a(... a(W_1 x + b_1) ...) + b_L, or with an activation at its end."""

from functools import partial
from typing import NamedTuple

import warp as wp

from ..factories import cached
from .activations import make_activation
from .contract import PolicyFunctions, PolicyKernel

BLOCK = 8  # outputs that are summed up together


class Layer(NamedTuple):
    """Numbers of inputs and outputs, and what follows: the name of an activation and its numbers."""

    inputs: int
    outputs: int
    activation: tuple[str, *tuple[float, ...]] = ("identity",)

    @property
    def blocks(self) -> int:
        """Blocks of outputs."""
        return -(-self.outputs // BLOCK)

    @property
    def rows(self) -> int:
        """Rows in the array of weights: blocks of the biases, then of every input's weights."""
        return (1 + self.inputs) * self.blocks


def network_kernel(layers: tuple[Layer, ...]) -> PolicyKernel:
    """The kernel of networks of these sizes and activations; their weights are data."""
    words = " ".join(f"{a.inputs}-{a.outputs} {a.activation}" for a in layers)
    return PolicyKernel(f"network:{words}", partial(make_network, layers))


@cached
def make_network(layers: tuple[Layer, ...], nx: int, nu: int, dtype: type) -> PolicyFunctions:
    """All layers after each other."""
    VX, Row = wp.types.vector(nx, dtype), wp.types.vector(BLOCK, dtype)

    @wp.struct
    class Network:
        weights: wp.array(dtype=Row)

    forward = make_layers(layers, dtype)

    @wp.func
    def control(policy: Network, world: int, step: int, x: VX):
        return forward(policy.weights, x)

    return PolicyFunctions(Network, control)


@cached
def make_layers(layers: tuple[Layer, ...], dtype: type) -> wp.Function:
    """forward(weights, x) -> y, the last of these layers after all before it."""
    *before, last = layers
    V, Row = wp.types.vector(layers[0].inputs, dtype), wp.types.vector(BLOCK, dtype)
    layer = make_layer(last, sum(each.rows for each in before), dtype)
    if not before:
        return layer
    earlier = make_layers(tuple(before), dtype)

    @wp.func
    def forward(weights: wp.array(dtype=Row), x: V):
        return layer(weights, earlier(weights, x))

    return forward


@cached
def make_layer(layer: Layer, start: int, dtype: type) -> wp.Function:
    """y = a(W x + b), with the layer's rows from `start` on; blocks are what a processor adds up at once."""
    INPUTS, OUTPUTS, BLOCKS = layer.inputs, layer.outputs, layer.blocks
    VI, VO = wp.types.vector(INPUTS, dtype), wp.types.vector(OUTPUTS, dtype)
    Row = wp.types.vector(BLOCK, dtype)
    activation = make_activation(layer.activation, dtype)

    @wp.func
    def forward(weights: wp.array(dtype=Row), x: VI):
        y = VO()
        for b in range(BLOCKS):
            total = weights[start + b]
            for j in range(INPUTS):
                total += weights[start + (1 + j) * BLOCKS + b] * x[j]
            for i in range(wp.min(BLOCK, OUTPUTS - BLOCK * b)):
                y[BLOCK * b + i] = activation(total[i])
        return y

    return forward
