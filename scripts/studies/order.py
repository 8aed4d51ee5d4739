"""Order of the integrators in smooth contact and with dampers, and what rules for dampers and springs do:
`python -m slcp_warp.scripts.studies.order`.

Phases whose exact motion is one equation of a single angle, solved here by Runge-Kutta at a small step: a
link that swings while another one is held on its limit, a ball that slides without friction down a disc, one
that rolls down it, a link with a damper in its joint, one with a damper between its tip and a fixed point.
Printed is the largest error of the state at the end in the hard problem; of places alone, from velocities
half a step before; how far strokes in the air carry a body with limbs; what the leapfrog costs; then what a
step leaves of the speed of a damped slider; then, of rules for one mass on a spring, the damping ratio that
they have by themselves, the error of their frequency, the largest stretch from a stretch, the largest energy
from a stretch and from a speed, all relative to the first, and the largest eigenvalue of a critically damped
spring; then the largest error of a position after .8 s of scenes with springs that fall to the ground.
"""

import dataclasses
import functools
import time
from collections.abc import Callable

import numpy as np

import slcp_warp as slcp

from ..benchmarks.shared.ours import cpu_threads

GRAVITY = 9.81
DURATION = 0.4
STEP_SIZES = (0.04, 0.02, 0.01, 0.005)
FLIGHT = (0.02, 0.01, 0.005, 0.0025)
HILL, BALL = 1.0, 0.2  # radii
REACH = HILL + BALL
RULES = {"q": (0.0, 0.0), "q + h/4 (v' - v)": (0.25, 0.0), "q + h/2 (v' - v)": (0.5, 0.0),
         "q + h (v' - v)": (1.0, 0.0), "q + h (v' - w)": (1.0, None), "q + h v'": (1.0, 1.0)}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Phase:
    """A motion that one angle describes: its equation angle'' = acceleration(angle, rate), where it begins,
    and the scene's state at an angle and rate.
    """

    scene: slcp.Scene
    acceleration: Callable[[float, float], float]
    begin: tuple[float, float]
    state: Callable[[float, float], np.ndarray]

    def after(self, duration: float) -> np.ndarray:
        """The exact state after a duration, which may be negative."""
        steps = 4000
        h = duration / steps
        y = np.array(self.begin)

        def slope(y: np.ndarray) -> np.ndarray:
            return np.array([y[1], self.acceleration(*map(float, y))])

        for _ in range(steps):
            a = slope(y)
            b = slope(y + 0.5 * h * a)
            c = slope(y + 0.5 * h * b)
            d = slope(y + h * c)
            y = y + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        return self.state(*map(float, y))


def limit() -> Phase:
    """Gravity holds the first link on its limit, the second one swings."""
    links = (
        slcp.Body("arm", 1.0, 0.05, com=(0.5, 0.0), lower=0.0),
        slcp.Body("bob", 1.0, 0.02, parent="arm", anchor=(1.0, 0.0), com=(0.4, 0.0)),
    )
    scene = slcp.Scene("limit", links, gravity=(0.0, -GRAVITY))

    def acceleration(angle: float, rate: float) -> float:
        return float(-GRAVITY * 0.4 / (0.02 + 0.4**2) * np.cos(angle))

    return Phase(scene, acceleration, (-1.0, 0.0), lambda angle, rate: np.array([0.0, angle, 0.0, rate]))


def hill(rolls: bool) -> Phase:
    """A ball on a disc, from .1 rad beside its top."""
    shapes = (slcp.Shape("hill", None, "disc", HILL), slcp.Shape("ball", "ball", "disc", BALL))
    ball = slcp.Body("ball", 1.0, 0.5 * BALL**2, joint="free")
    contact = slcp.Contact("hill", "ball", 2.0 if rolls else None)
    scene = slcp.Scene("hill", (ball,), shapes, (contact,), gravity=(0.0, -GRAVITY))
    share = 2.0 / 3.0 if rolls else 1.0

    def state(angle: float, rate: float) -> np.ndarray:
        x, y, spin = np.sin(angle), np.cos(angle), -rate * REACH / BALL if rolls else 0.0
        turn = -(angle - 0.1) * REACH / BALL if rolls else 0.0
        return np.array([REACH * x, REACH * y, turn, REACH * rate * y, -REACH * rate * x, spin])

    def acceleration(angle: float, rate: float) -> float:
        return float(share * GRAVITY / REACH * np.sin(angle))

    return Phase(scene, acceleration, (0.1, 0.3), state)


def damped(between_points: bool) -> Phase:
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

    return Phase(scene, acceleration, (-0.3, 1.0), lambda angle, rate: np.array([angle, rate]))


def in_phases(integrators: tuple[str, str], staggered: bool) -> None:
    """Print the largest error of the state at the end; `staggered`: of places, from velocities half a step
    before.
    """
    phases = {"limit": limit(), "slides": hill(False), "rolls": hill(True), "drag": damped(False),
              "damper": damped(True)}  # fmt: skip
    told = "places, from velocities half a step before" if staggered else "states"
    print(f"{told}\nphase   integrator   " + "  ".join(f"h = {h:<6g}" for h in STEP_SIZES) + "  last ratio")
    for name, phase in phases.items():
        end, nv = phase.after(DURATION), phase.scene.nv
        for integrator in integrators:
            options = slcp.Options(residual="hard", integrator=integrator)
            sim = slcp.Simulator(phase.scene, options, dtype="float64")
            errors = []
            for h in STEP_SIZES:
                start = phase.after(0.0)
                if staggered:
                    start[nv:] = phase.after(-0.5 * h)[nv:]
                controls = np.zeros((round(DURATION / h), sim.nu))
                run = sim.rollout(start, controls, sim.params.replace(step_size=h))
                errors.append(float(np.abs(run.states[-1] - end)[: nv if staggered else None].max()))
            figures = "  ".join(f"{e:<10.2e}" for e in errors)
            print(f"{name:7} {integrator:12} {figures}  {errors[-2] / errors[-1]:.2f}")


def in_flight() -> None:
    """Print how far strokes in the air carry a torso with a leg of two links: how far its centre of mass is
    off its parabola, at most within .8 s.
    """
    bodies = (
        slcp.Body("torso", 12.0, 0.4, joint="free", com=(0.0, 0.1)),
        slcp.Body("thigh", 2.5, 0.03, parent="torso", com=(0.0, -0.2), armature=0.02),
        slcp.Body("shin", 1.5, 0.02, parent="thigh", anchor=(0.0, -0.4), com=(0.0, -0.2), armature=0.02),
    )
    motors = tuple(slcp.Actuator(name) for name in ("thigh", "shin"))
    scene = slcp.Scene("flyer", bodies, actuators=motors, gravity=(0.0, -GRAVITY))
    print("off the parabola [m] " + "  ".join(f"h = {h:<6g}" for h in FLIGHT))
    for integrator in ("euler", "leapfrog", "trapezoidal"):
        sim = slcp.Simulator(scene, slcp.Options(residual="hard", integrator=integrator), dtype="float64")
        figures = []
        for h in FLIGHT:
            t = h * np.arange(round(0.8 / h))
            part = t % 0.4  # a fast stroke and a slow return
            push = 120.0 * np.where(part < 0.1, np.sign(0.05 - part), np.sign(part - 0.25) / 9.0)
            params = sim.params.replace(step_size=h)
            run = sim.rollout(np.zeros(10), np.stack([push, 0.3 * push], 1), params)
            late = 0.0 if integrator == "trapezoidal" else h
            fallen = 0.5 * run.times * (run.times + late) * GRAVITY
            place = run.momentum.place - run.momentum.place[0]
            figures.append(np.abs(place + np.stack([0.0 * fallen, fallen], 1)).max())
        print(f"{integrator:20} " + "  ".join(f"{figure:<10.2e}" for figure in figures))


def price() -> None:
    """Print what the leapfrog costs beside Euler's rule in generic kernels, by process time of one thread."""
    links = [slcp.Body("link0", 1.0, 0.02, com=(0.25, 0.0))]
    for i in range(1, 20):
        links.append(slcp.Body(f"link{i}", 1.0, 0.02, f"link{i - 1}", anchor=(0.5, 0.0), com=(0.25, 0.0)))
    scenes = (slcp.Scene("chain of 20", tuple(links)), slcp.scenes.hopper(), slcp.scenes.walker())
    print("Euler's us a step, times the leapfrog's")
    for scene in scenes:
        x = np.tile(scene.x0, (64, 1)) + 0.01 * np.random.default_rng(0).standard_normal((64, len(scene.x0)))
        for residual in ("hard", "rem-logistic"):
            calls: dict[str, list[Callable[[], object]]] = {"rollout": [], "A, B": [], "gradients": []}
            for integrator in ("euler", "leapfrog"):
                options = slcp.Options(residual, integrator=integrator)
                sim = slcp.Simulator(scene, options, dtype="float64", device="cpu", strategy="generic")
                us = np.zeros((64, 40, sim.nu))
                weight = np.ones((64, 41, sim.nx))
                calls["rollout"].append(functools.partial(sim.rollout, x, us))
                calls["A, B"].append(functools.partial(sim.linearize, x, us[:, 0]))
                calls["gradients"].append(
                    functools.partial(slcp.vjp, sim, x, us, weight, parameters=sim.params.names)
                )
            figures = []
            for name, both in calls.items():
                times = np.array([[process_seconds(call) for call in both] for _ in range(10)])[1:]
                steps = 64 * (1 if name == "A, B" else 40)
                ratio = np.median(times[:, 1] / times[:, 0])
                figures.append(f"{name} {times[:, 0].min() / steps * 1e6:.2f} x {ratio:.2f}")
            print(f"{scene.name:12} {residual:13} " + "   ".join(figures))


def process_seconds(call: Callable[[], object]) -> float:
    """Process time of a call on one thread."""
    start = time.process_time()
    call()
    return time.process_time() - start


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
    in_phases(("euler", "trapezoidal"), staggered=False)
    in_phases(("euler", "leapfrog"), staggered=True)
    in_flight()
    with cpu_threads(1):
        price()
    decay()
    swing()
    falling()


if __name__ == "__main__":
    main()
