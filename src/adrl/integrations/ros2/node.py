"""What both nodes have: parameters, topics, stamps, an executor, an orderly end."""

import logging
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from adrl.errors import MissingExtra
from adrl.integrations.ros.config import Config, Parameter, with_parameters
from adrl.integrations.ros.messages import message_class
from adrl.integrations.ros.outbox import Publish, log_to

try:
    import rclpy  # pyright: ignore[reportMissingImports]
    from builtin_interfaces.msg import Time  # pyright: ignore[reportMissingImports]
    from rcl_interfaces.msg import ParameterDescriptor  # pyright: ignore[reportMissingImports]
    from rclpy.clock import Clock, ClockType  # pyright: ignore[reportMissingImports]
    from rclpy.duration import Duration  # pyright: ignore[reportMissingImports]
    from rclpy.experimental import EventsExecutor  # pyright: ignore[reportMissingImports]
    from rclpy.qos import (  # pyright: ignore[reportMissingImports]
        DurabilityPolicy,
        QoSProfile,
        ReliabilityPolicy,
    )
    from rclpy.qos_overriding_options import (  # pyright: ignore[reportMissingImports]
        QoSOverridingOptions,
        QoSPolicyKind,
    )
    from rclpy.signals import SignalHandlerOptions  # pyright: ignore[reportMissingImports]
    from std_msgs.msg import Header  # pyright: ignore[reportMissingImports]
except ImportError as error:
    raise MissingExtra(
        f"ROS 2 is not in this environment ({error}); make ros2 in the source makes one, .venv-ros2, with its own adrl"
    ) from None

LOG = logging.getLogger("adrl.driver")

RELIABLE = QoSProfile(depth=1)
SENSOR = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
TRANSFORMS = {
    "/tf": QoSProfile(depth=100),
    "/tf_static": QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL),
}
OVERRIDABLE = QoSOverridingOptions((QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY, QoSPolicyKind.DEPTH))
"""By parameters qos_overrides.TOPIC.subscription.reliability and the like."""

LAST_WORD_S = 1.0
"""So long a publisher that ends waits for those who listen to have its last message."""

WAIT_S = 0.1
"""A signal is heeded so soon where no message comes."""


@contextmanager
def a_node(
    name: str, ros_arguments: Sequence[str], make: Callable[[str], Any] = rclpy.create_node
) -> Iterator[Any]:
    """A node with the arguments from --ros-args on, for as long as the context lasts."""
    # Signals are ours: a context that has shut down could no longer tell the base to stop.
    rclpy.init(args=["adrl", *ros_arguments], signal_handler_options=SignalHandlerOptions.NO)
    node = make(name)
    log = node.get_logger()
    log_to(
        {  # rclpy holds each place that logs to one level
            logging.INFO: lambda words: log.info(words),
            logging.WARNING: lambda words: log.warning(words),
            logging.ERROR: lambda words: log.error(words),
        }
    )
    try:
        yield node
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def require(*packages: str) -> None:
    """Packages, or modules of theirs. Raises MissingExtra where interfaces are missing."""
    for package in packages:
        try:
            import_module(package)
        except ImportError as error:
            name = package.partition(".")[0].replace("_", "-")
            raise MissingExtra(
                f"{error}: install ROS 2's package {name}, or run make ros2 in the source, which generates it"
            ) from None


def configure(node: Any, config: Config) -> Config:
    """The settings with the values of the node's parameters, which cannot be changed later. Raises ConfigError."""
    return with_parameters(config, reader(node))


def reader(node: Any) -> Callable[[str, Parameter], Any]:
    """Declares a parameter with a default, and tells its value."""
    descriptor = ParameterDescriptor(read_only=True, dynamic_typing=True)

    def get(name: str, default: Parameter) -> Any:
        if not node.has_parameter(name):
            # An empty list has no type that ROS could infer.
            node.declare_parameter(name, None if default == [] else default, descriptor)
        value = node.get_parameter(name).value
        return default if value is None else value

    return get


def publisher(node: Any, topic: str, kind: str, *, latched: bool = False) -> Publish:
    """Publishes on a topic."""
    return create_publisher(node, topic, kind, latched=latched).publish


def create_publisher(node: Any, topic: str, kind: str, *, latched: bool = False) -> Any:
    """rclpy's."""
    qos = TRANSFORMS.get(topic, LATCHED if latched else RELIABLE)
    return node.create_publisher(message_class(kind), topic, qos, qos_overriding_options=OVERRIDABLE)


def last_word(publisher: Any) -> None:
    """Wait until all who listen have what was published: a publisher takes with it what was not sent yet."""
    if not publisher.wait_for_all_acked(Duration(seconds=LAST_WORD_S)):
        LOG.warning("not all who listen to %s have its last message; some may be gone", publisher.topic_name)


def subscribe(node: Any, topic: str, kind: str, take: Callable[[Any], None], qos: Any) -> Any:
    """Have a topic's messages taken. Returns rclpy's subscription."""

    def take_all(message: Any) -> None:
        """What waits behind it, too: else transforms are older than other messages wherever the node was held up."""
        take(message)
        while (more := made.handle.take_message(made.msg_type, made.raw)) is not None:
            take(more[0])

    call = take_all if topic in TRANSFORMS else take
    made = node.create_subscription(message_class(kind), topic, call, qos, qos_overriding_options=OVERRIDABLE)
    return made


def seconds(stamp: Any) -> float:
    """Of a builtin_interfaces/Time."""
    return stamp.sec + 1e-9 * stamp.nanosec


def header(stamp_s: float, frame: str) -> Any:
    """A std_msgs/Header."""
    whole, nanoseconds = divmod(round(stamp_s * 1e9), 1_000_000_000)
    return Header(stamp=Time(sec=whole, nanosec=nanoseconds), frame_id=frame)


def clock_of(node: Any) -> Callable[[], float]:
    """Tells the node's time, s."""
    clock = node.get_clock()
    return lambda: 1e-9 * clock.now().nanoseconds


def steady_clock() -> Any:
    """That no one sets."""
    return Clock(clock_type=ClockType.STEADY_TIME)


def spin(node: Any, until: Callable[[], bool] = lambda: False) -> None:
    """Until SIGINT or SIGTERM, or until that is so."""

    told: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        # Noted and not raised: within rclpy's bindings an exception comes out as another one.
        signal.signal(number, lambda number, _: told.append(number))
    run(node, lambda: bool(told) or until())


def run(node: Any, until: Callable[[], bool]) -> None:
    """Have the node's messages taken until that is so, on any thread."""
    executor = EventsExecutor()
    executor.add_node(node)
    while not until():
        # spin(), which waits without an end, calls nothing and keeps a core busy with the wheels of 2025-11.
        executor.spin_once(timeout_sec=WAIT_S)
    executor.remove_node(node)
