"""From what is foretold over a few steps to what is foretold over a whole log."""

import numpy as np

from ....policies import KalmanFilter
from .logs import Logs

MEMORY = (6.0, 24.0, 96.0)  # steps after which a softened filter has forgotten a state
SLIGHT = 0.1  # of a sensor's largest slope, below which it is not of a state


def softenings(filter: KalmanFilter, logs: Logs) -> list[np.ndarray]:
    """Variances (nx,) of velocities after a second to begin with, fewer from stage to stage; the last none.

    Contact makes what is foretold of a whole log a rough function of a mechanism's numbers: whether something
    slips, or where it hits, changes what follows. With more noise a filter forgets sooner, foretells a few
    steps only, and the likelihood is smooth. A filter of a double integrator remembers for tau = (r^2 h /
    w^2)^(1/4) with position sensors of deviation r, and for r h^(1/2) / w with velocity sensors; (M74) turns
    that into w.
    """
    scene, h, count = filter.model.scene, filter.step_size, logs.measured.shape[1]
    slopes = np.abs(filter.sensing.slopes(logs.x0.mean(axis=0)[None], filter.params)[0])
    slopes *= slopes >= SLIGHT * slopes.max(axis=1, keepdims=True)
    out = []
    for steps in MEMORY:
        if steps >= count:
            continue
        tau = steps * h
        found: dict[int, float] = {}
        for sensor, place in zip(*np.nonzero(slopes)):
            of = int(place % scene.nv)
            power = 4 if place < scene.nv else 2
            wanted = filter.variance[sensor] / slopes[sensor, place] ** 2 * h / tau**power
            found[of] = min(wanted, found.get(of, np.inf))
        if not found:
            break
        units = scene.state_units[: scene.nv]
        same = {unit: [found[i] for i in found if units[i] == unit] for unit in set(units)}
        every = list(found.values())
        noise = [found.get(i, np.exp(np.mean(np.log(same[units[i]] or every)))) for i in range(scene.nv)]
        own = np.concatenate([np.zeros(scene.nv), noise])
        if (own > filter.process).any():
            out.append(own)
    return [*out, np.zeros(2 * scene.nv)]
