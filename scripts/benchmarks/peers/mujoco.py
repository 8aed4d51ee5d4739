"""MuJoCo C as a peer: its documented options, rollouts of starts."""

from dataclasses import dataclass, field, replace

import numpy as np

from slcp_warp import Scene

from ..shared.workload import Workload
from .mujoco_model import Peer as Model
from .mujoco_model import import_mujoco
from .peer import Deviation, Run, step_count

Options = dict[str, str]
_EXACT = {"ccd_tolerance": "1e-12", "tolerance": "1e-12"}
_ELLIPTIC = {"cone": "elliptic", "impratio": "10", **_EXACT}
_STIFF = {"solref": "2h 1", "solimp": "0.9999 0.9999 0.0001"}  # the stiffest reference and impedance
_DAMPED = {**_STIFF, "solref": "2h 20"}  # the same, overdamped: impacts do not rebound


@dataclass(frozen=True)
class Setting:
    """Attributes of <option>, of every contact and limit ("2h" is twice the step), and flags."""

    option: Options = field(default_factory=dict)
    contact: Options = field(default_factory=dict)
    flags: tuple[str, ...] = ()


SETTINGS = {
    "default": Setting(),
    "stiff": Setting(_ELLIPTIC, _STIFF),
    "overdamped": Setting(_ELLIPTIC, _DAMPED, ("speculative",)),
    "CG": Setting({"solver": "CG"}),
    "RK4": Setting({"integrator": "RK4"}),
}
TIMED = 4000  # world steps of a run that is timed


def model_of(scene: Scene, h: float, setting: Setting, threads: int = 1) -> Model:
    """The scene with these options and step [s]."""
    contact = {name: value.replace("2h", repr(2.0 * h)) for name, value in setting.contact.items()}
    return Model(replace(scene, step_size=h), threads, contact, setting.flags, **setting.option)


def in_single(setting: Setting) -> Setting:
    """The options that MuJoCo's descendants in single precision take: default cones and tolerances."""
    option = {name: value for name, value in setting.option.items() if name == "integrator"}
    return Setting(option, setting.contact)


class MuJoCo:
    """MuJoCo C. `threads` roll out the worlds side by side; `touching`: settings where anything can touch."""

    name = "MuJoCo"

    def __init__(
        self, threads: int = 1, touching: tuple[str, ...] = ("default", "stiff", "overdamped")
    ) -> None:
        self.version: str = import_mujoco().__version__
        self.threads, self.touching = threads, touching

    def settings(self, contacts: bool) -> tuple[str, ...]:
        """Its default; the stiffest contacts; the same without rebound, the most accurate; Runge-Kutta."""
        return self.touching if contacts else ("default", "RK4")

    def prepare(self, scene: Scene, starts: np.ndarray, duration: float, h: float, setting: str) -> Run:
        """A run of the starts (B, nx); nothing is compiled."""
        model = model_of(scene, h, SETTINGS[setting], self.threads)
        steps = step_count(duration, h)
        work, timed = (
            Workload(x0, np.zeros((len(x0), steps, scene.nu)))
            for x0 in (starts, np.resize(starts, (max(1, TIMED // steps), starts.shape[1])))
        )

        def rollout() -> np.ndarray:
            return np.concatenate([starts[:, None], model.rollout(work)], axis=1)

        facts = {"dtype": "float64", "threads": self.threads, "batch": len(timed.x0), "device": "cpu"}
        return Run(rollout, lambda: model.rollout(timed), len(timed.x0), duration, 0.0, facts)

    def deviation(self, scene: Scene, q: np.ndarray) -> Deviation:
        """Of its model at the tolerance of the accurate options, at q (K, nv)."""
        return model_of(scene, scene.step_size, SETTINGS["overdamped"]).deviation(q)
