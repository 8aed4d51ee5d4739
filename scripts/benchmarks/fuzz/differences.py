"""A, B, second derivatives and gradients by parameters against central differences of the package's own step
(second ones: of its A and B) in float64.

Differences know no closed form, so they judge the derivatives; the step that they difference is judged by the
oracle. Of several step lengths the one whose neighbours agree best counts, world by world and column by
column; where none agree the step has a kink there, and the world is left out. So it is where the slopes to
both sides stay apart as steps shrink: a gap of 1e-9 m has a kink within every step, and their mean agrees.
"""

from typing import Any

import numpy as np
import warp as wp

from slcp_warp import weighted_hessian
from slcp_warp.description.acting import BUILT, acting
from slcp_warp.description.kinematics import Array

STEPS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
RATIO = 10.0  # of a step to the next
AGREE = 1e-5  # of the largest entry: neighbours that agree to this are trusted
WRONG_BY = 30.0  # times what the differences themselves are uncertain by, at least LIMIT
LIMIT = 1e-5
CURVED = 1e-4  # of second derivatives: what they are compared with has the roundings of A and B over a step
KINK = 3e-6  # of the largest entry: slopes to both sides that are further apart
STAYS = 0.3  # and by this share of what they were in the step ten times as long


def compare(exact: Array, up: Array, down: Array) -> tuple[Array, Array]:
    """Error of `exact` (B, n) against differences forwards and backwards (steps, B, n), relative to the
    largest entry of a world, and whether they can be trusted (B,). Where a row enters within 1e-5 m longer
    steps agree beside it, and the shortest still misses: so what two steps tend to counts as well.
    """
    tried = 0.5 * (up + down)
    size = np.maximum(np.abs(exact).max(1), np.nanmax(np.abs(tried), (0, 2), initial=0.0)) + 1e-300
    apart = np.abs(np.diff(tried, axis=0)) / size[:, None]
    apart = np.where(np.isfinite(apart), apart, np.inf)
    best = apart.argmin(0)[None]
    unsure = np.take_along_axis(apart, best, 0)[0]
    limits = (RATIO**2 * tried[1:] - tried[:-1]) / (RATIO**2 - 1.0)
    close = np.minimum(np.abs(exact - tried[1:]), np.abs(exact - limits)) / size[:, None]
    longer = np.arange(1, len(tried))[:, None, None] <= best
    error = np.where(longer | ~np.isfinite(close), np.inf, close).min(0)
    bent = np.abs(up - down)[2:4] / size[:, None]
    kinked = ((bent[1] > KINK) & (bent[1] > STAYS * bent[0])).any(1)
    trusted = (unsure < AGREE).all(1) & ~kinked
    return np.max(error / np.maximum(1.0, WRONG_BY * unsure / LIMIT), 1), trusted


def jacobian_errors(sim: Any, x: Array, u: Array, params: Any) -> tuple[Array, Array]:
    """Errors of (A, B) at states, and which of them can be trusted (B,)."""
    lin = sim.linearize(x, u if sim.nu else None, params)
    exact = np.concatenate([lin.A, lin.B], 2)
    z = np.concatenate([x, u], 1)
    good = np.asarray(lin.status) == 0

    def after(moved: Array) -> Array:
        done = sim.step(moved[:, : sim.nx], moved[:, sim.nx :] if sim.nu else None, params)
        return np.where((done.status == 0)[:, None], done.state, np.nan)

    here, sides = after(z), []
    for side in (1.0, -1.0):
        tried = []
        for e in STEPS:
            columns = [(after(z + side * e * unit) - here) / (side * e) for unit in np.eye(z.shape[1])]
            tried.append(np.stack(columns, 2).reshape(len(x), -1))
        sides.append(np.stack(tried))
    error, trusted = compare(exact.reshape(len(x), -1), *sides)
    return error, trusted & good


def curvature_errors(sim: Any, x: Array, u: Array, params: Any, seed: int) -> tuple[Array, Array]:
    """Errors of the second derivatives of a random weight of x' by (x, u), against differences of that
    weight's slopes, relative to the largest entry of both; and which of them can be trusted (B,).
    """
    weight = np.random.default_rng(seed).standard_normal(x.shape)
    exact, status = weighted_hessian(sim, x, u, weight, params)
    z = np.concatenate([x, u], 1)

    def slopes(moved: Array) -> Array:
        lin = sim.linearize(moved[:, : sim.nx], moved[:, sim.nx :] if sim.nu else None, params)
        out = np.einsum("bi,bij->bj", weight, np.concatenate([lin.A, lin.B], 2))
        return np.where((np.asarray(lin.status) == 0)[:, None], out, np.nan)

    here, sides = slopes(z), []
    least = np.abs(here).max(1)[:, None]  # what hardly bends has no more digits than its slopes
    for side in (1.0, -1.0):
        tried = []
        for e in STEPS:
            columns = [(slopes(z + side * e * unit) - here) / (side * e) for unit in np.eye(z.shape[1])]
            tried.append(np.concatenate([np.stack(columns, 2).reshape(len(x), -1), least], 1))
        sides.append(np.stack(tried))
    found = np.concatenate([exact.reshape(len(x), -1), least], 1)
    error, trusted = compare(found, *sides)
    return error, trusted & (status == 0)


def gradient_errors(sim: Any, x: Array, u: Array, params: Any, seed: int) -> tuple[Array, Array]:
    """Errors of the gradient of a random weight of x' by every parameter, and whether to trust them (B,);
    that by state and controls is compared with A and B.
    """
    weight = np.random.default_rng(seed).standard_normal(x.shape)
    tracked = params.track()
    kinds = {"dtype": sim.dtype, "device": sim.device}
    start: Any = wp.array(x, requires_grad=True, **kinds)
    control: Any = wp.array(u, requires_grad=True, **kinds)
    with wp.Tape() as tape:
        done = sim.step(start, control if sim.nu else None, tracked)
    tape.backward(grads={done.state: wp.array(weight, **kinds)})
    good = done.status.numpy() == 0
    lin = sim.linearize(x, u if sim.nu else None, params)
    through = np.einsum("bi,bij->bj", weight, np.concatenate([lin.A, lin.B], 2))
    own = np.concatenate([start.grad.numpy()] + [control.grad.numpy()] * (sim.nu > 0), 1)
    misses = np.abs(own - through).max(1) / (np.abs(through).max(1) + 1e-300)
    exact: list[Array] = []
    forwards: list[Array] = []
    backwards: list[Array] = []

    def value(name: str, moved: Array) -> Array:
        out = sim.step(x, u if sim.nu else None, params.replace(**{name: moved}))
        return np.where(out.status == 0, np.sum(weight * out.state, 1), np.nan)

    for name in params.names:
        base = np.asarray(params[name], float)
        shape = sim.params.layout.shape(name)
        base = np.broadcast_to(base, (len(x), *shape)).copy()
        gradient = tracked.gradient(name).reshape(len(x), -1)
        for k in np.ndindex(*shape):
            if name in BUILT and not acting(sim.scene.structure, name)[k[0]]:
                continue  # no kernel reads it
            at = base[(slice(None), *k)]
            size = np.maximum(np.abs(at), 1e-3 if name not in ONE_SIDED else 0.0)
            if name in SHARES:
                size = np.minimum(at, 1.0 - at)
            elif not size.all() or name in SKIPPED:
                continue
            here = value(name, base)
            for side, columns in ((1.0, forwards), (-1.0, backwards)):
                slopes = []
                for e in STEPS:
                    moved = base.copy()
                    moved[(slice(None), *k)] += side * e * size
                    slopes.append((value(name, moved) - here) / (side * e))
                columns.append(np.stack(slopes))
            place = int(np.ravel_multi_index(k, shape)) if shape else 0
            exact.append(gradient[:, place] * size)
    error, trusted = compare(np.stack(exact, 1), np.stack(forwards, 2), np.stack(backwards, 2))
    misses = np.where(np.asarray(lin.status) == 0, misses, 0.0)
    return np.maximum(error, misses), trusted & good


ONE_SIDED = ("mass", "inertia", "step_size", "sigma", "radius", "damping", "armature", "friction",
             "spring_damping", "spring_length", "shape_angle", "tendon_damping",
             "tendon_force_sigma")  # fmt: skip
SHARES = ("restitution",)  # in [0, 1], and at an end of it without differences
SKIPPED = (
    "axis",
    "position_covariance",
    "velocity_covariance",
    "radius",
    "corner_radius",
)  # constrained, not free numbers
