"""The version of the package, as files name it."""

__version__ = "0.1.0"
