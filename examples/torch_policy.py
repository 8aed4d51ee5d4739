"""A small neural policy learns to push a block to any mark, by gradients through contact in PyTorch.

    python examples/torch_policy.py [--out docs/images/torch_policy.png] [--rounds 80] [--seeds 3]

Ten times a second the network sees the state, the mark and the time left, and sets the force on the pusher;
after 1.2 s the block is to stand still and level at the mark, which differs from episode to episode.
Training is Adam on the cost's own gradient, backwards through impacts, sliding and sticking (hard contact,
Coulomb friction). Beside it random search in the weights of the same network (Mania et al. 2018, basic
version, steps scaled by the spread of costs), with as many simulated steps, a backward pass counted as two.
"""

import argparse
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import torch
from torch import Tensor, nn
from torch.func import functional_call, vmap

import slcp_warp as slcp
import slcp_warp.torch as slcp_torch

DECISIONS, HOLD = 12, 10  # of .1 s; steps of .01 s for which a force is held
X, Y, ANGLE = 1, 2, 3  # the block's coordinates in the state; the pusher's is 0
MARKS = (0.7, 1.3)  # [m]
FORCE = 30.0  # [N], the largest
PLACE, LEVEL, REST, EFFORT = 20.0, 5.0, 2.0, 2e-4  # as in push.py: [1/m^2], [1/rad^2], [s^2/m^2], [1/N^2]
EPISODES, DIRECTIONS = 64, 8  # of a round; of random search's round, each there and back
EVERY = 5  # rounds between scores
RATE, SEARCH_RATE, SEARCH_WIDTH = 0.015, 0.02, 0.02  # the search: the best of four pairs

SCENE = slcp.scenes.push_block()
OPTIONS = slcp.Options(residual="hard", friction="coulomb")
SIM = slcp.Simulator(SCENE, OPTIONS, device="cpu", dtype="float64")
START = torch.tensor(SCENE.x0)


def policy() -> nn.Module:
    """A fresh network: (state, mark, time left) to a force in (-1, 1)."""
    layers = nn.Sequential(
        nn.Linear(10, 32), nn.Tanh(), nn.Linear(32, 32), nn.Tanh(), nn.Linear(32, 1), nn.Tanh()
    )
    return layers.double()


def episode(net: nn.Module, weights: dict[str, Tensor], marks: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Cost (E,) of episodes with these marks (E,), their last states (E, 8) and status (E,)."""
    x = START.expand(len(marks), -1)
    effort, status = torch.zeros_like(marks), torch.zeros(len(marks), dtype=torch.int32)
    for k in range(DECISIONS):
        left = torch.full_like(marks, 1.0 - k / DECISIONS)
        force = FORCE * functional_call(net, weights, (torch.cat([x, torch.stack([marks, left], 1)], 1),))
        states, failed = slcp_torch.rollout(SIM, x, force[:, None].expand(-1, HOLD, 1), check=False)
        x, status, effort = states[:, -1], torch.maximum(status, failed), effort + EFFORT * force[:, 0] ** 2
    cost = PLACE * (x[:, X] - marks) ** 2 + LEVEL * x[:, ANGLE] ** 2 + effort
    return cost + REST * (x[:, 4 + X] ** 2 + x[:, 4 + Y] ** 2), x, status


def draw_marks(count: int) -> Tensor:
    """Random marks."""
    return MARKS[0] + (MARKS[1] - MARKS[0]) * torch.rand(count, dtype=torch.float64)


def score(net: nn.Module) -> tuple[float, float]:
    """Share of 121 marks at which the block stands, within 3 cm, at the end, and the mean cost."""
    marks = torch.linspace(*MARKS, 121, dtype=torch.float64)
    with torch.no_grad():
        cost, x, status = episode(net, dict(net.named_parameters()), marks)
    still = x[:, 4 + X].abs() + x[:, 4 + Y].abs() < 0.02
    good = ((x[:, X] - marks).abs() < 0.03) & (x[:, ANGLE].abs() < 0.05) & still & (status == 0)
    return good.double().mean().item(), cost.mean().item()


def train(net: nn.Module, rounds: int) -> list[tuple[float, float]]:
    """Descent along gradients through contact; scores of every fifth round."""
    optimiser = torch.optim.Adam(net.parameters(), lr=RATE)
    schedule = torch.optim.lr_scheduler.LambdaLR(optimiser, lambda i: 1.0 - 0.95 * i / rounds)
    history = []
    for k in range(rounds):
        cost, _, _ = episode(net, dict(net.named_parameters()), draw_marks(EPISODES))
        optimiser.zero_grad()
        cost.mean().backward()
        if torch.isfinite(nn.utils.clip_grad_norm_(net.parameters(), 1.0)):  # no step where a world failed
            optimiser.step()
        schedule.step()
        if (k + 1) % EVERY == 0:
            history.append(score(net))
    return history


@torch.no_grad()
def search(net: nn.Module, rounds: int) -> list[tuple[float, float]]:
    """Random search: steps along random directions by the difference of the costs there and back."""
    history = []
    weights = {name: p.detach().clone() for name, p in net.named_parameters()}
    each = 3 * EPISODES // (2 * DIRECTIONS)
    population = vmap(lambda w, marks: episode(net, w, marks)[0].mean(), in_dims=(0, None))
    for k in range(rounds):
        ways = {name: torch.randn(DIRECTIONS, *p.shape, dtype=p.dtype) for name, p in weights.items()}
        moved = {name: p + SEARCH_WIDTH * torch.cat([ways[name], -ways[name]]) for name, p in weights.items()}
        there, back = population(moved, draw_marks(each)).chunk(2)
        slope = (there - back) / (DIRECTIONS * torch.cat([there, back]).std())
        for name in weights:
            weights[name] -= SEARCH_RATE * (1.0 - 0.95 * k / rounds) * torch.tensordot(slope, ways[name], 1)
        net.load_state_dict(weights)
        if (k + 1) % EVERY == 0:
            history.append(score(net))
    return history


def chart(histories: dict[str, np.ndarray], out: Path) -> None:
    """Success and cost over the rounds: every seed, and the median."""
    figure, axes = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
    for color, (name, history) in zip(("C0", "C1"), histories.items()):
        for i, axis in enumerate(axes):
            rounds = 3 * EPISODES * EVERY * np.arange(1, history.shape[1] + 1)
            axis.plot(rounds, history[..., i].T, color=color, alpha=0.3, linewidth=0.8)
            axis.plot(rounds, np.median(history[..., i], 0), color=color, label=f"{name}: median of seeds")
    axes[0].set(xlabel="episodes simulated (backward: two)", ylabel="success", ylim=(-0.02, 1.02))
    axes[1].set(xlabel="episodes simulated (backward: two)", ylabel="mean cost", yscale="log")
    axes[0].legend()
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=110)


def main() -> None:
    """Train, search, report, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs/images/torch_policy.png"))
    parser.add_argument("--rounds", type=int, default=80)
    parser.add_argument("--seeds", type=int, default=3)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    histories: dict[str, np.ndarray] = {}
    for name, method in (("gradient", train), ("random search", search)):
        runs = []
        for seed in range(arguments.seeds):
            torch.manual_seed(seed)
            begin = time.perf_counter()
            runs.append(method(policy(), arguments.rounds))
            success, cost = runs[-1][-1]
            print(f"{name}, seed {seed}: success {success:.0%}, mean cost {cost:.3f}, "
                  f"{time.perf_counter() - begin:.0f} s")  # fmt: skip
        histories[name] = np.array(runs)
    chart(histories, arguments.out)
    print(f"wrote {arguments.out}")


if __name__ == "__main__":
    main()
