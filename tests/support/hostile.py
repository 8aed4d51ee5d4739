"""What a user may hand over by mistake, values of wrong types, shapes and sizes, and how a call takes it."""

import contextlib
import datetime
import decimal
import fractions
import functools
import inspect
import pathlib
import re

import numpy as np
import warp as wp
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from warp._src.context import pack_arg

import slcp_warp as slcp
import slcp_warp.kernels.device.launch as launches


class Rude:
    """An object that answers every question with an exception."""

    def __getattr__(self, name):
        raise RuntimeError("rude")

    def __repr__(self):
        raise RuntimeError("rude")

    __len__ = __iter__ = __bool__ = __eq__ = __hash__ = __float__ = __repr__

    def __array__(self, dtype=None, copy=None):
        raise RuntimeError("rude")


class Stranger:
    """A policy of a kind that no kernel knows."""

    def kernel(self, sim):
        return "mine", None


def deep(depth):
    out = 1.0
    for _ in range(depth):
        out = [out]
    return out


def structured():
    return np.zeros(2, dtype=[("a", float), ("b", int)])


def of_torch():
    """Tensors, where PyTorch is installed."""
    with contextlib.suppress(ImportError):
        import torch

        return [
            torch.zeros(3), torch.zeros(2, 6, requires_grad=True), torch.zeros(6, dtype=torch.complex64),
            torch.zeros(6, dtype=torch.bool), torch.zeros(6, device="meta"), torch.eye(6).to_sparse(),
            torch.float32, torch.nn.Linear(2, 2),
        ]  # fmt: skip
    return []


def of_warp():
    return [
        wp.zeros(6, dtype=wp.float32, device="cpu"), wp.zeros((1, 6), dtype=wp.int32, device="cpu"),
        wp.zeros(2, dtype=wp.vec3, device="cpu"), wp.zeros((2, 12), dtype=wp.float64, device="cpu")[:, ::2],
        wp.zeros((0, 6), dtype=wp.float64, device="cpu"), wp.float64, wp.get_device("cpu"),
    ]  # fmt: skip


NUMBERS = [
    True, False, np.True_, np.nan, np.inf, -np.inf, 0, 0.0, -1, -0.5, 1, 3, 0.5, 2.5, -10**400, 10**400,
    2**31, 2**63, 10**12, -2**63, 1e300, -1e300, 1e-300, 1j, np.float32(np.nan), np.int64(-3),
    np.array(2.0), decimal.Decimal("1.5"), fractions.Fraction(1, 2),
]  # fmt: skip
OTHERS = [
    None, "", "abc", "1.5", "a\0b", "x" * 5000, b"1", Ellipsis, NotImplemented, object(), object, int, len,
    lambda x: x, Rude(), Stranger(), Stranger, slcp, datetime.datetime(2020, 1, 1), datetime.timedelta(1),
    pathlib.Path("/nowhere/at/all"), range(3), slice(3), re.compile("a"),
]  # fmt: skip
CONTAINERS = [
    [], (), {}, set(), frozenset({1}), [[]], [None], (None, None), ["a"], ("1", "2"), [np.nan], [1, [2]],
    [[1, 2], [3]], [True, 1.0], deep(30), deep(200), {"a": 1}, {1: 2}, {"mass": None}, {"mass": "heavy"},
    {"mass": 0.1}, {None: 1}, [object()], [{}], [10**400], [1e300] * 2, [Rude()], (1.0, 2.0), (2.0, 1.0),
    [0.0] * 6, [[0.0] * 6], (lambda: (yield 1))(),
]  # fmt: skip
ARRAYS = [
    np.zeros(0), np.zeros((0, 0)), np.zeros((0, 6)), np.zeros((0, 5, 2)), np.zeros(3), np.zeros(6),
    np.zeros((2, 6)), np.zeros((3, 5, 2)), np.zeros((1, 1, 1, 1)), np.full(6, np.nan), np.full((1, 6),
    np.inf), np.zeros(6) * 1j, np.array(["1", "2"]), np.array([None, 1]), np.zeros(6, bool), np.zeros(6,
    np.float16), np.zeros(6, np.int8), np.zeros(6, "datetime64[s]"), structured(), np.eye(6), -np.eye(6),
    np.eye(3), np.arange(36.0).reshape(6, 6), np.ma.masked_all(6), np.zeros((1, 6))[:, ::-1],

]  # fmt: skip


LISTED = [*NUMBERS, *OTHERS, *CONTAINERS, *ARRAYS, *of_torch(), *of_warp()]


@functools.cache
def values():
    """A strategy of hostile values (some of them are good somewhere)."""
    leaves = st.one_of(
        st.none(), st.booleans(), st.integers(-5, 5), st.floats(width=32), st.complex_numbers(),
        st.text(max_size=5), st.binary(max_size=3),
    )  # fmt: skip
    nested = st.recursive(
        leaves,
        lambda inner: st.one_of(
            st.lists(inner, max_size=4),
            st.lists(inner, max_size=4).map(tuple),
            st.dictionaries(st.text(max_size=4), inner, max_size=3),
        ),
        max_leaves=8,
    )
    shapes = hnp.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=6)
    arrays = hnp.arrays(hnp.scalar_dtypes(), shapes, fill=st.nothing())
    listed = st.integers(0, len(LISTED) - 1).map(lambda i: LISTED[i])  # by place: some cannot be compared
    return st.one_of(listed, listed, nested, arrays)


class Command:
    """A recorded launch that does nothing."""

    def launch(self):
        pass

    def set_param_at_index(self, index, value):
        pass


def pack_only(kernel, dim, inputs, device=None, record_cmd=False, **_):
    """`wp.launch` up to the kernel: the arguments are checked by Warp, nothing is compiled or run."""
    for argument, value in zip(kernel.adj.args, inputs, strict=True):
        pack_arg(kernel, argument.type, argument.label, value, device)
    return Command() if record_cmd else None


@contextlib.contextmanager
def no_kernels(monkeypatch):
    """Launches end where the kernel would be compiled."""
    with monkeypatch.context() as patch:
        patch.setattr(launches, "load", lambda kernel, device: None)
        patch.setattr(wp, "launch", pack_only)
        yield


def named(argument, message):
    return re.search(rf"(?<![A-Za-z_]){re.escape(argument)}(?![A-Za-z])", message) is not None


CALLBACKS = ("progress", "score")  # what a user's function raises when it is called is the user's


def judge(call, good, argument, value, aliases=()):
    """Call with one argument replaced: it works, or the package's own error names the argument."""
    changed = {**good, argument: value}
    try:
        call(**changed)
    except slcp.InputError as error:
        message = str(error)
        file = isinstance(value, str | pathlib.Path) and argument in ("path", "out")
        theirs = file and str(value) in message  # a file's error names the file
        theirs = theirs or "Worlds.params: step_size is 0.0" in message  # all was good: no kernel drew worlds
        assert theirs or any(named(name, message) for name in (argument, *aliases)), (argument, message)
        assert len(message) < 1000 or theirs, message
    except (FileNotFoundError, IsADirectoryError):
        assert isinstance(value, str | pathlib.Path)
    except Exception:  # raw
        if not (argument in CALLBACKS and callable(value)):
            raise


def arguments(call):
    """Names of a function's arguments that can be given by name."""
    kinds = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    return [
        p.name for p in inspect.signature(call).parameters.values() if p.kind in kinds and p.name != "self"
    ]
