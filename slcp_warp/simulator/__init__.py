"""A scene's simulator, and products with the derivatives of its rollouts."""

from .simulator import DTYPES as DTYPES
from .simulator import Simulator as Simulator
