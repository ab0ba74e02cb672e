"""SIGINT and SIGTERM as a request: long work ends at its next safe point, and a second signal ends it at once.

Work that may end anywhere needs no such point: there SIGTERM does what SIGINT does.
"""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

STOPPING = (signal.SIGINT, signal.SIGTERM)
NOTICE = b"\nadrl: stopping at the next safe point; once more stops at once\n"


@contextmanager
def stop_requests() -> Iterator[Callable[[], bool]]:
    """The function says whether one of the signals has come.

    After the first one they do again what they did before. A signal that the process ignores stays ignored; outside
    the main thread, where Python takes no handlers, nothing changes and the answer is no.
    """
    asked = False

    def note(number: int, frame: object) -> None:
        nonlocal asked
        asked = True
        give_back()
        os.write(2, NOTICE)  # what the signal interrupted may be writing to sys.stderr itself

    def give_back() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    before = {number: signal.getsignal(number) for number in STOPPING}
    if threading.current_thread() is not threading.main_thread():
        before.clear()
    before = {number: handler for number, handler in before.items() if handler not in (None, signal.SIG_IGN)}
    for number in before:
        signal.signal(number, note)
    try:
        yield lambda: asked
    finally:
        give_back()


@contextmanager
def termination_interrupts() -> Iterator[None]:
    """SIGTERM raises KeyboardInterrupt, where nobody else handles it."""
    main = threading.current_thread() is threading.main_thread()
    if not main or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
