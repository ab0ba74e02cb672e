"""What a base was told and what it did, period by period: recorded in a rollout, or read from a file."""

import csv
import io
import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adrl import files
from adrl.envs import NavSim
from adrl.errors import DatasetError, FileError
from adrl.types import Array

MAX_BYTES = 2**28
"""Of a CSV file."""
MOST = 1e7
"""Seconds, m/s, rad/s: no drive has more."""
COLUMNS = ("drive", "time_s", "command_mps", "command_radps", "speed_mps", "yaw_rate_radps")


@dataclass(frozen=True, eq=False)
class Drives:
    """R control periods of several drives, one drive's after another's, in order of time."""

    drive: NDArray[np.int64]
    """(R,) number of the drive a row is of."""
    time_s: Array
    """(R,) end of the period, since the drive began."""
    command: Array
    """(R, 2) speed and yaw rate that were asked for in the period."""
    twist: Array
    """(R, 2) speed and yaw rate at its end."""
    notes: tuple[str, ...] = ()
    """What there is to say of where they come from, for people."""

    def __len__(self) -> int:
        return len(self.drive)

    def tracking_error(self) -> Array:
        """(2,) root mean square of what was asked for less what was there: m/s, rad/s."""
        return np.sqrt(((self.command - self.twist) ** 2).mean(axis=0))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a CSV file of COLUMNS."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(COLUMNS)
        numbers = np.column_stack([self.time_s, self.command, self.twist])
        for drive, row in zip(self.drive, numbers, strict=True):
            writer.writerow([int(drive), *(f"{number:.6g}" for number in row)])
        files.atomic_write_text(path, text.getvalue())


def read_drives(path: str | os.PathLike[str]) -> Drives:
    """Read a CSV file of COLUMNS, in any order and among others. Raises DatasetError naming the file."""
    if not os.path.exists(path):
        raise DatasetError(f"{path}: no such file; adrl gazebo evaluate --drives FILE writes one")
    try:
        reader = csv.DictReader(io.StringIO(files.read_text(path, MAX_BYTES), newline=""))
        rows = list(reader)
    except (FileError, csv.Error) as error:
        raise DatasetError(f"{path}: not a readable CSV file ({error})") from None
    if rows and not set(COLUMNS) <= set(reader.fieldnames or ()):
        raise DatasetError(f"{path}: needs the columns {', '.join(COLUMNS)}, and has {', '.join(rows[0])}")
    numbers = [
        [_number(path, line, name, row[name]) for name in COLUMNS] for line, row in enumerate(rows, start=1)
    ]
    if not numbers:
        raise DatasetError(f"{path}: holds no row")
    table = np.array(numbers)
    table = table[np.lexsort((table[:, 1], table[:, 0]))]
    return Drives(table[:, 0].astype(np.int64), table[:, 1], table[:, 2:4], table[:, 4:6])


def _number(path: str | os.PathLike[str], row: int, column: str, text: str | None) -> float:
    try:
        number = float(text or "")
    except ValueError:
        raise DatasetError(
            f"{path}: row {row}: {column} is {text!r}; numbers are needed in each row"
        ) from None
    if not abs(number) <= MOST:  # nor NaN
        raise DatasetError(f"{path}: row {row}: {column} is {number}; give a finite number up to {MOST:g}")
    return number


class DriveRecorder:
    """Gathers the drives of a rollout: give it as on_drive."""

    def __init__(self) -> None:
        self._parts: list[tuple[NDArray[np.int64], Array, Array, Array]] = []

    def __call__(self, sim: NavSim, tasks: NDArray[np.int64], moving: NDArray[np.bool_]) -> None:
        """Take the period that the moving robots (N,) have just ended; tasks (N,) number their drives."""
        b = sim.b
        self._parts.append(
            (tasks[moving], b["time"][moving], b["command"][moving].copy(), b["twist"][moving].copy())
        )

    def drives(self) -> Drives:
        """All of them. Raises DatasetError when nothing moved."""
        if not self._parts or not sum(len(part[0]) for part in self._parts):
            raise DatasetError("nothing moved; give tasks whose start is not at the goal")
        drive, time_s, command, twist = (
            np.concatenate(columns) for columns in zip(*self._parts, strict=True)
        )
        order = np.lexsort((time_s, drive))
        return Drives(drive[order], time_s[order], command[order], twist[order])
