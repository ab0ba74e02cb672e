"""What both nodes have: rospy from the distribution, parameters, topics, stamps."""

import logging
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

from adrl.errors import MissingExtra
from adrl.integrations.ros.config import Config, with_parameters
from adrl.integrations.ros.messages import message_class
from adrl.integrations.ros.outbox import Publish, log_to
from adrl.integrations.ros.transforms import TF

DIST_PACKAGES = Path("/usr/lib/python3/dist-packages")
"""Where Debian and Ubuntu install rospy; a virtual environment does not look there."""
PACKAGES = (
    "python3-rospy python3-sensor-msgs python3-nav-msgs python3-geometry-msgs python3-std-msgs "
    "python3-diagnostic-msgs"
)

FLUSH_S = 0.1
"""rospy's publishers have threads of their own, which are not waited for at the end."""


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


def require(*packages: str) -> None:
    """Raises MissingExtra where modules of ROS are missing."""
    for package in packages:
        try:
            import_module(package)
        except ImportError as error:
            name = package.replace("_", "-")
            raise MissingExtra(f"{error}: on Debian apt-get install python3-{name}") from None


@contextmanager
def a_node(name: str, config: Config, ros_arguments: Sequence[str]) -> Iterator[tuple[Any, Config]]:
    """rospy with a node for as long as the context lasts, and the settings with the values of its private parameters.

    Raises AdrlError.
    """
    rospy = import_rospy()
    # Signals are ours: rospy shuts down within its handler, which waits for ever where the main thread is publishing.
    rospy.init_node(name, argv=["adrl", *ros_arguments], disable_signals=True)
    log_to({logging.INFO: rospy.loginfo, logging.WARNING: rospy.logwarn, logging.ERROR: rospy.logerr})
    try:
        yield rospy, with_parameters(config, lambda key, default: rospy.get_param(f"~{key}", default))
    finally:
        rospy.signal_shutdown("the node ends")


def spin(rospy: Any, call: Callable[[], None], pause_s: float) -> None:
    """Call it again and again, pause_s of real time after it began, until SIGINT, SIGTERM or a shutdown by ROS."""
    told: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: told.append(number))
    due_s = time.monotonic()
    while not told and not rospy.is_shutdown():
        call()
        due_s = max(due_s + pause_s, time.monotonic())
        time.sleep(max(due_s - time.monotonic(), 0.0))


def before_shutdown(rospy: Any, call: Callable[[], None]) -> None:
    """Call it while the topics are still open, whoever ends the node, and let what it publishes get away."""

    def last() -> None:
        call()
        time.sleep(FLUSH_S)

    rospy.on_shutdown(
        last
    )  # rospy's own hooks, which close the topics, come before preshutdown hooks of others


def publisher(rospy: Any, topic: str, kind: str, *, latched: bool = False) -> Publish:
    """Publishes on a topic; nothing once the node is shutting down."""
    return publishing(rospy, create_publisher(rospy, topic, kind, latched=latched))


def create_publisher(rospy: Any, topic: str, kind: str, *, latched: bool = False) -> Any:
    """rospy's."""
    return rospy.Publisher(topic, message_class(kind), queue_size=1, latch=latched, tcp_nodelay=True)


def publishing(rospy: Any, topic_publisher: Any) -> Publish:
    """Its publish(), but for the time when the node is shutting down."""

    def publish(message: Any) -> None:
        try:
            topic_publisher.publish(message)
        except rospy.ROSException:
            if not rospy.is_shutdown():
                raise

    return publish


def subscribe(rospy: Any, topic: str, kind: str, take: Callable[[Any], None]) -> None:
    """Have a topic's messages taken."""
    # Of transforms each counts, of the rest the newest.
    depth = 100 if topic in TF else 1
    rospy.Subscriber(topic, message_class(kind), take, queue_size=depth, tcp_nodelay=True)


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
