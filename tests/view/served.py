"""adrl view as a user runs it: a process of its own."""

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from waiting import wait_until

PATIENCE_S = 300.0
"""A busy machine is no failure."""


@dataclass
class Served:
    """A running command, and the address that it printed."""

    process: subprocess.Popen[bytes]
    output: Path
    address: str

    @property
    def port(self) -> int:
        """Of the address."""
        return int(self.address.split(":")[2].split("/")[0])

    @property
    def token(self) -> str:
        """Of the address."""
        return self.address.rstrip("/").rpartition("/")[2]

    @property
    def line(self) -> str:
        """The address of the live line."""
        return self.address.replace("http", "ws", 1) + "live"

    def end(self, number: signal.Signals = signal.SIGTERM) -> int:
        """Its exit code after a signal."""
        self.process.send_signal(number)
        return self.process.wait(PATIENCE_S)


@contextmanager
def served(*arguments: object) -> Iterator[Served]:
    """The command, until the context ends."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "output"
        with output.open("wb") as out:
            process = subprocess.Popen(
                [sys.executable, "-m", "adrl.cli", "view", *map(str, arguments)],
                stdout=out,
                stderr=subprocess.STDOUT,
                cwd=folder,
                env=os.environ | {"PYTHONUNBUFFERED": "1"},
            )
        try:
            wait_until(lambda: "http://" in output.read_text() or process.poll() is not None, PATIENCE_S)
            assert process.poll() is None, output.read_text()
            yield Served(process, output, output.read_text().split()[0])
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
