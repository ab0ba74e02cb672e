"""Lag, acceleration and latency of our simulator's base, fitted to how another base drove.

Each of speed and yaw rate follows its command as core/drive/kinematics.cpp has it. Where a command is `latency` old
when it takes effect, a period has two parts: the older command's, then the newer one's.
"""

from dataclasses import dataclass, replace

import numpy as np

from adrl import _core
from adrl.errors import DatasetError
from adrl.evaluation.drives import Drives
from adrl.types import Array, RobotConfig

LEAST_ROWS = 50
GRID = 7
"""Values of each constant tried in a round,"""
ROUNDS = 12
"""each round in half the range about the best of the last."""
LAG_RANGE_S = (0.0, 1.0)
ACCELERATION_FACTOR = 8.0
"""Accelerations are looked for from the configured one divided by this to this times it."""


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """The fit, and what it is worth."""

    robot: RobotConfig
    """The robot with the fitted constants."""
    error_before: Array
    """(2,) root mean square error of a period's end, m/s and rad/s, predicted with the constants as configured."""
    error_after: Array
    """(2,) the same with the fitted ones."""
    rows: int

    def summary(self) -> dict[str, float]:
        """As JSON has it."""
        robot = self.robot
        return {
            "lag_s": robot.lag_s,
            "latency_s": robot.latency_s,
            "max_acceleration_mps2": robot.max_acceleration_mps2,
            "max_yaw_acceleration_radps2": robot.max_yaw_acceleration_radps2,
            "rows": self.rows,
            "speed_error_before_mps": float(self.error_before[0]),
            "speed_error_mps": float(self.error_after[0]),
            "yaw_rate_error_before_radps": float(self.error_before[1]),
            "yaw_rate_error_radps": float(self.error_after[1]),
        }


def calibrate(drives: Drives, robot: RobotConfig) -> Calibration:
    """Fit the robot's constants to the drives, whose rows are control periods of the robot.

    The error of a period's end, predicted from its beginning, in units of the greatest speeds, is least. Raises
    DatasetError for too few rows, or rows at other intervals.
    """
    fit = _Fit(drives, robot)
    low = np.array([LAG_RANGE_S[0], 0.0, *(np.log(fit.accelerations / ACCELERATION_FACTOR))])
    high = np.array(
        [LAG_RANGE_S[1], fit.longest_latency_s, *(np.log(fit.accelerations * ACCELERATION_FACTOR))]
    )
    best = np.array([robot.lag_s, robot.latency_s, *np.log(fit.accelerations)])
    least = float(((fit.errors(robot) / fit.scales) ** 2).sum())
    centre, half = 0.5 * (low + high), 0.5 * (high - low)
    for _ in range(ROUNDS):
        # Lag and latency act on both axes, each acceleration on its own: the axes are searched together but for that.
        spread = np.linspace(-1.0, 1.0, GRID)
        for lag in np.unique(np.clip(centre[0] + spread * half[0], low[0], high[0])):
            for latency in np.unique(np.clip(centre[1] + spread * half[1], low[1], high[1])):
                chosen, cost = np.array([lag, latency, 0.0, 0.0]), 0.0
                for axis in (0, 1):
                    tried = np.clip(centre[2 + axis] + spread * half[2 + axis], low[2 + axis], high[2 + axis])
                    costs = [fit.error(axis, lag, latency, np.exp(value)) for value in tried]
                    chosen[2 + axis] = tried[int(np.argmin(costs))]
                    cost += (min(costs) / fit.scales[axis]) ** 2
                if cost < least:
                    best, least = chosen, cost
        centre, half = best, 0.5 * half
    fitted = replace(
        robot,
        lag_s=round(float(best[0]), 4),
        latency_s=round(float(best[1]), 4),
        max_acceleration_mps2=round(float(np.exp(best[2])), 4),
        max_yaw_acceleration_radps2=round(float(np.exp(best[3])), 4),
    )
    return Calibration(
        robot=fitted, error_before=fit.errors(robot), error_after=fit.errors(fitted), rows=fit.rows
    )


class _Fit:
    """Periods with their commands, newest first, and how well constants predict them."""

    def __init__(self, drives: Drives, robot: RobotConfig) -> None:
        self._dt_s = dt = robot.control_period_s
        self.accelerations = np.array([robot.max_acceleration_mps2, robot.max_yaw_acceleration_radps2])
        self.scales = np.array([robot.max_speed_mps, robot.max_yaw_rate_radps])
        self._history = history = _core.MAX_LATENCY_PERIODS
        self.longest_latency_s = (history - 1) * dt
        low = (robot.min_speed_mps, -robot.max_yaw_rate_radps)
        command = np.clip(drives.command, low, self.scales)
        self._curve_m = robot.min_turning_radius_m
        if robot.is_car:  # as the base takes a command that it cannot steer
            most = np.abs(command[:, 0]) / self._curve_m
            command[:, 1] = np.clip(command[:, 1], -most, most)
        before, after, commands = [], [], []
        for drive in np.unique(drives.drive):
            rows = np.flatnonzero(drives.drive == drive)
            intervals = np.diff(drives.time_s[rows])
            if len(intervals) and abs(intervals - dt).max() > 0.1 * dt:
                raise DatasetError(
                    f"drive {drive}: rows are {intervals.min():.3g} to {intervals.max():.3g} s apart; robot "
                    f"{robot.name!r} is controlled every {dt} s; resample the file, or give another robot"
                )
            # Rest before the drive: a robot stands until its first command.
            told = np.concatenate([np.zeros((history, 2)), command[rows]])
            at_rest = abs(drives.time_s[rows[0]] - dt) < 0.1 * dt
            twist = drives.twist[rows]
            # What was told before the rows of a drive that was under way is not known.
            first = 0 if at_rest else history
            before.append(np.concatenate([np.zeros((1, 2)), twist[:-1]])[first:])
            after.append(twist[first:])
            stacked = np.stack([told[history - k : len(told) - k] for k in range(history + 1)], axis=1)
            commands.append(stacked[first:])
        self._before, self._after = np.concatenate(before), np.concatenate(after)
        self._commands = np.concatenate(commands)  # (R, history + 1, 2)
        self.rows = len(self._after)
        if self.rows < LEAST_ROWS:
            raise DatasetError(f"{self.rows} periods are too few to fit; record {LEAST_ROWS} or more")

    def error(self, axis: int, lag_s: float, latency_s: float, acceleration: float) -> float:
        """Root mean square error of the ends of the periods."""
        whole = int(latency_s / self._dt_s + 1e-9)
        older_s = max(latency_s - whole * self._dt_s, 0.0)
        value = self._before[:, axis]
        for span, due in ((older_s, whole + 1), (self._dt_s - older_s, whole)):
            if span > 1e-9:
                response = 1.0 - np.exp(-span / lag_s) if lag_s > 0.0 else 1.0
                change = response * (self._commands[:, due, axis] - value)
                value = value + np.clip(change, -acceleration * span, acceleration * span)
        if axis == 1 and self._curve_m > 0.0:
            most = np.abs(self._after[:, 0]) / self._curve_m
            value = np.clip(value, -most, most)
        return float(np.sqrt(((value - self._after[:, axis]) ** 2).mean()))

    def errors(self, robot: RobotConfig) -> Array:
        """(2,) of the robot's constants."""
        accelerations = (robot.max_acceleration_mps2, robot.max_yaw_acceleration_radps2)
        return np.array(
            [self.error(axis, robot.lag_s, robot.latency_s, accelerations[axis]) for axis in (0, 1)]
        )
