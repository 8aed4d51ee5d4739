"""Tensors between PyTorch's stream and Warp's: what is waited for, and when. The streams are made up."""

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from simulators import simulator

from slcp_warp.inputs import streams

torch = pytest.importorskip("torch")


class Stream:
    """A stream that says for whom it waits."""

    def __init__(self, name, handle, said):
        self.name, self.cuda_stream, self._said = name, handle, said

    def wait_stream(self, other):
        self._said.append(f"{self.name} waits for {other.name}")


@pytest.fixture
def said(monkeypatch):
    """What streams say on a made-up GPU, whose arrays are the CPU's."""
    out = []
    ours, theirs = Stream("warp", 1, out), Stream("torch", 2, out)
    gpu = SimpleNamespace(is_cuda=True, is_capturing=False, stream=ours, alias="cuda:0")
    fake = SimpleNamespace(
        get_device=lambda device: gpu, device_to_torch=lambda device: "cuda:0", stream_from_torch=lambda s: s
    )
    monkeypatch.setattr(streams, "wp", fake)
    monkeypatch.setattr(torch.cuda, "current_stream", lambda device: theirs)
    return SimpleNamespace(out=out, gpu=gpu, theirs=theirs)


def test_tensors_are_waited_for_and_results_wait(said, monkeypatch):
    sim = simulator("flicking_finger", "cpu", wp.float64, "none")
    x = torch.as_tensor(np.tile(sim.scene.x0, (3, 1)))
    launch = wp.launch
    monkeypatch.setattr(wp, "launch", lambda *a, **k: said.out.append("launch") or launch(*a, **k))
    state = sim.step(x).state
    assert isinstance(state, torch.Tensor)
    at = said.out.index("launch")
    assert said.out[:at] and set(said.out[:at]) == {"warp waits for torch"}
    after = [line for line in said.out[at:] if line != "launch"]
    assert after and set(after) == {"torch waits for warp"}
    said.out.clear()
    sim.step(x.numpy())
    assert set(said.out) == {"launch"}


def test_nothing_waits_on_one_stream_in_a_capture_or_without_torch(said, monkeypatch):
    def both():
        streams.wait_for_torch("cuda:0")
        streams.let_torch_wait("cuda:0")
        return said.out.copy()

    assert both() == ["warp waits for torch", "torch waits for warp"]
    said.out.clear()
    said.gpu.is_capturing = True
    assert both() == []
    said.gpu.is_capturing, said.theirs.cuda_stream = False, 1
    assert both() == []
    said.theirs.cuda_stream, said.gpu.is_cuda = 2, False
    assert both() == []
    monkeypatch.setitem(streams.sys.modules, "torch", None)
    said.gpu.is_cuda = True
    assert both() == []
