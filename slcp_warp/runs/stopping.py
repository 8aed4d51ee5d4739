"""Ctrl-C and SIGTERM as a wish that is granted between chunks, so that nothing finished is lost."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

GRACE = 2.0  # seconds that chunks in flight are given
SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Stop:
    """A wish to stop, from another thread or by a signal.

    Attributes:
        signal: the number of the signal it came by, 0 for none.
    """

    def __init__(self) -> None:
        self._event = threading.Event()
        self.signal = 0

    def __call__(self) -> None:
        """Wish it."""
        self._event.set()

    def __bool__(self) -> bool:
        return self._event.is_set()

    def wait(self, seconds: float) -> bool:
        """Sleep until it is wished, so long at most; whether it is."""
        return self._event.wait(seconds)


@contextmanager
def on_signals(stop: Stop, grace: float | None = GRACE) -> Iterator[None]:
    """Within the block Ctrl-C and SIGTERM wish for `stop`.

    Python code that still runs after `grace` seconds (None: however long), and at a second signal, is
    interrupted (KeyboardInterrupt). Outside the main thread, where no signal arrives, nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    timers: list[threading.Timer] = []
    main = threading.main_thread().ident
    assert main is not None

    def wish(number: int, frame: FrameType | None) -> None:
        if stop:
            raise KeyboardInterrupt
        stop.signal = number
        stop()
        if grace is not None:
            timers.append(threading.Timer(grace, signal.pthread_kill, (main, number)))
            timers[0].daemon = True
            timers[0].start()

    before = {number: signal.signal(number, wish) for number in SIGNALS}
    try:
        yield
    finally:
        for timer in timers:
            timer.cancel()
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
