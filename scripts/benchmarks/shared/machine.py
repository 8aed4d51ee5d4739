"""What a measurement ran on: processor, load, versions, commit."""

import os
from typing import Any

from slcp_warp.runs.origin import surroundings, version


def machine() -> dict[str, Any]:
    """The processor, its cores, the load of the last minute, and the versions of what was measured."""
    found = surroundings()
    return {
        "cpu": found["cpu"],
        "cores": found["cores"],
        "load": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else 0.0,
        "system": found["system"],
        "python": found["python"],
        **{name: version(name) for name in ("slcp-warp", "warp-lang", "numpy", "mujoco")},
        "commit": found["commit"],
        "time": found["time"],
    }
