"""Parts of a section in processes side by side: what takes long there is one core's."""

import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import Any, TypeVar

import warp as wp

from .record import Event, Found
from .setting import Setting, cores

Part = TypeVar("Part")


def side_by_side(
    work: Callable[[Setting, Found, Part], None],
    setting: Setting,
    found: Found,
    parts: Sequence[Part],
    workers: int | None = None,
) -> None:
    """What `work` finds of every part, a part's events together, as parts are done.

    Args:
        workers: processes; None: one a core beside a GPU, else none but this one.
    """
    if workers is None:
        workers = min(len(parts), cores()) if setting.gpu else 1
    if workers == 1:
        for part in parts:
            work(setting, found, part)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        waiting = [pool.submit(_events, work, setting, part) for part in parts]
        for done in as_completed(waiting):
            for event in done.result():
                found.send(event)


def _events(work: Callable[[Setting, Found, Any], None], setting: Setting, part: Any) -> list[Event]:
    wp.config.log_level = wp.LOG_WARNING
    events: list[Event] = []
    work(setting, Found(events.append), part)
    return events
