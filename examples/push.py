"""Push a block to a mark and leave it there: 1,000 starts at once, by exact gradients through contact.

    python examples/push.py [--out docs/images/push.png] [--starts 1000] [--rounds 60]

A pusher drives into the block, which slides on and stops by friction. What is chosen is the force on the
pusher, held for .1 s at a time; what counts is that the block stands still and level at the mark after 1.2
s, at little effort. Every start is a descent of its own (Adam), one rollout and one backward pass a round
for all of them. Beside it, as many evolution strategies (1+1), which see the same number of rollouts but no
gradient. Contact is hard, friction Coulomb's: no smoothing, the gradients are those of the modes.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import torch
from torch import Tensor

import slcp_warp as slcp
import slcp_warp.torch as slcp_torch

STEPS, HOLD = 120, 10  # of .01 s; steps for which a force is held
X, Y, ANGLE = 1, 2, 3  # the block's coordinates in the state; the pusher's is 0
MARK = 1.0  # [m]
PLACE, LEVEL, REST, EFFORT = 20.0, 5.0, 2.0, 2e-4  # weights: [1/m^2], [1/rad^2], [s^2/m^2], [1/N^2]
SPREAD, RATE = 10.0, 1.0  # [N] of the starts, of a round's change

SCENE = slcp.scenes.push_block()
OPTIONS = slcp.Options(residual="hard", friction="coulomb")
SIM = slcp.Simulator(SCENE, OPTIONS, device="cpu", dtype="float64")
START = torch.tensor(SCENE.x0)
Outcome = tuple[Tensor, np.ndarray]


def evaluate(force: Tensor) -> Tensor:
    """Cost (B,) of forces (B, STEPS/HOLD); inf where a step was not solved."""
    controls = force.repeat_interleave(HOLD, 1)[..., None]
    states, status = slcp_torch.rollout(SIM, START.expand(len(force), -1), controls, check=False)
    last = states[:, -1]
    cost = PLACE * (last[:, X] - MARK) ** 2 + LEVEL * last[:, ANGLE] ** 2 + EFFORT * (force**2).sum(1)
    cost = cost + REST * (last[:, 4 + X] ** 2 + last[:, 4 + Y] ** 2)
    return torch.where(status == int(slcp.Status.SOLVED), cost, torch.inf)


def descend(start: Tensor, rounds: int) -> Outcome:
    """Adam from every start: the best forces, and the least cost so far (rounds, B)."""
    force = start.clone().requires_grad_()
    optimiser = torch.optim.Adam([force], lr=RATE, betas=(0.8, 0.95))
    schedule = torch.optim.lr_scheduler.LambdaLR(optimiser, lambda k: 1.0 - k / rounds)
    best, least, history = start.clone(), torch.full((len(start),), torch.inf, dtype=start.dtype), []
    for _ in range(rounds):
        now = evaluate(force)
        better = now.detach() < least
        least, best = (
            torch.where(better, now.detach(), least),
            torch.where(better[:, None], force.detach(), best),
        )
        history.append(least.numpy())
        optimiser.zero_grad()
        now.sum().backward()
        force.grad.nan_to_num_(0.0)  # of worlds that were not solved
        optimiser.step()
        schedule.step()
    return best, np.array(history)


@torch.no_grad()
def evolve(start: Tensor, rounds: int, rng: np.random.Generator) -> Outcome:
    """(1+1) evolution strategies with the one-fifth rule: the same outcome as `descend`."""
    best, least = start, evaluate(start)
    width, history = torch.full_like(least, 3.0), [least.numpy()]
    for _ in range(rounds - 1):
        trial = best + width[:, None] * torch.tensor(rng.normal(size=best.shape))
        now = evaluate(trial)
        better = now < least
        least, best = torch.where(better, now, least), torch.where(better[:, None], trial, best)
        width = width * torch.where(better, 1.5, 1.5**-0.25)
        history.append(least.numpy())
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
    force = torch.tensor(SPREAD * rng.standard_normal((arguments.starts, STEPS // HOLD)))
    best, descent = descend(force, arguments.rounds)
    _, search = evolve(force, arguments.rounds, rng)
    for name, history in (("gradient", descent), ("evolution strategy", search)):
        middle = np.median(history[-1])
        print(f"{name}: least cost {history[-1].min():.4f}, median of {len(force)} starts {middle:.4f}")
    share = (descent[-1] < search[-1].min()).mean()
    print(f"starts whose gradient descent ends below the best evolution strategy: {share:.0%}")
    winner = best[int(np.argmin(descent[-1]))].numpy()
    states = SIM.rollout(SCENE.x0, np.repeat(winner, HOLD)[:, None]).states
    print(
        f"the best plan's block ends at {states[-1, X]:.4f} m at {states[-1, 4 + X]:.4f} m/s; mark {MARK} m"
    )
    draw(states, descent, search, arguments.out)
    print(f"wrote {arguments.out}")


if __name__ == "__main__":
    main()
