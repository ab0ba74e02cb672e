"""Processes of our own beside this one, each to be bound to a core. Spawned, never forked: JAX has threads."""

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from typing import IO

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Libraries that count the machine's cores, not those a process may use."""


Process = subprocess.Popen[bytes]


def usable_cores() -> list[int]:
    """Numbers of the cores that this process may use."""
    return sorted(os.sched_getaffinity(0))


def start_module(
    module: str,
    *arguments: str,
    stdout: int | IO[bytes],
    stderr: int | None = None,
    environment: Mapping[str, str] | None = None,
) -> Process:
    """Start python -m module with an open pipe as its standard input.

    The module takes the pipe's end for the end of its parent, and must call bind_to_core before it imports JAX.
    stdout, stderr: as Popen takes them. environment: variables beside those of this process.
    """
    return subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        stdin=subprocess.PIPE,
        env=os.environ | ONE_THREAD | dict(environment or {}),
        # Ctrl-C is for the parent, which then ends its children.
        start_new_session=True,
        stdout=stdout,
        stderr=stderr,
    )


def bind_to_core(core: int) -> None:
    """Bind this process to a core. Before JAX is imported: it starts a thread for each core it finds."""
    os.sched_setaffinity(0, {core})


def send(process: Process, line: bytes) -> None:
    """Write a line to the process; nothing where it has ended, which its exit code tells."""
    assert process.stdin is not None
    with contextlib.suppress(BrokenPipeError):
        process.stdin.write(line + b"\n")
        process.stdin.flush()


def end(running: Sequence[Process], patience_s: float) -> None:
    """Ask processes to end, SIGTERM; kill those that have not after patience_s, and close their pipes."""
    give_up_s = time.monotonic() + patience_s
    try:
        for process in running:
            process.terminate()
        for process in running:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(max(give_up_s - time.monotonic(), 0.0))
    finally:
        for process in running:
            close(process)


def close(process: Process) -> None:
    """Kill the process if it runs, and close its pipes."""
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with contextlib.suppress(BrokenPipeError):
                pipe.close()
