"""Identify a block's mass and its friction with the ground from a noisy recording of being pushed.

    python examples/identify.py [--out docs/images/identify.png] [--recordings 200]

A pusher drives into the block with a known force; the recording is the positions, ten times a second, with
errors of 2 mm and 2 mrad. Gauss-Newton on the logarithms of mass and friction, all recordings at once. The
Jacobian is exact: one world per measured number, each sending its own row of the identity back through the
rollout. The standard errors come from the same Jacobian; over many recordings they must cover the truth as
often as they claim.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import warp as wp

import slcp_warp as slcp

STEPS, EVERY, NOISE = 120, 10, 2e-3  # of .01 s; a measurement every 10 steps; [m], [rad]
TRUTH, GUESS = np.array([1.3, 0.35]), np.array([0.8, 0.6])  # mass [kg], friction
NAMES = ("mass [kg]", "friction")
ROUNDS = 8

SCENE = slcp.scenes.push_block()
SIM = slcp.Simulator(SCENE, device="cpu", dtype="float64")
BLOCK = [body.name for body in SCENE.bodies].index("block")
GROUND = [i for i, pair in enumerate(SCENE.contacts) if "ground" in (pair.shape_a, pair.shape_b)]
TIMES = np.arange(EVERY, STEPS + 1, EVERY)


def force(worlds: int) -> np.ndarray:
    """The known force on the pusher [N], (worlds, STEPS, 1)."""
    time = 0.01 * np.arange(STEPS)
    return np.broadcast_to((9.0 + 6.0 * np.sin(12.0 * time))[:, None], (worlds, STEPS, 1)).copy()


def parameters(theta: np.ndarray) -> slcp.Parameters:
    """Parameters of worlds with mass and friction theta (B, 2); the block's inertia grows with its mass."""
    worlds = len(theta)
    mass = np.tile(SIM.params["mass"], (worlds, 1))
    inertia = np.tile(SIM.params["inertia"], (worlds, 1))
    friction = np.tile(SIM.params["friction"], (worlds, 1))
    inertia[:, BLOCK] *= theta[:, 0] / mass[:, BLOCK]
    mass[:, BLOCK] = theta[:, 0]
    friction[:, GROUND] = theta[:, 1:]
    return SIM.params.replace(mass=mass, inertia=inertia, friction=friction)


def predict(theta: np.ndarray) -> np.ndarray:
    """What would be measured with theta (B, 2): positions (B, len(TIMES), nv)."""
    traj = SIM.rollout(np.tile(SCENE.x0, (len(theta), 1)), force(len(theta)), parameters(theta))
    assert not traj.status.any()
    return traj.states[:, TIMES, : SIM.nx // 2]


def jacobian(theta: np.ndarray) -> np.ndarray:
    """Derivatives by log mass and log friction, (B, measured, 2), in one backward pass."""
    batch, nv = len(theta), SIM.nx // 2
    measured = len(TIMES) * nv
    each = np.repeat(theta, measured, axis=0)
    seeds = np.zeros((batch, measured, STEPS + 1, SIM.nx))
    for k, step in enumerate(TIMES):
        for i in range(nv):
            seeds[:, k * nv + i, step, i] = 1.0
    params = parameters(each).track()
    with wp.Tape() as tape:
        x0 = wp.array(np.tile(SCENE.x0, (len(each), 1)), dtype=wp.float64, device="cpu")
        us = wp.array(force(len(each)), dtype=wp.float64, device="cpu")
        traj = SIM.rollout(x0, us, params)
    seeds = seeds.reshape(len(each), STEPS + 1, SIM.nx)
    tape.backward(grads={traj.states: wp.array(seeds, dtype=wp.float64, device="cpu")})
    by_mass = params.gradient("mass")[:, BLOCK] * each[:, 0]
    by_mass += params.gradient("inertia")[:, BLOCK] * params["inertia"][:, BLOCK]
    by_friction = params.gradient("friction")[:, GROUND].sum(1) * each[:, 1]
    return np.stack([by_mass, by_friction], -1).reshape(batch, measured, 2)


def identify(recordings: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Least squares for every recording (B, T, nv): theta (B, 2), covariance of its logarithm, history."""
    theta = np.tile(GUESS, (len(recordings), 1))
    history = [theta]
    for _ in range(ROUNDS):
        error = (recordings - predict(theta)).reshape(len(recordings), -1)
        slope = jacobian(theta)
        step = np.linalg.solve(slope.swapaxes(1, 2) @ slope, np.einsum("bij,bi->bj", slope, error)[..., None])
        theta = theta * np.exp(np.clip(step[..., 0], -0.5, 0.5))
        history.append(theta)
    error = (recordings - predict(theta)).reshape(len(recordings), -1)
    variance = (error**2).sum(1) / (error.shape[1] - 2)
    slope = jacobian(theta)
    return theta, variance[:, None, None] * np.linalg.inv(slope.swapaxes(1, 2) @ slope), history


def draw(recording: np.ndarray, theta: np.ndarray, error: np.ndarray, out: Path) -> None:
    """The first recording with what is predicted before and after, and every recording's estimate."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    time = 0.01 * TIMES
    for name, value, style in (("first guess", GUESS, ":"), ("identified", theta[0], "-")):
        left.plot(time, predict(value[None])[0, :, 1], style, color="C0", label=f"block, {name}")
    left.errorbar(time, recording[:, 1], 2.0 * NOISE, fmt=".", color="C1", label="recorded, 2 sd")
    left.set(xlabel="time [s]", ylabel="block's position [m]")
    left.legend()
    by, bx = 1.96 * (theta * error)[:, 1], 1.96 * (theta * error)[:, 0]
    right.errorbar(*theta.T, by, bx, fmt=".", color="C0", elinewidth=0.4, label="recordings, 95 %")
    right.plot(*TRUTH, "*", color="C3", markersize=14, zorder=5, label="truth")
    right.set(xlabel=NAMES[0], ylabel=NAMES[1])
    right.legend()
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=110)


def main() -> None:
    """Identify, report, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs/images/identify.png"))
    parser.add_argument("--recordings", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    clean = predict(TRUTH[None])
    recordings = clean + NOISE * rng.standard_normal((arguments.recordings, *clean.shape[1:]))
    theta, covariance, history = identify(recordings)
    error = np.sqrt(np.einsum("bii->bi", covariance))
    inside = np.abs(np.log(theta / TRUTH)) <= 1.96 * error
    for i, name in enumerate(NAMES):
        found = f"{theta[0, i]:.4f} +- {theta[0, i] * error[0, i]:.4f}"
        print(f"{name}: truth {TRUTH[i]}, first guess {GUESS[i]}, first recording {found};")
        print(f"  95 % interval covers the truth in {inside[:, i].mean():.1%} of {len(theta)} recordings")
    print("change of the last round:", np.abs(np.log(history[-1] / history[-2])).max())
    draw(recordings[0], theta, error, arguments.out)
    print(f"wrote {arguments.out}")


if __name__ == "__main__":
    main()
