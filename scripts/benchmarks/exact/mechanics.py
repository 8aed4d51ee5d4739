"""Equations of motion of hinged planar bodies with one pair of ellipses, in float64 and apart from kernels.

A point of the plane is a complex number, a turn a product with e^(i angle). A body's joint is at o, its
velocity field is V(p) = V(o) + i omega (p - o), and at zero joint accelerations its material point p has the
acceleration a(p) = a(o) - omega^2 (p - o). NumPy alone.
"""

import cmath
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slcp_warp import Scene, SceneError, Shape

SEARCH = 128  # directions in which the distance is searched
Array = np.ndarray


class Frame(NamedTuple):
    """Motion of a body: angle, rate; joint's position, velocity and acceleration at q'' = 0."""

    angle: float
    rate: float
    at: complex
    velocity: complex
    acceleration: complex

    def moving(self, point: complex) -> tuple[complex, complex]:
        """Velocity of the body's material point, and its acceleration at q'' = 0."""
        arm = point - self.at
        return self.velocity + 1j * self.rate * arm, self.acceleration - self.rate**2 * arm


class Touch(NamedTuple):
    """The pair: gap [m], rows J_n, J_t (nv,), velocities J_n v, J_t v, and their rates at q'' = 0."""

    gap: float
    normal: Array
    tangent: Array
    normal_speed: float
    tangent_speed: float
    normal_bias: float
    tangent_bias: float


REST = Frame(0.0, 0.0, 0j, 0j, 0j)


@dataclass(frozen=True)
class Limit:
    """A joint limit: sign (q[dof] - bound) >= 0."""

    dof: int
    sign: float
    bound: float


class Mechanism:
    """Mass matrix, forces, contact rows and energy of a scene of revolute bodies.

    Attributes:
        nv: degrees of freedom.
        limits: of the joints.
        touches: whether there is a pair.
        friction: of it.

    Raises:
        SceneError: another joint, a spring, a tendon, or more than one contact, or others than ellipses
            and discs.
    """

    def __init__(self, scene: Scene) -> None:
        names = [body.name for body in scene.bodies]
        for body in scene.bodies:
            if body.joint != "revolute" or body.stiffness is not None:
                raise SceneError(f"body {body.name!r}: events take revolute joints without springs")
        if scene.springs or scene.tendons or len(scene.all_contacts) > 1:
            raise SceneError(f"scene {scene.name!r}: events take no springs, no tendons, one contact at most")
        self.nv = scene.nv
        self.parents = [None if b.parent is None else names.index(b.parent) for b in scene.bodies]
        self.bodies = scene.bodies
        self.gravity = complex(*scene.gravity)
        numbers = scene.default_parameters()
        self.damping = numbers["damping"]
        self.limits = tuple(
            Limit(i, sign, float(bound))
            for i, body in enumerate(scene.bodies)
            for sign, bound in ((1.0, body.lower), (-1.0, body.upper))
            if isinstance(bound, (int, float))
        )
        self.touches = bool(scene.all_contacts)
        self.friction = float(numbers["friction"][0]) if self.touches else 0.0
        self.pair: tuple[tuple[Shape, int | None], ...] = ()
        if self.touches:
            shapes = {shape.name: shape for shape in scene.shapes}
            pair = scene.all_contacts[0]
            for shape in (shapes[pair.shape_a], shapes[pair.shape_b]):
                if shape.kind not in ("ellipse", "disc"):
                    raise SceneError(f"shape {shape.name!r}: events take ellipses and discs")
                self.pair += ((shape, None if shape.body is None else names.index(shape.body)),)
        self._normal = 0.0  # angle of the last normal: where the next search starts

    # ---------------------------------------------------------------- motion

    def frames(self, q: Array, v: Array) -> list[Frame]:
        """Every body's motion."""
        out: list[Frame] = []
        for b, body in enumerate(self.bodies):
            parent = self.parents[b]
            base = REST if parent is None else out[parent]
            at = base.at + cmath.rect(1.0, base.angle) * complex(*body.anchor)
            velocity, acceleration = base.moving(at)
            out.append(Frame(base.angle + body.angle + float(q[b]), base.rate + float(v[b]), at, velocity,
                             acceleration))  # fmt: skip
        return out

    def jacobian(self, frames: list[Frame], body: int | None, point: complex) -> list[complex]:
        """Velocity of a body's material point for a unit rate of every joint."""
        out = [0j] * self.nv
        while body is not None:
            out[body] = 1j * (point - frames[body].at)
            body = self.parents[body]
        return out

    def dynamics(self, frames: list[Frame], v: Array) -> tuple[Array, Array]:
        """M (nv, nv) and r (nv,) of M q'' = r + J' f: inertial forces, gravity and damping."""
        mass, force = np.zeros((self.nv, self.nv)), -self.damping * v
        for b, body in enumerate(self.bodies):
            frame = frames[b]
            centre = frame.at + cmath.rect(1.0, frame.angle) * complex(*body.com)
            push = body.mass * (self.gravity - frame.moving(centre)[1])
            jac = self.jacobian(frames, b, centre)
            chain = []
            j: int | None = b
            while j is not None:
                chain.append(j)
                j = self.parents[j]
            for i in chain:
                force[i] += (jac[i].conjugate() * push).real
                for k in chain:
                    mass[i, k] += body.mass * (jac[i].conjugate() * jac[k]).real + body.inertia
        return mass, force

    def energy(self, q: Array, v: Array) -> float:
        """Kinetic energy and that of gravity [J]."""
        total, frames = 0.0, self.frames(q, v)
        for body, frame in zip(self.bodies, frames):
            centre = frame.at + cmath.rect(1.0, frame.angle) * complex(*body.com)
            speed = abs(frame.moving(centre)[0])
            total += 0.5 * body.mass * speed**2 + 0.5 * body.inertia * frame.rate**2
            total -= body.mass * (self.gravity.conjugate() * centre).real
        return total

    def derivative(self, t: float, x: Array) -> Array:
        """x' of the state x = (q, v) where nothing touches."""
        q, v = x[: self.nv], x[self.nv :]
        return np.concatenate([v, np.linalg.solve(*self.dynamics(self.frames(q, v), v))])

    # ---------------------------------------------------------------- contact

    def _ellipses(self, frames: list[Frame]) -> list[tuple[complex, float, float, float]]:
        out = []
        for shape, body in self.pair:
            frame = REST if body is None else frames[body]
            radius = shape.radius if isinstance(shape.radius, tuple) else (shape.radius,)
            at = frame.at + cmath.rect(1.0, frame.angle) * complex(*shape.offset)
            out.append((at, frame.angle + shape.angle, float(radius[0]), float(radius[-1])))
        return out

    def gap(self, q: Array) -> float:
        """Signed distance of the pair; the normal is searched all round and kept for `touch`."""
        (ca, ta, ax, ay), (cb, tb, bx, by) = self._ellipses(self.frames(q, np.zeros(self.nv)))
        angle = 2.0 * math.pi / SEARCH * np.arange(SEARCH)
        along = (np.exp(-1j * angle) * (cb - ca)).real
        along -= np.hypot(ax * np.cos(angle - ta), ay * np.sin(angle - ta))
        along -= np.hypot(bx * np.cos(angle - tb), by * np.sin(angle - tb))
        self._normal = float(angle[along.argmax()])
        return self._stationary(ca, ta, ax, ay, cb, tb, bx, by)[1]

    def _stationary(self, ca: complex, ta: float, ax: float, ay: float, cb: complex, tb: float, bx: float,
                    by: float) -> tuple[float, float, tuple[float, ...], tuple[float, ...]]:  # fmt: skip
        """Normal's angle, gap, and supports (h, h', rho) of both, by Newton's method from the last normal."""
        angle, step = self._normal, math.inf
        for _ in range(50):
            a, b = support(angle - ta, ax, ay), support(angle - tb, bx, by)
            delta = cmath.rect(1.0, -angle) * (cb - ca)
            gap = delta.real - a[0] - b[0]
            if abs(step) < 1e-8:  # quadratic: this angle is right to rounding
                break
            curvature = gap + a[2] + b[2]
            step = (delta.imag - a[1] - b[1]) / curvature if curvature > 0.0 else 0.02
            angle += max(-0.1, min(0.1, step))
        self._normal = angle
        return angle, gap, a, b

    def touch(self, frames: list[Frame], v: Array) -> Touch:
        """The pair's rows at a state, with the time derivatives of their velocities at q'' = 0.

        The normal turns at the rate alpha' with (d + rho_A + rho_B) alpha' = t.(c_B - c_A)' + sum of h'' w,
        and the touched points run along their outlines with it.
        """
        (ca, ta, ax, ay), (cb, tb, bx, by) = self._ellipses(frames)
        angle, gap, a, b = self._stationary(ca, ta, ax, ay, cb, tb, bx, by)
        n = cmath.rect(1.0, angle)
        t = 1j * n
        pa, pb = ca + a[0] * n + a[1] * t, cb - b[0] * n - b[1] * t
        body_a, body_b = self.pair[0][1], self.pair[1][1]
        fa = REST if body_a is None else frames[body_a]
        fb = REST if body_b is None else frames[body_b]
        (va, acc_a), (vb, acc_b) = fa.moving(pa), fb.moving(pb)
        u, acc = vb - va, acc_b - acc_a
        jac = [y - x for x, y in zip(self.jacobian(frames, body_a, pa), self.jacobian(frames, body_b, pb))]
        centres = fb.moving(cb)[0] - fa.moving(ca)[0]
        turning = dot(t, centres) + (a[2] - a[0]) * fa.rate + (b[2] - b[0]) * fb.rate
        turning /= gap + a[2] + b[2]
        slide = fb.rate * b[2] * (turning - fb.rate) + fa.rate * a[2] * (turning - fa.rate)
        return Touch(
            gap,
            np.array([dot(n, c) for c in jac]),
            np.array([dot(t, c) for c in jac]),
            dot(n, u),
            dot(t, u),
            turning * dot(t, u) + dot(n, acc) + slide,
            -turning * dot(n, u) + dot(t, acc),
        )


def dot(a: complex, b: complex) -> float:
    """a.b of two vectors of the plane."""
    return a.real * b.real + a.imag * b.imag


def support(angle: float, x: float, y: float) -> tuple[float, float, float]:
    """h, h' and the radius of curvature rho = h + h'' of an ellipse, at a direction in its own axes."""
    c, s = math.cos(angle), math.sin(angle)
    h = math.hypot(x * c, y * s)
    return h, (y * y - x * x) * c * s / h, (x * y) ** 2 / h**3
