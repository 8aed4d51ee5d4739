"""The look of all pictures, for files: no window is opened."""

import matplotlib

matplotlib.use("Agg")

from slcp_warp.results.pictures.style import (
    BLACK,
    BLUE,
    CASES,
    GREEN,
    GREY,
    IMPULSE,
    ORANGE,
    PINK,
    RED,
    SKY,
    STYLE,
    plt,
    save,
)

plt.style.use(STYLE)

__all__ = [
    "BLACK", "BLUE", "CASES", "GREEN", "GREY", "IMPULSE", "ORANGE", "PINK", "RED", "SKY", "plt", "save",
]  # fmt: skip
