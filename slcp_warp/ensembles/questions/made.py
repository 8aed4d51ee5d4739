"""Policies that a user's function makes from numbers."""

import inspect
from collections.abc import Callable, Mapping
from typing import Any

from ...inputs.checks import shown
from ...inputs.errors import ArgumentTypeError


def made(policy: Any, numbers: Mapping[str, Any]) -> Any:
    """The policy that a function gives for numbers by name; without any, what is given.

    Raises:
        ArgumentTypeError: no function of these numbers, or one that gives None. Errors of the function go
            through, with a note of the numbers.
    """
    if not numbers:
        return policy
    if not callable(policy):
        raise ArgumentTypeError(
            f"policy is {shown(policy)}; a function of ({', '.join(numbers)}) that gives a policy is needed"
        )
    make: Callable[..., Any] = policy
    own = {name: float(value) for name, value in numbers.items()}
    called = f"policy({', '.join(f'{name}={value!r}' for name, value in own.items())})"
    try:
        inspect.signature(make).bind(**own)
    except TypeError as error:
        raise ArgumentTypeError(
            f"policy takes {inspect.signature(make)}, the numbers are ({', '.join(numbers)}): {error}"
        ) from None
    except ValueError:  # what has no signature
        pass
    try:
        found = make(**own)
    except Exception as error:
        error.add_note(called)
        raise
    if found is None:
        raise ArgumentTypeError(f"{called} is None; a policy is needed")
    return found
