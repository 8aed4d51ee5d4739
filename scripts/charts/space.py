"""Pictures of configuration space in cylindrical coordinates: Fig. 2, contact surface; Fig. 3, library.

theta3 has period pi, so a turn around the vertical axis is one period: the angle is 2 theta3. The radius is
RADIUS + theta1 + pi, which keeps the finger's lower limit off the axis; the height is theta2.
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from slcp_warp import ddp

from ..support.records import Record
from .isosurface import isosurface
from .style import IMPULSE, plt, save

RADIUS = 0.5
ELEVATION, AZIMUTH = 32.0, -62.0
WINDOW = (0.05, 0.0, 0.86, 1.06)  # of the 3-D axes in a figure
LIGHT = np.array([0.05, -0.75, 0.66])  # direction to the light: the viewer's left shoulder


def cylindrical(q: np.ndarray) -> np.ndarray:
    """Points (..., 3) in the picture from (theta1, theta2, theta3) (..., 3)."""
    radius, angle = RADIUS + q[..., 0] + np.pi, 2.0 * q[..., 2]
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), q[..., 1]], axis=-1)


def space_axes(figure: Any, rectangle: tuple[float, float, float, float]) -> Any:
    """3-D axes in a rectangle of the figure, with the cylinder's coordinates drawn in."""
    ax = figure.add_axes(rectangle, projection="3d", computed_zorder=False)
    ax.view_init(ELEVATION, AZIMUTH)
    ax.set_axis_off()
    outer = RADIUS + np.pi
    floor = -2.3
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    for theta1 in (-np.pi, -np.pi / 2.0, 0.0):
        r = RADIUS + theta1 + np.pi
        ax.plot(r * np.cos(turn), r * np.sin(turn), floor, color="#BBBBBB", lw=0.8, zorder=0)
        ax.text(0.74 * r, -0.74 * r, floor, _angle_name(theta1), color="#555555", fontsize=8, zorder=1)
    for k, name in enumerate(("0", "π/4", "π/2", "3π/4")):
        c, s = np.cos(k * np.pi / 2.0), np.sin(k * np.pi / 2.0)
        ax.plot([RADIUS * c, outer * c], [RADIUS * s, outer * s], floor, color="#BBBBBB", lw=0.8, zorder=0)
        ax.text(1.13 * outer * c, 1.13 * outer * s, floor, f"θ₃ = {name}", color="#555555", fontsize=9,
                ha="center", va="center", zorder=1)  # fmt: skip
    _height_scale(ax, outer, floor)
    ax.set_box_aspect((1.0, 1.0, 0.55), zoom=1.35)
    ax.set_xlim(-outer, outer)
    ax.set_ylim(-outer, outer)
    ax.set_zlim(floor, 1.7)
    return ax


def _angle_name(value: float) -> str:
    return {0: "θ₁ = 0", -1: "−π/2", -2: "−π"}[round(2.0 * value / np.pi)]


def _height_scale(ax: Any, outer: float, floor: float) -> None:
    """A vertical scale for theta2 at the picture's left edge."""
    x, y = -outer * 0.98, -outer * 0.55
    ax.plot([x, x], [y, y], [floor, 1.6], color="#888888", lw=0.8, clip_on=False)
    for value in (-2.0, -1.0, 0.0, 1.0):
        ax.plot([x, x - 0.12], [y, y], [value, value], color="#888888", lw=0.8, clip_on=False)
        label = {"va": "center", "ha": "right", "color": "#555555", "fontsize": 8}
        ax.text(x - 0.28, y, value, f"{value:+.0f}" if value else "0", **label)
    ax.text(x, y, 1.75, "θ₂ [rad]", color="#555555", fontsize=9, ha="center")


def add_surface(ax: Any, record: Record, alpha: float = 1.0, legal_only: bool = False) -> None:
    """Draw d(q) = 0; the part with theta2 > 0, beyond the joint's limit, is grey or left out."""
    axes = [record[f"axis{i}"].astype(float) for i in range(3)]
    triangles = isosurface(axes, record["gap"].astype(float))
    illegal = triangles[:, :, 1].mean(axis=1) > 0.0
    if legal_only:
        triangles, illegal = triangles[~illegal], illegal[~illegal]
    points = cylindrical(triangles)  # which mirrors: triangles turn the other way round
    shade = 0.5 + 0.5 * np.clip(0.5 + 0.5 * _normals(points[:, ::-1]) @ LIGHT, 0.0, 1.0)
    base = np.where(illegal[:, None], to_rgb("#C8CDD2"), to_rgb("#6FB7E0"))
    colours = np.concatenate(
        [np.clip(base * shade[:, None] * 1.08, 0, 1), np.full((len(base), 1), alpha)], axis=1
    )
    collection = Poly3DCollection(points, facecolors=colours, edgecolors=colours if alpha == 1.0 else "none",
                                  linewidths=0.3, zorder=2)  # fmt: skip
    ax.add_collection3d(collection)


def _normals(triangles: np.ndarray) -> np.ndarray:
    """Unit normals (n, 3), averaged over the triangles around each corner."""
    flat = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    corners, place = np.unique(np.round(triangles.reshape(-1, 3), 5), axis=0, return_inverse=True)
    total = np.zeros((len(corners), 3))
    np.add.at(total, place.ravel(), np.repeat(flat, 3, axis=0))
    smooth = total[place.ravel()].reshape(-1, 3, 3).sum(axis=1)
    return np.asarray(smooth / (np.linalg.norm(smooth, axis=1, keepdims=True) + 1e-12))


def surface_chart(record: Record, path: Path) -> Path:
    """Fig. 2: the contact surface."""
    figure = plt.figure(figsize=(6.4, 4.8))
    ax = space_axes(figure, WINDOW)
    add_surface(ax, record)
    figure.suptitle("Contact surface d(q) = 0: finger tip and ellipse touch", fontsize=11)
    for colour, text in (("#6FB7E0", "reachable"), ("#C8CDD2", "beyond the limit θ₂ ≤ 0")):
        ax.scatter([], [], [], color=colour, marker="s", label=text)
    figure.legend(loc="lower right", handletextpad=0.2)
    return save(figure, path)


def library_chart(library: ddp.Library, path: Path, surface: Record | None = None) -> Path:
    """Fig. 3: the origins of the controllers, and how much their plans gain."""
    figure = plt.figure(figsize=(7.2, 4.8))
    ax = space_axes(figure, WINDOW)
    if surface is not None:
        add_surface(ax, surface, alpha=0.16, legal_only=True)
    points = cylindrical(library.x)
    order = np.argsort(library.gain)
    dots = ax.scatter(*points[order].T, c=library.gain[order], cmap="cividis_r", s=9.0, depthshade=False,
                      linewidths=0.0, zorder=5)  # fmt: skip
    bar = figure.colorbar(dots, cax=figure.add_axes((0.88, 0.2, 0.018, 0.6)))
    bar.set_label("cost saved against zero torque")
    plans = int((library.age == 0).sum())
    figure.suptitle(f"Origins of {len(library)} local controllers from {plans} plans", fontsize=11)
    return save(figure, path)


def add_path(ax: Any, q: np.ndarray, impulse: np.ndarray, norm: Any, width: float = 2.2) -> Any:
    """A path through configuration space coloured by the impulse of every step; (T+1, 3) and (T,)."""
    points = cylindrical(q)
    lines = Line3DCollection(np.stack([points[:-1], points[1:]], axis=1), cmap=IMPULSE, norm=norm,
                             linewidths=width, zorder=6, capstyle="round")  # fmt: skip
    lines.set_array(impulse)
    ax.add_collection3d(lines)
    return lines
