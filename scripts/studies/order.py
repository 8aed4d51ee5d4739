"""Order of the integrators in smooth contact and with dampers, and what rules for dampers and springs do:
`python -m slcp_warp.scripts.studies.order`.

Phases whose exact motion is one equation of a single angle, solved here by Runge-Kutta at a small step: a
link that swings while another one is held on its limit, a ball that slides without friction down a disc, one
that rolls down it, a link with a damper in its joint, one with a damper between its tip and a fixed point.
Printed is the largest error of the state at the end in the hard problem; then what a step leaves of the
speed of a damped slider; then, of rules for one mass on a spring, the damping ratio that they have by
themselves, the error of their frequency, the largest stretch from a stretch, the largest energy from a
stretch and from a speed, all relative to the first, and the largest eigenvalue of a critically damped spring;
then the largest error of a position after .8 s of scenes with springs that fall to the ground.
"""

import dataclasses
from collections.abc import Callable

import numpy as np

import slcp_warp as slcp

GRAVITY = 9.81
DURATION = 0.4
STEP_SIZES = (0.04, 0.02, 0.01, 0.005)
HILL, BALL = 1.0, 0.2  # radii
REACH = HILL + BALL
RULES = {"q": (0.0, 0.0), "q + h/4 (v' - v)": (0.25, 0.0), "q + h/2 (v' - v)": (0.5, 0.0),
         "q + h (v' - v)": (1.0, 0.0), "q + h (v' - w)": (1.0, None), "q + h v'": (1.0, 1.0)}  # fmt: skip


def angle_after(
    acceleration: Callable[[float, float], float], angle: float, rate: float
) -> tuple[float, float]:
    """Angle and rate after DURATION of angle'' = acceleration(angle, rate)."""
    steps = 4000
    h = DURATION / steps
    y = np.array([angle, rate])

    def slope(y: np.ndarray) -> np.ndarray:
        return np.array([y[1], acceleration(y[0], y[1])])

    for _ in range(steps):
        a = slope(y)
        b = slope(y + 0.5 * h * a)
        c = slope(y + 0.5 * h * b)
        d = slope(y + h * c)
        y = y + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    return float(y[0]), float(y[1])


def limit() -> tuple[slcp.Scene, np.ndarray, np.ndarray]:
    """Scene, start and exact end: gravity holds the first link on its limit, the second one swings."""
    links = (
        slcp.Body("arm", 1.0, 0.05, com=(0.5, 0.0), lower=0.0),
        slcp.Body("bob", 1.0, 0.02, parent="arm", anchor=(1.0, 0.0), com=(0.4, 0.0)),
    )
    angle, rate = angle_after(lambda a, w: -GRAVITY * 0.4 / (0.02 + 0.4**2) * np.cos(a), -1.0, 0.0)
    scene = slcp.Scene("limit", links, gravity=(0.0, -GRAVITY))
    return scene, np.array([0.0, -1.0, 0.0, 0.0]), np.array([0.0, angle, 0.0, rate])


def hill(rolls: bool) -> tuple[slcp.Scene, np.ndarray, np.ndarray]:
    """The same for a ball on a disc, from .1 rad beside its top."""
    shapes = (slcp.Shape("hill", None, "disc", HILL), slcp.Shape("ball", "ball", "disc", BALL))
    ball = slcp.Body("ball", 1.0, 0.5 * BALL**2, joint="free")
    contact = slcp.Contact("hill", "ball", 2.0 if rolls else None)
    scene = slcp.Scene("hill", (ball,), shapes, (contact,), gravity=(0.0, -GRAVITY))
    share = 2.0 / 3.0 if rolls else 1.0

    def state(angle: float, rate: float) -> np.ndarray:
        x, y, spin = np.sin(angle), np.cos(angle), -rate * REACH / BALL if rolls else 0.0
        turn = -(angle - 0.1) * REACH / BALL if rolls else 0.0
        return np.array([REACH * x, REACH * y, turn, REACH * rate * y, -REACH * rate * x, spin])

    end = angle_after(lambda a, w: share * GRAVITY / REACH * np.sin(a), 0.1, 0.3)
    return scene, state(0.1, 0.3), state(*end)


def damped(between_points: bool) -> tuple[slcp.Scene, np.ndarray, np.ndarray]:
    """A link of length 1 that swings with a damper of 1 N s/m at its tip, or of 1 N m s/rad in its joint."""
    at, inertia = np.array([0.5, -1.5]), 0.05 + 0.5**2
    link = slcp.Body("link", 1.0, 0.05, com=(0.5, 0.0), damping=0.0 if between_points else 1.0)
    spring = slcp.Spring("link", None, (1.0, 0.0), tuple(at), damping=1.0)
    springs = (spring,) if between_points else ()
    scene = slcp.Scene("damped", (link,), springs=springs, gravity=(0.0, -GRAVITY))

    def acceleration(angle: float, rate: float) -> float:
        lever = 1.0
        if between_points:
            line = np.array([np.cos(angle), np.sin(angle)]) - at
            lever = line @ np.array([-np.sin(angle), np.cos(angle)]) / np.linalg.norm(line)
        return float(-GRAVITY * 0.5 * np.cos(angle) - lever * lever * rate) / inertia

    return scene, np.array([-0.3, 1.0]), np.array(angle_after(acceleration, -0.3, 1.0))


def decay() -> None:
    """Print what one step leaves of a slider's speed, over x = c h/m."""
    ratios = np.array([0.1, 1.0, 3.0, 10.0, 100.0, 1e4])
    print(f"{'x':21} " + "  ".join(f"{x:<10g}" for x in ratios))
    print(f"{'exp(-x)':21} " + "  ".join(f"{np.exp(-x):<10.2e}" for x in ratios))
    for implicit in (True, False):
        body = slcp.Body("slider", 1.0, 1.0, joint="prismatic")
        scene = slcp.Scene("slider", (body,), gravity=(0.0, 0.0), implicit_damping=implicit)
        for integrator in ("euler", "trapezoidal"):
            sim = slcp.Simulator(scene, slcp.Options(integrator=integrator), dtype="float64")
            x = np.tile([0.0, 1.0], (len(ratios), 1))
            left = sim.step(x, None, sim.params.replace(damping=ratios[:, None], step_size=1.0)).state[:, 1]
            name = integrator if implicit else f"{integrator}, explicit"
            print(f"{name:21} " + "  ".join(f"{v:<10.2e}" for v in left))


def sprung(x: float, y: float, share: float, late: float | None) -> np.ndarray:
    """The matrix of a step of (q, h v) of one mass, x = h omega, y = c h/m: a spring met at q + h share (v' -
    v) + h late v, a damper at v'. None: v - w for late v, w = v/(1 + y + x^2).
    """
    n = 1.0 + y + share * x * x
    late = 1.0 - 1.0 / n if late is None else late
    v = np.array([-x * x, n - y - late * x * x]) / n
    return np.stack([np.array([1.0, 0.0]) + v, v])


def swing() -> None:
    """Print what rules for springs do."""
    print("spring met at    h omega  damping  frequency  stretch   energy q  energy v  critical")
    for name, rule in RULES.items():
        for x in (0.1, 0.3, 1.0, 3.0, 10.0, 100.0):
            matrix, state, largest = sprung(x, 0.0, *rule), np.diag([1.0, x]), np.ones(3)
            with np.errstate(over="ignore", invalid="ignore"):
                for _ in range(4000):
                    state = matrix @ state
                    energy = state[0] ** 2 + (state[1] / x) ** 2
                    largest = np.fmax(largest, [abs(state[0, 0]), *energy])
            values = np.linalg.eigvals(matrix)
            log = np.log(values[np.argmax(np.abs(values))] + 0j)
            shift, ratio = np.abs(log.imag) / x - 1.0, -log.real / np.abs(log)
            figures = "  ".join(f"{value:<8.3g}" for value in largest)
            damped = np.abs(np.linalg.eigvals(sprung(x, 2.0 * x, *rule))).max()
            print(f"{name:16} {x:7g}  {ratio:7.4f}  {shift:+9.4f}  {figures}  {damped:.3f}")


def falling() -> None:
    """Print errors of scenes with springs, against the explicit rule at a 256th of their step."""
    for base in (slcp.scenes.hopper(), slcp.scenes.walker()):
        rules = [dataclasses.replace(base, implicit_stiffness=rule) for rule in (False, True)]
        sizes = base.step_size * np.array([1.0 / 256.0, 0.25, 1.0, 2.0, 5.0, 10.0])
        print(f"{base.name:16} " + "  ".join(f"h = {h:<7g}" for h in sizes[1:]))
        truth = None
        for scene in rules:
            sim = slcp.Simulator(scene, slcp.Options("hard"), dtype="float64", strategy="generic")
            ends = []
            for h in sizes:
                controls = np.zeros((round(0.8 / h), sim.nu))
                ends.append(sim.rollout(scene.x0, controls, sim.params.replace(step_size=h)).states[-1])
            truth = ends[0] if truth is None else truth
            figures = [np.abs(end - truth)[: scene.nv].max() for end in ends[1:]]
            name = "q + h/2 (v' - v)" if scene.implicit_stiffness else "q"
            print(f"{name:16} " + "  ".join(f"{figure:<11.2g}" for figure in figures))


def main() -> None:
    """Print the tables."""
    phases = {"limit": limit(), "slides": hill(False), "rolls": hill(True), "drag": damped(False),
              "damper": damped(True)}  # fmt: skip
    print("phase   integrator   " + "  ".join(f"h = {h:<6g}" for h in STEP_SIZES) + "  last ratio")
    for phase, (scene, start, end) in phases.items():
        for integrator in ("euler", "trapezoidal"):
            sim = slcp.Simulator(scene, slcp.Options(residual="hard", integrator=integrator))
            errors = []
            for h in STEP_SIZES:
                controls = np.zeros((round(DURATION / h), sim.nu))
                run = sim.rollout(start, controls, sim.params.replace(step_size=h))
                errors.append(float(np.abs(run.states[-1] - end).max()))
            figures = "  ".join(f"{e:<10.2e}" for e in errors)
            print(f"{phase:7} {integrator:12} {figures}  {errors[-2] / errors[-1]:.2f}")
    decay()
    swing()
    falling()


if __name__ == "__main__":
    main()
