"""Messages of a bag, topic by topic, and errors that name file and topic."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from adrl.bags.damage import mending, reason, require_bag
from adrl.errors import DatasetError, MissingExtra

SCAN_TOPIC = "/scan"
ODOMETRY_TOPIC = "/odom"
COMMAND_TOPIC = "/cmd_vel"
POSE_TOPIC = "/amcl_pose"
SCANS = ("sensor_msgs/msg/LaserScan",)
ODOMETRY = ("nav_msgs/msg/Odometry",)
TWISTS = ("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped")
POSES = ("geometry_msgs/msg/PoseWithCovarianceStamped",)
GOALS = ("geometry_msgs/msg/PoseStamped",)
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
TRANSFORM_TOPICS = ("/tf", "/tf_static")


class Bag:
    """A bag that is open for reading."""

    def __init__(self, path: Path, reader: Any) -> None:
        self.path = path
        self._reader = reader

    @property
    def topics(self) -> set[str]:
        """Those it has, also the empty ones."""
        return {connection.topic for connection in self._reader.connections}

    @property
    def is_ros2(self) -> bool:
        """Whether ROS 2 recorded it."""
        return bool(self._reader.is2)

    def types(self, topic: str) -> set[str]:
        """Of a topic's messages, such as "geometry_msgs/msg/Twist"; none for a topic that it does not have."""
        return {line.msgtype for line in self._reader.connections if line.topic == topic}

    def messages(
        self, topic: str, kinds: tuple[str, ...], *, optional: bool = False
    ) -> Iterator[tuple[float, Any]]:
        """Messages of a topic, in the order recorded: seconds since the bag began, and the message.

        The time is that at which the bag recorded it: the one clock that stamped all topics. kinds: the types that
        will do, such as "sensor_msgs/msg/LaserScan". optional: no such topic, or no message on it, is no error. Raises
        DatasetError: no such topic, no message, another type, damaged.
        """
        connections = [line for line in self._reader.connections if line.topic == topic]
        if not connections and optional:
            return
        if not connections:
            raise DatasetError(
                f"{self.path}: no topic {topic}; it has {', '.join(sorted(self.topics)) or 'none'}"
            )
        for line in connections:
            if line.msgtype not in kinds:
                wanted = " or ".join(kind.replace("/msg/", "/") for kind in kinds)
                found = line.msgtype.replace("/msg/", "/")
                raise DatasetError(f"{self.path}: {topic} is of {found}; give a topic of {wanted}")
        count = 0
        try:
            for line, nanoseconds, raw in self._reader.messages(connections=connections):
                count += 1
                yield (
                    (nanoseconds - self._reader.start_time) * 1e-9,
                    self._reader.deserialize(raw, line.msgtype),
                )
        except Exception as error:  # What a damaged bag makes rosbags raise is not documented.
            raise DatasetError(
                f"{self.path}: {topic} is damaged after {count} messages ({reason(error)})"
                + mending(self.path, error)
            ) from error
        if count == 0 and not optional:
            raise DatasetError(f"{self.path}: topic {topic} holds no message")


@contextmanager
def open_bag(path: str | os.PathLike[str]) -> Iterator[Bag]:
    """Open a ROS 1 bag file, or the folder of a ROS 2 bag, or one of its files.

    Raises MissingExtra without rosbags; DatasetError, which says what to run where a bag can be mended.
    """
    path = Path(path)
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise MissingExtra.named("bags", "reading bags") from None
    require_bag(path)
    # Old ROS 2 bags do not say what their messages are; these have been the same in all releases.
    store = get_typestore(Stores.ROS2_HUMBLE)
    try:
        reader = AnyReader([path], default_typestore=store)
        reader.open()
        if reader.is2:  # some say it of some topics only
            known = reader.typestore.fielddefs
            reader.typestore.register({k: v for k, v in store.fielddefs.items() if k not in known})
    except Exception as error:  # as in Bag.messages
        raise DatasetError(f"{path}: not a readable bag ({reason(error)}){mending(path, error)}") from error
    try:
        yield Bag(path, reader)
    finally:
        reader.close()
