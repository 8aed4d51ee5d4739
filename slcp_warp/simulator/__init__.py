"""A scene's simulator, products with the derivatives of its rollouts, problems without a mechanism."""

from .simulator import DTYPES as DTYPES
from .simulator import Simulator as Simulator
