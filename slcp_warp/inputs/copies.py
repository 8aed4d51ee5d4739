"""Copies of what has arrays and launches on a device."""

from typing import Any

from .errors import ArgumentTypeError


class NotCopied:
    """A mixin of what holds device arrays that its launches write: copies would share them."""

    def __reduce_ex__(self, protocol: Any) -> Any:
        raise ArgumentTypeError(
            f"a {type(self).__name__} cannot be copied or pickled, its arrays are on a device; make another "
            "one from what it was made of"
        )
