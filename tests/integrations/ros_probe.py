"""Speaks with ROS nodes for a test: a program of the nodes' own environment, run by test_ros.py.

    python ros_probe.py '{"generation": 2, "namespace": "/robot1", "stamped": true, "watch": ["odom"], "relay": true}'

Lines of JSON in: {"goal": [x, y], "frame": "map"}, {"cancel": true}, {"relay": false}. Lines of JSON out: what topics
said. relay: scans come from topic scan and go to topic relayed/scan, until told otherwise.
"""

import json
import sys
import threading
from queue import Empty as NothingThere
from queue import SimpleQueue
from typing import Any

ASK = json.loads(sys.argv[1])
if ASK["generation"] == 1:
    sys.path.append("/usr/lib/python3/dist-packages")

from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402  # pyright: ignore
from geometry_msgs.msg import PoseStamped, Twist, TwistStamped  # noqa: E402  # pyright: ignore
from nav_msgs.msg import Odometry, Path  # noqa: E402  # pyright: ignore
from sensor_msgs.msg import LaserScan  # noqa: E402  # pyright: ignore
from std_msgs.msg import Empty, UInt32  # noqa: E402  # pyright: ignore

LOCK = threading.Lock()
RELAY = [bool(ASK["relay"])]


def say(topic: str, **values: Any) -> None:
    """One line."""
    with LOCK:
        sys.stdout.write(json.dumps({"topic": topic, **values}) + "\n")
        sys.stdout.flush()


def seconds(stamp: Any) -> float:
    """Of either generation's stamp."""
    return stamp.to_sec() if ASK["generation"] == 1 else stamp.sec + 1e-9 * stamp.nanosec


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


def on_collisions(message: Any) -> None:
    say("collisions", count=message.data)


LISTEN = {
    "adrl/status": (DiagnosticArray, on_status),
    "collisions": (UInt32, on_collisions),
    "odom": (Odometry, on_odometry),
    "cmd_vel": (TwistStamped if ASK["stamped"] else Twist, on_command),
    "plan": (Path, on_plan),
}
ALWAYS = ("adrl/status", "collisions")
TOPICS = {topic: what for topic, what in LISTEN.items() if topic in ALWAYS or topic in ASK["watch"]}


def obey(line: str, goals: Any, cancels: Any) -> None:
    """One line from the test."""
    order = json.loads(line)
    if "goal" in order:
        goal = PoseStamped()
        goal.header.frame_id = order["frame"]
        goal.pose.position.x, goal.pose.position.y = order["goal"]
        goal.pose.orientation.w = 1.0
        goals.publish(goal)
    elif "cancel" in order:
        cancels.publish(Empty())
    else:
        RELAY[0] = order["relay"]


def probe_ros1() -> None:
    import rospy  # pyright: ignore

    rospy.init_node("probe", disable_signals=True)

    def publisher(topic: str, kind: Any) -> Any:
        return rospy.Publisher(topic, kind, queue_size=5, tcp_nodelay=True)

    goals, cancels = publisher("goal_pose", PoseStamped), publisher("adrl/cancel", Empty)
    for topic, (kind, take) in TOPICS.items():
        rospy.Subscriber(topic, kind, take, tcp_nodelay=True)
    if ASK["relay"]:
        relayed = publisher("relayed/scan", LaserScan)
        rospy.Subscriber("scan", LaserScan, lambda m: RELAY[0] and relayed.publish(m), tcp_nodelay=True)
    for line in sys.stdin:
        obey(line, goals, cancels)
    rospy.signal_shutdown("done")


def probe_ros2() -> None:
    import rclpy  # pyright: ignore
    from rclpy.qos import (  # pyright: ignore
        DurabilityPolicy,
        QoSProfile,
        qos_profile_sensor_data,
    )

    latched = QoSProfile(depth=5, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    rclpy.init(args=["probe", "--ros-args", "-r", f"__ns:={ASK['namespace'] or '/'}"])
    node = rclpy.create_node("probe")
    goals = node.create_publisher(PoseStamped, "goal_pose", 5)
    cancels = node.create_publisher(Empty, "adrl/cancel", 5)
    for topic, (kind, take) in TOPICS.items():
        node.create_subscription(kind, topic, take, latched if topic in ALWAYS else 50)
    if ASK["relay"]:
        relayed = node.create_publisher(LaserScan, "relayed/scan", qos_profile_sensor_data)
        node.create_subscription(
            LaserScan, "scan", lambda m: RELAY[0] and relayed.publish(m), qos_profile_sensor_data
        )
    lines: SimpleQueue[str] = SimpleQueue()

    def read() -> None:
        for line in sys.stdin:
            lines.put(line)
        lines.put("")

    threading.Thread(target=read, daemon=True).start()
    while True:
        rclpy.spin_once(node, timeout_sec=0.01)
        try:
            line = lines.get_nowait()
        except NothingThere:
            continue
        if not line:
            return
        obey(line, goals, cancels)


if __name__ == "__main__":
    probe_ros1() if ASK["generation"] == 1 else probe_ros2()
