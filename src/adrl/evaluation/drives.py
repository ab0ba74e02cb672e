"""What a base was told and what it did, period by period: recorded in a rollout, or read from a file."""

import csv
import io
import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adrl import files
from adrl.envs import NavSim
from adrl.errors import DatasetError
from adrl.types import Array

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
    try:
        with open(path, newline="", encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream))
        table = np.array([[float(row[name]) for name in COLUMNS] for row in rows]).reshape(-1, len(COLUMNS))
    except FileNotFoundError:
        raise DatasetError(f"{path}: no such file; adrl gazebo evaluate --drives FILE writes one") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise DatasetError(f"{path}: not a readable CSV file ({error})") from None
    except (KeyError, TypeError, ValueError) as error:
        raise DatasetError(
            f"{path}: needs the columns {', '.join(COLUMNS)}, numbers in each row ({error})"
        ) from None
    if len(table) == 0 or not np.isfinite(table).all():
        raise DatasetError(f"{path}: holds no row, or a number that is not finite")
    table = table[np.lexsort((table[:, 1], table[:, 0]))]
    return Drives(table[:, 0].astype(np.int64), table[:, 1], table[:, 2:4], table[:, 4:6])


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
