"""MJX as a peer: MuJoCo's model and options compiled by JAX in float32, and its forward-mode derivatives."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from slcp_warp import Scene

from ..shared.optional import load
from .mujoco import SETTINGS, Setting, in_single, model_of
from .peer import Deviation, Linearization, Run, deviation_of, places, step_count

BATCH = 64  # worlds that are timed
TIMED = 20  # steps that are timed
STILL = 1e-6  # step in which nothing moves [s]
Array = np.ndarray


class MJX:
    """MJX on JAX's default device."""

    name = "MJX"

    def __init__(self, batch: int = BATCH) -> None:
        self.jax = load("jax", "MJX", "peers")
        self.mjx = load("mujoco.mjx", "MJX", "peers")
        self.version: str = load("importlib.metadata", "MJX", "peers").version("mujoco-mjx")
        self.batch = batch
        self._advance = self.jax.jit(self.jax.vmap(self._steps, in_axes=(None, 0, None)))

    def settings(self, contacts: bool) -> tuple[str, ...]:
        """MuJoCo's, as far as they are supported and compile in half a minute."""
        return ("default", "overdamped") if contacts else ("RK4",)

    def _steps(self, model: Any, data: Any, count: Any) -> Any:
        return self.jax.lax.fori_loop(0, count, lambda _, d: self.mjx.step(model, d), data)

    def _map(self, model: Any, data: Any, z: Any) -> Any:
        """One step from z = (q, v, u) to the next (q, v)."""
        nv = model.nv
        data = data.replace(qpos=z[:nv], qvel=z[nv : 2 * nv], ctrl=z[2 * nv :])
        data = self.mjx.step(model, data)
        return self.jax.numpy.concatenate([data.qpos, data.qvel])

    def _put(self, scene: Scene, h: float, setting: str) -> tuple[Any, Any]:
        """Model and data of one world."""
        host = model_of(scene, h, in_single(SETTINGS[setting])).model
        return self.mjx.put_model(host), self.mjx.make_data(host)

    def _worlds(self, data: Any, x: Array) -> Any:
        """A batch of worlds at states x (B, nx), at time 0 and without a warm start."""
        nv, single = x.shape[1] // 2, np.float32
        many = self.jax.tree_util.tree_map(lambda leaf: np.broadcast_to(leaf, (len(x), *leaf.shape)), data)
        many = many.replace(qpos=x[:, :nv].astype(single), qvel=x[:, nv:].astype(single))
        return self.jax.device_put(many, self.jax.devices()[0])  # as results are: nothing compiles twice

    def prepare(self, scene: Scene, starts: Array, duration: float, h: float, setting: str) -> Run:
        """A run of the starts (B, nx), already done; timed on worlds anywhere on these trajectories."""
        model, single = self._put(scene, h, setting)
        batch = max(self.batch, len(starts))
        data = self._worlds(single, np.resize(starts, (batch, starts.shape[1])))
        begin = time.perf_counter()
        data = self._advance(model, data, 0)  # compiles
        compiling = time.perf_counter() - begin
        states = []
        for k in range(step_count(duration, h) + 1):
            data = self._advance(model, data, min(k, 1))
            states.append(np.concatenate([data.qpos, data.qvel], axis=1, dtype=float)[: len(starts)])
        every = np.stack(states, axis=1)
        every[:, 0] = starts
        timed = self._advance(model, self._worlds(single, places(every, batch)), 0)
        facts = {"dtype": "float32", "batch": batch, "device": self.jax.default_backend()}

        def simulate() -> None:
            self.jax.block_until_ready(self._advance(model, timed, TIMED))

        return Run(lambda: every, simulate, batch, TIMED * h, compiling, facts)

    def stepper(self, scene: Scene, h: float, x: Array, u: Array, count: int) -> Callable[[], Array]:
        """A call that takes `count` steps from x (B, nx) under u (B, nu) and gives the states (B, nx)."""
        model, single = self._put(scene, h, "default")
        nv, data = scene.nv, self._worlds(single, x)

        def call() -> Array:
            begun = data.replace(qpos=x[:, :nv].astype(np.float32), qvel=x[:, nv:].astype(np.float32),
                                 ctrl=u.astype(np.float32))  # fmt: skip
            done = self._advance(model, begun, count)
            return np.concatenate([done.qpos, done.qvel], axis=1)

        return call

    def linearization(self, scene: Scene, h: float, setting: str = "default") -> Linearization:
        """Its step in float64, and jax.jacfwd of it in float32."""
        with self.jax.enable_x64(True):
            wide = self._put(scene, h, setting)
        single = self._put(scene, h, setting)
        one = self.jax.jit(self.jax.vmap(self._map, in_axes=(None, None, 0)))
        derivative = self.jax.jacfwd(self._map, argnums=2)
        many = self.jax.jit(self.jax.vmap(derivative, in_axes=(None, None, 0)))

        def step(z: Array) -> Array:
            with self.jax.enable_x64(True):
                return np.asarray(one(*wide, z.astype(np.float64)))

        def jacobian(z: Array) -> Array:
            return np.asarray(many(*single, z.astype(np.float32)))

        return Linearization(step, {"jacfwd": jacobian})

    def deviation(self, scene: Scene, q: Array) -> Deviation:
        """Of its model, at q (K, nv), BATCH of them at most."""
        model, single = self._put(scene, STILL, self.settings(bool(scene.all_contacts))[0])
        x = np.concatenate([q, 0.0 * q], axis=1)
        data = self._advance(model, self._worlds(single, np.resize(x, (self.batch, x.shape[1]))), 1)
        masses = np.asarray(self.jax.vmap(self.mjx.full_m, in_axes=(None, 0))(model, data), float)[: len(q)]
        touch = data._impl.contact  # of the step's start; MJX makes one of every pair at any distance
        gaps = np.zeros((len(q), len(scene.all_contacts)))
        normals = np.zeros((*gaps.shape, 2))
        if len(scene.all_contacts):
            names = model_of(scene, scene.step_size, Setting()).model
            for k, c in enumerate(scene.all_contacts):
                first, second = (names.geom(name).id for name in (c.shape_a, c.shape_b))
                ends = np.asarray(touch.geom[0])
                j = int(np.nonzero((np.sort(ends, axis=1) == sorted((first, second))).all(axis=1))[0][0])
                gaps[:, k] = touch.dist[: len(q), j]
                sign = 1.0 if ends[j, 0] == first else -1.0
                normals[:, k] = sign * np.asarray(touch.frame[: len(q), j, 0, :2])
        return deviation_of(scene, q, masses, gaps, normals)
