"""How far work is: a live bar on a terminal, lines where there is none."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

REDRAW_S = 0.1
LINE_S = 10.0
"""A file gets a line so often, and at once when a phase begins."""


class Show(Protocol):
    """Where the work stands."""

    def __call__(self, fraction: float, note: str = "", phase: str = "") -> None:
        """fraction: of the work, 0 to 1. phase: what is being done now."""
        ...


def console() -> Console:
    """Where tables and bars go: standard error keeps standard output clean for data."""
    return Console(stderr=True)


@contextmanager
def progress_bar(description: str) -> Iterator[Show]:
    """A bar from 0 to 1 with the time left. What was shown last stands there at the end."""
    if not console().is_terminal:
        with _lines() as write:

            def tell(fraction: float, note: str = "", phase: str = "") -> None:
                words = (description, phase, f"{100.0 * fraction:.0f} %", note)
                write(", ".join(word for word in words if word), phase)

            tell(0.0)
            yield tell
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f}%"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
    )
    with Progress(*columns, console=console()) as bar:
        task = bar.add_task(description, total=1.0, note="")

        def draw(fraction: float, note: str = "", phase: str = "") -> None:
            words = f"{description}: {phase}" if phase else description
            bar.update(task, completed=fraction, note=note, description=words)

        with _paced(draw) as show:
            yield show


@contextmanager
def counting_bar(description: str, things: str) -> Iterator[Callable[[int, int], None]]:
    """A bar; the function to call with how many of the things have ended, of how many."""
    with progress_bar(description) as show:
        yield lambda ended, total: show(ended / total, f"{ended} of {total} {things}")


@contextmanager
def job_bar(description: str) -> Iterator[Callable[[int, int, int], None]]:
    """A bar of jobs that run side by side; the function to call with (done, running, total)."""
    clock = _Clock()
    if not console().is_terminal:
        with _lines() as write:
            yield lambda done, running, total: write(
                f"{description}, {done} of {total}, {clock.note(done, running, total)}", str(done)
            )
        return
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
        yield lambda done, running, total: bar.update(
            task, completed=done, total=total, note=clock.note(done, running, total)
        )


@contextmanager
def _paced(draw: Show) -> Iterator[Show]:
    """draw, called every REDRAW_S at the most, and with the last state in the end."""
    last: tuple[float, str, str] | None = None
    drawn_s, phase_drawn = 0.0, ""

    def show(fraction: float, note: str = "", phase: str = "") -> None:
        nonlocal last, drawn_s, phase_drawn
        last, now = (fraction, note, phase), time.monotonic()
        if now - drawn_s >= REDRAW_S or phase != phase_drawn:
            draw(*last)
            last, drawn_s, phase_drawn = None, now, phase

    try:
        yield show
    finally:
        if last is not None:
            draw(*last)


@contextmanager
def _lines() -> Iterator[Callable[[str, str], None]]:
    """The function to call with (line, mark): every LINE_S, at once for a new mark, and in the end."""
    began_s = written_s = time.monotonic()
    seen: set[str] = set()
    waiting: str | None = None

    def put(line: str) -> None:
        minutes, seconds = divmod(int(time.monotonic() - began_s), 60)
        print(f"{minutes}:{seconds:02d} {line}", file=sys.stderr, flush=True)

    def write(line: str, mark: str) -> None:
        nonlocal written_s, waiting
        now = time.monotonic()
        if mark in seen and now - written_s < LINE_S:
            waiting = line
            return
        put(line)
        seen.add(mark)
        written_s, waiting = now, None

    try:
        yield write
    finally:
        if waiting is not None:
            put(waiting)


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
