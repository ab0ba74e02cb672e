"""Lines of a test's orders, read while a probe goes on; of ROS's environments, too: the standard library alone."""

import sys
import threading
from collections.abc import Callable, Iterator
from queue import Empty, SimpleQueue


def lines_while(go_on: Callable[[], None]) -> Iterator[str]:
    """Those of the standard input as they come; between them go_on() is called again and again."""
    lines: SimpleQueue[str] = SimpleQueue()

    def read() -> None:
        for line in sys.stdin:
            lines.put(line)
        lines.put("")

    threading.Thread(target=read, daemon=True).start()
    while True:
        go_on()
        try:
            line = lines.get_nowait()
        except Empty:
            continue
        if not line:
            return
        yield line
