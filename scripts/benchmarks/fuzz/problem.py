"""One step of many worlds as the oracle sees it: the rows, what drives them, and the sizes of both.

Euler: H v' = M v + h f + J' lambda with H = M and f = r + u where damping is explicit, H = M + h C and f = r
+ u + C v where it is implicit; with implicit stiffness M + h^2/2 K for M. Sizes, which a rounding error is
relative to, come from the data (state, numbers, free velocity) and never from the answer that is judged.
"""

import copy
import dataclasses
import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slcp_warp import Scene
from slcp_warp.description.kinematics import Array
from slcp_warp.kernels.method import Method

from ..mechanics.bounces import met
from ..mechanics.contact import Touches, touches
from ..mechanics.leaps import late, reached_by
from ..mechanics.level import level, level_touches
from ..mechanics.overlaps import limited, room
from ..mechanics.tree import Mechanics
from .draws import Worlds

TOLERANCE = {"float64": 1e-10, "float32": 2e-5}  # of the size of the terms: the documented accuracy
EPSILON = {"float64": 2.2e-16, "float32": 1.2e-7}
LOGISTIC = np.sqrt(3.0) / np.pi  # scale of the logistic distribution of standard deviation 1
ERM_SLACK = 10.0  # of TOLERANCE: a vanishing gradient of squares has the square of a residual's condition
MOST_LOSS = 1e-2  # relative error, whatever the mass matrix
LOST_ROWS = {"float64": 100.0, "float32": 50.0}  # times TOLERANCE that J v' + d/h may lose by it
REFUSED = 3e-4  # of the motion that a rounding may make of it where the trapezoidal method may say NONFINITE
SUMMED = 10.0  # roundings that the kernels lay to entries of that method's matrix, beside those of H^-1
GIVEN = {"float64": 2.0**-52, "float32": 2.0**-24}  # of its lengths: what kernels take an overlap for less by
FLOOR = 1e-30
LEVER = 3.0  # a sum of a dozen terms, which rounds by more than 4 EPSILON of its terms
TURNED = 0.3  # of a normal by rounding: two points in one place have any


SHAKEN = 1e-7  # relative change of forces by which conditions are measured


@dataclass(frozen=True)
class Drive:
    """H (B, nv, nv), right-hand side H v_free and the size of its terms (B, nv), v_free (B, nv); by how much
    H v' and H v_free change with relative changes of what they are made of (B, nv), of which roundings are a
    share, and of the predicted contact forces (B, nv), which are known to the tolerance; the change by the
    trapezoidal method's matrix as a share of its motion (B,).
    """

    h_mass: Array
    rhs: Array
    size: Array
    free: Array
    doubt: Array
    guess: Array
    lost: Array


class Truth:
    """The oracle's account of worlds before a step, under generalised forces `force` (B, nv) beside the
    scene's own; methods share it. `meets`: v_free by which pairs bounce, if another one.
    """

    def __init__(self, scene: Scene, worlds: Worlds, force: Array | None = None) -> None:
        self.scene, self.s, self.worlds = scene, scene.structure, worlds
        self.mech = Mechanics(scene, worlds.numbers)
        self.meets: Array | None = None
        nv = self.s.nv
        self.q, self.v = worlds.x[:, :nv], worlds.x[:, nv:]
        self.h = np.broadcast_to(self.mech.h, (len(self.q),))
        self.motion = self.mech.motion(self.q, self.v, worlds.u, force)
        self.touches = touches(self.mech, self.q)
        self.openings: dict[tuple[bool, str], dict[int, float]] = {}  # proofs, by method and world

    def placed(self, dtype: str) -> tuple[Mechanics, Touches]:
        """The scene and its contacts as kernels of this precision take them."""
        return self._level if dtype == "float32" else (self.mech, self.touches)

    @functools.cached_property
    def _level(self) -> tuple[Mechanics, Touches]:
        mech = level(self.mech)
        return mech, level_touches(mech, self.q, self.touches if mech is self.mech else None)

    @property
    def damped(self) -> bool:
        """Whether dampers may only take energy: unless the scene wants their explicit rule."""
        return bool(getattr(self.scene, "implicit_damping", True))

    def undamped(self) -> Array:
        """Where Euler's forces alone take the velocity without dampers (B, nv)."""
        momentum = np.einsum("bij,bj->bi", self.inertia, self.v) + self.h[:, None] * self.motion.force
        return solved(self.inertia, momentum)

    @functools.cached_property
    def inertia(self) -> Array:
        """M, with implicit stiffness M + h^2/2 K (B, nv, nv)."""
        return self.mech.inertia(self.motion)

    def drive(self, push: Array | None = None) -> Drive:
        """The equation of motion of Euler's step, or of the trapezoidal one with the predicted contact force
        `push` = N^-1 J' lambda (B, nv).
        """
        h, mo = self.h[:, None], self.motion
        drag = np.einsum("bij,bj->bi", mo.damping, self.v)
        size = np.einsum("bij,bj->bi", np.abs(mo.mass), np.abs(self.v)) + h * (mo.size + np.abs(drag))
        h_mass = self.mech.effective(mo, push is not None)
        inertia = self.inertia if push is None else mo.mass
        size += np.einsum("bij,bj->bi", np.abs(inertia - mo.mass), np.abs(self.v))
        rhs = np.einsum("bij,bj->bi", inertia, self.v) + h * (
            mo.force - (0.0 if self.mech.implicit else drag)
        )
        if push is not None:
            pull = np.einsum("bij,bj->bi", h_mass, push)
            reached = self.mech.trapezoid(self.q, self.v, self.worlds.u, pull / h)
            doubt, guess = self._doubt(h_mass, mo.force - drag + pull / h, pull / h, reached)
            shaken, lost = self._shaken(h_mass, pull / h, reached)
            rhs = np.einsum("bij,bj->bi", h_mass, reached - push)
            doubt += LEVER * shaken + self._placed(h_mass, pull / h, reached)
            return Drive(h_mass, rhs, size, reached - push, doubt, guess, lost)
        free = solved(h_mass, rhs)
        none = np.zeros(free.shape)
        return Drive(h_mass, rhs, size, free, self._strung(free), none, none[:, 0])

    def leap(self, reached: Array) -> Drive:
        """The leapfrog's equation of motion, whose Euler's step ends at `reached` (B, nv)."""
        euler, of = self.drive(), (self.mech, self.q)
        added, size = late(*of, self.v, self.worlds.u, reached)
        inverse = np.linalg.inv(euler.h_mass)
        terms = euler.size + np.einsum("bij,bj->bi", np.abs(euler.h_mass), np.abs(reached))
        shaken = [reached_by(*of, self.worlds.u, reached, inverse, part) for part in (terms, euler.doubt)]
        rhs, free = euler.rhs + added, euler.free + solved(euler.h_mass, added)
        size, doubt = euler.size + size + shaken[0], euler.doubt + shaken[1]
        return dataclasses.replace(euler, rhs=rhs, size=size, free=free, doubt=doubt)

    def _strung(self, free: Array) -> Array:
        """Products behind springs' forces, C and K: they cancel at right angles to a spring."""
        mo, h = self.motion, self.h[:, None]
        out: Array = h * mo.pulled + h * np.einsum("bij,bj->bi", mo.damped, np.abs(self.v))
        late = (
            h[..., None] * mo.damped * self.mech.implicit
            + 0.5 * h[..., None] ** 2 * mo.stiffened * self.mech.stiff
        )
        return out + np.einsum("bij,bj->bi", late, np.abs(self.v) + np.abs(free))

    def _placed(self, n: Array, push: Array, reached: Array) -> Array:
        """What relative errors of positions make of N reached: no method does better than to solve the step
        of data that are rounded. A stiff spring turns them into forces.
        """
        change = np.zeros(push.shape)
        for j in range(push.shape[1]):
            q = self.q.copy()
            q[:, j] *= 1.0 + SHAKEN
            moved = self.mech.trapezoid(q, self.v, self.worlds.u, push) - reached
            change += np.abs(np.einsum("bij,bj->bi", n, moved)) / SHAKEN
        return change

    def _shaken(self, n: Array, push: Array, reached: Array) -> tuple[Array, Array]:
        """What relative errors of the terms of the method's matrix make of N reached (Skeel's bound), also
        without the predicted forces; and the larger of both as a share of the motion, measured by energy.
        """
        root, lost = np.sqrt(np.einsum("bjj->bj", n)), np.zeros(len(n))
        still = self.mech.trapezoid(self.q, self.v, self.worlds.u, 0.0 * push)
        for force, end in ((0.0 * push, still), (push, reached)):
            change = self.mech.amplified(self.q, self.v, self.worlds.u, force, end)
            moved = root * np.maximum(np.abs(end - self.v), np.abs(self.v))
            lost = np.maximum(lost, (root * change).max(1) / np.maximum(moved.max(1), 1e-300))
        return np.einsum("bij,bj->bi", np.abs(n), change), lost

    def _doubt(self, h_mass: Array, force: Array, push: Array, reached: Array) -> tuple[Array, Array]:
        """What relative errors of the acceleration N^-1 f make of N reached: the method's matrix E holds that
        acceleration, and may be worse conditioned than N. And what those of its part N^-1 push make of the
        right-hand side N reached - h push: where E is stiff next to nothing of N reached, but all of h push.
        """
        weight, part = (
            np.einsum("bij,bj->bi", np.abs(h_mass), np.abs(solved(h_mass, x))) for x in (force, push)
        )
        share = part / np.maximum(weight, 1e-300)
        worst, guess = np.zeros(push.shape), np.zeros(push.shape)
        for j, unit in enumerate(np.eye(push.shape[1])):  # one by one: the worst that any signs add up to
            other = self.mech.trapezoid(self.q, self.v, self.worlds.u, push + SHAKEN * weight * unit)
            change = np.einsum("bij,bj->bi", h_mass, other - reached) / SHAKEN
            taken = change - self.h[:, None] * weight * unit
            worst, guess = worst + np.abs(change), guess + np.abs(taken) * share[:, j : j + 1]
        return worst, guess


def solved(matrix: Array, rhs: Array) -> Array:
    """matrix^-1 rhs, (B, n)."""
    out: Array = np.linalg.solve(matrix, rhs[..., None])[..., 0]
    return out


class Problem:
    """Rows of a method, (B, nr, ...), in the scene's order, and the sizes of their terms.

    Attributes:
        jac: J.
        rate: d/h, of rows that bounce e J_n v, of overlaps no less than the method's speed.
        near: d/h of all.
        stays: rows whose overlap stays in this step.
        parts: e J_n v of pairs.
        bounces: which pairs bounce.
        bound: of |J| entries by what they are the sum of.
        tangent: Coulomb's tangential rows.
        mu: friction coefficients (B, nr).
        a: A = J H^-1 J'.
        diag: its diagonal.
        free: b = J v_free + d/h.
        sigma: noise levels.
        mech, touches: the scene and its contacts as the kernels take them.
        whole: diag of what D is of, where that is another H.
    """

    whole: Array | None = None

    def __init__(
        self, truth: Truth, drive: Drive, method: Method, dtype: str, inner: str | None = None
    ) -> None:
        self.truth, self.drive, self.method, self.dtype = truth, drive, method, dtype
        self.inner = inner or dtype  # the precision that the kernels work in
        self.tolerance = TOLERANCE[dtype] * (ERM_SLACK if method.erm else 1.0)
        self.mech, self.touches = truth.placed(dtype)
        s, p, t = truth.s, truth.mech.p, self.touches
        self.loose = 4.0 * EPSILON[dtype] / TOLERANCE[dtype]  # a rounding error in units of the tolerance
        rows, rates, bounds, mus, sizes, unclear = [], [], [], [], [], []
        zero = np.zeros(truth.q.shape)
        for row in s.rows:
            if row.kind == "limit":
                bound = p["lower" if row.sign > 0 else "upper"][:, row.index]
                unit = zero.copy()
                unit[:, row.index] = row.sign
                q = truth.q[:, row.index]
                rows.append(unit)
                rates.append(row.sign * (q - bound) / truth.h)
                bounds.append(np.abs(unit))
                sizes.append((np.abs(q) + np.abs(bound)) / truth.h)
                mus.append(np.zeros(len(q)))
                unclear.append(np.zeros(len(q), bool))
                continue
            row_, rate, bound, mu = self._contact(t, row.index, row.sign, p["friction"])
            rows.append(row_)
            rates.append(rate)
            bounds.append(bound)
            mus.append(mu)
            sizes.append(np.zeros(len(mu)) if self._is_tangent(row) else t.size[:, row.index] / truth.h)
            several = t.margin[:, row.index] < 40.0 * EPSILON[dtype] * t.size[:, row.index]
            unclear.append(several | (t.bend[:, row.index] * EPSILON[dtype] > TURNED))
        self.tangent = np.array([self._is_tangent(row) for row in s.rows], bool)
        self.jac, self.bound = _stack(rows, zero), _stack(bounds, zero)
        self.rate, self.mu, self.size = (_stack(x, truth.h) for x in (rates, mus, sizes))
        self.unclear = _stack(unclear, truth.h > 0.0)
        self.near = self.rate
        self.parts = np.zeros((len(truth.h), len(s.pairs)))
        self.bounces = self.parts > 0.0
        self.stays = np.zeros(self.near.shape, bool)
        self._hold()
        if s.bounces:
            self.parts, self.bounces, unsure = met(self)
            of_pairs = [row.index if row.kind == "contact" else 0 for row in s.rows]
            contact = np.array([row.kind == "contact" for row in s.rows]) & ~self.tangent
            self.unclear = self.unclear | (unsure[:, of_pairs] & contact)
            self._hold()
        self.sigma = self._sigma()

    def _respond(self) -> None:
        """What follows from J and d/h: A, its diagonal and b."""
        self.a = self.jac @ np.linalg.solve(self.drive.h_mass, np.swapaxes(self.jac, 1, 2))
        self.diag = np.einsum("bii->bi", self.a)
        self.free = self.rate + np.einsum("bij,bj->bi", self.jac, self.drive.free)

    def _hold(self) -> None:
        """Rates: d/h, e J_n v of pairs that bounce, and what overlaps are pushed out with."""
        self.rate = limited(self.method.depenetration_speed, self.near)
        for i, row in enumerate(self.truth.s.rows):
            if row.kind == "contact" and not self.tangent[i]:
                here = self.bounces[:, row.index]
                self.rate[here, i] = self.parts[here, row.index]
        if self.stays.any():
            self.rate = np.where(self.stays, np.maximum(self.rate, room(self)), self.rate)
        self._respond()

    def with_bounces(self, pairs: Sequence[int]) -> "Problem":
        """The same where of the pairs that bounce none but these do."""
        out = copy.copy(self)
        out.bounces = np.zeros_like(self.bounces)
        out.bounces[:, list(pairs)] = self.bounces[:, list(pairs)]
        out._hold()
        return out

    def with_overlaps(self, stays: Array) -> "Problem":
        """The same where the overlaps of these rows (B, nr) stay."""
        out = copy.copy(self)
        out.stays = stays
        out._hold()
        return out

    def start_from(self, rate: Array) -> None:
        """Take other values of d/h."""
        self.free, self.rate, self.near = self.free + rate - self.rate, rate, rate

    def ease(self, told: Array | None = None) -> None:
        """Take overlaps for less by what rounding of lengths may have made of them, or for what they are
        `told` to be (B, nr) [m] where that is not more. In J, too: what turns both sides of a contact as one
        moves them along its surface alone, by the distance.
        """
        s = self.truth.s
        most = self.near + np.clip(-self.near, 0.0, GIVEN[self.dtype] * self.size)
        self.near = most if told is None else np.clip(told / self.truth.h[:, None], self.near, most)
        for i, row in enumerate(s.rows):
            if row.kind == "contact":
                pair, tangent = s.pairs[row.index], self.tangent[i]
                sides = [s.shapes[shape].body for shape in (pair.shape_a, pair.shape_b)]
                both = [j for j in range(s.nv) if all(s.turns(body, j) for body in sides)]
                slope = 0.0 if self.method.coulomb else row.sign * self.mu[:, i]
                gap = self.near[:, i - tangent] * self.truth.h
                self.jac[:, i, both] = (gap * np.where(tangent, 1.0, slope))[:, None]
        self._hold()

    def _is_tangent(self, row: object) -> bool:
        return self.method.coulomb and row.kind == "contact" and row.sign < 0  # type: ignore[attr-defined]

    def _contact(self, t: Touches, k: int, sign: int, friction: Array) -> tuple[Array, Array, Array, Array]:
        """J, d/h, the bound of J's entries and mu of a contact's row."""
        mu = friction[:, k] + np.zeros(len(t.gap))
        turned = np.maximum(1.0, t.bend[:, k] * self.loose)[:, None]
        bound = (np.abs(t.normal[:, k]) + np.abs(t.tangent[:, k])) * turned
        turning = np.array([kind == "revolute" for kind in self.truth.s.dof_kind])
        lever = turning * t.size[:, k, None] * LEVER * self.loose
        bound = (bound + lever) * (1.0 + mu[:, None])
        if self.method.coulomb and sign < 0:
            return t.tangent[:, k], np.zeros(len(mu)), bound, mu
        slope = 0.0 if self.method.coulomb else sign * mu[:, None]
        return t.normal[:, k] + slope * t.tangent[:, k], t.gap[:, k] / self.truth.h, bound, mu

    def _sigma(self) -> Array:
        p, method = self.truth.mech.p, self.method
        if method.hard:
            return np.zeros(self.rate.shape)
        sigma = p["sigma"] + np.zeros(self.rate.shape)
        if method.state_noise:
            noise = p["position_covariance"] / self.truth.h[:, None, None] ** 2 + p["velocity_covariance"]
            variance = np.einsum("bri,bij,brj->br", self.jac, noise, self.jac)
            sigma = np.sqrt(np.maximum(variance, 0.0) + 1e-12)
        return sigma * (LOGISTIC if method.converts else 1.0)

    @property
    def loss(self) -> Array:
        """How many times the tolerance the digits are that H^-1 costs of velocities (B,), at least 1: its own
        rounding, that of A, and of the sum v_free + H^-1 J' lambda. What H v' itself misses is a rounding, v'
        being refined (with the trapezoidal method as much as v_free).
        """
        lost = LEVER * self.condition * EPSILON[self.inner] / self.tolerance
        out: Array = np.clip(lost, 1.0, LOST_ROWS[self.dtype])
        return out

    @property
    def turned(self) -> Array:
        """Whether rounding turns a row's normal by more than the tolerance (B, nr)."""
        rows = [(row.kind == "contact", row.index) for row in self.truth.s.rows]
        bends = [self.touches.bend[:, k] if contact else 0.0 * self.truth.h for contact, k in rows]
        return _stack([bend * self.loose > 1.0 for bend in bends], self.truth.h > 0.0)

    @property
    def digitless(self) -> Array:
        """Where the matrices of the step may be said to have no digits (B,): H, or the trapezoidal method's,
        whose accelerations have lost the digits of H's condition.
        """
        out: Array = self.condition * EPSILON[self.inner] > MOST_LOSS
        return out | (self.shaken > REFUSED)

    @property
    def shaken(self) -> Array:
        """The share of the motion (B,) that roundings in the trapezoidal method's matrix make."""
        out: Array = self.drive.lost * (1.0 + self.condition / SUMMED) * EPSILON[self.inner]
        return out

    @functools.cached_property
    def condition(self) -> Array:
        """Condition of H in units of its diagonal (B,)."""
        root = np.sqrt(np.einsum("bjj->bj", self.drive.h_mass))
        out: Array = np.linalg.cond(self.drive.h_mass / (root[:, :, None] * root[:, None]))
        return out

    @property
    def scale(self) -> Array:
        """D (B, nr)."""
        diag = self.diag if self.whole is None else self.whole
        return np.maximum(diag, FLOOR) if self.method.inertia_scaling else np.ones(diag.shape)

    def terms(self, velocity: Array) -> Array:
        """Sizes (B, nr) of the terms of J v + d/h for velocities of this size."""
        return np.abs(self.rate) + self.loose * self.size + np.einsum("bij,bj->bi", self.bound, velocity)


def _stack(parts: list[Array], like: Array) -> Array:
    """Parts (B, ...) side by side in a new second axis, of extent 0 where there are none."""
    return np.stack(parts, 1) if parts else like[:, None][:, :0]
