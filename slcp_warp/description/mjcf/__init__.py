"""Planar scenes from MJCF, read off the model that the `mujoco` package compiles."""

from .plane import MjcfError
from .reader import load_mjcf, mjcf_control_limits

__all__ = ["MjcfError", "load_mjcf", "mjcf_control_limits"]
