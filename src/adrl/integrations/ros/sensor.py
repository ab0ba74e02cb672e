"""What a driving node sees by: a LaserScan, or a PointCloud2 looked at between two heights."""

import dataclasses
import logging
import math
from typing import Any

import numpy as np

from adrl.deploy import Pose, Scan
from adrl.deploy.frames import Frames, Transform, matrix, mount_of
from adrl.errors import TransformError
from adrl.integrations.ros.config import RuntimeConfig
from adrl.integrations.ros.messages import scan_of
from adrl.types import Array, LidarConfig

LOG = logging.getLogger("adrl.driver")

BEAMS = 360
"""Directions that a cloud is looked at in."""
FLOATS = {7: "f4", 8: "f8"}
"""sensor_msgs/PointField's FLOAT32 and FLOAT64."""


class Sensor:
    """Reads one sensor's messages; with tf it is placed on the robot by the transform to the frame of the first one."""

    def __init__(self, config: RuntimeConfig, frames: Frames, lidar: LidarConfig) -> None:
        self._config, self._frames = config, frames
        self._max_range_m = lidar.max_range_m
        self._is_cloud = config.heights is not None
        self.topic = "cloud" if self._is_cloud else "scan"
        self.kind = "sensor_msgs/msg/PointCloud2" if self._is_cloud else "sensor_msgs/msg/LaserScan"
        self._frame = ""
        """Of its messages."""
        self._upside_down = False
        self._told = ""

    def read(self, message: Any, stamp_s: float) -> tuple[Scan, Pose | None]:
        """The scan, and where it is seen from on the robot where that is news.

        Raises TransformError where no transform tells where the sensor is, and for messages that are of no use.
        """
        frame = message.header.frame_id.strip("/")
        news = None
        if self._is_cloud:
            heights = self._config.heights
            assert heights is not None
            transform = self._frames.lookup(self._config.base_frame, frame, stamp_s)
            scan = flat_scan(points_of(message), transform, heights, self._max_range_m, stamp_s)
            news = None if self._frame else (0.0, 0.0, 0.0)
        else:
            scan = scan_of(message, stamp_s)
            if self._config.source == "tf" and self._config.mount is None:
                if not self._frame:
                    at = self._frames.lookup(self._config.base_frame, frame, stamp_s)
                    news, self._upside_down = mount_of(at)
                elif frame != self._frame:
                    raise TransformError(f"a scan in frame {frame!r}: this robot's are in {self._frame!r}")
        self._frame, self._told = frame, ""
        return (_mirrored(scan) if self._upside_down else scan), news

    def tell(self, error: TransformError) -> None:
        """Once, until it works."""
        if not self._told:
            LOG.warning("%s is not used: %s", self.topic, error)
        self._told = str(error)


def points_of(message: Any) -> Array:
    """(P, 3) x, y, z of a sensor_msgs/PointCloud2 in its frame. Raises TransformError for one without them."""
    fields = {field.name: field for field in message.fields}
    order = ">" if message.is_bigendian else "<"
    try:
        kinds = [order + FLOATS[fields[name].datatype] for name in "xyz"]
    except KeyError:
        raise TransformError("the cloud has no x, y and z that are floats; give one that has") from None
    try:
        layout = np.dtype(
            {
                "names": list("xyz"),
                "formats": kinds,
                "offsets": [fields[name].offset for name in "xyz"],
                "itemsize": message.point_step,
            }
        )
    except ValueError:
        raise TransformError(
            f"the cloud's x, y and z do not fit into its point_step of {message.point_step}; mend its driver"
        ) from None
    rows = np.frombuffer(bytes(message.data), np.uint8)
    if (
        message.width * message.point_step > message.row_step
        or message.row_step * message.height != rows.size
    ):
        raise TransformError("the cloud's width, height and steps are not those of its data; mend its driver")
    rows = rows.reshape(message.height, message.row_step)[:, : message.width * message.point_step]
    points = np.ascontiguousarray(rows).view(layout)
    return np.stack([points[name].ravel().astype(np.float64) for name in "xyz"], axis=1)


def flat_scan(
    points: Array, transform: Transform, heights: tuple[float, float], max_range_m: float, stamp_s: float
) -> Scan:
    """What a planar LiDAR in the middle of the robot would see of (P, 3) points between two heights above its frame.

    Of each direction the nearest such point. Where there are points, but only above or below, the way is free; where
    there are none at all, nothing is known.
    """
    axes, place = matrix(transform)
    on_robot = points[np.isfinite(points).all(axis=1)] @ axes.T + place
    beams = np.floor((np.arctan2(on_robot[:, 1], on_robot[:, 0]) + math.pi) / (2.0 * math.pi) * BEAMS)
    beams = beams.astype(np.intp) % BEAMS
    ranges = np.full(BEAMS, np.nan)
    ranges[beams] = np.inf
    within = (heights[0] <= on_robot[:, 2]) & (on_robot[:, 2] <= heights[1])
    np.minimum.at(ranges, beams[within], np.hypot(on_robot[within, 0], on_robot[within, 1]))
    increment = 2.0 * math.pi / BEAMS
    return Scan(
        ranges=ranges,
        angle_min_rad=-math.pi + 0.5 * increment,
        angle_increment_rad=increment,
        range_max_m=max_range_m,
        stamp_s=stamp_s,
    )


def _mirrored(scan: Scan) -> Scan:
    """That of a LiDAR upside down, seen from above."""
    return dataclasses.replace(
        scan,
        angle_min_rad=-scan.angle_min_rad,
        angle_increment_rad=-scan.angle_increment_rad,
        angle_max_rad=-scan.angle_max_rad,
    )
