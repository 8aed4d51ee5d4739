"""What a file of results belongs to, written into it: the scene, the options and every parameter's value.

The one place that writes and reads them. The scene is in the file's header as a scene file holds it, so that
the results can be drawn and simulated again without the file it came from.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Protocol

import numpy as np

from ..description.scene import Scene
from ..description.scene_file import scene_content, scene_of
from ..options import Options
from ..parameters import Parameters
from ..scenes import NAMED
from ..storage.archive import Archive
from ..storage.files import FileError
from ..storage.printed import Printed

OLDER = 1  # version of files of results that hold the name of their scene only
PREFIX = "param_"


class Simulates(Protocol):
    """What a simulator says about itself."""

    scene: Scene
    options: Options
    params: Parameters


@dataclass(frozen=True, repr=False)
class Simulated(Printed):
    """A scene, the options of its simulator, and the parameters of its worlds (one value, or one a world)."""

    scene: Scene
    options: Options
    parameters: Parameters

    @classmethod
    def of(cls, sim: Simulates, parameters: Parameters | None = None) -> "Simulated":
        """What a simulator simulates."""
        return cls(sim.scene, sim.options, sim.params if parameters is None else parameters)

    def _line(self) -> str:
        return f"{self.scene.name!r}, {self.options.residual}, h = {self.step_size:g} s"

    @property
    def step_size(self) -> float:
        """The time step h, of the first world if they differ [s]."""
        return float(np.ravel(self.parameters["step_size"])[0])

    def header(self) -> dict[str, Any]:
        """Header entries: scene, options, and for readers of the file its name, step size and noise level."""
        sigma = np.ravel(self.parameters["sigma"])
        smoothed = not self.options.hard and sigma.size > 0  # a scene without rows has nothing to smooth
        return {
            "scene": self.scene.name,
            "scene_file": scene_content(self.scene),
            "options": asdict(self.options),
            "residual": self.options.residual,
            "step_size": self.step_size,
            "sigma": float(sigma[0]) if smoothed else None,
        }

    def arrays(self) -> dict[str, np.ndarray]:
        """Every parameter, as param_<name>."""
        return {f"{PREFIX}{name}": np.asarray(self.parameters[name]) for name in self.parameters.names}

    @classmethod
    def read(cls, archive: Archive, version: int) -> "Simulated":
        """What a file of results holds.

        Raises:
            FileError: no scene, or numbers that do not fit it. Other errors of a scene, options, parameters.
        """
        header = archive.header
        scene = _named(header) if version == OLDER else scene_of(header.get("scene_file"))
        options = _options(header, version)
        if options.method.state_noise:
            scene = scene.with_covariances()
        parameters = Parameters(scene)
        names = [name for name in parameters.names if f"{PREFIX}{name}" in archive.names or version != OLDER]
        values = archive.read_all(f"{PREFIX}{name}" for name in names)
        found = cls(scene, options, parameters.replace(**{n: values[f"{PREFIX}{n}"] for n in names}))
        if version != OLDER:
            found._check_said(header)
        return found

    def _check_said(self, header: Mapping[str, Any]) -> None:
        """Raise FileError where a header's own words about scene, residual and step size are of others."""
        own = self.header()
        for name in ("scene", "residual", "step_size"):
            if header.get(name) != own[name]:
                raise FileError(f"its header: {name} is {header.get(name)!r:.60}; {own[name]!r} is needed")

    def select(self, index: Any) -> "Simulated":
        """Some worlds, or, for a whole number, one without a world axis."""
        if self.parameters.worlds is None:
            return self
        own = self.parameters.layout
        values = {name: self.parameters[name] for name in self.parameters.names}
        varied = {n: v[index] for n, v in values.items() if v.ndim > len(own.shape(n))}
        return replace(self, parameters=Parameters(self.scene, {**values, **varied}))

    def world(self, index: int) -> dict[str, np.ndarray]:
        """The parameters of one world by name, without a world axis."""
        own = self.parameters.layout
        values = {name: self.parameters[name] for name in self.parameters.names}
        return {n: v[index] if v.ndim > len(own.shape(n)) else v for n, v in values.items()}


def _named(header: Mapping[str, Any]) -> Scene:
    """The scene of an older file, which holds a name only."""
    name = header.get("scene")
    if not isinstance(name, str) or name not in NAMED:
        raise FileError(f"an older version wrote it without its scene, {name!r:.60}; make it again")
    return NAMED[name]()


def _options(header: Mapping[str, Any], version: int) -> Options:
    names = ("residual", "scaling", "friction", "integrator")
    given = {n: header[n] for n in names if n in header} if version == OLDER else header.get("options")
    known = set(asdict(Options()))
    if not isinstance(given, dict) or not set(given) <= known:
        raise FileError(f"its options are {given!r:.80}; {', '.join(sorted(known))} are needed")
    return Options(**given)
