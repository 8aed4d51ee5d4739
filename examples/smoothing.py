"""The gradient of a contact task under noise: by one smoothed rollout, by sampling, by sampling without
derivatives.

    python examples/smoothing.py [--out docs/images/smoothing.png]

The finger flicks at the ellipse; the task is how far the ellipse turns in .7 s, as a function of the speed
at which the finger's first joint starts. Contact is hard, and every velocity is disturbed before every step
(.1 rad/s). What one wants is the gradient of the mean. One smoothed rollout gives the gradient of its own
model, where the noise has become a fuzzy layer (18): no variance, some bias. The mean of exact gradients
along disturbed hard rollouts has variance, and is blind to jumps. Values times noise (the score function,
zeroth order) need no gradient and have no bias, but more variance. The truth comes from a quadrature over
the first disturbance, with many rollouts for the others.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import warp as wp

import slcp_warp as slcp

STEPS = 14  # of .05 s
NOISE = 0.1  # of every velocity, before every step [rad/s]
SPEEDS = np.linspace(-0.5, 3.0, 71)  # where the gradient is wanted [rad/s]
START = np.array([-2.2, -0.6, 0.4, 0.0, -1.0, 0.0])
JOINT, TASK = 3, 2  # the first joint's speed and the ellipse's angle in the state
ASSUMED = (0.5, 0.3, 0.2, 0.15, 0.1, 0.05, 0.02, 0.01, 0.005)  # noise of the smoothed model [rad/s]
POOL = 1024  # samples at each speed, from which the estimators' errors follow
COUNTS = 2.0 ** np.arange(15)

SCENE = slcp.scenes.flicking_finger()
SMOOTH = slcp.Simulator(
    SCENE, slcp.Options(residual="rem-normal", noise="state"), device="cpu", dtype="float64"
)
HARD = slcp.Simulator(SCENE, slcp.Options(residual="hard"), device="cpu", dtype="float64")


@wp.kernel
def disturb(
    x: wp.array2d(dtype=wp.float64), noise: wp.array2d(dtype=wp.float64), y: wp.array2d(dtype=wp.float64)
):
    """y = x + noise."""
    i, j = wp.tid()
    y[i, j] = x[i, j] + noise[i, j]


def starts(speed: np.ndarray) -> np.ndarray:
    """States (B, 6) whose first joint starts at the speeds (B,)."""
    x0 = np.tile(START, (len(speed), 1))
    x0[:, JOINT] = speed
    return x0


def smoothed(noise: float) -> tuple[np.ndarray, np.ndarray]:
    """Turn [rad] and its derivative at SPEEDS, by one rollout each of the model that assumes `noise`."""
    params = SMOOTH.params.replace(position_covariance=0.0, velocity_covariance=noise**2 * np.eye(3))
    x0 = wp.array(starts(SPEEDS), dtype=wp.float64, device="cpu", requires_grad=True)
    us = wp.zeros((len(SPEEDS), STEPS, 2), dtype=wp.float64, device="cpu")
    with wp.Tape() as tape:
        traj = SMOOTH.rollout(x0, us, params)
    if traj.status.numpy().any():
        raise RuntimeError("a smoothed rollout was not solved")
    seed = np.zeros(traj.states.shape)
    seed[:, -1, TASK] = 1.0
    tape.backward(grads={traj.states: wp.array(seed, dtype=wp.float64, device="cpu")})
    return traj.states.numpy()[:, -1, TASK] - START[TASK], x0.grad.numpy()[:, JOINT]


def sampled(speed: np.ndarray, rng: np.random.Generator, first: bool = True) -> tuple[np.ndarray, ...]:
    """Turn (B,), its derivative along the path, and the first joint's first disturbance, of hard rollouts.

    first: whether the first joint is disturbed before the first step, too.
    """
    x = wp.array(starts(speed), dtype=wp.float64, device="cpu", requires_grad=True)
    u, start, initial = np.zeros((len(speed), 2)), x, None
    with wp.Tape() as tape:
        for k in range(STEPS):
            noise = np.zeros((len(speed), 6))
            noise[:, 3:] = NOISE * rng.standard_normal((len(speed), 3))
            if k == 0:
                noise[:, JOINT] *= first
                initial = noise[:, JOINT]
            y = wp.zeros_like(x, requires_grad=True)
            wp.launch(
                disturb, x.shape, [x, wp.array(noise, dtype=wp.float64, device="cpu")], [y], device="cpu"
            )
            step = HARD.step(y, wp.array(u, dtype=wp.float64, device="cpu"))
            x = step.state
    seed = np.zeros(x.shape)
    seed[:, TASK] = 1.0
    tape.backward(grads={x: wp.array(seed, dtype=wp.float64, device="cpu")})
    return x.numpy()[:, TASK] - START[TASK], start.grad.numpy()[:, JOINT], initial


def mean_under_noise(
    rng: np.random.Generator, fine: int = 1401, each: int = 200
) -> tuple[np.ndarray, np.ndarray]:
    """The task's mean and the mean's gradient at SPEEDS."""
    reach = 5.0 * NOISE
    speed = np.linspace(SPEEDS[0] - reach, SPEEDS[-1] + reach, fine)
    turn = np.mean([sampled(speed, rng, first=False)[0] for _ in range(each)], axis=0)
    away = (speed - SPEEDS[:, None]) / NOISE
    weight = np.exp(-0.5 * away**2)
    weight /= weight.sum(1, keepdims=True)
    return weight @ turn, (weight * away) @ turn / NOISE


def errors(truth: np.ndarray, mean: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Error of the estimators for COUNTS rollouts: root mean square over SPEEDS, relative to the truth's."""
    turn, slope, noise = (a.reshape(-1, POOL) for a in sampled(np.repeat(SPEEDS, POOL), rng))
    samples = {
        "values (zeroth order)": (turn - mean[:, None]) * noise / NOISE**2,
        "gradients (first order)": slope,
    }
    found = {}
    for name, sample in samples.items():
        variance = sample.var(1)
        bias = np.maximum((sample.mean(1) - truth) ** 2 - variance / POOL, 0.0)  # less the pool's own scatter
        bias *= name.startswith("gradients")  # the score function has none
        found[name] = np.sqrt((bias + variance / COUNTS[:, None]).mean(1) / (truth**2).mean())
    return found


def draw(turns: dict[str, np.ndarray], single: np.ndarray, found: dict[str, np.ndarray], out: Path) -> None:
    """The task, the error of one smoothed gradient over the noise it assumes, and all over rollouts."""
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(14, 4), layout="constrained")
    for name, turn in turns.items():
        left.plot(SPEEDS, turn, label=name, linewidth=2.5 if "mean" in name else 1.0)
    left.set(xlabel="speed of joint 1 at the start [rad/s]", ylabel="turn of the ellipse [rad]")
    left.legend(fontsize=8)
    middle.loglog(ASSUMED, single, "o-")
    middle.axvline(NOISE, color="black", linestyle=":", label="the noise there is")
    middle.set(xlabel="noise that is assumed [rad/s]", ylabel="relative error of the gradient")
    middle.set(title="one smoothed rollout")
    middle.legend(fontsize=8)
    for name, error in found.items():
        right.loglog(COUNTS, error, label=f"hard, {name}")
    right.axhline(single[ASSUMED.index(NOISE)], color="black", linestyle=":", label="one smoothed rollout")
    right.set(xlabel="rollouts", ylabel="relative error of the gradient", title="sampled")
    right.legend(fontsize=8)
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=110)


def main() -> None:
    """Measure, report, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs/images/smoothing.png"))
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    mean, truth = mean_under_noise(rng)
    hard = HARD.rollout(starts(SPEEDS), np.zeros((len(SPEEDS), STEPS, 2))).states[:, -1, TASK] - START[TASK]
    turns, single = {"hard, no noise": hard}, []
    for noise in ASSUMED:
        turn, slope = smoothed(noise)
        single.append(np.sqrt(((slope - truth) ** 2).mean() / (truth**2).mean()))
        if noise in (NOISE, 0.02):
            turns[f"smoothed, assumes {noise}"] = turn
        print(f"one smoothed rollout that assumes {noise:5g}: relative error {single[-1]:.3f}")
    turns[f"mean of hard under noise {NOISE}"] = mean
    found = errors(truth, mean, rng)
    for name, error in found.items():
        line = ", ".join(f"{int(COUNTS[k])}: {error[k]:.3f}" for k in (0, 4, 8, 12))
        print(f"hard, {name}: relative error at rollouts {line}")
    draw(turns, np.array(single), found, arguments.out)
    print(f"wrote {arguments.out}")


if __name__ == "__main__":
    main()
