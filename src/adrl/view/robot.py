"""A robot that is watched by its topics: what it sees, where it heads, and what its supervisor says."""

import math
from collections import deque
from typing import Any

import numpy as np

from adrl.deploy import Pose
from adrl.errors import ConfigError
from adrl.integrations.ros.watch import Sight, Watch
from adrl.report.document import robot_shape, shown_beams
from adrl.report.encode import numbers, own_map, world_content
from adrl.types import GOAL_TOLERANCE_M, RobotConfig, World
from adrl.view.drive import MAP_EVERY
from adrl.view.lane import KEPT, STANDING
from adrl.view.messages import Message

GROUND_M = 4.0
"""Shown about the robot and its goal; the ground that is shown grows by so much."""


class Robot:
    """What a Watch knows, as a page shows it. Its frame is the odometry's, and what stands there is not known."""

    def __init__(self, watch: Watch, robot: RobotConfig) -> None:
        self._watch, self._robot = watch, robot
        self._beginnings = self._turns = 0
        self.version = 0
        """Counts up when pages are to be told all anew."""
        self._begin()

    def _begin(self) -> None:
        self._rows: deque[list[float | None]] = deque(maxlen=KEPT)
        self._bounds = (-GROUND_M, -GROUND_M, GROUND_M, GROUND_M)

    def turn(self, asked: list[Message], now_s: float) -> dict[str, Any]:
        """See Show."""
        if self._watch.beginnings != self._beginnings:
            self._beginnings = self._watch.beginnings
            self._begin()
            self.version += 1
        sight = self._watch.now()
        news = self._news(sight)
        self._show_all(sight)
        lane = self._lane(sight) | {"rows": news}
        if self._turns % MAP_EVERY == 0:
            made = self._watch.map()
            lane["map"] = None if made is None else own_map(*made)
        self._turns += 1
        refused = str(ConfigError("this page shows a robot, and sends it nothing"))
        return {"lanes": [lane]} | ({"errors": [refused]} if asked else {})

    def _news(self, sight: Sight) -> list[list[float | None]]:
        """The row of this turn, if the robot has said where it is since the last."""
        odometry = sight.odometry
        if odometry is None or (self._rows and sight.since_s <= (self._rows[-1][0] or 0.0)):
            return []
        self._rows.append(numbers([round(sight.since_s, 3), *odometry.pose, *odometry.twist, 0.0]))
        return [self._rows[-1]]

    def _show_all(self, sight: Sight) -> None:
        """The ground that is shown grows to where robot and goal are."""
        places = [] if sight.odometry is None else [sight.odometry.pose[:2]]
        places += [] if sight.goal is None else [sight.goal]
        x0, y0, x1, y1 = self._bounds
        for x, y in places:
            low = [math.floor((value - 1.0) / GROUND_M) * GROUND_M for value in (x, y)]
            high = [math.ceil((value + 1.0) / GROUND_M) * GROUND_M for value in (x, y)]
            x0, y0, x1, y1 = min(x0, low[0]), min(y0, low[1]), max(x1, high[0]), max(y1, high[1])
        if (x0, y0, x1, y1) != self._bounds:
            self._bounds = x0, y0, x1, y1
            self.version += 1

    def _lane(self, sight: Sight) -> dict[str, Any]:
        odometry, said = sight.odometry, sight.status
        pose: Pose = (0.0, 0.0, 0.0) if odometry is None else odometry.pose
        twist = (0.0, 0.0) if odometry is None else odometry.twist
        silent = [f"no {topic} for {seconds:.0f} s" for topic, seconds in sight.silent.items()]
        driving = "driving" if np.abs(twist).max() > STANDING else "idle"
        beams = shown_beams(self._robot.lidar.num_beams)
        seen = len(sight.ranges) > 0
        return {
            "pose": numbers(pose),
            "ranges": numbers(sight.ranges[beams], 4) if seen else [],
            "people": [],
            "legs": [],
            "time_s": round(sight.since_s, 3),
            "goal": None if sight.goal is None else list(sight.goal),
            "tolerance": GOAL_TOLERANCE_M,
            "path": [],
            "waypoint": None if sight.waypoint is None else numbers(sight.waypoint),
            "plan": numbers(sight.plan) if len(sight.plan) > 1 else [],
            "status": driving if said is None else said["status"],
            "arrived": said is not None and said.get("outcome") == "reached",
            "reasons": [] if said is None else [reason for reason in said["reasons"].split(", ") if reason],
            "message": "; ".join(silent or ([] if said is None else [said["message"]])),
            "twist": numbers(twist, 3),
        }

    def setup(self) -> dict[str, Any]:
        """See Show."""
        about = {
            "label": self._robot.name,
            "guidance": "",
            "maturity": None,
            "note": "",
            "terms": [],
            "shape": robot_shape(self._robot),
            "rows": list(self._rows),
        }
        return {
            "kind": "robot",
            "title": "adrl view --ros2",
            "world": world_content(World(bounds=self._bounds)),
            "lanes": [about],
        }

    def close(self) -> list[str]:
        """See Show."""
        return []
