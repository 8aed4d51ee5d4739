"""How hard tendons pull in the steps of a rollout, in plain NumPy."""

from typing import Any

import numpy as np

from slcp_warp.kernels.mechanism.stiff_springs import SHARE

from ..description.scene import Scene
from ..inputs.errors import ArgumentError
from ..measures.signals import TRAPEZOIDAL
from ..options import Options


def tendon_forces(
    scene: Scene, options: Options, numbers: dict[str, Any], states: np.ndarray, controls: np.ndarray | None
) -> np.ndarray:
    """(B, N, tendons): the force along each tendon in every step, of its spring, damper and actuators.

    Args:
        numbers: parameters by name, shared or with the worlds first.
        states: (B, N+1, nx).
        controls: (B, N, nu) as they act; None: not known.

    Raises:
        ArgumentError: controls pull at tendons and are not known, or the trapezoidal rule made the steps.
    """
    s = scene.structure
    if options.method.trapezoidal:
        raise ArgumentError(TRAPEZOIDAL)
    driven = [(i, s.driven_tendon(i)) for i in range(s.nu) if s.driven_tendon(i) >= 0]
    if driven and controls is None:
        raise ArgumentError("controls were not recorded, and some pull at tendons; roll out with "
                            "record='controls'")  # fmt: skip
    axes = {name: len(np.shape(scene.default_parameters()[name])) for name in numbers}

    def of(name: str, i: int) -> np.ndarray:
        value = np.asarray(numbers[name], float)
        return value[..., i][..., None] if value.ndim > axes[name] else value[..., i]

    h = np.asarray(numbers["step_size"], float)
    h = h[..., None] if h.ndim else h
    q, v = states[:, :-1, : s.nv], states[:, :-1, s.nv :]
    change = states[:, 1:, s.nv :] - v
    out = np.zeros((*q.shape[:2], len(s.tendons)))
    for i, dofs in enumerate(s.tendons):
        start = s.tendon_start(i)
        shares = [of("tendon_coefficient", start + n) for n in range(len(dofs))]
        length, rate, more = (
            sum(share * x[..., j] for share, j in zip(shares, dofs, strict=True)) for x in (q, v, change)
        )
        k, d = of("tendon_stiffness", i), of("tendon_damping", i)
        late = SHARE * h * more * (k > 0.0) if s.implicit_stiffness else 0.0
        out[..., i] = -k * (length + late - of("tendon_length", i))
        out[..., i] -= d * (rate + more if s.implicit_damping else rate)
    for a, i in driven:
        assert controls is not None
        out[..., i] += of("gear", a) * controls[..., a]
    for i in s.limited:
        most, sigma = of("tendon_force_limit", i), of("tendon_force_sigma", i)
        out[..., i] = _clamped(out[..., i], most, 0.0 * sigma if options.method.hard else sigma)
    return out


def forces_are_known(scene: Scene, options: Options, controls: Any) -> bool:
    """Whether `tendon_forces` has what it needs, of tendons that there are."""
    s = scene.structure
    driven = any(s.driven_tendon(i) >= 0 for i in range(s.nu))
    return bool(s.tendons) and not options.method.trapezoidal and (controls is not None or not driven)


def _clamped(asked: np.ndarray, most: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """What is asked for within a limit, or the mean of that under logistic noise of a scale (M65)."""
    scale = np.where(sigma > 0.0, sigma, 1.0)
    above, below = (np.log1p(np.exp(-np.abs(asked + side * most) / scale)) for side in (1.0, -1.0))
    return np.clip(asked, -most, most) + sigma * (above - below)
