"""Push a block to a mark and leave it there: 1,000 starts at once, by exact gradients through contact.

    python examples/push.py [--out docs/images/push.png] [--starts 1000] [--rounds 60]

A pusher drives into the block, which slides on and stops by friction. What is chosen is the force on the
pusher, held for .1 s at a time; what counts is that the block stands still and level at the mark after 1.2
s, at little effort. Every start is a descent of its own (Adam), one rollout and one backward pass a round
for all of them. Beside it, as many evolution strategies (1+1), which see the same number of rollouts but no
gradient. Contact is hard, friction Coulomb's: no smoothing, the gradients are those of the modes.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import warp as wp

import slcp_warp as slcp

STEPS, HOLD = 120, 10  # of .01 s; steps for which a force is held
X, Y, ANGLE = 1, 2, 3  # the block's coordinates in the state; the pusher's is 0
MARK = 1.0  # [m]
PLACE, LEVEL, REST, EFFORT = 20.0, 5.0, 2.0, 2e-4  # weights: [1/m^2], [1/rad^2], [s^2/m^2], [1/N^2]
SPREAD, RATE = 10.0, 1.0  # [N] of the starts, of a round's change

SCENE = slcp.scenes.push_block()
OPTIONS = slcp.Options(residual="hard", friction="coulomb")
SIM = slcp.Simulator(SCENE, OPTIONS, device="cpu", dtype="float64")
Evaluation = tuple[np.ndarray, np.ndarray]


def cost(force: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Cost (B,) of forces (B, STEPS/HOLD) that end in the states `last` (B, 8)."""
    place = PLACE * (last[:, X] - MARK) ** 2 + LEVEL * last[:, ANGLE] ** 2
    return place + REST * (last[:, 4 + X] ** 2 + last[:, 4 + Y] ** 2) + EFFORT * (force**2).sum(1)


def controls(force: np.ndarray) -> np.ndarray:
    """Controls (B, STEPS, 1)."""
    return np.repeat(force, HOLD, axis=1)[..., None]


def value(force: np.ndarray) -> np.ndarray:
    """The cost (B,); inf where a step was not solved."""
    traj = SIM.rollout(np.tile(SCENE.x0, (len(force), 1)), controls(force))
    return np.where(traj.status == slcp.Status.SOLVED, cost(force, traj.states[:, -1]), np.inf)


def value_and_gradient(force: np.ndarray) -> Evaluation:
    """The cost (B,) and its gradient by the forces (B, STEPS/HOLD)."""
    x0 = wp.array(np.tile(SCENE.x0, (len(force), 1)), dtype=wp.float64, device="cpu")
    us = wp.array(controls(force), dtype=wp.float64, device="cpu", requires_grad=True)
    with wp.Tape() as tape:
        traj = SIM.rollout(x0, us)
    last = traj.states.numpy()[:, -1]
    seed = np.zeros((len(force), STEPS + 1, 8))
    seed[:, -1, X] = 2.0 * PLACE * (last[:, X] - MARK)
    seed[:, -1, ANGLE] = 2.0 * LEVEL * last[:, ANGLE]
    seed[:, -1, 4 + X : 4 + Y + 1] = 2.0 * REST * last[:, 4 + X : 4 + Y + 1]
    tape.backward(grads={traj.states: wp.array(seed, dtype=wp.float64, device="cpu")})
    gradient = us.grad.numpy()[..., 0].reshape(len(force), -1, HOLD).sum(2) + 2.0 * EFFORT * force
    failed = traj.status.numpy() != slcp.Status.SOLVED
    return np.where(failed, np.inf, cost(force, last)), np.where(failed[:, None], 0.0, gradient)


def descend(force: np.ndarray, rounds: int) -> Evaluation:
    """Adam from every start: the best forces and the least cost so far, (rounds, B)."""
    mean, square = np.zeros_like(force), np.zeros_like(force)
    best, least, history = force.copy(), np.full(len(force), np.inf), []
    for k in range(1, rounds + 1):
        now, gradient = value_and_gradient(force)
        better = now < least
        least, best = np.where(better, now, least), np.where(better[:, None], force, best)
        history.append(least)
        mean, square = 0.8 * mean + 0.2 * gradient, 0.95 * square + 0.05 * gradient**2
        step = (mean / (1.0 - 0.8**k)) / (np.sqrt(square / (1.0 - 0.95**k)) + 1e-9)
        force = force - RATE * (1.0 - (k - 1) / rounds) * step
    return best, np.array(history)


def evolve(force: np.ndarray, rounds: int, normal: Callable[..., np.ndarray]) -> Evaluation:
    """(1+1) evolution strategies with the one-fifth rule: the same outcome as `descend`."""
    best, least = force, value(force)
    width, history = np.full(len(force), 3.0), [least]
    for _ in range(rounds - 1):
        trial = best + width[:, None] * normal(size=best.shape)
        now = value(trial)
        better = now < least
        least, best = np.where(better, now, least), np.where(better[:, None], trial, best)
        width *= np.where(better, 1.5, 1.5**-0.25)
        history.append(least)
    return best, np.array(history)


def draw(states: np.ndarray, descent: np.ndarray, search: np.ndarray, out: Path) -> None:
    """The best plan's motion, and the costs over the rounds."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
    time = 0.01 * np.arange(STEPS + 1)
    left.plot(time, states[:, X] - 0.15, color="C0", label="block's left face")
    left.plot(time, states[:, 0] - 0.35, "--", color="C1", label="pusher's front")
    left.axhline(MARK - 0.15, color="C3", linewidth=0.8, label="mark")
    left.set(xlabel="time [s]", ylabel="position [m]")
    left.legend()
    rounds = np.arange(1, len(descent) + 1)
    for name, history, color in (("gradient", descent, "C0"), ("evolution strategy", search, "C1")):
        low, middle, high = np.quantile(history, (0.1, 0.5, 0.9), axis=1)
        right.fill_between(rounds, low, high, color=color, alpha=0.2)
        right.plot(rounds, middle, color=color, label=f"{name}: median, 10-90 % of starts")
    right.set(yscale="log", xlabel="rollouts of each start", ylabel="least cost so far")
    right.legend()
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=110)


def main() -> None:
    """Optimise, report, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs/images/push.png"))
    parser.add_argument("--starts", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    force = SPREAD * rng.standard_normal((arguments.starts, STEPS // HOLD))
    best, descent = descend(force, arguments.rounds)
    _, search = evolve(force, arguments.rounds, rng.normal)
    for name, history in (("gradient", descent), ("evolution strategy", search)):
        middle = np.median(history[-1])
        print(f"{name}: least cost {history[-1].min():.4f}, median of {len(force)} starts {middle:.4f}")
    share = (descent[-1] < search[-1].min()).mean()
    print(f"starts whose gradient descent ends below the best evolution strategy: {share:.0%}")
    winner = best[[np.argmin(descent[-1])]]
    states = SIM.rollout(SCENE.x0[None], controls(winner)).states[0]
    print(
        f"the best plan's block ends at {states[-1, X]:.4f} m at {states[-1, 4 + X]:.4f} m/s; mark {MARK} m"
    )
    draw(states, descent, search, arguments.out)
    print(f"wrote {arguments.out}")


if __name__ == "__main__":
    main()
