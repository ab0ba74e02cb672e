"""What moves around a robot: scans of the last control periods, and the comparison of the newest with the oldest."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adrl import _core
from adrl.observation.component import F32, Mirror, Senses
from adrl.observation.config import EncoderConfig
from adrl.types import Array, RobotConfig

ROUNDING_M = 0.02
"""Apparent motion of still surfaces between beams; three standard deviations of the range noise come on top."""


class ScanHistory:
    """Scans and odometry of N robots over the last `steps` control periods, in one ring for all of them.

    begin() for a robot whose episode begins, add() once for every new scan. `arrays` is all that changes.
    """

    def __init__(self, num_envs: int, num_beams: int, steps: int) -> None:
        self.arrays: dict[str, NDArray[Any]] = {
            "past_ranges": np.zeros((steps + 1, num_envs, num_beams), dtype=np.float32),
            "past_odometry": np.zeros((steps + 1, num_envs, 3)),
            "newest": np.zeros(1, dtype=np.int64),
        }

    def begin(self, indices: NDArray[np.intp], ranges: F32, odometry: Array) -> None:
        """As if robots `indices` (M,) had stood still so far, seeing this: rows of (N, K) ranges, (N, 3) odometry."""
        self.arrays["past_ranges"][:, indices] = ranges[indices]
        self.arrays["past_odometry"][:, indices] = odometry[indices]

    def add(self, ranges: F32, odometry: Array) -> None:
        """The scans (N, K) of a new control period, and the odometry (N, 3) at which they were taken."""
        newest = self.arrays["newest"]
        newest[0] = (newest[0] + 1) % len(self.arrays["past_ranges"])
        self.arrays["past_ranges"][newest[0]] = ranges
        self.arrays["past_odometry"][newest[0]] = odometry

    def ends(self, steps: int | None = None) -> tuple[F32, Array, F32, Array]:
        """Ranges (N, K) and odometry (N, 3) of the newest scan, and of the one so many steps ago, or the oldest."""
        ranges, odometry = self.arrays["past_ranges"], self.arrays["past_odometry"]
        newest = int(self.arrays["newest"][0])
        past = (newest - steps) % len(ranges) if steps is not None else (newest + 1) % len(ranges)
        return ranges[newest], odometry[newest], ranges[past], odometry[past]

    def cues(self, motion: "_core.MotionCue", num_sectors: int) -> F32:
        """(N, num_sectors) what has moved between the oldest scan and the newest; see motion_cue."""
        ends = self.ends()
        out = np.empty((len(ends[0]), num_sectors), dtype=np.float32)
        motion.compute(*ends, out)
        return out

    def of(self, rows: NDArray[np.intp], num_beams: int | None = None) -> "ScanHistory":
        """A copy, of the robots `rows` (M,) alone; of their first num_beams beams where that is given."""
        past = self.arrays["past_ranges"][:, rows, :num_beams]
        part = ScanHistory(len(rows), past.shape[2], len(past) - 1)
        part.arrays["past_ranges"][:] = past
        part.arrays["past_odometry"][:] = self.arrays["past_odometry"][:, rows]
        part.arrays["newest"][:] = self.arrays["newest"]
        return part


class CueSettings(NamedTuple):
    """The arguments of _core.MotionCue, which has the same names."""

    num_beams: int
    angle_min_rad: float
    angle_increment_rad: float
    mount: tuple[float, float, float]
    max_range_m: float
    num_sectors: int
    margin_m: float
    scale_m: float


def cue_settings(robot: RobotConfig, num_sectors: int, steps: int) -> CueSettings:
    """How a robot compares two scans `steps` control periods apart."""
    lidar = robot.lidar
    return CueSettings(
        num_beams=lidar.num_beams,
        angle_min_rad=lidar.angle_min_rad,
        angle_increment_rad=lidar.angle_increment_rad,
        mount=lidar.mount,
        max_range_m=lidar.max_range_m,
        num_sectors=num_sectors,
        margin_m=ROUNDING_M + 3.0 * lidar.noise_std_m,
        scale_m=steps * robot.control_period_s * robot.max_speed_mps,
    )


def motion_cue(robot: RobotConfig, num_sectors: int, steps: int) -> "_core.MotionCue":
    """The comparison of two scans `steps` control periods apart, a number in [-1, 1] a sector.

    Negative: something has come. The sector's nearest hits lie where the past scan saw free space, and this much of it
    they have taken, in units of the way the robot drives at full speed in that time. Positive: what was seen there has
    gone, and this much has become free. 0: nothing moved, or an obstacle hid it. The robot's own motion is taken out
    by its odometry, so that still surroundings read 0 up to noise while it drives and turns.
    """
    return _core.MotionCue(*cue_settings(robot, num_sectors, steps))


class MotionCues:
    """num_sectors numbers in [-1, 1]: what has come, negative, or gone since history_steps control periods ago."""

    limit = 1.0

    def __init__(self, robots: Sequence[RobotConfig], config: EncoderConfig) -> None:
        self.size = config.num_sectors
        cues = [motion_cue(robot, config.num_sectors, config.history_steps) for robot in robots]
        self._motion = _core.MotionCues(cues)
        self._steps = config.history_steps

    def write(self, senses: Senses, out: F32) -> None:
        """Fill (N, S). Raises ValueError without the history of the scans."""
        if senses.history is None:
            raise ValueError("an encoder with motion cues needs the history of the scans")
        cues = np.empty((len(senses.kind), self.size), np.float32)
        self._motion.compute(senses.kind, *senses.history.ends(self._steps), cues)
        out[:] = cues

    def mirror(self) -> Mirror | None:
        """The sectors in reverse."""
        return Mirror(np.arange(self.size)[::-1], np.ones(self.size, np.float32))
