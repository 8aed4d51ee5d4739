"""What a kernel is made for, as one key of the factories."""

from typing import NamedTuple

from .method import Method
from .structure import Structure


class Specialisation(NamedTuple):
    """The mechanism's structure, the floats' type (wp.float32 or wp.float64) and the method that steps it.

    What depends on structure and type alone is made from these two, so that all methods share it.
    """

    structure: Structure
    dtype: type
    method: Method
