"""What is odd about recorded runs: sensors that stand still, angles in degrees, controls of another step."""

import numpy as np

from ....storage.printed import counted
from .likelihood import Likelihood
from .unknowns import Unknowns

FAR = 3.0  # standard deviations
STILL = 8  # readings, all the same, of a sensor that stands still
SPAN = 20.0  # rad that an angle spans which may be in degrees
LATE = (1, -1, 2, -2)  # steps that controls are tried later
BETTER = 5.0  # of a cost, by which another step explains logs better


def oddities(likelihood: Likelihood, place: np.ndarray, rms: float) -> tuple[str, ...]:
    """In sentences without a stop.

    Args:
        likelihood: of the logs.
        place: (size,) what was found.
        rms: of the deviations there.
    """
    unknowns = likelihood.unknowns
    return (
        *_tied(unknowns),
        *_sensors(likelihood, rms),
        *_starts(likelihood, place),
        *_late(likelihood, place),
    )


def _tied(unknowns: Unknowns) -> list[str]:
    if not unknowns.tied:
        return []
    return [
        f"mass and inertia of {name} are one number here, as in drawn worlds; tied=False looks for both"
        for name in unknowns.with_inertia
    ]


def _sensors(likelihood: Likelihood, rms: float) -> list[str]:
    filter, seen, out = likelihood.unknowns.filter, likelihood.logs.measured, []
    for i, name in enumerate(filter.sensors):
        shown, place = seen[:, :, i][np.isfinite(seen[:, :, i])], filter.sensing.places[i]
        if len(shown) >= STILL and np.ptp(shown) == 0.0:
            out.append(f"{name} stands still: {shown[0]:.4g} in all of {len(shown)} readings")
        angle = place >= 0 and filter.model.scene.state_units[place].startswith("rad")
        if angle and rms > FAR and len(shown) and np.ptp(shown) > SPAN:
            out.append(f"{name} spans {np.ptp(shown):.4g} rad (degrees?)")
    return out


def _starts(likelihood: Likelihood, place: np.ndarray) -> list[str]:
    """First states that are far from what was believed of them."""
    states = likelihood.unknowns.filter.model.scene.state_names
    off = np.abs(place[likelihood.count :].reshape(likelihood.runs, len(likelihood.starts)))
    return [
        f"the first {states[state]} is {each.max():.2g} deviations from what was believed (start=, x0=)"
        for state, each in zip(likelihood.starts, off.T)
        if each.max() > FAR
    ]


def _late(likelihood: Likelihood, place: np.ndarray) -> list[str]:
    """Whether controls that act in another step explain the logs better."""
    logs, own = likelihood.logs, float(likelihood.data(place[None]).sum())
    us = logs.controls
    if not us.size or us.shape[1] <= max(LATE):
        return []
    found = []
    for late in LATE:
        steps = np.clip(np.arange(us.shape[1]) - late, 0, us.shape[1] - 1)
        other = Likelihood(likelihood.unknowns, logs._replace(controls=us[:, steps]), likelihood.given)
        found.append(own - float(other.data(place[None]).sum()))
    best = int(np.argmax(found))
    if not found[best] > BETTER:
        return []
    count = counted(abs(LATE[best]), "step")
    when = "later" if LATE[best] > 0 else "earlier"
    return [
        f"controls that act {count} {when} explain the logs better, by {found[best]:.2g} of the cost: in a "
        "log a control belongs to the step in which it acts"
    ]
