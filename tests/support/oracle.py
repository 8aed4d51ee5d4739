"""An independent float64 account of one time step, in NumPy alone: the truth that the kernels are judged by.

Nothing here follows the kernels' closed forms. Poses of the bodies are maximal coordinates as functions of q;
their first derivatives come from complex steps, their second ones from a contour integral in the complex
plane; M and r(q, v) are the bodies' own Newton-Euler equations projected on those derivatives. Distances are
found by trying directions all round and bisecting; touched points come from the ellipses' parametric form and
their Jacobians from complex steps of body-fixed points. Functions take any leading batch axes: q (..., nv).

With implicit damping (`Scene.implicit_damping`) the dampers' forces act with the velocity v' and M + h C
stands where the step is solved, C from forces at unit velocities. With implicit stiffness
(`Scene.implicit_stiffness`) h^2/2 K stands there as well: springs pull with what they would at q + h/2 (v' -
v), but for the part of their stiffness that is not positive.

Step (1), (17): M v' = h (r + u) + M v + J' lambda,  a = D lambda,  b = J v' + d / h,  a - s(a - b) = 0, or
min(a, b) = 0 for the hard problem.
"""

import numpy as np
from oracle_overlap import direction, leaving
from oracle_solvers import softplus, solve_hard, solve_hard_by_trial, solve_smooth

__all__ = ["Oracle", "residual", "softplus", "solve_hard", "solve_hard_by_trial", "solve_smooth"]

WORLD = -1
COMPLEX_STEP = 1e-30
DIRECTIONS = 720


def complex_step(function, q):
    """Jacobian (..., outputs, n) of an analytic function of q (..., n) -> (..., outputs)."""
    n = q.shape[-1]
    moved = q + 1j * COMPLEX_STEP * np.eye(n).reshape((n,) + (1,) * (q.ndim - 1) + (n,))
    return np.moveaxis(function(moved).imag / COMPLEX_STEP, 0, -1)


def second_along(function, q, v, points=32):
    """d^2/de^2 function(q + e v) at e = 0, by Cauchy's integral over a circle in the complex plane."""
    radius = 1.0 / max(1.0, float(np.max(np.abs(v), initial=0.0)))
    circle = np.exp(2j * np.pi * np.arange(points) / points).reshape((points,) + (1,) * q.ndim)
    values = function(q + radius * circle * v)
    weight = circle.reshape((points,) + (1,) * (values.ndim - 1)) ** -2
    return 2.0 * np.mean(values * weight, axis=0).real / radius**2


class Oracle:
    """Truth about one scene; `changes` replace its numbers, batch axes first."""

    def __init__(self, scene, **changes):
        self.scene, self.structure = scene, scene.structure
        self.p = {k: np.asarray(v, float) for k, v in {**scene.default_parameters(), **changes}.items()}
        self.nv, self.nu, self.nr = self.structure.nv, self.structure.nu, self.structure.nr
        if self.p["sigma"].ndim == 0:
            self.p["sigma"] = np.full(self.nr, float(self.p["sigma"]))
        rings = np.array([shape.kind == "ring" for shape in self.structure.shapes], bool)
        self.p["radius"] = np.where(rings[:, None], -1.0, 1.0) * self.p["radius"]  # discs of negative radius

    def frames(self, q):
        """Angle (...) and origin (..., 2) of every body, complex if q is."""
        p, out = self.p, []
        for i, body in enumerate(self.structure.bodies):
            at = p["anchor"][..., i, :]
            turn = p["angle"][..., i]
            mine = [q[..., j] for j in body.dofs]
            if body.joint == "revolute":
                turn = turn + mine[0]
            elif body.joint == "prismatic":
                at = at + p["axis"][..., i, :] * mine[0][..., None]
            else:
                at = at + np.stack(mine[:2], -1)
                turn = turn + mine[2]
            if body.parent == WORLD:
                at = at + 0.0 * q[..., :1]
                turn = turn + 0.0 * q[..., 0]
            else:
                base_turn, base = out[body.parent]
                at = base + rotate(base_turn, at)
                turn = base_turn + turn
            out.append((turn, at))
        return out

    def point(self, q, body, local):
        """World position (..., 2) of a body-fixed point."""
        if body == WORLD:
            return local + 0.0 * q[..., :1]
        turn, at = self.frames(q)[body]
        return at + rotate(turn, local)

    def poses(self, q):
        """Maximal coordinates (..., 3 nb): centre of mass and angle of every body."""
        parts = []
        for i, (turn, at) in enumerate(self.frames(q)):
            com = self.p["com"][..., i, :]
            parts += [at + rotate(turn, com), turn[..., None]]
        return np.concatenate(parts, axis=-1)

    def inertias(self):
        """Diagonal of the maximal mass matrix (..., 3 nb)."""
        m, i = self.p["mass"], self.p["inertia"]
        return np.stack([m, m, i], -1).reshape(m.shape[:-1] + (-1,))

    def mass_matrix(self, q):
        """M(q), (..., nv, nv)."""
        g = complex_step(self.poses, q)
        own = self.p["armature"][..., None] * np.eye(self.nv) if self.structure.armature else 0.0
        return np.einsum("...ki,...k,...kj->...ij", g, self.inertias(), g) + own

    def force(self, q, v, u=None, external=None):
        """r(q, v) + gear u + external wrenches (..., nb, 3) at the centres of mass, as (..., nv)."""
        g = complex_step(self.poses, q)
        wrench = np.zeros(np.broadcast_shapes(g.shape[:-1], self.inertias().shape))
        wrench -= self.inertias() * second_along(self.poses, q, v)
        for i in range(self.structure.nb):
            wrench[..., 3 * i : 3 * i + 2] += self.p["mass"][..., i, None] * self.p["gravity"]
        if external is not None:
            wrench += np.asarray(external, float).reshape(np.shape(external)[:-2] + (-1,))
        out = np.einsum("...ki,...k->...i", g, wrench) - self.p["damping"] * v
        if self.structure.sprung:
            out = out - self.p["stiffness"] * (q - self.p["rest"])
        for i in range(len(self.structure.springs)):
            out = out + self.spring_force(q, v, i)
        for i, along in enumerate(self.tendons()):
            k, d, length = (self.p[f"tendon_{n}"][..., i] for n in ("stiffness", "damping", "length"))
            tension = k * (np.sum(along * q, -1) - length) + d * np.sum(along * v, -1)
            out = out - tension[..., None] * along
        if u is not None:
            for i, dof in enumerate(self.structure.actuators):
                way = np.eye(self.nv)[dof] if dof >= 0 else self.tendons()[-1 - dof]
                out = out + np.multiply(self.p["gear"][..., i], u[..., i])[..., None] * way
        return out

    def tendons(self):
        """dl/dq (..., nv) of every tendon: its coefficients, which come one tendon after the other."""
        starts = np.cumsum([0, *map(len, self.structure.tendons)])
        return [self.p["tendon_coefficient"][..., a : a + len(dofs)] @ np.eye(self.nv)[list(dofs)]
                for a, dofs in zip(starts, self.structure.tendons)]  # fmt: skip

    def spring_force(self, q, v, i):
        """Generalised force (..., nv) of spring i: k (l - L) + c dl/dt towards the other end, where the
        length l is rounded off at zero.
        """
        ends = self.p["spring_point"][..., i, :, :]
        a, b = self.structure.springs[i]

        def span(z):
            return self.point(z, b, ends[..., 1, :]) - self.point(z, a, ends[..., 0, :])

        delta, jac = span(q), complex_step(span, q)
        short = 1e-3 * self.p["spring_length"][..., i] + 1e-5
        length = np.sqrt(np.sum(delta * delta, axis=-1) + short**2)
        rate = np.einsum("...i,...ij,...j->...", delta, jac, v) / length
        pull = self.p["spring_stiffness"][..., i] * (length - self.p["spring_length"][..., i])
        pull = pull + self.p["spring_damping"][..., i] * rate
        return -np.einsum("...,...i,...ij->...j", pull / length, delta, jac)

    def damping_matrix(self, q):
        """C(q), (..., nv, nv): what dampers oppose to unit velocities."""
        joints = self.p["damping"][..., None] * np.eye(self.nv) + 0.0 * q[..., None]
        for i in range(len(self.structure.springs)):
            still = self.spring_force(q, np.zeros(q.shape), i)
            moved = [self.spring_force(q, 0.0 * q + unit, i) - still for unit in np.eye(self.nv)]
            joints = joints - np.stack(moved, axis=-1)
        for i, along in enumerate(self.tendons()):
            damping = self.p["tendon_damping"][..., i]
            joints = joints + np.einsum("...,...i,...j->...ij", damping, along, along)
        return joints

    def stiffness_matrix(self, q):
        """K(q), (..., nv, nv): joint springs; of those between points k along the line, k (1 - L/l) across it
        where they pull.
        """
        out = 0.0 * q[..., None] * np.eye(self.nv)
        if self.structure.sprung:
            out = out + np.maximum(self.p["stiffness"], 0.0)[..., None] * np.eye(self.nv)
        for i, (a, b) in enumerate(self.structure.springs):
            ends, rest = self.p["spring_point"][..., i, :, :], self.p["spring_length"][..., i]

            def span(z, a=a, b=b, ends=ends):
                return self.point(z, b, ends[..., 1, :]) - self.point(z, a, ends[..., 0, :])

            delta, jac = span(q), complex_step(span, q)
            length = np.sqrt(np.sum(delta * delta, axis=-1) + (1e-3 * rest + 1e-5) ** 2)
            along = np.einsum("...i,...ij->...j", delta / length[..., None], jac)
            loose = np.maximum(1.0 - rest / length, 0.0)[..., None, None]
            part = loose * np.einsum("...ki,...kj->...ij", jac, jac)
            part = part + (1.0 - loose) * along[..., :, None] * along[..., None, :]
            out = out + np.maximum(self.p["spring_stiffness"][..., i, None, None], 0.0) * part
        for i, along in enumerate(self.tendons()):
            stiff = np.maximum(self.p["tendon_stiffness"][..., i], 0.0)
            out = out + np.einsum("...,...i,...j->...ij", stiff, along, along)
        return out

    def energy(self, q, v):
        """Kinetic plus potential energy (...)."""
        pose = self.poses(q).reshape(q.shape[:-1] + (-1, 3))
        height = np.einsum("...bi,...i->...b", pose[..., :2], np.broadcast_to(self.p["gravity"], (2,)))
        kinetic = 0.5 * np.einsum("...i,...ij,...j->...", v, self.mass_matrix(q), v)
        return kinetic - np.sum(self.p["mass"] * height, -1)

    def shape_pose(self, q, shape, end=0):
        """Centre (..., 2) and world angle (...) of a shape, or of the disc at an end of a capsule or a
        rectangle's corner.
        """
        body = self.structure.shapes[shape].body
        along = np.zeros(self.p["radius"].shape[:-2] + (2,))
        if self.structure.shapes[shape].kind == "rectangle" and end:
            along = self.core(shape) * {2: (-1, -1), 3: (1, -1), 4: (1, 1), 5: (-1, 1)}[end]
        elif end:
            along[..., 0] = end * self.p["radius"][..., shape, 1]
        reach = rotate(self.p["shape_angle"][..., shape], along)
        at = self.point(q, body, self.p["shape_offset"][..., shape, :] + reach)
        turn = self.p["shape_angle"][..., shape] + 0.0 * q[..., 0]
        return at, turn if body == WORLD else turn + self.frames(q)[body][0]

    def core(self, shape):
        """Half sizes (..., 2) of a rectangle without its rounding."""
        return self.p["radius"][..., shape, :] - self.p["corner_radius"][..., shape, None]

    def support(self, shape, turn, angle, end=0):
        """Largest extent (...) of a round shape along the direction `angle`; analytic in `angle`."""
        rx, ry = self.p["radius"][..., shape, 0], self.p["radius"][..., shape, 1]
        if self.structure.shapes[shape].kind == "rectangle":
            half, corner = self.core(shape), self.p["corner_radius"][..., shape]
            sides = [np.sqrt((half[..., i] * f(angle - turn)) ** 2) for i, f in enumerate((np.cos, np.sin))]
            return corner + (0.0 * (angle - turn) if end else sides[0] + sides[1])
        if self.structure.shapes[shape].kind in ("disc", "ring") or end:
            return rx + 0.0 * (angle - turn)
        if self.structure.shapes[shape].kind == "capsule":
            return rx + np.sqrt((ry * np.cos(angle - turn)) ** 2)
        return np.sqrt((rx * np.cos(angle - turn)) ** 2 + (ry * np.sin(angle - turn)) ** 2)

    def farthest(self, shape, centre, turn, angle, end=0):
        """The boundary point (..., 2) that is farthest along `angle`, by the shape's parametric form."""
        rx, ry = self.p["radius"][..., shape, 0], self.p["radius"][..., shape, 1]
        if self.structure.shapes[shape].kind in ("disc", "ring") or end:
            if self.structure.shapes[shape].kind == "rectangle":
                rx = self.p["corner_radius"][..., shape]
            return centre + rx[..., None] * direction(angle)
        parameter = np.arctan2(ry * np.sin(angle - turn), rx * np.cos(angle - turn))
        return centre + rotate(turn, np.stack([rx * np.cos(parameter), ry * np.sin(parameter)], -1))

    def ends(self, q, k):
        """Centres (..., 2) and world angles (...) of both shapes of pair k: of A, then of B."""
        pair = self.structure.pairs[k]
        return *self.shape_pose(q, pair.shape_a, pair.end_a), *self.shape_pose(q, pair.shape_b, pair.end_b)

    def separation(self, ends, k, angle):
        """n.(c_B - c_A) - h_A(n) - h_B(-n) of pair k along `angle`, from its `ends`."""
        pair = self.structure.pairs[k]
        ca, ta, cb, tb = ends
        along = np.sum(direction(angle) * (cb - ca), -1) - self.support(pair.shape_a, ta, angle, pair.end_a)
        return along - self.support(pair.shape_b, tb, angle + np.pi, pair.end_b)

    def normal_angle(self, q, k):
        """Angle (...) of the normal of pair k, and by how much it beats other maxima (inf: the only one)."""
        pair = self.structure.pairs[k]
        kinds = [self.structure.shapes[i].kind for i in (pair.shape_a, pair.shape_b)]
        if "halfplane" in kinds:
            turn = self.shape_pose(q, (pair.shape_a, pair.shape_b)[kinds.index("halfplane")])[1]
            return turn + np.pi * kinds.index("halfplane"), np.full(turn.shape, np.inf)
        if "ring" in kinds:  # against the line of centres
            across = self.ends(q, k)[0] - self.ends(q, k)[2]
            return np.arctan2(across[..., 1], across[..., 0]), np.full(q.shape[:-1], np.inf)
        grid = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
        ends = self.ends(q, k)
        tried = self.separation(ends, k, grid.reshape((-1,) + (1,) * (q.ndim - 1)))
        peak = (tried >= np.roll(tried, 1, 0)) & (tried > np.roll(tried, -1, 0))
        best = np.argmax(tried, 0)
        rivals = np.sort(np.where(peak, tried, -np.inf), axis=0)
        lo, hi = grid[best] - grid[1], grid[best] + grid[1]
        for _ in range(60):
            mid = 0.5 * (lo + hi)
            rising = self.separation(ends, k, mid + 1j * COMPLEX_STEP).imag > 0.0
            lo, hi = np.where(rising, mid, lo), np.where(rising, hi, mid)
        angle = 0.5 * (lo + hi)
        if kinds == ["rectangle", "rectangle"]:
            angle = leaving(self, q, k, angle, self.separation(ends, k, angle))
        return angle, rivals[-1] - rivals[-2]

    def contact(self, q, k):
        """Pair k: gap, normal's angle (...), touched points (..., 2) on A and B, uniqueness margin (...)."""
        pair = self.structure.pairs[k]
        a, b = pair.shape_a, pair.shape_b
        angle, margin = self.normal_angle(q, k)
        ends = ca, ta, cb, tb = self.ends(q, k)
        kind_a = "disc" if pair.end_a else self.structure.shapes[a].kind
        kind_b = "disc" if pair.end_b else self.structure.shapes[b].kind
        n = direction(angle)
        if kind_a in ("halfplane", "capsule", "rectangle"):
            pb = self.farthest(b, cb, tb, angle + np.pi, pair.end_b)
            gap = np.sum(n * (pb - ca), -1) if kind_a == "halfplane" else self.separation(ends, k, angle)
            pa = pb - gap[..., None] * n
        elif kind_b in ("halfplane", "capsule", "rectangle"):
            pa = self.farthest(a, ca, ta, angle, pair.end_a)
            gap = np.sum(n * (cb - pa), -1) if kind_b == "halfplane" else self.separation(ends, k, angle)
            pb = pa + gap[..., None] * n
        else:
            pa = self.farthest(a, ca, ta, angle, pair.end_a)
            pb = self.farthest(b, cb, tb, angle + np.pi, pair.end_b)
            gap = self.separation(ends, k, angle)
        return gap, angle, pa, pb, margin

    def contact_jacobian(self, q, k):
        """Gap (...), normal and tangential rows (..., nv) and uniqueness margin (...) of pair k."""
        pair = self.structure.pairs[k]
        gap, angle, pa, pb, margin = self.contact(q, k)
        moving = []
        for shape, at in ((pair.shape_a, pa), (pair.shape_b, pb)):
            body = self.structure.shapes[shape].body
            if body == WORLD:
                moving.append(np.zeros(q.shape[:-1] + (2, self.nv)))
                continue
            turn, origin = self.frames(q)[body]
            local = rotate(-turn, at - origin)
            moving.append(complex_step(lambda z, body=body, local=local: self.point(z, body, local), q))
        relative = moving[1] - moving[0]
        n, t = direction(angle), direction(angle + np.pi / 2)
        along = np.einsum("...i,...ij->...j", t, relative)
        for i in (pair.shape_a, pair.shape_b) if self.structure.runs else ():  # zero where no surface runs
            along[..., self.structure.shapes[i].driver] -= self.p["surface_ratio"][..., i]
        return gap, np.einsum("...i,...ij->...j", n, relative), along, margin

    def rows(self, q):
        """Gaps d (..., nr), Jacobian J (..., nr, nv), uniqueness margin (...), in the scene's row order."""
        pairs = [self.contact_jacobian(q, k) for k in range(len(self.structure.pairs))]
        gaps, rows = [], []
        for row in self.structure.rows:
            if row.kind == "limit":
                bound = self.p["lower" if row.sign > 0 else "upper"][..., row.index]
                gaps.append(row.sign * (q[..., row.index] - bound))
                unit = np.zeros(q.shape)
                unit[..., row.index] = row.sign
                rows.append(unit)
            else:
                gap, jn, jt, _ = pairs[row.index]
                gaps.append(gap)
                rows.append(jn + row.sign * self.p["friction"][..., row.index, None] * jt)
        margin = np.min([pair[3] for pair in pairs], axis=0) if pairs else np.full(q.shape[:-1], np.inf)
        if not rows:
            return np.zeros(q.shape[:-1] + (0,)), np.zeros(q.shape[:-1] + (0, self.nv)), margin
        return np.stack(np.broadcast_arrays(*gaps), -1), np.stack(np.broadcast_arrays(*rows), -2), margin

    def problem(self, x, u=None, external=None, scaling="inertia"):
        """What one step solves: a dict of M (or M + h C + h^2/2 K), f = M vfree, J, d, rate = d / h, A, b, D,
        sigma, h, margin.
        """
        q, v = x[..., : self.nv], x[..., self.nv :]
        h = self.p["step_size"]
        mass = self.mass_matrix(q)
        f = h[..., None] * self.force(q, v, u, external) + np.einsum("...ij,...j->...i", mass, v)
        if self.scene.implicit_damping:
            drag = h[..., None, None] * self.damping_matrix(q)
            f = f + np.einsum("...ij,...j->...i", drag, v)
            mass = mass + drag
        if self.scene.implicit_stiffness:
            late = 0.5 * h[..., None, None] ** 2 * self.stiffness_matrix(q)
            f = f + np.einsum("...ij,...j->...i", late, v)
            mass = mass + late
        d, jac, margin = self.rows(q)
        vfree = np.linalg.solve(mass, f[..., None])[..., 0]
        a = jac @ np.linalg.solve(mass, np.swapaxes(jac, -1, -2))
        diag = np.einsum("...ii->...i", a)
        rate = d / h[..., None]
        return {
            "M": mass, "f": f, "vfree": vfree, "J": jac, "d": d, "rate": rate, "A": a, "h": h,
            "margin": margin,
            "b": rate + np.einsum("...ij,...j->...i", jac, vfree),
            "D": np.ones(diag.shape) if scaling == "none" else diag,
            "sigma": np.broadcast_to(self.p["sigma"], diag.shape),
        }  # fmt: skip

    def step(self, x, u=None, external=None, scaling="inertia", hard=False):
        """Next state (..., 2 nv) and impulses (..., nr)."""
        problem = self.problem(x, u, external, scaling)
        v, impulse = (solve_hard if hard else solve_smooth)(problem)
        q = x[..., : self.nv] + problem["h"][..., None] * v
        return np.concatenate([q, v], -1), impulse


def rotate(angle, vector):
    """`vector` (..., 2) turned by `angle` (...)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * vector[..., 0] - s * vector[..., 1], s * vector[..., 0] + c * vector[..., 1]], -1)


def residual(problem, v, impulse, hard=False):
    """r1 = M v' - f - J' lambda (..., nv) and r2 = a - s(a - b), or min(a, b) when hard (..., nr)."""
    r1 = np.einsum("...ij,...j->...i", problem["M"], v) - problem["f"]
    r1 = r1 - np.einsum("...ij,...i->...j", problem["J"], impulse)
    a = problem["D"] * impulse
    b = problem["rate"] + np.einsum("...ij,...j->...i", problem["J"], v)
    if hard:
        return r1, np.minimum(a, b)
    # min(a, b) - s(-|a - b|) is the same number without cancellation
    return r1, np.minimum(a, b) - problem["sigma"] * np.log1p(np.exp(-np.abs(a - b) / problem["sigma"]))
