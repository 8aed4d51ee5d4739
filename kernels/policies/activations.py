"""Activations of networks, as PyTorch defines them."""

import math

import warp as wp

from ..factories import cached

NUMBERS = {  # of each
    "identity": 0, "tanh": 0, "relu": 0, "leaky_relu": 1, "elu": 1, "sigmoid": 0, "softplus": 2, "silu": 0,
    "gelu": 0, "gelu_tanh": 0,
}  # fmt: skip


@cached
def make_activation(activation: tuple, dtype: type) -> wp.Function:
    """a(z) of a name in `NUMBERS` and its numbers."""
    name, *numbers = activation
    A, B = (dtype(number) for number in [*numbers, 0.0, 0.0][:2])
    ZERO, HALF, ONE = dtype(0.0), dtype(0.5), dtype(1.0)
    ROOT, SCALE, CUBE = dtype(math.sqrt(0.5)), dtype(math.sqrt(2.0 / math.pi)), dtype(0.044715)

    @wp.func
    def identity(z: dtype):
        return z

    @wp.func
    def tanh(z: dtype):
        return wp.tanh(z)

    @wp.func
    def relu(z: dtype):
        return wp.where(z < ZERO, ZERO, z)

    @wp.func
    def leaky_relu(z: dtype):
        return wp.where(z < ZERO, A * z, z)

    @wp.func
    def elu(z: dtype):
        if z > ZERO:
            return z
        return A * (wp.exp(z) - ONE)

    @wp.func
    def sigmoid(z: dtype):
        return ONE / (ONE + wp.exp(-z))

    @wp.func
    def softplus(z: dtype):
        if A * z > B:
            return z
        return wp.log(ONE + wp.exp(A * z)) / A

    @wp.func
    def silu(z: dtype):
        return z / (ONE + wp.exp(-z))

    @wp.func
    def gelu(z: dtype):
        return HALF * z * (ONE + wp.erf(ROOT * z))

    @wp.func
    def gelu_tanh(z: dtype):
        return HALF * z * (ONE + wp.tanh(SCALE * (z + CUBE * z * z * z)))

    return {
        "identity": identity, "tanh": tanh, "relu": relu, "leaky_relu": leaky_relu, "elu": elu,
        "sigmoid": sigmoid, "softplus": softplus, "silu": silu, "gelu": gelu, "gelu_tanh": gelu_tanh,
    }[name]  # fmt: skip
