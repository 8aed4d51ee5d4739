"""The equations that the stability battery holds a recorded step against, in NumPy float64.

    M v' = h (r + u) + M v + J' lambda,    a = D lambda,  b = J v' + d / h,    min(a, b) - s(-|a - b|) = 0,

with s = 0 (hard), the logistic's (17) or the normal's (footnote 3). Coulomb's friction has rows (n, t):
min(a, b) = 0 in n, and lambda_t is the projection of lambda_t - v_t / A_tt on [-mu lambda_n, mu lambda_n].
Errors are relative to the terms of the equations, of which impulses and v', the answer, count up to EARNED
times what the data set: all momentum there is on one row, or what a row needs to open by itself.
"""

import numpy as np

from slcp_warp.description.kinematics import Array
from slcp_warp.kernels.method import Method
from slcp_warp.kernels.structure import Structure

from ..mechanics.complementarity import complementarity, expected_square_slopes, rubbed

EARNED = 100.0  # times what the data set: impulses and velocities beyond are no measure of an error
OPEN = 1e-6  # of its terms: a row that is open by more acts in no precision
FLOOR = 1e-30  # of D, as the solver documents it: a row whose J is 0 acts on nothing


class Problem:
    """One step's numbers, see `Checker.dynamics` and `Checker.contacts`, and its rows J, d / h."""

    def __init__(self, s: Structure, method: Method, mass: Array, h: Array, v: Array, v1: Array,
                 force: Array, size: Array, d: Array, jn: Array, jt: Array, lengths: Array,
                 friction: Array, sigma: Array) -> None:  # fmt: skip
        self.s, self.method, self.mass, self.h = s, method, mass, h[..., None]
        self.v, self.v1, self.force, self.size = v, v1, force, size
        limits = sum(row.kind == "limit" for row in s.rows)
        self.place = [i if r.kind == "limit" else limits + r.index for i, r in enumerate(s.rows)]
        rows, terms = [], []
        for row, k in zip(s.rows, self.place):
            rubs = row.kind == "contact" and row.sign != 0
            if method.coulomb:
                rows.append(jt[..., k, :] if rubs and row.sign < 0 else jn[..., k, :])
                terms.append(np.abs(rows[-1]))
            else:
                slope = row.sign * friction[..., row.index, None] if rubs else 0.0
                rows.append(jn[..., k, :] + slope * jt[..., k, :])
                terms.append(np.abs(jn[..., k, :]) + np.abs(slope * jt[..., k, :]))
        self.tangent = np.array([method.coulomb and r.kind == "contact" and r.sign < 0 for r in s.rows])
        self.mu = [friction[..., row.index] if row.kind == "contact" else None for row in s.rows]
        self.jac = np.stack(rows, -2)
        self.reach = np.stack(terms, -2)  # of the terms of J
        self.rate = np.where(self.tangent, 0.0, d[..., self.place] / self.h)
        self.lengths = lengths[..., self.place] / self.h
        self.free = v + self.h * np.linalg.solve(mass, force[..., None])[..., 0]
        self.matrix = self.jac @ np.linalg.solve(mass, np.swapaxes(self.jac, -1, -2))  # A (2a)
        self.delassus = np.einsum("...ii->...i", self.matrix)
        self.most_impulse, self.most_speed = self._earned(v, np.zeros(1) if method.hard else sigma)

    def _earned(self, v: Array, sigma: Array) -> tuple[Array, Array]:
        """The largest impulse (B, N, 1) and speeds (B, N, nv) that count as sizes of terms."""
        momentum = np.einsum("...ij,...j->...i", np.abs(self.mass), np.abs(v) + np.abs(self.free))
        momentum = momentum + self.h * self.size
        lever = self.reach.max(-2)
        on_one = np.where(lever > FLOOR, momentum / np.maximum(lever, FLOOR), 0.0).max(-1)
        closing = np.maximum(-self.rate - np.einsum("...ij,...j->...i", self.jac, self.free), 0.0) + sigma
        alone = np.where(self.delassus > FLOOR, closing / np.maximum(self.delassus, FLOOR), 0.0).max(-1)
        impulse = EARNED * np.maximum(on_one, alone)[..., None]
        pushed = np.abs(np.linalg.solve(self.mass, np.swapaxes(self.jac, -1, -2))).max(-1)
        return impulse, EARNED * (np.abs(v) + np.abs(self.free)) + pushed * impulse

    def motion(self, impulse: Array) -> Array:
        """Error (B, N) of M v' = h (r + u) + M v + J' lambda; a body's coordinates are weighed by energy."""
        momentum = np.einsum("...ij,...j->...i", self.mass, self.v1 - self.v)
        push = np.einsum("...ij,...i->...j", self.jac, impulse)
        speed, counted = np.minimum(np.abs(self.v1), self.most_speed), self._counted(impulse)
        terms = np.einsum("...ij,...j->...i", np.abs(self.mass), speed + np.abs(self.v))
        terms += self.h * self.size + np.einsum("...ij,...i->...j", self.reach, counted) + 1e-30
        root = np.sqrt(np.einsum("...jj->...j", self.mass))
        ratio, body = terms / root, np.array(self.s.dof_body)
        largest = np.stack([ratio[..., body == b].max(-1) for b in body], -1)
        return (np.abs(momentum - self.h * self.force - push) / (root * largest)).max(-1)

    def _counted(self, impulse: Array) -> Array:
        return np.minimum(np.abs(impulse), self.most_impulse)

    def weight(self, impulse: Array) -> Array:
        """Size (B, N) of the velocities that the complementarity problem is made of."""
        speed = np.minimum(np.abs(self.v1), self.most_speed) + np.abs(self.free)
        approach = np.einsum("...ij,...j->...i", self.reach, speed)
        return (self.lengths + approach).max(-1) + (self.delassus * self._counted(impulse)).max(-1) + 1e-30

    def contact(self, impulse: Array, sigma: Array) -> Array:
        """Error (B, N) of the complementarity problem."""
        unscaled = np.ones(self.delassus.shape)
        scale = np.maximum(self.delassus, FLOOR) if self.method.inertia_scaling else unscaled
        b = self.rate + np.einsum("...ij,...j->...i", self.jac, self.v1)
        if self.method.erm:  # stationary: D r_a + A r_b = 0, relative to the larger of D and A's diagonal
            by_a, by_b = expected_square_slopes(scale * impulse, b, sigma, self.method)
            slope = scale * by_a + np.einsum("...ij,...j->...i", self.matrix, by_b)
            terms = self.weight(impulse)[..., None] + sigma  # b + noise: at rest only the noise is left
            size = np.maximum(self.delassus, scale) * terms
            return (np.abs(slope) / (size + scale * scale * self._counted(impulse))).max(-1)
        error = complementarity(scale * impulse, b, sigma, self.method)
        for i in np.flatnonzero(self.tangent):  # the row before it is the pair's normal row
            bound = self.mu[i] * impulse[..., i - 1]
            asked = rubbed(impulse[..., i], b[..., i], np.maximum(self.delassus[..., i], FLOOR), bound)
            error[..., i] = self.delassus[..., i] * (impulse[..., i] - asked)
        return np.abs(error).max(-1) / self.weight(impulse)

    def opens(self, v: Array) -> Array:
        """Whether (B, N) all rows are clearly open when the bodies move with v, so that nothing acts."""
        b = self.rate + np.einsum("...ij,...j->...i", self.jac, v)
        clear = OPEN * (self.lengths + np.einsum("...ij,...j->...i", self.reach, np.abs(v)))
        return np.all(self.tangent | (b > clear), -1)

    def entered(self, v: Array, sigma: Array) -> Array:
        """By how much (B, N) moving with v enters the rows' half spaces, relative to velocities and sigma."""
        b = self.rate + np.einsum("...ij,...j->...i", self.jac, v)
        size = self.weight(np.zeros(b.shape)) + (0.0 if self.method.hard else sigma.max(-1))
        return np.where(self.tangent, 0.0, np.maximum(-b, 0.0)).max(-1) / size
