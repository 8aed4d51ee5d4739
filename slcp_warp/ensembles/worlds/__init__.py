"""The worlds of a sweep: drawn or given numbers of what each is and goes through."""

from .arrays import Worlds
from .draws import draw_worlds
from .saved import load_worlds, save_worlds

__all__ = ["Worlds", "draw_worlds", "load_worlds", "save_worlds"]
