"""Speaks with our nodes as Nav2's behaviour tree and lifecycle manager do, for a test; in ROS 2's environment.

    python nav2_probe.py

Lines of JSON in: {"change": 3}, {"follow": [[x, y], ...], "frame": "map", "yaw": 0.0, "controller_id": ""},
{"navigate": [x, y, yaw], "frame": "map"}, {"cancel": true}, {"limit": 50.0, "percentage": true}, {"clear": true}. Lines
of JSON out: what came of it, and what topics said.
"""

import json
import sys
from typing import Any

import rclpy  # pyright: ignore
from bond.msg import Status  # pyright: ignore
from geometry_msgs.msg import PoseStamped, Twist  # pyright: ignore
from lifecycle_msgs.srv import ChangeState  # pyright: ignore
from nav2_msgs.action import FollowPath, NavigateToPose  # pyright: ignore
from nav2_msgs.msg import SpeedLimit  # pyright: ignore
from nav2_msgs.srv import ClearEntireCostmap  # pyright: ignore
from nav_msgs.msg import Odometry  # pyright: ignore
from probe_lines import lines_while
from rclpy.action import ActionClient  # pyright: ignore
from rclpy.qos import DurabilityPolicy, QoSProfile  # pyright: ignore
from std_msgs.msg import UInt32  # pyright: ignore

from adrl.geometry import quaternion_of, yaw_of

PATIENCE_S = 30.0


def say(topic: str, **values: Any) -> None:
    """One line."""
    sys.stdout.write(json.dumps({"topic": topic, **values}) + "\n")
    sys.stdout.flush()


def pose(frame: str, x: float, y: float, yaw: float) -> Any:
    """A PoseStamped."""
    out = PoseStamped()
    out.header.frame_id = frame
    out.pose.position.x, out.pose.position.y = float(x), float(y)
    turn = out.pose.orientation
    turn.x, turn.y, turn.z, turn.w = quaternion_of(yaw)
    return out


class Client:
    """One action's client; goals are numbered."""

    def __init__(self, node: Any, kind: Any, name: str) -> None:
        self.kind, self.name = kind, name
        self._client = ActionClient(node, kind, name)
        self._count = 0
        self._newest: Any = None

    def send(self, goal: Any) -> None:
        """What comes of it is said."""
        assert self._client.wait_for_server(PATIENCE_S), f"no action {self.name}"
        self._count += 1
        number = self._count
        future = self._client.send_goal_async(
            goal, feedback_callback=lambda m: self._tell(number, m.feedback)
        )
        future.add_done_callback(lambda done: self._taken(number, done.result()))

    def cancel(self) -> None:
        """The newest goal."""
        self._newest.cancel_goal_async().add_done_callback(lambda done: say("cancelling"))

    def _taken(self, number: int, handle: Any) -> None:
        say("taken", action=self.name, number=number, accepted=handle.accepted)
        if handle.accepted:
            self._newest = handle
            handle.get_result_async().add_done_callback(lambda done: self._ended(number, done.result()))

    def _tell(self, number: int, feedback: Any) -> None:
        if self.kind is FollowPath:
            say("feedback", number=number, left_m=feedback.distance_to_goal, speed=feedback.speed)
            return
        at = feedback.current_pose.pose
        time_s = feedback.navigation_time.sec + 1e-9 * feedback.navigation_time.nanosec
        say(
            "feedback",
            number=number,
            left_m=feedback.distance_remaining,
            at=[at.position.x, at.position.y, yaw_of(at.orientation)],
            time_s=time_s,
        )

    def _ended(self, number: int, answer: Any) -> None:
        say(
            "ended",
            action=self.name,
            number=number,
            status=answer.status,
            code=answer.result.error_code,
            message=answer.result.error_msg,
        )


def main() -> None:
    """Until there is no more input."""
    rclpy.init()
    node = rclpy.create_node("probe")
    follow = Client(node, FollowPath, "follow_path")
    navigate = Client(node, NavigateToPose, "navigate_to_pose")
    clients: list[Client] = []
    limits = node.create_publisher(SpeedLimit, "speed_limit", 5)
    states = node.create_client(ChangeState, "controller_server/change_state")
    clearing = node.create_client(ClearEntireCostmap, "local_costmap/clear_entirely_local_costmap")
    node.create_subscription(Twist, "cmd_vel", lambda m: say("cmd_vel", v=m.linear.x, w=m.angular.z), 50)
    latched = QoSProfile(depth=5, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(UInt32, "collisions", lambda m: say("collisions", count=m.data), latched)
    node.create_subscription(Odometry, "odom", on_odometry, 50)
    node.create_subscription(Status, "bond", lambda m: say("bond", id=m.id, active=m.active), 50)
    for line in lines_while(lambda: rclpy.spin_once(node, timeout_sec=0.01)):
        order = json.loads(line)
        if "change" in order:
            assert states.wait_for_service(PATIENCE_S), "no controller"
            request = ChangeState.Request()
            request.transition.id = order["change"]
            states.call_async(request).add_done_callback(
                lambda done: say("changed", success=done.result().success)
            )
        elif "follow" in order:
            goal, frame = FollowPath.Goal(), order.get("frame", "map")
            goal.path.header.frame_id = frame
            goal.path.poses = [pose(frame, x, y, order.get("yaw", 0.0)) for x, y in order["follow"]]
            for name in ("controller_id", "goal_checker_id", "progress_checker_id"):
                setattr(goal, name, order.get(name, ""))
            clients.append(follow)
            follow.send(goal)
        elif "navigate" in order:
            clients.append(navigate)
            navigate.send(NavigateToPose.Goal(pose=pose(order["frame"], *order["navigate"])))
        elif "cancel" in order:
            clients[-1].cancel()
        elif "clear" in order:
            assert clearing.wait_for_service(PATIENCE_S), "no service to clear the local costmap"
            clearing.call_async(ClearEntireCostmap.Request()).add_done_callback(lambda done: say("cleared"))
        else:
            limits.publish(SpeedLimit(percentage=order["percentage"], speed_limit=order["limit"]))


def on_odometry(message: Any) -> None:
    stamp, twist, at = message.header.stamp, message.twist.twist, message.pose.pose
    say(
        "odom",
        t=stamp.sec + 1e-9 * stamp.nanosec,
        v=twist.linear.x,
        w=twist.angular.z,
        x=at.position.x,
        y=at.position.y,
        yaw=yaw_of(at.orientation),
    )


if __name__ == "__main__":
    main()
