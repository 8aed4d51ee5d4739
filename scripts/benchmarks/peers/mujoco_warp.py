"""mujoco_warp as a peer: MuJoCo's model and options in float32, a batch of worlds in one launch."""

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import warp as wp

from slcp_warp import Scene

from ..shared.optional import load
from .mujoco import SETTINGS, in_single, model_of
from .mujoco_model import import_mujoco
from .peer import Deviation, Run, places, step_count

BATCH = 1024  # worlds that are timed
TIMED = 5  # steps that are timed
CONTACTS = 8  # least room for contacts of a world, and most of a body in large scenes
ROWS = 8  # of a contact, and limits, in a small scene
Array = np.ndarray


class MuJoCoWarp:
    """mujoco_warp on a device (None: Warp's preferred one); on a GPU its step is captured in a graph."""

    name = "mujoco_warp"

    def __init__(self, device: str | None = None, batch: int = BATCH) -> None:
        import_mujoco()
        self.module = load("mujoco_warp", "mujoco_warp", "peers")
        self.version: str = self.module.__version__
        self.device = wp.get_device(device)
        self.batch = batch

    def settings(self, contacts: bool) -> tuple[str, ...]:
        """MuJoCo's, as far as they are supported."""
        return ("default", "overdamped") if contacts else ("RK4",)

    def prepare(self, scene: Scene, starts: Array, duration: float, h: float, setting: str) -> Run:
        """A run of the starts (B, nx), already done; timed on worlds anywhere on these trajectories."""
        mujoco_model = model_of(scene, h, in_single(SETTINGS[setting])).model
        steps = step_count(duration, h)
        begin = time.perf_counter()
        worlds = Worlds(self.module, mujoco_model, len(starts), self.device)
        worlds.set(starts)
        worlds.step()
        compiling = time.perf_counter() - begin
        worlds.set(starts)
        states = [starts.astype(float)]
        for _ in range(steps):
            worlds.step()
            states.append(worlds.states())
        every = np.stack(states, axis=1)
        many = Worlds(self.module, mujoco_model, self.batch, self.device)
        timed = places(every, self.batch)

        def simulate() -> None:
            many.set(timed)
            for _ in range(TIMED):
                many.step()
            wp.synchronize_device(self.device)

        facts = {"dtype": "float32", "batch": self.batch, "device": str(self.device)}
        if self.device.is_cpu:
            facts["threads"] = 1
        return Run(lambda: every, simulate, self.batch, TIMED * h, compiling, facts)

    def deviation(self, scene: Scene, q: Array) -> Deviation:
        """Of its model, at q (K, nv)."""
        mujoco = import_mujoco()

        def forward(model: Any, q: Array) -> Iterator[Any]:
            worlds = Worlds(self.module, model, len(q), self.device)
            worlds.set(np.concatenate([q, 0.0 * q], axis=1))
            self.module.forward(worlds.model, worlds.data)
            for i in range(len(q)):
                data = mujoco.MjData(model)
                self.module.get_data_into(data, model, worlds.data, i)
                yield data

        setting = in_single(SETTINGS["default"])
        return model_of(scene, scene.step_size, setting).deviation(q, forward)


class Worlds:
    """A batch of worlds on a device, its step captured in a graph where there are graphs."""

    def __init__(self, module: Any, mujoco_model: Any, count: int, device: wp.Device) -> None:
        self.module, self.device = module, device
        self.graph: Any = None
        room = max(CONTACTS, min(mujoco_model.npair, CONTACTS * mujoco_model.nbody))
        rows = max(CONTACTS * ROWS, ROWS // 2 * room)
        with wp.ScopedDevice(device):
            self.model = module.put_model(mujoco_model)
            self.data = module.make_data(mujoco_model, nworld=count, nconmax=room, njmax=rows)

    def set(self, x: Array, u: Array | None = None) -> None:
        """Put states (B, nx) and controls (B, nu) into all worlds, at time 0 and without a warm start."""
        nv = x.shape[1] // 2
        self.data.qpos.assign(x[:, :nv].astype(np.float32))
        self.data.qvel.assign(x[:, nv:].astype(np.float32))
        if u is not None and u.shape[1]:
            self.data.ctrl.assign(u.astype(np.float32))
        self.data.qacc_warmstart.zero_()
        self.data.time.zero_()

    def step(self) -> None:
        """One step of all worlds. The first one compiles, and captures the graph."""
        with wp.ScopedDevice(self.device):
            if self.graph is not None:
                wp.capture_launch(self.graph)
                return
            self.module.step(self.model, self.data)
            if self.device.is_cuda:
                with wp.ScopedCapture() as capture:
                    self.module.step(self.model, self.data)
                self.graph = capture.graph

    def states(self) -> Array:
        """States of all worlds (B, nx)."""
        return np.concatenate([self.data.qpos.numpy(), self.data.qvel.numpy()], axis=1).astype(float)
