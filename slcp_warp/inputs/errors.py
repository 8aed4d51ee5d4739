"""The errors of bad input: every one is an `InputError`, and a `ValueError` or a `TypeError` as well.

Modules have errors of their own (`ArrayError`, `OptionError`, ...), all of them an `ArgumentError`. A message
names the argument, what came and what is needed.
"""


class InputError(Exception):
    """Base of every error that bad input raises in this package."""


class ArgumentError(InputError, ValueError):
    """An argument with a value that cannot be used."""


class ArgumentTypeError(InputError, TypeError):
    """An argument that is another kind of object than the one needed."""


class SceneError(ArgumentError):
    """A scene that describes no mechanism; the message names the field, what came and what is needed."""
