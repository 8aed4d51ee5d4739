"""What people run on scenes of their own, each small: numbers of every world, beside a CPU's.

The task pushes a block to a mark, with everything that a task may have: draws, kicks, pushes, a late and
noisy sensor, measures of contact. What no task says (bounces, ropes, belts) is `slcp bench fuzz --device`'s.
"""

import importlib.util
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np

import slcp_warp as slcp
from slcp_warp import costs, ddp, measures, policies

Numbers = dict[str, np.ndarray]
WORLDS, STEPS = 256, 40
HARD = slcp.Options("hard")  # whose next velocity is unique, unlike that of Coulomb's friction
SMOOTHED = slcp.Options()


class Use(NamedTuple):
    """A use of the product.

    Attributes:
        run: its numbers by name, (B, ...) of worlds, on a device.
        within: how far a world's numbers may be from the CPU's, of 1 + their size.
        share: of the worlds that may be further away: of two roundings one may touch, and the other not.
        needs: a module that it cannot do without.
    """

    run: Callable[[str], Numbers]
    within: float = 2e-3
    share: float = 0.03
    needs: str = "numpy"


@cache
def task() -> slcp.Task:
    """The push with all that disturbs and is measured."""
    scene, box = replace(slcp.scenes.push_block(), step_size=0.02, sigma=0.05), "face/pusher"
    far = [costs.Term("square", 200.0, state="block.x", target=0.6)]
    disturbances = slcp.Disturbances(
        velocity=0.02,
        torque=0.2,
        dropped=0.05,
        dropouts=(slcp.Dropout(slcp.Uniform(0.2, 0.5), 0.06),),
        parameters={"mass": 0.1, "friction": slcp.Uniform(0.2, 0.6, shared=True)},
        start={"pusher.shift": slcp.Uniform(-0.02, 0.0)},
        sensor={"block.x": 0.002},
        delay=slcp.Uniform(0.0, 0.06),
        hold=0.04,
        kick_times=(0.31,),
        kicks={"block.vx": 0.1},
        pushes=(slcp.Push("block", slcp.Uniform(0.2, 0.5), 0.1, (slcp.Normal(6.0), 0.0)),),
    )
    measured = {
        "place": measures.final("block.x"),
        "speed": measures.final("block.vx"),
        "push": measures.impulse(box),
        "slid": measures.integral(abs(measures.slip("ground/block"))),
        "hardest": measures.largest(measures.normal_force(box)),
        "touched": measures.first_time(measures.contact(box) > 0.5),
        "near": measures.smallest(measures.gap(box)),
        "angle": measures.largest(abs(measures.state("block.angle"))),
    }
    reached = measures.final("block.x").between(0.75, 1.0)  # four of five
    return slcp.Task(
        "push", scene, costs.terms(scene, [costs.effort(1e-4)], far), horizon=STEPS, duration=0.8,
        control_limits=(-20.0, 20.0), start={"pusher.vshift": 0.0}, disturbances=disturbances,
        measures=measured, success=reached,
    )  # fmt: skip


def law() -> Any:
    """Push to the mark with a weak spring."""
    scene = task().scene
    K = np.zeros((1, 2 * scene.nv))
    K[0, scene.state_index("block.x")], K[0, scene.state_index("pusher.vshift")] = -20.0, -2.0
    return policies.Linear(K, x_ref=scene.state({"block.x": 0.6}), u_ref=[0.5])


class Asked:
    """A policy on the host."""

    def act(self, x: np.ndarray, time: float, worlds: np.ndarray) -> np.ndarray:
        """A push that dies away, and a little of the world's number."""
        return 8.0 * np.exp(-time) - 3.0 * x[:, :1] + 0.01 * np.asarray(worlds)[:, None]


def _swept(policy: Callable[[], Any], strategy: str, device: str) -> Numbers:
    report = slcp.sweep(task(), policy(), worlds=WORLDS, cases=[SMOOTHED, HARD], device=device,
                        strategy=strategy)  # fmt: skip
    names = ["status", "success", *task().measures]
    return {name: np.asarray(report.table[name], float) for name in names}


def _replayed(strategy: str, device: str) -> Numbers:
    worlds = slcp.draw_worlds(task(), WORLDS, seed=3, device="cpu")
    run = slcp.replay(task(), law(), worlds, record=("controls", "impulse", "gap"), case=HARD, device=device,
                      strategy=strategy)  # fmt: skip
    found = {name: np.asarray(getattr(run, name), float) for name in ("states", "controls", "gap", "status")}
    return found | {"pressed": np.asarray(run.impulse, float).sum(2)}  # of two edges of a cone only the sum


def _learnt(strategy: str, device: str) -> Numbers:
    env = slcp.Environment(task(), WORLDS, seed=2, case=HARD, device=device, strategy=strategy)
    seen, paid, controls = [env.reset()], [], np.random.default_rng(0).uniform(-5.0, 10.0, (STEPS, WORLDS, 1))
    for u in controls[: task().steps - 1]:  # before the episodes end, and others begin
        moment = env.step(u)
        seen.append(moment.observation)
        paid.append(moment.reward)
    return {"observations": np.stack(seen, 1), "rewards": np.stack(paid, 1)}


def _network() -> Any:
    from torch import manual_seed, nn

    manual_seed(0)
    return policies.Network(nn.Sequential(nn.Linear(8, 16), nn.Tanh(), nn.Linear(16, 1)))


def _trained(device: str) -> Numbers:
    import torch

    from slcp_warp import torch as differentiable

    sim = slcp.Simulator(task().scene, SMOOTHED, device=device, dtype="float32", strategy="generic")
    torch.manual_seed(0)
    net = torch.nn.Sequential(torch.nn.Linear(8, 8), torch.nn.Tanh(), torch.nn.Linear(8, 1)).to(device)
    x0 = torch.tensor(_starts(sim), device=device, requires_grad=True)
    done = differentiable.closed_loop(sim, x0, net, 10)
    done.states[:, -1, 0].sum().backward()
    assert x0.grad is not None
    weights = [p.grad.detach().cpu().numpy().ravel() for p in net.parameters() if p.grad is not None]
    return {"states": done.states.detach().cpu().numpy(), "by x0": x0.grad.cpu().numpy(),
            "by weights": np.concatenate(weights)[None]}  # fmt: skip


def _starts(sim: slcp.Simulator) -> np.ndarray:
    rng = np.random.default_rng(1)
    return np.asarray(sim.scene.x0 + 0.01 * rng.standard_normal((64, sim.nx)), np.float32)


def _planned(strategy: str, device: str) -> Numbers:
    sim = slcp.Simulator(task().scene, SMOOTHED, device=device, dtype="float64", strategy=strategy)
    problem = ddp.Problem(sim, task().cost, horizon=STEPS, control_limits=task().control_limits)
    done = ddp.solve(problem, task().start, np.full((1, STEPS, 1), 3.0), ddp.Options(max_iterations=6))
    return {"cost": done.cost, "states": done.xs}


def _controlled(device: str) -> Numbers:
    problem = ddp.problem_of(task(), task().simulator(device=device))
    plant = task().simulator(HARD, device=device)
    mpc = ddp.MPC(problem, passes=2, starts=["shift", "zero"])
    return {"states": plant.rollout(task().start[:1], policy=mpc, steps=8).states}


def _mapped(device: str) -> Numbers:
    axes = ("block.mass", [0.5, 1.0, 2.0]), ("friction", [0.2, 0.5])
    found = slcp.robustness_map(task(), law(), *axes, worlds=WORLDS, case=HARD, device=device)
    return {"shares": found.successes[None] / WORLDS}


def _explained(device: str) -> Numbers:
    found = slcp.sensitivity(task(), law(), measure="place", samples=WORLDS, case=HARD, device=device)
    return {"total": np.array([[t[0] for t in found.total]])}


def _rare(device: str) -> Numbers:
    far = replace(task(), success=task().measures["place"] < 1.2)
    found = slcp.failure_share(far, law(), islands=4, particles=100, length=5, case=HARD, device=device)
    return {"logarithm": np.log([[found.share + 1e-12]])}


def _broken(device: str) -> Numbers:
    found = slcp.falsify(task(), law(), "kick", worlds=256, rounds=5, case=HARD, device=device)
    return {"size": np.array([[found.size]])}


def _scattered(device: str) -> Numbers:
    sim = slcp.Simulator(task().scene, slcp.Options("hard"), device=device)
    covariance = 1e-4 * np.eye(sim.nx)
    found = slcp.particles(sim, task().start[0], covariance=covariance, count=WORLDS)
    return {"mean": found.state[None], "covariance": found.covariance.reshape(1, -1)}


PRODUCT: dict[str, Use] = {
    **{f"sweep, {kind} kernels": Use(partial(_swept, law, kind)) for kind in ("generic", "specialised")},
    **{f"replay, {kind} kernels": Use(partial(_replayed, kind)) for kind in ("generic", "specialised")},
    **{f"environment, {kind} kernels": Use(partial(_learnt, kind)) for kind in ("generic", "specialised")},
    "sweep of a policy on the host": Use(partial(_swept, Asked, "specialised")),
    "sweep of a network": Use(partial(_swept, _network, "specialised"), needs="torch"),
    "gradients of a closed loop": Use(_trained, needs="torch"),
    "plan, generic kernels": Use(partial(_planned, "generic"), within=1e-6),
    "plan, specialised kernels": Use(partial(_planned, "specialised"), within=1e-6),
    "model predictive control": Use(_controlled, within=1e-2, share=0.0),
    "map": Use(_mapped, within=0.02, share=0.0),
    "sensitivity": Use(_explained, within=0.1, share=0.0),
    "rare failures": Use(_rare, within=0.3, share=0.0),
    "smallest kick": Use(_broken, within=0.05, share=0.0),
    "particles": Use(_scattered),
}


def there(use: Use) -> bool:
    """Whether what it needs is installed."""
    return importlib.util.find_spec(use.needs) is not None
