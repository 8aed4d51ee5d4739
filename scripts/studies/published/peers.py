"""The published problems in crocoddyl and mim_solvers: `python peers.py` prints a row of JSON each.

It runs in an environment of their own (`pip install crocoddyl mim_solvers`) and imports nothing of this
package. The linear-quadratic problem is crocoddyl's own C++ model; the others are Python models whose
Jacobians are exact to rounding (complex steps), so their times are mostly Python's: compare passes and costs.
"""

import json
import time
from typing import Any

import crocoddyl
import numpy as np

try:
    import mim_solvers
except ImportError:
    mim_solvers = None


def acrobot(x: Any, u: Any) -> Any:
    """Explicit Euler, 0.1 s, as in trajax's tests."""
    c2, s2 = np.cos(x[1]), np.sin(x[1])
    d1, d2 = 3.5 + c2, 1.25 + 0.5 * c2
    phi2 = 4.9 * np.cos(x[0] + x[1] - np.pi / 2)
    phi1 = -0.5 * x[3] ** 2 * s2 - x[3] * x[2] * s2 + 14.7 * np.cos(x[0] - np.pi / 2) + phi2
    a2 = (u[0] + d2 / d1 * phi1 - 0.5 * x[2] ** 2 * s2 - phi2) / (1.25 - d2**2 / d1)
    return x + 0.1 * np.array([x[2], x[3], -(d2 * a2 + phi1) / d1, a2])


def pole_rate(x: Any, u: Any) -> Any:
    """Rates of a cart of 1 kg with a point of .2 kg at .5 m, hanging at angle 0."""
    s, c = np.sin(x[1]), np.cos(x[1])
    r1, r2 = u[0] + 0.1 * s * x[3] ** 2, -0.981 * s
    det = 1.2 * 0.05 - (0.1 * c) ** 2
    return np.array([x[2], x[3], (0.05 * r1 - 0.1 * c * r2) / det, (1.2 * r2 - 0.1 * c * r1) / det])


def cart_pole(x: Any, u: Any) -> Any:
    """Kutta's third-order rule, 0.05 s, as in Altro's examples."""
    k1 = 0.05 * pole_rate(x, u)
    k2 = 0.05 * pole_rate(x + 0.5 * k1, u)
    return x + (k1 + 4.0 * k2 + 0.05 * pole_rate(x - k1 + 2.0 * k2, u)) / 6.0


def car(x: Any, u: Any) -> Any:
    """Parking, 0.03 s, Tassa, Mansard & Todorov 2014."""
    f = 0.03 * x[3]
    b = 2.0 + f * np.cos(u[0]) - np.sqrt(4.0 - (f * np.sin(u[0])) ** 2)
    turn = np.arcsin(np.sin(u[0]) * f / 2.0)
    return x + np.array([b * np.cos(x[2]), b * np.sin(x[2]), turn, 0.03 * u[1]])


def quadratic(weights: Any, target: Any, effort: float) -> Any:
    """sum w (x - t)^2 / 2 + effort u^2 / 2: value, gradient and curvature of (x, u)."""

    def cost(x: Any, u: Any) -> tuple[float, Any, Any]:
        z = np.concatenate([x - target, u])
        w = np.concatenate([weights, np.full(len(u), effort)])
        return 0.5 * float(w @ z**2), w * z, w

    return cost


def smooth(weights: Any, scales: Any, efforts: Any) -> Any:
    """sum w (sqrt(x^2 + p^2) - p) + efforts u^2."""

    def cost(x: Any, u: Any) -> tuple[float, Any, Any]:
        root = np.sqrt(x**2 + scales**2)
        value = float(weights @ (root - scales) + efforts[: len(u)] @ u**2)
        slope = np.concatenate([weights * x / root, 2.0 * efforts[: len(u)] * u])
        return value, slope, np.concatenate([weights * scales**2 / root**3, 2.0 * efforts[: len(u)]])

    return cost


class Model(crocoddyl.ActionModelAbstract):
    """One step of a dynamics and its cost; without a dynamics the end."""

    def __init__(self, step: Any, cost: Any, nu: int, limits: Any = None) -> None:
        crocoddyl.ActionModelAbstract.__init__(self, crocoddyl.StateVector(4), nu, 0)
        self.step, self.cost = step, cost
        if limits is not None and nu:
            self.u_lb, self.u_ub = (np.asarray(a, float) for a in limits)

    def calc(self, data: Any, x: Any, u: Any = None) -> None:
        """Next state and cost."""
        controls = np.zeros(0) if u is None or self.step is None else u
        data.cost = self.cost(x, controls)[0]
        data.xnext = x.copy() if self.step is None or u is None else self.step(x, u)

    def calcDiff(self, data: Any, x: Any, u: Any = None) -> None:
        """Their derivatives."""
        controls = np.zeros(0) if u is None or self.step is None else u
        _, slope, bend = self.cost(x, controls)
        data.Lx, data.Lxx = slope[:4], np.diag(bend[:4])
        if self.step is None or u is None:
            return
        data.Lu, data.Luu = slope[4:], np.diag(bend[4:])
        z = np.concatenate([x, u]).astype(complex)
        columns = []
        for i in range(len(z)):
            moved = z.copy()
            moved[i] += 1e-30j
            columns.append(np.imag(self.step(moved[:4], moved[4:])) / 1e-30)
        data.Fx, data.Fu = np.array(columns[:4]).T, np.array(columns[4:]).T


def rendezvous() -> tuple[Any, int, Any]:
    """crocoddyl's linear-quadratic model; its cost is half of x'Qx + ..., as written."""
    grow = 1.0 + 0.1 * (1.0 - 0.01)
    A, B = np.eye(8), np.zeros((8, 4))
    A[:4, 4:], A[4:, 4:], B[4:] = 0.1 * np.eye(4), grow * np.eye(4), 0.01 * np.eye(4)
    Q = np.eye(8)
    Q[0, 2] = Q[2, 0] = Q[1, 3] = Q[3, 1] = -1.0
    model = crocoddyl.ActionModelLQR(
        A, B, 2.0 * Q, 0.2 * np.eye(4), np.zeros((8, 4)), np.zeros(8), np.zeros(8), np.zeros(4)
    )
    x0 = np.array([0.0, 0.0, 10.0, 10.0, 0.0, -5.0, 5.0, 0.0])
    return crocoddyl.ShootingProblem(x0, [model] * 200, model), 4, None


def problems() -> dict[str, tuple[Any, int, Any]]:
    """name -> shooting problem, number of controls, limits."""
    up, over = np.array([np.pi, 0.0, 0.0, 0.0]), np.array([0.0, np.pi, 0.0, 0.0])
    one, parked = np.ones(4), np.array([1.0, 1.0, 1.5 * np.pi, 0.0])
    a, b, c = (-3.0,), (3.0,), (np.array([-0.5, -2.0]), np.array([0.5, 2.0]))
    near, efforts = np.array([1e-3, 1e-3, 0.0, 0.0]), np.array([1e-2, 1e-4])
    way = smooth(near, np.full(4, 0.1), efforts)
    last = smooth(np.array([0.1, 0.1, 1.0, 0.3]), np.array([0.01, 0.01, 0.01, 1.0]), efforts)

    def end(x: Any, u: Any) -> tuple[float, Any, Any]:
        return tuple(p + q for p, q in zip(way(x, u), last(x, u), strict=True))

    swing = Model(acrobot, quadratic(0.1 * one, up, 0.01), 1), Model(None, quadratic(1000 * one, up, 0), 0)
    pole = (
        Model(cart_pole, quadratic(5e-4 * one, over, 5e-3), 1, (a, b)),
        Model(None, quadratic(100 * one, over, 0), 0),
    )
    return {
        "rendezvous": rendezvous(),
        "acrobot": (crocoddyl.ShootingProblem(np.zeros(4), [swing[0]] * 50, swing[1]), 1, None),
        "cart-pole": (crocoddyl.ShootingProblem(np.zeros(4), [pole[0]] * 100, pole[1]), 1, (a, b)),
        "car": (crocoddyl.ShootingProblem(parked, [Model(car, way, 2, c)] * 500, Model(None, end, 0)), 2, c),
    }


def main() -> None:
    """From zero controls, states a rollout's; at most 500 passes."""
    more = [] if mim_solvers is None else [mim_solvers.SolverSQP]
    for name, (problem, nu, limits) in problems().items():
        kinds = [crocoddyl.SolverBoxDDP, crocoddyl.SolverBoxFDDP]
        if limits is None:
            kinds = [crocoddyl.SolverDDP, crocoddyl.SolverFDDP, *more]
        for kind in kinds:
            us = [np.zeros(nu)] * problem.T
            spent: list[float] = []
            while len(spent) < 3 and sum(spent) < 2.0:
                solver = kind(problem)
                start = time.process_time()
                solver.solve(problem.rollout(us), us, 500, False)
                spent.append(time.process_time() - start)
            label = f"{kind.__module__.split('.')[0].lstrip('_')} {kind.__name__}"
            row = {"problem": name, "solver": label, "cost": float(solver.cost),
                   "passes": int(solver.iter) + 1, "seconds": min(spent)}  # fmt: skip
            print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
