"""Arguments of the functions that make named scenes, checked by what their signatures say."""

import functools
import inspect
import types
import typing
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

from ..inputs.checks import flag, number, shown, whole
from ..inputs.errors import SceneError

P = ParamSpec("P")
T = TypeVar("T")
MOST_BODIES = 10_000  # of a chain or a stack


def checked(make: Callable[P, T]) -> Callable[P, T]:
    """The function, with a SceneError for arguments that are not what their annotations say, and for numbers
    of which no scene can be made.
    """
    hints, signature = typing.get_type_hints(make), inspect.signature(make)

    @functools.wraps(make)
    def scene(*args: P.args, **kwargs: P.kwargs) -> T:
        given = signature.bind(*args, **kwargs).arguments
        for name, value in given.items():
            _check(f"{make.__name__}: {name}", value, hints[name])
        try:
            return make(*args, **kwargs)
        except (ArithmeticError, ValueError) as error:  # a part of the scene, or 1/0, 1e200**2, log(-1)
            raise SceneError(f"{make.__name__} makes no scene of {shown(dict(given))}: {error}") from error

    return scene


def _check(name: str, value: Any, hint: Any) -> None:
    options = typing.get_args(hint) if isinstance(hint, types.UnionType) else (hint,)
    if value is None and type(None) in options:
        return
    if any(typing.get_origin(option) for option in options) and isinstance(value, list | tuple):
        for i, entry in enumerate(value):
            number(f"{name}[{i}]", entry, error=SceneError)
    elif bool in options:
        flag(name, value)
    elif int in options:
        whole(name, value, 1, MOST_BODIES, error=SceneError)
    elif float in options:
        number(name, value, error=SceneError)
    elif not isinstance(value, str):
        raise SceneError(f"{name} is {shown(value)}; a text is needed")
