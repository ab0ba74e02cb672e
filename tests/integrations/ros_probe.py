"""Speaks with ROS nodes for a test: a program of the nodes' own environment, run by test_ros.py.

    python ros_probe.py '{"generation": 2, "namespace": "/robot1", "stamped": true, "watch": ["odom"], "relay": true}'

Lines of JSON in: {"goal": [x, y], "frame": "map"}, {"cancel": true}, or Relay.become's arguments. Lines of JSON out:
what topics said. relay: clock, scan, odometry and pose go on to relayed/..., as they are or as a test wants them.
"""

import copy
import json
import math
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

ASK = json.loads(sys.argv[1])
if ASK["generation"] == 1:
    sys.path.append("/usr/lib/python3/dist-packages")

from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402  # pyright: ignore
from geometry_msgs.msg import (  # noqa: E402  # pyright: ignore
    PoseStamped,
    PoseWithCovarianceStamped,
    Twist,
    TwistStamped,
)
from nav_msgs.msg import OccupancyGrid, Odometry, Path  # noqa: E402  # pyright: ignore
from probe_lines import lines_while  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402  # pyright: ignore
from sensor_msgs.msg import LaserScan  # noqa: E402  # pyright: ignore
from std_msgs.msg import Empty, UInt32  # noqa: E402  # pyright: ignore
from visualization_msgs.msg import MarkerArray  # noqa: E402  # pyright: ignore

LOCK = threading.Lock()
RELAYED = {"scan": LaserScan, "odom": Odometry, "amcl_pose": PoseWithCovarianceStamped, "/clock": Clock}
LATE = 4
"""Scans by which one that is late comes after its time."""


def say(topic: str, **values: Any) -> None:
    """One line."""
    with LOCK:
        sys.stdout.write(json.dumps({"topic": topic, **values}) + "\n")
        sys.stdout.flush()


def seconds(stamp: Any) -> float:
    """Of either generation's stamp."""
    return stamp.to_sec() if ASK["generation"] == 1 else stamp.sec + 1e-9 * stamp.nanosec


class Relay:
    """What comes between a robot and its driver. Healthy until told otherwise."""

    def __init__(self, publish: dict[str, Callable[[Any], None]]) -> None:
        """publish: of what is relayed."""
        self._publish = publish
        self._kept: list[Any] = []
        self.become()

    def become(self, scans: str = "pass", clock_s: float = 0.0, sensors_s: float = 0.0) -> None:
        """scans: pass, drop, freeze, nan, late or swap. clock_s, sensors_s: by which clock and stamps are wrong."""
        self._scans, self._clock_s, self._sensors_s = scans, clock_s, sensors_s
        self._kept.clear()

    def take(self, topic: str, message: Any) -> None:
        """Pass on what is left of a message."""
        message = copy.deepcopy(message)
        if topic == "/clock":
            shift(message.clock, self._clock_s)
        else:
            shift(message.header.stamp, self._sensors_s)
        for passed in self._scan(message) if topic == "scan" else [message]:
            self._publish[topic](passed)

    def _scan(self, message: Any) -> list[Any]:
        kept = self._kept
        kept.append(message)
        match self._scans:
            case "drop":
                return []
            case "freeze":
                message.ranges = kept[0].ranges
            case "nan":
                message.ranges = [math.nan] * len(message.ranges)
            case "late":
                return [kept.pop(0)] if len(kept) > LATE else []
            case "swap":
                return [kept.pop(), kept.pop()] if len(kept) == 2 else []
            case _:
                kept.clear()
        return [message]


def shift(stamp: Any, by_s: float) -> None:
    """Of either generation."""
    whole = "secs" if ASK["generation"] == 1 else "sec"
    setattr(stamp, whole, getattr(stamp, whole) + int(by_s))


def on_status(message: Any) -> None:
    (status,) = message.status
    values = {pair.key: pair.value for pair in status.values}
    level = status.level if isinstance(status.level, int) else status.level[0]
    say("status", level=level, message=status.message, **values)


def on_odometry(message: Any) -> None:
    twist, at = message.twist.twist, message.pose.pose.position
    say("odom", t=seconds(message.header.stamp), v=twist.linear.x, w=twist.angular.z, x=at.x, y=at.y)


def on_command(message: Any) -> None:
    twist = message.twist if ASK["stamped"] else message
    frame = message.header.frame_id if ASK["stamped"] else ""
    say("cmd_vel", v=twist.linear.x, w=twist.angular.z, frame=frame)


def on_plan(message: Any) -> None:
    say("plan", points=len(message.poses), frame=message.header.frame_id)


def on_markers(message: Any) -> None:
    shown = {marker.ns: marker for marker in message.markers if marker.action == 0}
    frames = {name: marker.header.frame_id for name, marker in shown.items()}
    points = {name: [(at.x, at.y) for at in marker.points] for name, marker in shown.items()}
    say("markers", frames=frames, points=points, text="".join(marker.text for marker in shown.values()))


def on_map(message: Any) -> None:
    info, cells = message.info, list(message.data)
    corner = [info.origin.position.x, info.origin.position.y]
    size = [info.width, info.height]
    say("map", frame=message.header.frame_id, size=size, corner=corner, cell_m=info.resolution, cells=cells)


def on_collisions(message: Any) -> None:
    say("collisions", count=message.data)


LISTEN = {
    "adrl/status": (DiagnosticArray, on_status),
    "collisions": (UInt32, on_collisions),
    "odom": (Odometry, on_odometry),
    "cmd_vel": (TwistStamped if ASK["stamped"] else Twist, on_command),
    "plan": (Path, on_plan),
    "adrl/markers": (MarkerArray, on_markers),
    "adrl/map": (OccupancyGrid, on_map),
}
ALWAYS = ("adrl/status", "collisions")
TOPICS = {topic: what for topic, what in LISTEN.items() if topic in ALWAYS or topic in ASK["watch"]}


def obey(line: str, goals: Any, cancels: Any, relay: Relay) -> None:
    """One line from the test."""
    order = json.loads(line)
    if "goal" in order:
        goal = PoseStamped()
        goal.header.frame_id = order["frame"]
        goal.pose.position.x, goal.pose.position.y = order["goal"]
        goal.pose.orientation.w = 1.0
        publish(goals, goal)
    elif "cancel" in order:
        publish(cancels, Empty())
    else:
        relay.become(**order)


def publish(publisher: Any, message: Any) -> None:
    """Once there is someone to hear it."""
    count = publisher.get_num_connections if ASK["generation"] == 1 else publisher.get_subscription_count
    give_up_s = time.monotonic() + 20.0
    while not count():
        assert time.monotonic() < give_up_s, "nobody listens"
        time.sleep(0.01)
    publisher.publish(message)


def probe_ros1() -> None:
    import rospy  # pyright: ignore

    rospy.init_node("probe", disable_signals=True)

    def publisher(topic: str, kind: Any) -> Any:
        return rospy.Publisher(topic, kind, queue_size=5, tcp_nodelay=True)

    goals, cancels = publisher("goal_pose", PoseStamped), publisher("adrl/cancel", Empty)
    for topic, (kind, take) in TOPICS.items():
        rospy.Subscriber(topic, kind, take, tcp_nodelay=True)
    relayed = RELAYED if ASK["relay"] else {}
    relay = Relay({topic: publisher(where(topic), kind).publish for topic, kind in relayed.items()})
    for topic, kind in relayed.items():
        rospy.Subscriber(topic, kind, lambda m, t=topic: relay.take(t, m), tcp_nodelay=True)
    for line in sys.stdin:
        obey(line, goals, cancels, relay)
    rospy.signal_shutdown("done")


def probe_ros2() -> None:
    import rclpy  # pyright: ignore
    from rclpy.qos import (  # pyright: ignore
        DurabilityPolicy,
        QoSProfile,
        ReliabilityPolicy,
    )

    latched = QoSProfile(depth=5, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    newest = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    rclpy.init(args=["probe", "--ros-args", "-r", f"__ns:={ASK['namespace'] or '/'}"])
    node = rclpy.create_node("probe")
    goals = node.create_publisher(PoseStamped, "goal_pose", 5)
    cancels = node.create_publisher(Empty, "adrl/cancel", 5)
    for topic, (kind, take) in TOPICS.items():
        node.create_subscription(kind, topic, take, latched if topic in ALWAYS else 50)
    relayed = RELAYED if ASK["relay"] else {}
    qos = {topic: latched if topic == "amcl_pose" else newest for topic in relayed}
    relay = Relay({t: node.create_publisher(kind, where(t), qos[t]).publish for t, kind in relayed.items()})
    for topic, kind in relayed.items():
        node.create_subscription(kind, topic, lambda m, t=topic: relay.take(t, m), qos[topic])
    for line in lines_while(lambda: rclpy.spin_once(node, timeout_sec=0.01)):
        obey(line, goals, cancels, relay)


def where(topic: str) -> str:
    """What is relayed from a topic comes out here."""
    return f"relayed/{topic.removeprefix('/')}"


if __name__ == "__main__":
    probe_ros1() if ASK["generation"] == 1 else probe_ros2()
