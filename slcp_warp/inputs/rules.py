"""What the numbers of a mechanism may be: one table for `Scene` and its parts, for scene files
and MJCF, which make these, and for `Parameters.replace`.

Everything is finite. The names are those of parameters (`Parameters`); a scene's field `damping` of a spring
is the parameter `spring_damping`.
"""

from typing import Any

import numpy as np

from .checks import numeric, shown
from .errors import ArgumentError

POSITIVE = ("step_size", "sigma", "mass", "inertia", "period")
NONNEGATIVE = (
    "damping",
    "armature",
    "friction",
    "radius",
    "corner_radius",
    "restitution",
    "spring_damping",
    "spring_length",
    "tendon_damping",
    "tendon_force_limit",
    "tendon_force_sigma",
)
OF_EITHER_SIGN = (
    "gravity",
    "gear",
    "stiffness",
    "spring_stiffness",
    "tendon_stiffness",
    "tendon_coefficient",
    "surface_ratio",
)
PERTURBABLE = sorted({*POSITIVE, *NONNEGATIVE, *OF_EITHER_SIGN} - {"period"})  # by factors
COVARIANCES = ("position_covariance", "velocity_covariance")
SINGLE = 1e-6  # by which a number that was kept in single precision may be larger
UNIT = 5e-3  # by how much the length of a direction may differ from 1
HINTS = {"sigma": '; for the problem without noise use Options(residual="hard")'}


def numbers(
    label: str, value: Any, error: type[ArgumentError], rule: str, ndim: int | None = None
) -> np.ndarray:
    """A value as a float64 array that obeys the rule of a parameter, or the error that says what is wrong.

    Args:
        label: what the value is called in the message.
        rule: the parameter's name.
        ndim: number of axes that it must have, if it matters.
    """
    array = numeric(value)
    if array is None or ndim not in (None, array.ndim):
        need = "a number is" if ndim == 0 else "numbers are"
        raise error(f"{label} is {shown(value)}; {need} needed")
    check(label, array, error, rule)
    return array


def check(label: str, array: np.ndarray, error: type[ArgumentError], rule: str) -> None:
    """Raise an error for numbers that break the rule of a parameter."""
    finite = np.isfinite(array)
    if not finite.all():
        raise error(f"{label} is {array[~finite].flat[0]}; it must be finite")
    if rule in POSITIVE and not (array > 0.0).all():
        raise error(f"{label} is {array.min()}; it must be positive{HINTS.get(rule, '')}")
    if rule in NONNEGATIVE and not (array >= 0.0).all():
        raise error(f"{label} is {array.min()}; it must not be negative")
    if rule == "restitution" and not (array <= 1.0).all():
        raise error(f"{label} is {array.max()}; at most 1 is needed")


def check_axis(label: str, array: np.ndarray, error: type[ArgumentError]) -> None:
    """Raise an error for directions (..., 2) that are not of unit length: a joint's coordinate is in m."""
    length = np.hypot(array[..., 0], array[..., 1])
    wrong = np.abs(length - 1.0) > UNIT
    if wrong.any():
        x, long = array[wrong][0], length[wrong].flat[0]
        unit = "" if long == 0.0 or not np.isfinite(long) else f", {tuple((x / long).round(6).tolist())}"
        raise error(f"{label} is {tuple(x.tolist())}, of length {long:.4g}; a unit vector is needed{unit}")


def check_radius(label: str, kind: str, radius: np.ndarray, error: type[ArgumentError]) -> None:
    """Raise an error for sizes (..., 2) that a kind of shape cannot have."""
    if kind in ("ellipse", "rectangle", "ring") and not (radius > 0.0).all():
        which = "an ellipse" if kind == "ellipse" else f"a {kind}"
        raise error(f"{label} is {radius.min()}; {which}'s must be positive")
    different = radius[..., 0] != radius[..., 1]
    if kind in ("disc", "ring") and different.any():
        pair = tuple(np.atleast_2d(radius[different])[0].tolist())
        raise error(f"{label} is {pair}; a {kind} has one radius, both numbers of it; an ellipse has two")


def check_corners(
    label: str, kind: str, radius: np.ndarray, corner: np.ndarray, error: type[ArgumentError]
) -> None:
    """Raise an error for corner radii (...) that are larger than half a rectangle (..., 2)."""
    half = radius.min(axis=-1)
    wrong = corner > half * (1.0 + SINGLE)
    if kind == "rectangle" and wrong.any():
        at = np.broadcast_to(corner, wrong.shape)[wrong].flat[0]
        most = np.broadcast_to(half, wrong.shape)[wrong].flat[0]
        raise error(f"{label} is {at}; at most half of the shorter side is needed, {most}")


def covariance(label: str, array: np.ndarray, size: int, error: type[ArgumentError]) -> np.ndarray:
    """A checked covariance (n, n) or (B, n, n) from a number (times the identity), (B,) numbers or itself."""
    if array.ndim < 2:
        array = array[..., None, None] * np.eye(size)
    if array.shape[-2:] != (size, size) or array.ndim > 3:
        need = f"a scalar (times the identity), {(size, size)}, (B,) or (B, {size}, {size})"
        raise error(f"{label} has shape {array.shape}; give {need}")
    if not np.allclose(array, np.swapaxes(array, -1, -2), rtol=1e-9, atol=0.0):
        raise error(f"{label} is not symmetric: {shown(array.tolist())}")
    if array.size:
        lowest = np.linalg.eigvalsh(array).min(axis=-1)
        if np.any(lowest < -1e-12 * np.abs(array).max(axis=(-1, -2))):
            raise error(f"{label} has the eigenvalue {lowest.min()}; a covariance has none below 0")
    return array.copy()


def shapes_of(shape: tuple[int, ...]) -> str:
    """Shapes in which a parameter, or a part of one, may be given, in words."""
    if not shape:
        return "a scalar or (B,)"
    return f"a scalar, {shape}, (B,) or ({', '.join(['B', *map(str, shape)])})"
