"""A bag that is replayed: what a robot saw, was told and did."""

from pathlib import Path
from typing import Any

import numpy as np

from adrl.errors import AdrlError, ConfigError
from adrl.imitation.bag_recording import BagTopics, Recording, read_recording
from adrl.report.document import robot_shape, shown_beams
from adrl.report.encode import numbers, world_content
from adrl.types import GOAL_TOLERANCE_M, Array, RobotConfig, World
from adrl.view import messages
from adrl.view.messages import Message
from adrl.view.pace import Pace

GROUND_M = 3.0
"""Shown about the robot's way."""


class Replay:
    """A recording on the robot's control periods. Its frame is the odometry's, and what stands there is not known."""

    def __init__(self, path: Path, robot: RobotConfig, topics: BagTopics) -> None:
        """Raises MissingExtra, DatasetError."""
        self._name, self._robot = path.name, robot
        self._recording: Recording = read_recording(path, robot, topics)
        self._pace = Pace()
        self._pace.begin(robot.control_period_s)
        self._at = self._told = 0
        self.version = 0

    def turn(self, asked: list[Message], now_s: float) -> dict[str, Any]:
        """See Show."""
        errors: list[str] = []
        for message in asked:
            try:
                self._take(message)
            except AdrlError as error:
                errors.append(str(error))
        for _ in self._pace.steps(now_s):
            if self._at == len(self._recording.times_s) - 1:
                self._pace.playing = False
                break
            self._at += 1
        return self._frame() | ({"errors": errors} if errors else {})

    def _take(self, message: Message) -> None:
        match message:
            case messages.Pace():
                if message.playing and self._at == len(self._recording.times_s) - 1:
                    self._go(0)
                self._pace.set(message.playing, message.speed)
            case messages.Seek():
                times = self._recording.times_s - self._recording.times_s[0]
                self._go(int(np.searchsorted(times, message.time_s, side="right")) - 1)
            case _:
                raise ConfigError("this page shows a recording, which cannot be changed")

    def _go(self, at: int) -> None:
        """Pages are told the way up to there anew."""
        self._at = self._told = min(max(at, 0), len(self._recording.times_s) - 1)
        self.version += 1

    def setup(self) -> dict[str, Any]:
        """See Show."""
        about = {
            "label": self._name,
            "guidance": "",
            "maturity": None,
            "note": "",
            "terms": [],
            "shape": robot_shape(self._robot),
            "rows": self._rows(0, self._at + 1),
        }
        return {
            "kind": "recording",
            "title": f"adrl view {self._name}",
            "world": world_content(World(bounds=_bounds(self._recording.pose))),
            "lanes": [about],
        }

    def _rows(self, first: int, last: int) -> list[list[float | None]]:
        """As a lane's: time, pose, twist, clearance."""
        recording = self._recording
        begin_s = recording.times_s[0]
        return [
            numbers([recording.times_s[i] - begin_s, *recording.pose[i], *recording.twist[i], 0.0])
            for i in range(first, last)
        ]

    def _frame(self) -> dict[str, Any]:
        recording, i = self._recording, self._at
        begin_s = recording.times_s[0]
        goal = None
        if recording.goals is not None and recording.goal[i] >= 0:
            goal = numbers(recording.goals.at(int(recording.goal[i]), recording.times_s[i : i + 1])[0])
        lane = {
            "pose": numbers(recording.pose[i]),
            "ranges": numbers(recording.ranges[i][shown_beams(self._robot.lidar.num_beams)], 4),
            "people": [],
            "legs": [],
            "time_s": round(float(recording.times_s[i] - begin_s), 3),
            "goal": goal,
            "tolerance": GOAL_TOLERANCE_M,
            "path": [],
            "waypoint": None,
            "plan": [],
            "status": "driving" if np.abs(recording.command[i]).max() > 0.0 else "idle",
            "arrived": False,
            "reasons": [],
            "message": "told {:.2f} m/s, {:.2f} rad/s".format(*recording.command[i]),
            "twist": numbers(recording.command[i], 3),
            "rows": self._rows(self._told + 1, i + 1),
        }
        self._told = i
        end_s = float(recording.times_s[-1] - begin_s)
        return {
            "lanes": [lane],
            "time_s": lane["time_s"],
            "duration_s": round(end_s, 2),
        } | self._pace.content()

    def close(self) -> list[str]:
        """See Show."""
        return []


def _bounds(poses: Array) -> tuple[float, float, float, float]:
    """About the robot's way."""
    low, high = poses[:, :2].min(axis=0) - GROUND_M, poses[:, :2].max(axis=0) + GROUND_M
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])
