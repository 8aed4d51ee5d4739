"""The engine: simulated time that follows the clock, commands in, pictures out; it knows no browser."""

import queue
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from slcp_warp.results.pictures.contacts import contact_points, forces
from slcp_warp.stepping.acting import Acting, acting

from .knobs import SPEED, Knob, knobs_of
from .pull import Pull, catch
from .record import Record
from .scenario import Button
from .world import Subject, Worlds

FRAME = 1.0 / 60.0  # s
MARGIN = 0.15  # around the mechanism at its start, of its size
PLAN_EVERY = 5  # steps of a plan that is drawn
MOST_STEPS = 8  # of a frame: what is later than that is dropped
ZERO = "zero"
MOST = 1e12  # of what a picture holds: JSON has no infinite numbers


def plain(values: Any, digits: int) -> Any:
    """Rounded numbers as JSON has them: what is none is 0, and none is larger than `MOST`."""
    return np.clip(np.nan_to_num(values), -MOST, MOST).round(digits).tolist()


class Engine:
    """Owns what is watched; one thread runs it, others send commands and take the newest picture.

    Args:
        subject: what is watched.
        policies: by name; "zero" is always there.
        folder: where records go.
        pushes: buttons by name.
        device: as of a simulator.
    """

    def __init__(
        self,
        subject: Subject,
        policies: Mapping[str, Any] | None = None,
        folder: Path = Path(),
        pushes: Mapping[str, Button] | None = None,
        device: str | None = None,
    ) -> None:
        self.worlds = Worlds(subject, device)
        self.knobs: dict[str, Knob] = {k.name: k for k in knobs_of(subject.scene, subject.options)}
        self.worlds.turn({k.name: k.value for k in self.knobs.values()})
        self.policies = {ZERO: None, **(policies or {})}
        self.pushes, self.folder = dict(pushes or {}), folder
        self.commands: queue.Queue[tuple[int, dict[str, Any]]] = queue.Queue(1000)
        self.paused, self.lag, self.time, self.steps, self.frame = False, 0.0, 0.0, 0, 0
        self.said, self.written = "", 0
        self.stepped = 0  # single steps of this frame
        self.pull: Pull | None = None
        self.puller = -1  # who holds it
        self.recording: Record | None = None
        self.controls = np.zeros((len(subject.start), subject.scene.nu))
        self._bounds = np.array(self.worlds.mechanism.bounds(subject.start[:, : subject.scene.nv], MARGIN))
        self._size = (self._bounds[1] - self._bounds[0], self._bounds[3] - self._bounds[2])
        self.choose(list(self.policies)[-1])
        self._lock, self._latest = threading.Lock(), self.picture(1.0)

    def choose(self, name: str) -> None:
        """Give the controls to another policy, from its beginning."""
        self.acting: Acting = acting(self.policies[name], self.worlds.sim, np.arange(len(self.worlds.state)))
        self.policy, self.since = name, self.time
        self.lost = self._lost()

    def _lost(self) -> int:
        """Plans that the policy kept for want of a better one, since it was made."""
        return int(getattr(self.policies[self.policy], "failures", 0))

    def prepare(self) -> None:
        """Compile what stepping and asking need, before anybody waits for it."""
        worlds = self.worlds
        first = worlds.variant
        for variant in worlds.sims:
            worlds.choose(variant)
            for name in self.policies:
                self.choose(name)
                self.tick()
        worlds.choose(first)
        self.reset()

    def reset(self) -> None:
        """Everything back to the start."""
        self.worlds.reset()
        self.time, self.steps, self.lag, self.pull, self.said = 0.0, 0, 0.0, None, ""
        self.choose(self.policy)

    def tick(self) -> None:
        """One step of the simulation."""
        worlds = self.worlds
        elapsed = self.time - self.since
        step = int(elapsed / worlds.subject.scene.step_size + 0.5)  # plans count steps of the scene's size
        try:
            self.controls = worlds.limited(self.acting.controls(worlds.state, step, elapsed))
        except (
            Exception
        ) as error:  # a user's function: its worlds go on without control, and the page says so
            self.said = f"{self.policy}: {error}"
            self.choose(ZERO)
            self.controls = np.zeros_like(self.controls)
        if self._lost() > self.lost:
            self.said = f"{self.policy}: {self._lost() - self.lost} plans failed, the last ones go on"
        record = self.recording if self.recording is not None and not self.recording.full else None
        if record is not None:
            record.before(self.controls)
        worlds.step(self.controls, self.pull)
        self.time += worlds.step_size
        self.steps += 1
        if record is not None:
            record.after()
            if record.full:
                self._fill()

    def advance(self, seconds: float) -> int:
        """Step until the simulated time has caught up with that much more of the clock; steps made."""
        self._obey()
        if self.paused:
            return 0
        self.lag += seconds * self.worlds.values[SPEED.name]
        count = 0
        while self.lag >= self.worlds.step_size and count < MOST_STEPS:
            self.tick()
            self.lag -= self.worlds.step_size
            count += 1
        self.lag = min(self.lag, self.worlds.step_size)
        return count

    def run(self, stop: threading.Event, wake: Callable[[], None]) -> None:
        """Follow the clock until told to stop; `wake` after every picture."""
        last = time.perf_counter()
        while not stop.is_set():
            now = time.perf_counter()
            try:
                self.advance(min(now - last, 0.25))
            except Exception as error:  # nothing that happens in a step ends the page
                self.said, self.paused = f"{type(error).__name__}: {error}", True
            last = now
            share = 1.0 if self.paused else min(1.0, self.lag / self.worlds.step_size)
            picture = self.picture(share)
            with self._lock:
                self._latest = picture
            wake()
            stop.wait(max(0.0, FRAME - (time.perf_counter() - now)))
        if self.recording is not None:
            self._save_last()

    def latest(self) -> dict[str, Any]:
        """The newest picture."""
        with self._lock:
            return self._latest

    def send(self, client: int, message: dict[str, Any]) -> None:
        """Take a command of a client; dropped where thousands wait."""
        try:
            self.commands.put_nowait((client, message))
        except queue.Full:
            self.said = "too many commands"

    def _obey(self) -> None:
        self.stepped = 0
        for _ in range(self.commands.qsize()):
            client, message = self.commands.get_nowait()
            try:
                self._do(client, **message)
            except (ValueError, KeyError, OSError) as error:
                self.said = str(error)

    def _do(
        self, client: int, do: str, at: Any = None, name: str = "", value: Any = None, world: int = 0
    ) -> None:
        worlds, nv = self.worlds, self.worlds.subject.scene.nv
        if do == "grab" and 0 <= world < len(worlds.state):
            height = self._bounds[3] - self._bounds[2]
            self.pull = catch(worlds.mechanism, worlds.state[world, :nv], np.array(at), height, world)
            self.puller = client
        elif do == "drag" and self.pull is not None and client == self.puller:
            self.pull.target = np.array(at)
        elif do == "release" and client == self.puller:
            self.pull = None
        elif do == "set":
            worlds.turn({name: self.knobs[name].checked(value)})
        elif do == "variant" and name in worlds.sims:
            worlds.choose(name)
        elif do == "policy" and name in self.policies:
            self.said = ""
            self.choose(name)
        elif do == "pause":
            self.paused = value
        elif do == "step":
            self.paused = True
            if self.stepped < MOST_STEPS:  # whoever asks for thousands does not hold up the page
                self.tick()
                self.stepped += 1
        elif do == "reset":
            self.reset()
        elif do == "record":
            self._record(value)
        elif do == "push" and name in self.pushes:
            self.pushes[name](worlds)

    def _record(self, on: bool) -> None:
        if on and self.recording is None:
            self.recording = Record(self.worlds, tuple(self.knobs))
        elif not on and self.recording is not None:
            if self.recording.rows:
                while (path := self.folder / f"watch-{self.written:03d}.npz").exists():
                    self.written += 1
                self.said = f"wrote {self.recording.save(path)}"
            self.recording = None  # one that cannot be written goes on, to be written once it can

    def _fill(self) -> None:
        """Write a record that is full; one that cannot be written takes no more steps."""
        try:
            self._record(False)
            self.said = f"the record is full; {self.said}"
        except (ValueError, OSError) as error:
            self.said = f"the record is full, and is kept: {error}"

    def _save_last(self) -> None:
        """Write the record that is being made when the page ends, elsewhere where its folder takes none."""
        try:
            self._record(False)
        except (ValueError, OSError) as error:
            self.folder = Path(tempfile.mkdtemp(prefix="slcp-watch-"))
            self._record(False)
            print(f"slcp watch: {error}; {self.said}", file=sys.stderr)

    def hello(self) -> dict[str, Any]:
        """What a page needs once: shapes, widgets and where they stand."""
        scene, mechanism = self.worlds.subject.scene, self.worlds.mechanism
        shapes = [
            {
                "kind": "rope" if s in mechanism.ropes else shape.kind,
                "body": shape.body,
                "radius": mechanism.size(s).tolist(),
            }
            for s, shape in enumerate(scene.structure.shapes)
        ]
        values = self.worlds.values
        knobs = [vars(k) | {"value": values[k.name]} for k in self.knobs.values()]
        return {
            "hello": self.worlds.subject.name, "shapes": shapes, "knobs": knobs,
            "driven": sorted(scene.structure.driven_bodies),
            "policies": list(self.policies), "variants": list(self.worlds.sims),
            "pushes": list(self.pushes), "worlds": len(self.worlds.state),
            "states": list(scene.state_names), "controls": list(scene.control_names),
        }  # fmt: skip

    def picture(self, share: float) -> dict[str, Any]:
        """What a page draws, between the last two states."""
        worlds, nv = self.worlds, self.worlds.subject.scene.nv
        mechanism = worlds.mechanism
        q = (1.0 - share) * worlds.before[:, :nv] + share * worlds.state[:, :nv]
        centre, angle = mechanism.shapes(q)
        poses = np.concatenate([centre, angle[..., None]], axis=2)
        self.frame += 1
        self._follow(q)
        return {
            "frame": self.frame, "time": round(self.time, 4),
            "bounds": plain(self._bounds, 5), "poses": plain(poses, 5),
            "links": [plain(line, 4) for line in mechanism.links(q)],
            "springs": [[plain(z, 4) for z in mechanism.springs(one)] for one in q],
            "arrows": [self._arrows(w, q[w]) for w in range(len(q))],
            "pull": self._pull_line(q), "plan": self._plan(), "paused": self.paused, "policy": self.policy,
            "variant": worlds.variant,
            "recording": self.recording is not None, "said": self.said, "status": worlds.status.tolist(),
            "state": plain(worlds.state[0], 5), "control": plain(self.controls[0], 5),
            "impulse": plain(worlds.impulse[0, :, 0].sum(), 6),
        }  # fmt: skip

    def _plan(self) -> list[list[list[float]]]:
        """Where the plan of the first world takes the shapes that move, where the policy tells."""
        intended = getattr(self.policies[self.policy], "intended", None)
        if intended is None or not self.steps:
            return []
        worlds = self.worlds
        try:
            q = intended(0)[::PLAN_EVERY, : worlds.subject.scene.nv]
        except ValueError:  # there is none yet
            return []
        centre, _ = worlds.mechanism.shapes(q)
        moving = [s for s, shape in enumerate(worlds.subject.scene.structure.shapes) if shape.body >= 0]
        return [plain(centre[:, s], 5) for s in moving]

    def _follow(self, q: np.ndarray) -> None:
        """Keep the mechanism in the picture: move it, and widen it where that is not enough."""
        if not (np.abs(q) < MOST).all():
            return
        found = np.array(self.worlds.mechanism.bounds(q, 0.0))
        for low, high in ((0, 1), (2, 3)):
            self._bounds[low] -= max(0.0, self._bounds[low] - found[low])
            self._bounds[high] += max(0.0, found[high] - self._bounds[high])
            room, first = self._bounds[high] - self._bounds[low], self._size[low // 2]
            spare = room - max(first, found[high] - found[low])
            if spare > 0.0:  # give back on the side that it has left
                left = min(spare, max(0.0, found[low] - self._bounds[low]))
                self._bounds[low] += left
                self._bounds[high] -= spare - left

    def _arrows(self, world: int, q: np.ndarray) -> list[list[float]]:
        """[x, y, force x, force y] of the pairs that press [m, N]."""
        impulse = self.worlds.impulse[world]
        pressing = np.flatnonzero(impulse[:, 0] > 1e-9).tolist()
        points, normals = contact_points(self.worlds.mechanism, q, pressing)
        found = np.concatenate([points, forces(normals, impulse[pressing], self.worlds.step_size)], axis=1)
        return [plain(row, 4) for row in found]

    def _pull_line(self, q: np.ndarray) -> list[float] | None:
        pull = self.pull
        if pull is None:
            return None
        here = pull.where(self.worlds.mechanism, q[pull.world])
        return [float(pull.world), *plain(here, 4), *plain(pull.target, 4),
                plain(np.linalg.norm(pull.force), 3)]  # fmt: skip
