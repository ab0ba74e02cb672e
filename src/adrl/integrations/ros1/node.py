"""What both nodes have: rospy from the distribution, parameters, topics, stamps."""

import logging
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from adrl.errors import MissingExtra
from adrl.integrations.ros.config import Config, with_parameters
from adrl.integrations.ros.messages import message_class
from adrl.integrations.ros.outbox import Publish, log_to

DIST_PACKAGES = Path("/usr/lib/python3/dist-packages")
"""Where Debian and Ubuntu install rospy; a virtual environment does not look there."""
PACKAGES = (
    "python3-rospy python3-sensor-msgs python3-nav-msgs python3-geometry-msgs python3-std-msgs "
    "python3-diagnostic-msgs"
)


def import_rospy() -> Any:
    """The module rospy. Raises MissingExtra."""
    # Last on the path: all that the environment has itself comes first.
    if (DIST_PACKAGES / "rospy").is_dir() and str(DIST_PACKAGES) not in sys.path:
        sys.path.append(str(DIST_PACKAGES))
    try:
        import rospy  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise MissingExtra(
            f"ROS 1 is not on this machine ({error}): source its setup.bash, or on Debian apt-get install {PACKAGES}"
        ) from None
    return rospy


def start(name: str, config: Config, ros_arguments: Sequence[str]) -> tuple[Any, Config]:
    """rospy with a node, and the settings with the values of its private parameters. Raises AdrlError."""
    rospy = import_rospy()
    rospy.init_node(name, argv=["adrl", *ros_arguments])
    log_to({logging.INFO: rospy.loginfo, logging.WARNING: rospy.logwarn, logging.ERROR: rospy.logerr})
    return rospy, with_parameters(config, lambda key, default: rospy.get_param(f"~{key}", default))


def publisher(rospy: Any, topic: str, kind: str, *, latched: bool = False) -> Publish:
    """Publishes on a topic; nothing once the node is shutting down."""
    topic_publisher = rospy.Publisher(
        topic, message_class(kind), queue_size=1, latch=latched, tcp_nodelay=True
    )

    def publish(message: Any) -> None:
        try:
            topic_publisher.publish(message)
        except rospy.ROSException:
            if not rospy.is_shutdown():
                raise

    return publish


def subscribe(rospy: Any, topic: str, kind: str, take: Callable[[Any], None]) -> None:
    """Have a topic's messages taken."""
    rospy.Subscriber(topic, message_class(kind), take, queue_size=1, tcp_nodelay=True)


class Alone:
    """rospy calls from a thread a topic: one at a time gets in."""

    def __init__(self) -> None:
        self._lock = threading.Lock()

    def __call__(self, call: Callable[..., None]) -> Callable[..., None]:
        """The same, waiting for its turn."""

        def alone(*arguments: Any) -> None:
            with self._lock:
                call(*arguments)

        return alone


def header(stamp_s: float, frame: str) -> Any:
    """A std_msgs/Header."""
    from std_msgs.msg import Header  # pyright: ignore[reportMissingImports]

    return Header(stamp=import_rospy().Time.from_sec(stamp_s), frame_id=frame)
