"""A task and policies in a user's Python file, for kernels that the tests of tasks have compiled."""

from pathlib import Path

TEXT = """
from dataclasses import replace
import numpy as np
import slcp_warp as slcp

SCENE = replace(slcp.scenes.push_block(), step_size=0.02, sigma=0.05)

def push():
    cost = slcp.costs.terms(SCENE, [slcp.costs.effort(1.0)])
    drawn = slcp.Disturbances(parameters={"mass": 0.1}, start={"pusher.shift": 0.02}, torque=0.3)
    x = slcp.measures.final("block.x")
    return slcp.Task("push", SCENE, cost, 60, measures={"x": x}, success=x > 0.4, disturbances=drawn)

gain = slcp.policies.Linear(np.zeros((1, 8)), SCENE.x0, [FORCE])

def asked():
    return slcp.policies.Callback(lambda x, time: np.full((len(x), 1), FORCE), period=0.6)
"""


def push_file(folder: Path, force: float = 3.0) -> Path:
    """Write the file: task `push`, policies `gain`, in kernels, and `asked`, on the host."""
    path = folder / "mine.py"
    path.write_text(TEXT.replace("FORCE", str(force)))
    return path
