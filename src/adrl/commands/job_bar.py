"""A live bar of jobs that run side by side, with the time left."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from adrl.commands.options import console


@contextmanager
def job_bar(description: str) -> Iterator[Callable[[int, int, int], None]]:
    """The function to call with (done, running, total)."""
    columns = (
        TextColumn(description),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[note]}"),
    )
    # The bar shares the machine with what it measures: one picture a second is enough.
    with Progress(*columns, console=console(), refresh_per_second=1) as bar:
        task = bar.add_task("", total=None, note="")
        clock = _Clock()

        def show(done: int, running: int, total: int) -> None:
            bar.update(task, completed=done, total=total, note=clock.note(done, running, total))

        yield show


class _Clock:
    """Time left, from the jobs that ended since the start."""

    def __init__(self) -> None:
        self._began_s = time.monotonic()
        self._done_before: int | None = None
        self._at_s = self._began_s
        self._seconds_a_job = 0.0
        self._done = 0

    def note(self, done: int, running: int, total: int) -> str:
        """What to write beside the bar."""
        now = time.monotonic()
        if self._done_before is None:
            self._done_before = self._done = done
        if done > self._done:
            self._done = done
            self._seconds_a_job = (now - self._began_s) / (done - self._done_before)
            self._at_s = now
        text = f"{running} running"
        if done > self._done_before:
            left = max(self._seconds_a_job * (total - done) - (now - self._at_s), 0.0)
            text += f", about {left / 60:.0f} min left" if left >= 90 else f", about {left:.0f} s left"
        return text
