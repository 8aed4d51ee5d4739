"""Arguments at the door: each function gives the value as it is used from there on, or raises one clear error
that names the argument, what came and what is needed.
"""

import inspect
import math
import os
import reprlib
import types
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.device.cache import KernelCacheError, get_device

from .errors import ArgumentError, ArgumentTypeError

_short = reprlib.Repr()
_short.maxstring = _short.maxother = 80
_short.maxlist = _short.maxtuple = _short.maxdict = 8
MOST = 2**31 - 1  # of what kernels count in 32 bits
FEW = 2**24  # numbers that fit into any memory: not worth a look


def shown(value: Any) -> str:
    """A value for an error message, short and in one line."""
    try:
        text = _short.repr(value)
        return f"{' '.join(text.split()) if chr(10) in text else text:.100}"
    except Exception:  # a foreign object's own repr
        return f"a {type(value).__name__}"


def numeric(value: Any) -> np.ndarray | None:
    """Integers and floats as a float64 array.

    None for text, bools, complex numbers, other objects, ragged lists and arrays with masked entries.
    """
    if _holds_bool(value):
        return None
    try:
        if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
            return None
        given = np.asarray(float(value) if type(value) is int else value)
        return given.astype(np.float64) if given.dtype.kind in "iuf" else None
    except Exception:  # whatever a foreign object raises when it is asked for numbers
        return None


def _holds_bool(value: Any, depth: int = 0) -> bool:
    if isinstance(value, list | tuple) and depth < 8:
        return any(_holds_bool(entry, depth + 1) for entry in value)
    return isinstance(value, bool)


def number(
    name: str,
    value: Any,
    low: float = -math.inf,
    high: float = math.inf,
    *,
    above: bool = False,
    infinite: bool = False,
    error: type[Exception] = ArgumentError,
) -> float:
    """A finite number in [low, high]; `above`: in (low, high]; `infinite`: may be infinite, too."""
    array = numeric(value)
    ok = array is not None and array.ndim == 0
    if ok and array is not None:
        out = float(array)
        inside = low < out <= high if above else low <= out <= high
        if inside and (infinite or math.isfinite(out)):
            return out
    raise error(f"{name} is {shown(value)}; {_range(low, high, above, infinite)} is needed")


def _range(low: float, high: float, above: bool, infinite: bool) -> str:
    kind = "a number" if infinite else "a finite number"
    if high < math.inf:
        return f"{kind} in {'(' if above else '['}{low:g}, {high:g}]"
    if low == 0.0:
        return f"{'a positive' if above else 'a nonnegative'} {'number' if infinite else 'and finite number'}"
    return kind if low == -math.inf else f"{kind} {'above' if above else 'of at least'} {low:g}"


def whole(
    name: str, value: Any, low: int = 1, high: int = MOST, *, error: type[Exception] = ArgumentError
) -> int:
    """A whole number in [low, high]; no bool."""
    if isinstance(value, int | np.integer) and not isinstance(value, bool) and low <= value <= high:
        return int(value)
    limit = f"of at least {low}" if high == MOST else f"in [{low}, {high}]"
    big = isinstance(value, int | np.integer) and value > high == MOST
    raise error(f"{name} is {shown(value)}; a whole number {'below 2^31' if big else limit} is needed")


def flag(name: str, value: Any) -> bool:
    """True or False."""
    if isinstance(value, bool | np.bool_):
        return bool(value)
    raise ArgumentTypeError(f"{name} is {shown(value)}; True or False is needed")


def choice(name: str, value: Any, choices: Collection[Any], *, error: type[Exception] = ArgumentError) -> Any:
    """One of some texts (and None, where it is among them)."""
    if (isinstance(value, str) or value is None) and value in choices:
        return value
    raise error(f"{name} is {shown(value)}; choose one of {list(choices)}")


def names(
    name: str, value: Any, known: Collection[str], *, error: type[Exception] = ArgumentError
) -> tuple[str, ...]:
    """One name or several, all of them known."""
    given = (value,) if isinstance(value, str) else value
    if not isinstance(given, list | tuple | set | frozenset) or not all(isinstance(n, str) for n in given):
        raise ArgumentTypeError(f"{name} is {shown(value)}; names out of {list(known)} are needed")
    unknown = sorted(set(given) - set(known))
    if unknown:
        raise error(f"{name} names {shown(unknown)}; choose from {', '.join(known)}")
    return tuple(given)


def instance(name: str, value: Any, kind: type | types.UnionType, need: str) -> Any:
    """An object of a class."""
    if isinstance(value, kind):
        return value
    raise ArgumentTypeError(f"{name} is a {type(value).__name__}; {need} is needed")


def function(
    name: str, value: Any, takes: int, optional: bool = False, called: str = ""
) -> Callable[..., Any] | None:
    """Something that can be called with so many arguments; `called`: which, for the error."""
    if value is None and optional:
        return None
    if not callable(value):
        raise ArgumentTypeError(f"{name} is {shown(value)}; a function is needed")
    try:
        inspect.signature(value).bind(*(None,) * takes)
    except TypeError as error:
        raise ArgumentTypeError(
            f"{name} is {shown(value)}; it must take {takes} arguments{called}"
        ) from error
    except ValueError:  # no signature to be seen
        pass
    out: Callable[..., Any] = value
    return out


def attribute(value: Any, name: str) -> Any:
    """An attribute, None where there is none or a foreign object does not give it."""
    try:
        return getattr(value, name, None)
    except Exception:
        return None


def path(name: str, value: Any) -> Path:
    """A path of a file."""
    if isinstance(value, str | os.PathLike) and 0 < len(str(value)) < 4096 and "\0" not in str(value):
        return Path(value)
    raise ArgumentTypeError(f"{name} is {shown(value)}; a path is needed")


def array(
    name: str,
    value: Any,
    shape: tuple[int | str | None, ...] | None = None,
    *,
    finite: bool = True,
    error: type[Exception] = ArgumentError,
) -> np.ndarray:
    """Numbers as a new float64 array of a shape, in which texts (or None) stand for any size."""
    out = numeric(value)
    if out is None:
        raise error(f"{name} is {shown(value)}; an array of numbers is needed")
    if shape is not None and (
        out.ndim != len(shape) or any(isinstance(w, int) and w != g for w, g in zip(shape, out.shape))
    ):
        need = ", ".join("B" if n is None else str(n) for n in shape) + ("," if len(shape) == 1 else "")
        raise error(f"{name} has shape {out.shape}; ({need}) is needed")
    if finite and not np.isfinite(out).all():
        raise error(f"{name} holds {out[~np.isfinite(out)][0]}; finite numbers are needed")
    return np.array(out)


def device(value: Any) -> wp.Device:
    """A Warp device by name, or the preferred one for None."""
    try:
        return get_device(value)
    except KernelCacheError:
        raise
    except (AttributeError, RuntimeError, TypeError, ValueError) as error:  # whatever Warp makes of it
        present = [each.alias for each in wp.get_devices()]
        raise ArgumentError(f"device is {shown(value)}; choose one of {present}") from error


def memory(what: str, count: int, bytes_each: int, where: wp.Device) -> None:
    """Raise ArgumentError where so many numbers cannot fit into the device's memory."""
    need = count * bytes_each
    if where.is_cuda:
        total = where.total_memory
    else:
        total = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    if need > total:
        raise ArgumentError(
            f"{what} would take {need / 2**30:.4g} GiB; {where.alias} has {total / 2**30:.4g} GiB of memory"
        )
