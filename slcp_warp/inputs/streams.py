"""PyTorch's streams of a GPU: what it has been asked for is waited for, and it waits for what it is given.

Warp works on a stream of its own and PyTorch on another one. Its side streams wait for nobody: without this a
tensor would be read before it is written, and a result used before it is there.
"""

import sys
from typing import Any

import warp as wp


def wait_for_torch(device: Any) -> None:
    """Let Warp's work on a device come after what PyTorch's current stream has been asked for."""
    ours, theirs = _streams(device)
    if theirs is not None:
        ours.wait_stream(theirs)


def let_torch_wait(device: Any) -> None:
    """Let what PyTorch's current stream is asked for come after Warp's work on a device."""
    ours, theirs = _streams(device)
    if theirs is not None:
        theirs.wait_stream(ours)


def _streams(device: Any) -> tuple[Any, Any]:
    """Warp's current stream of a device and PyTorch's, None where there is nothing to wait for: on a CPU, on
    one and the same stream, while a graph is captured, which waits for nothing outside of it.
    """
    where, torch = wp.get_device(device), sys.modules.get("torch")
    if torch is None or not where.is_cuda or where.is_capturing:
        return None, None
    ours, current = where.stream, torch.cuda.current_stream(wp.device_to_torch(where))
    if current.cuda_stream == ours.cuda_stream:
        return None, None
    return ours, wp.stream_from_torch(current)
