"""The sections of the check, in their order: what is right first, then what it costs."""

from collections.abc import Callable
from typing import NamedTuple

from .checks import (
    beside,
    compiling,
    crowds,
    environment,
    graphs,
    isolation,
    planning,
    product,
    rates,
    slopes,
    states,
    streams,
    sweeping,
)
from .record import Found
from .setting import Setting


class Section(NamedTuple):
    """A part of the check.

    Attributes:
        run: what it does.
        seconds: after which it is ended.
        gpu: whether a CPU has nothing to say in it.
    """

    run: Callable[[Setting, Found], None]
    seconds: float
    gpu: bool = False


SECTIONS = {
    "environment": Section(environment.run, 30.0),
    "kernels": Section(compiling.run, 300.0),
    "states": Section(states.run, 90.0),
    "derivatives": Section(slopes.run, 90.0),
    "product": Section(product.run, 200.0),
    "random": Section(states.random_numbers, 40.0),
    "graphs": Section(graphs.run, 60.0),
    "streams": Section(streams.run, 60.0),
    "torch": Section(streams.torch_streams, 60.0),
    "devices": Section(streams.devices, 60.0),
    "isolation": Section(isolation.run, 40.0),
    "rates": Section(rates.run, 90.0),
    "blocks": Section(rates.blocks, 90.0, gpu=True),
    "host": Section(rates.host, 40.0),
    "planning": Section(planning.run, 90.0),
    "sweep": Section(sweeping.run, 90.0),
    "crowds": Section(crowds.run, 150.0),
    "mujoco_warp": Section(beside.run, 60.0),
}
