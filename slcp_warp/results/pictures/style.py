"""One look for all pictures: light background, colours that colour-blind readers tell apart (Okabe & Ito).

`plt.style.context(STYLE)` puts it on.
"""

from pathlib import Path
from typing import Any

from ...storage.files import replacing

try:
    import matplotlib.pyplot as plt
    from matplotlib.animation import PillowWriter
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize
    from matplotlib.patches import Polygon
except ImportError as error:
    raise ImportError("pictures need matplotlib and pillow: pip install 'slcp-warp[cli]'") from error

BLACK, ORANGE, SKY, GREEN = "#222222", "#E69F00", "#56B4E9", "#009E73"
BLUE, RED, PINK, GREY = "#0072B2", "#D55E00", "#CC79A7", "#9A9A9A"
CASES = (BLUE, SKY, RED, ORANGE, GREEN, PINK)  # series in the order they come
IMPULSE: Colormap = LinearSegmentedColormap.from_list(
    "impulse", ["#A9BAC6", "#F0C987", "#E69F00", "#D55E00", "#7A1F00"]
)
STYLE: Any = {
    "figure.facecolor": "white", "axes.facecolor": "white", "figure.dpi": 100, "savefig.dpi": 150,
    "font.size": 10, "axes.titlesize": 11, "axes.labelsize": 10, "legend.fontsize": 9,
    "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "grid.color": "#E4E4E4",
    "grid.linewidth": 0.7, "axes.axisbelow": True, "axes.edgecolor": "#555555", "legend.frameon": False,
    "lines.linewidth": 1.6,
}  # fmt: skip

__all__ = [
    "BLACK", "BLUE", "CASES", "GREEN", "GREY", "IMPULSE", "ORANGE", "PINK", "RED", "SKY", "STYLE", "Axes",
    "Normalize", "PillowWriter", "Polygon", "ScalarMappable", "plt", "save",
]  # fmt: skip


def save(figure: Any, path: Path) -> Path:
    """Write a figure as a PNG and close it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as part:
        figure.savefig(part)
    plt.close(figure)
    return path
