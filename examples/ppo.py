"""A policy that learns to catch by trial and error (PPO), beside a plan with feedback, in the same worlds.

    python examples/ppo.py [--out docs/images/ppo.png] [--rounds 60] [--seeds 3]

A ball falls onto a paddle on a cart, disturbed as in the task's sweeps: every episode is a world of its own.
The learner knows nothing of the mechanism; it is paid for every step in which the ball is near the middle of
the paddle and still, up to 1. (Paid by the task's cost it learns to toss the ball: what has fallen far is so
dear that nothing else counts.) It is Proximal Policy Optimization (Schulman et al. 2017, clipped
objective, generalized advantages) on `slcp.Environment`, hard contact with Coulomb's friction. In the end its
network runs inside the kernels of a sweep, beside DDP's plan with its feedback gains.
"""

import argparse
import time
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import torch
import warp as wp
from torch import Tensor, nn

import slcp_warp as slcp
from slcp_warp import ddp

WORLDS, EPOCHS, BATCH = 512, 4, 4096
DISCOUNT, TRACE, CLIP, RATE, ENTROPY = 0.97, 0.95, 0.2, 1e-3, 1e-3
FAR = 0.02  # mean divergence from what played, at which a round stops to learn
OPTIONS = slcp.Options(residual="hard", friction="coulomb")
CART, X, Y = 0, 2, 3  # places of the cart and the ball in the state, positions first
NV = 5


@wp.func
def caught(x: Any, u: Any, time: wp.float64):
    """Near the middle of the paddle, as fast as the cart, and not below."""
    off, slip = x[wp.static(X)] - x[wp.static(CART)], x[wp.static(NV + X)] - x[wp.static(NV + CART)]
    near = wp.exp(-wp.float64(20.0) * wp.float64(off * off) - wp.float64(0.5) * wp.float64(slip * slip))
    return wp.where(x[wp.static(Y)] > x.dtype(0.0), near, wp.float64(0.0))


def network(inputs: int, outputs: int) -> nn.Sequential:
    """Two hidden layers of 64, behind a layer that brings observations to a size of one."""
    return nn.Sequential(
        nn.Linear(inputs, inputs),
        nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs),
    )  # fmt: skip


def normalise(layer: nn.Linear, y: Tensor) -> None:
    """Have a layer bring observations like these (n, ny) to mean 0 and deviation 1, and keep it so."""
    scale = 1.0 / (y.std(0) + 1e-3)
    layer.weight.data, layer.bias.data = torch.diag(scale), -scale * y.mean(0)
    layer.requires_grad_(False)


class Learner:
    """Actor and critic of an environment.

    Attributes:
        env: that is learnt.
        actor: controls in units of half the limits' range.
        critic: the value of what is observed.
    """

    def __init__(self, env: slcp.Environment) -> None:
        self.env = env
        self.actor, self.critic = network(env.observations, env.controls), network(env.observations, 1)
        self.actor[-1].weight.data *= 0.01
        self.actor.append(nn.Tanh())  # within the limits, beyond which nothing is learnt
        self.spread = nn.Parameter(torch.full((env.controls,), -0.7))  # logarithm of the noise
        low, high = (torch.tensor(side, dtype=torch.float32) for side in env.limits)
        self.middle, self.half = 0.5 * (low + high), 0.5 * (high - low)
        self.weights = [*self.actor.parameters(), *self.critic.parameters(), self.spread]
        self.optimiser = torch.optim.Adam(self.weights, lr=RATE, eps=1e-5)
        self.y = torch.from_numpy(env.reset())
        self.fresh = True

    def normal(self, y: Tensor) -> torch.distributions.Normal:
        """What is tried where y is observed."""
        return torch.distributions.Normal(self.actor(y), self.spread.exp())

    @torch.no_grad()
    def play(self, steps: int) -> dict[str, Tensor]:
        """What was observed, tried, and came of it, (steps, B, ...); and the success of what ended."""
        seen: dict[str, list[Tensor]] = {name: [] for name in ("y", "a", "logp", "reward", "over", "next")}
        success = []
        for _ in range(steps):
            tried = self.normal(self.y).sample()
            moment = self.env.step((self.middle + self.half * tried).numpy())
            last = self.critic(torch.from_numpy(moment.last))[:, 0]
            ended = torch.from_numpy(moment.terminated | moment.truncated)
            value = torch.where(torch.from_numpy(moment.terminated), 0.0, last)
            found = self.y, tried, self.normal(self.y).log_prob(tried).sum(1)
            row = (*found, torch.from_numpy(moment.reward).float(), ended, value)
            for name, each in zip(seen, row):
                seen[name].append(each)
            success += moment.ended["success"].tolist()
            self.y = torch.from_numpy(moment.observation)
        return {name: torch.stack(rows) for name, rows in seen.items()} | {"success": torch.tensor(success)}

    @torch.no_grad()
    def advantages(self, seen: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        """Generalized advantages (T, B), and what the values should have been."""
        value = self.critic(seen["y"])[..., 0]
        delta = 0.1 * seen["reward"] + DISCOUNT * seen["next"] - value
        out, trace = torch.zeros_like(delta), torch.zeros_like(delta[0])
        for k in reversed(range(len(delta))):
            trace = delta[k] + DISCOUNT * TRACE * torch.where(seen["over"][k], 0.0, trace)
            out[k] = trace
        return out, out + value

    def round(self, steps: int) -> float:
        """Play and learn from it; the share of the episodes that ended with success."""
        seen = self.play(steps)
        if self.fresh:
            self.fresh = False
            normalise(self.actor[0], seen["y"].flatten(0, 1))
            normalise(self.critic[0], seen["y"].flatten(0, 1))
            return float(seen["success"].float().mean())  # values and tries were of other networks
        advantage, target = (each.flatten() for each in self.advantages(seen))
        y, a, logp = (seen[name].flatten(0, 1) for name in ("y", "a", "logp"))
        for _ in range(EPOCHS):
            for rows in torch.randperm(len(y)).split(BATCH):
                self.learn(y[rows], a[rows], logp[rows], advantage[rows], target[rows])
            with torch.no_grad():
                if (logp - self.normal(y).log_prob(a).sum(1)).mean() > FAR:
                    break
        return float(seen["success"].float().mean())

    def learn(self, y: Tensor, a: Tensor, logp: Tensor, advantage: Tensor, target: Tensor) -> None:
        """One step of Adam on the clipped objective."""
        normal = self.normal(y)
        ratio = (normal.log_prob(a).sum(1) - logp).exp()
        gain = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
        clipped = torch.min(ratio * gain, ratio.clamp(1.0 - CLIP, 1.0 + CLIP) * gain).mean()
        error = (self.critic(y)[:, 0] - target).square().mean()
        loss = 0.5 * error - clipped - ENTROPY * normal.entropy().sum(1).mean()
        self.optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(self.weights, 0.5)
        self.optimiser.step()

    def policy(self) -> slcp.policies.Network:
        """The mean of what is tried, as kernels evaluate it."""
        out = nn.Linear(self.env.controls, self.env.controls)
        out.weight.data, out.bias.data = torch.diag(self.half), self.middle
        return slcp.policies.Network(nn.Sequential(*self.actor, out))


def train(task: slcp.Task, seed: int, rounds: int) -> tuple[slcp.policies.Network, list[float]]:
    """A policy, and the success of every round, with what it tries added to its controls."""
    torch.manual_seed(seed)
    paid = slcp.measures.total(slcp.measures.function(caught))
    learner = Learner(slcp.Environment(task, WORLDS, seed=1000 + seed, case=OPTIONS, reward=paid))
    history = []
    for k in range(rounds):
        for group in learner.optimiser.param_groups:
            group["lr"] = RATE * (1.0 - 0.9 * k / rounds)
        history.append(learner.round(task.steps))
    return learner.policy(), history


def main() -> None:
    """Train, plan, sweep both, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs/images/ppo.png"))
    parser.add_argument("--rounds", type=int, default=60)
    parser.add_argument("--seeds", type=int, default=3)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    task = slcp.tasks.catch()
    policies, histories = {}, []
    for seed in range(arguments.seeds):
        begin = time.perf_counter()
        name = f"learnt, seed {seed}"
        policies[name], history = train(task, seed, arguments.rounds)
        histories.append(history)
        print(f"{name}: success while it tries {history[-1]:.0%}, {time.perf_counter() - begin:.0f} s")
    policies["plan with feedback"] = ddp.TrackingPolicy(
        ddp.plan(task, starts=8, seed=0).best, task.scene.state_period
    )
    report = slcp.sweep(task, policies, worlds=4096, seed=0, cases=OPTIONS)
    shares = {}
    for row in report.summary:
        if row["arm"] == "disturbed":
            share, low, high = shares[row["policy"]] = row["success"]
            print(f"{row['policy']}: {share:.1%} ({low:.1%} to {high:.1%}) of 4,096 other worlds")
    figure, axis = plt.subplots(figsize=(7, 4), layout="constrained")
    episodes = WORLDS * np.arange(1, arguments.rounds + 1)
    axis.plot(episodes, np.array(histories).T, color="C0", alpha=0.4, linewidth=0.8)
    axis.plot(episodes, np.median(histories, 0), color="C0", label="PPO while it tries: median of seeds")
    axis.axhline(shares["plan with feedback"][0], color="C1", label="DDP's plan with feedback")
    axis.set(
        xlabel="episodes",
        ylabel="success",
        ylim=(-0.02, 1.02),
        title=f"{task.name}: disturbed worlds, hard contact",
    )
    axis.legend()
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(arguments.out, dpi=110)
    print(f"wrote {arguments.out}")


if __name__ == "__main__":
    main()
