"""Arguments that pins and ropes have in common: the bodies that they tie, and where."""

from typing import Any

from ...inputs.checks import array, shown
from ...inputs.errors import SceneError
from ..parts import Pair2


def body_of(label: str, value: Any) -> str | None:
    """The name of a body, or None for the world; anything else is a SceneError."""
    if value is None or (isinstance(value, str) and value):
        return value
    raise SceneError(f"{label} is {shown(value)}; a name, or None for the world, is needed")


def point_of(label: str, value: Any) -> Pair2:
    """Two finite numbers [m]; anything else is a SceneError."""
    x, y = array(label, value, (2,), error=SceneError).tolist()
    return float(x), float(y)
