"""Policies that are numbers, as files: which class they are of, JSON values and arrays; nothing is pickled.

A class whose policies can be saved has ``content() -> Content`` and a classmethod ``of_content(Content)``,
which gives a policy that does the same, bit for bit.
"""

import importlib
import os
from collections.abc import Mapping
from pathlib import Path
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np

from ..inputs import checks
from ..inputs.errors import ArgumentError
from ..storage.archive import open_archive, write_archive
from ..storage.files import FileError, reading
from ..storage.python import python_name

FORMAT, VERSION = "slcp-warp-policy", 1
RECORDS = "slcp-warp-"  # formats of other files begin with it
MADE_BY = {  # how other files become policies, in rooms above this one
    "plan": "ddp.TrackingPolicy(ddp.Result.load({!r}), scene.state_period)",
    "library": "ddp.Library.load({!r}).policy()",
}
PACKAGE = __name__.partition(".")[0]


class Content(NamedTuple):
    """What a policy is made from.

    Attributes:
        values: JSON values by name.
        arrays: numbers by name.
    """

    values: dict[str, Any]
    arrays: dict[str, np.ndarray]

    def below(self, name: str) -> "Content":
        """What is in it of a policy inside, which `within` put there."""
        values = {key.removeprefix(f"{name}."): v for key, v in self.values.items() if _in(key, name)}
        return Content(
            values, {key.removeprefix(f"{name}."): a for key, a in self.arrays.items() if _in(key, name)}
        )

    def within(self, name: str) -> "Content":
        """The same as part of another policy's content."""
        values, arrays = ({f"{name}.{key}": v for key, v in each.items()} for each in self)
        return Content(values, arrays)


def _in(key: str, name: str) -> bool:
    return key.startswith(f"{name}.")


def content_of(policy: Any) -> Content:
    """What a policy is made from.

    Raises:
        ArgumentError: a policy that is no data, a user's function among them.
    """
    kind = type(policy)
    own = kind.__module__.partition(".")[0] == PACKAGE
    if not own or not callable(getattr(policy, "content", None)):
        raise ArgumentError(
            f"policy is a {kind.__name__}, which is no data: give it as a text, 'file.py:name', of a Python "
            "file in which it is made"
        )
    values, arrays = policy.content()
    return Content({"class": f"{kind.__module__}:{kind.__qualname__}"} | values, arrays)


def policy_of(content: Content) -> Any:
    """The policy of a content.

    Raises:
        FileError: it is none, or of a class that is not this package's.
    """
    module, _, name = str(content.values.get("class")).partition(":")
    if module.partition(".")[0] != PACKAGE:
        raise FileError(f"its class is {content.values.get('class')!r:.80}; one of {PACKAGE} is needed")
    try:
        kind = getattr(importlib.import_module(module), name, None)
    except ImportError:
        kind = None
    make = getattr(kind, "of_content", None)
    if not isinstance(kind, type) or make is None:
        raise FileError(f"its class is {content.values['class']!r:.80}, which this program has not got")
    return make(content)


def save_policy(policy: Any, path: str | os.PathLike[str]) -> Path:
    """Write a policy to an .npz file: reading it gives one that does the same, bit for bit.

    Raises:
        ArgumentError: a policy that is no data: users' functions, callbacks.
    """
    path = checks.path("path", path)
    if path.suffix != ".npz":
        raise ArgumentError(f"path {path} ends in {path.suffix!r}; .npz is needed")
    values, arrays = content_of(policy)
    write_archive(path, {"format": FORMAT, "version": VERSION, "policy": values}, arrays)
    return path


def load_policy(name: str | os.PathLike[str]) -> Any:
    """The policy of a file that `save_policy` wrote, or of `file.py:name`.

    In a Python file the name is a policy, or a function that makes one; the file is run.

    Raises:
        FileNotFoundError: no such file.
        FileError: truncated, or no policy.
    """
    path = checks.path("name", name)
    file, colon, attribute = str(path).rpartition(":")
    if colon and file.endswith(".py"):
        return _from_python(Path(file), attribute)
    with reading(path, "a policy", FileError), open_archive(path) as archive:
        kind = str(archive.header.get("format")).removeprefix(RECORDS)
        if kind in MADE_BY:
            raise FileError(f"it holds a {kind}; give {MADE_BY[kind].format(path.name)}")
        archive.check_format(FORMAT, VERSION)
        values = archive.header.get("policy")
        if not isinstance(values, dict):
            raise FileError("its header says no policy")
        policy = policy_of(Content(values, archive.read_all(archive.names)))
        if unknown := sorted(set(archive.names) - set(content_of(policy).arrays)):
            raise FileError(f"it holds {unknown[0]!r:.60}, for which its policy has no use")
        return policy


def _from_python(path: Path, attribute: str) -> Any:
    try:
        found, names = python_name(path, attribute)
        policy = found() if isinstance(found, FunctionType) else found
    except FileNotFoundError:
        raise
    except Exception as error:
        raise FileError(f"{path}:{attribute}: {type(error).__name__}: {error}") from error
    if policy is None:
        need = "a policy, or a function that makes one, is needed"
        raise FileError(f"{path}: no {attribute} in it; {need}{_hint(names)}")
    return policy


def _hint(names: Mapping[str, Any]) -> str:
    """Policies among the names of a file, and functions that may make one."""
    own = []
    for name, value in names.items():
        acts = any(callable(checks.attribute(value, what)) for what in ("kernel", "act"))
        makes = isinstance(value, FunctionType) and value.__module__ == names["__name__"]
        if not isinstance(value, type) and (acts or (makes and not value.__code__.co_argcount)):
            own.append(name)
    return f"; there are {', '.join(own[:8])}" if own else ""
