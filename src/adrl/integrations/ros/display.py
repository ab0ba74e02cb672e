"""What RViz and Foxglove show of a driving node: markers and its own map, made only while somebody looks."""

import array
import math
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np

from adrl.bags.messages import New, pose
from adrl.deploy.driver import Driver, Report
from adrl.deploy.given_path import GivenPathGuide
from adrl.deploy.guidance import OwnMapGuide
from adrl.integrations.ros.config import RuntimeConfig
from adrl.integrations.ros.messages import status_words
from adrl.integrations.ros.outbox import Publish
from adrl.types import Array

MARKERS, MAP = "adrl/markers", "adrl/map"
"""Topics."""
KINDS = {MARKERS: "visualization_msgs/msg/MarkerArray", MAP: "nav_msgs/msg/OccupancyGrid"}
MARKER = "visualization_msgs/msg/Marker"
EVERY_S = {MARKERS: 0.2, MAP: 1.0}
"""Least time between two messages."""
SPHERE, LINE_STRIP, SPHERE_LIST, TEXT = 2, 4, 7, 9
DELETE_ALL = 3
"""Types and action of a visualization_msgs/Marker."""
ORANGE, BLUE, VERMILION, GREY = (0.90, 0.62, 0.0), (0.0, 0.45, 0.70), (0.84, 0.37, 0.0), (0.6, 0.6, 0.6)
ABOVE_M = 0.8
"""The words are so high above the robot."""


def displays() -> dict[str, str]:
    """Topic -> kind, of what this environment has messages for."""
    return {topic: kind for topic, kind in KINDS.items() if find_spec(kind.split("/")[0]) is not None}


class Display:
    """Publishers of what is to be seen."""

    def __init__(
        self,
        config: RuntimeConfig,
        publish: Mapping[str, Publish],
        heard: Callable[[str], bool],
        header: Callable[[float, str], Any],
        new: New,
        wall_s: Callable[[], float],
    ) -> None:
        """publish: of the displays, where there are any. heard: whether anybody listens to a topic. header(stamp_s,
        frame): a std_msgs/Header. new: makes the messages. wall_s: a clock that nobody sets."""
        self._odom_frame = config.odom_frame
        self._publish, self._heard = publish, heard
        self._header, self._new, self._wall_s = header, new, wall_s
        self._shown_s = dict.fromkeys(KINDS, -math.inf)

    def show(self, driver: Driver, report: Report, now_s: float) -> None:
        """Publish what is due and looked at."""
        for topic, make in ((MARKERS, self._markers), (MAP, self._map)):
            wall_s = self._wall_s()
            if (
                topic in self._publish
                and wall_s >= self._shown_s[topic] + EVERY_S[topic]
                and self._heard(topic)
            ):
                self._shown_s[topic] = wall_s
                message = make(driver, report, now_s)
                if message is not None:
                    self._publish[topic](message)

    def _markers(self, driver: Driver, report: Report, now_s: float) -> Any:
        """All that there were go; those that there are come."""
        command, supervisor = report.command, driver.navigator.supervisor
        goals, odom = self._header(now_s, report.frame), self._header(now_s, self._odom_frame)
        markers = [self._marker(odom, "", action=DELETE_ALL)]
        if len(command.plan):
            markers.append(self._marker(goals, "plan", LINE_STRIP, 0.03, BLUE, points=command.plan))
        if command.waypoint is not None:
            markers.append(self._marker(goals, "waypoint", SPHERE, 0.2, ORANGE, at=command.waypoint))
        hits = np.empty((0, 2)) if supervisor is None else supervisor.braked_for()
        if len(hits):
            markers.append(self._marker(odom, "braked for", SPHERE_LIST, 0.08, VERMILION, points=hits))
        if driver.here is not None:
            words = self._marker(
                odom, "status", TEXT, 0.2, GREY, at=driver.here[:2], text=status_words(report)
            )
            words.pose.position.z = ABOVE_M
            markers.append(words)
        return self._new(KINDS[MARKERS], markers=markers)

    def _marker(
        self,
        header: Any,
        name: str,
        kind: int = SPHERE,
        size_m: float = 1.0,
        colour: Sequence[float] = GREY,
        *,
        at: Sequence[float] = (0.0, 0.0),
        points: Array | Sequence[Any] = (),
        text: str = "",
        action: int = 0,
    ) -> Any:
        new, (red, green, blue) = self._new, colour
        return new(
            MARKER,
            header=header,
            ns=name,
            id=0,
            type=kind,
            action=action,
            pose=pose(new, (*at, 0.0)),
            scale=new("geometry_msgs/msg/Vector3", x=size_m, y=size_m, z=size_m),
            color=new("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=1.0),
            points=[new("geometry_msgs/msg/Point", x=float(x), y=float(y), z=0.0) for x, y in points],
            text=text,
        )

    def _map(self, driver: Driver, report: Report, now_s: float) -> Any:
        """What the robot has mapped itself, as far as it has seen: solid 100, free 0, else -1. None without a map."""
        guide = driver.navigator.guide
        if not isinstance(guide, OwnMapGuide | GivenPathGuide):
            return None
        b, resolution_m = guide.replanner.b, guide.replanner.config.resolution_m
        log_odds, (row, column) = b["log_odds"][0], b["origin"][0].tolist()
        rows, columns = (np.flatnonzero(log_odds.any(axis=axis)) for axis in (1, 0))
        if len(rows) == 0:
            return None
        seen = log_odds[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        cells = np.select([seen > 0, seen < 0], [100, 0], -1).astype(np.int8)
        header, new = self._header(now_s, self._odom_frame), self._new
        corner = ((column + int(columns[0])) * resolution_m, (row + int(rows[0])) * resolution_m, 0.0)
        info = new(
            "nav_msgs/msg/MapMetaData",
            map_load_time=header.stamp,
            resolution=resolution_m,
            width=cells.shape[1],
            height=cells.shape[0],
            origin=pose(new, corner),
        )
        # rclpy looks at each number of a list, and takes an array as it is.
        return new(KINDS[MAP], header=header, info=info, data=array.array("b", cells.tobytes()))
