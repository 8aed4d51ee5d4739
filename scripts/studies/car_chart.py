"""The picture of `slcp car`: two plans on the road, and the cars that follow them."""

from pathlib import Path
from typing import Any

import numpy as np

from slcp_warp import ddp

from ..charts.style import BLACK, BLUE, ORANGE, RED, plt, save
from .car_model import HALF_WIDTH, RADIUS, STEP_SIZE

VIEW = (-42.0, 15.0)


def car_chart(
    path: Path, names: list[str], plans: list[ddp.Result], tracks: list[tuple[Any, Any]], crash: float
) -> Path:
    """One panel a plan with its noisy cars, (states (B, N+1, 5), excess (B,)), and both plans' speeds."""
    figure, axes = plt.subplots(1, 3, figsize=(13.0, 3.6), layout="constrained", width_ratios=(1.4, 1.4, 1.0))
    for ax, name, plan, (states, excess) in zip(axes, names, plans, tracks):
        _road(ax)
        for x, lost in zip(states, excess > crash):
            ax.plot(x[:, 0], x[:, 1], color=RED if lost else BLUE, lw=0.5, alpha=0.5)
        ax.plot(plan.xs[:, 0], plan.xs[:, 1], color=ORANGE, lw=2.0)
        for k in range(0, len(plan.xs), 10):  # the car's heading every half second
            x, y, angle = plan.xs[k, :3]
            ax.plot([x - 0.8 * np.cos(angle), x + 0.8 * np.cos(angle)],
                    [y - 0.8 * np.sin(angle), y + 0.8 * np.sin(angle)], color=BLACK, lw=2.0)  # fmt: skip
        ax.set_title(f"planned for noise of {name}", loc="left")
    for colour, width, label in ((ORANGE, 2.0, "plan"), (BLUE, 0.8, "noisy cars"), (RED, 0.8, "that crash")):
        axes[1].plot([], [], color=colour, lw=width, label=label)
    axes[1].legend(loc="center left")
    time = STEP_SIZE * np.arange(len(plans[0].xs))
    for name, plan, style in zip(names, plans, ("-", "--")):
        axes[2].plot(time, np.hypot(plan.xs[:, 3], plan.xs[:, 4]), style, color=ORANGE, label=name)
    axes[2].set_xlabel("time [s]")
    axes[2].set_ylabel("planned speed [m/s]")
    axes[2].legend()
    return save(figure, path)


def _road(ax: Any) -> None:
    turn = np.linspace(-np.pi / 2.0, np.pi / 2.0, 100)
    for radius in (RADIUS - HALF_WIDTH, RADIUS + HALF_WIDTH):
        x = np.concatenate([[VIEW[0]], radius * np.cos(turn), [VIEW[0]]])
        y = np.concatenate([[-radius], radius * np.sin(turn), [radius]])
        ax.plot(x, y, color=BLACK, lw=1.2)
    ax.set_aspect("equal")
    ax.set_xlim(*VIEW)
    ax.set_ylim(-16.0, 16.0)
    ax.grid(False)
    ax.set_xlabel("x [m]")
    ax.set_ylabel("y [m]")
