"""Speaks with our node as ROS 1's clients of move_base do, for a test; by Debian's packages.

    python move_base_probe.py

Lines of JSON in: {"navigate": [x, y, yaw], "frame": "map"}, {"cancel": true}. Lines of JSON out: what came of it.
"""

import json
import sys
import threading
from typing import Any

sys.path.append("/usr/lib/python3/dist-packages")

import actionlib  # pyright: ignore
import rospy  # pyright: ignore
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal  # pyright: ignore

from adrl.geometry import quaternion_of, yaw_of

LOCK = threading.Lock()


def say(topic: str, **values: Any) -> None:
    """One line."""
    with LOCK:
        sys.stdout.write(json.dumps({"topic": topic, **values}) + "\n")
        sys.stdout.flush()


def main() -> None:
    """Until there is no more input."""
    rospy.init_node("client", disable_signals=True)
    client = actionlib.ActionClient("move_base", MoveBaseAction)
    client.wait_for_server(rospy.Duration(0.0))
    handles: list[Any] = []

    def changed(handle: Any, number: int) -> None:
        if handle.get_comm_state() == actionlib.CommState.DONE:
            status = handle.get_terminal_state()
            say("ended", number=number, status=status, message=handle.get_goal_status_text())

    def told(feedback: Any, number: int) -> None:
        at = feedback.base_position.pose
        say("feedback", number=number, at=[at.position.x, at.position.y, yaw_of(at.orientation)])

    for line in sys.stdin:
        order = json.loads(line)
        if "cancel" in order:
            handles[-1].cancel()
            continue
        goal, number = MoveBaseGoal(), len(handles) + 1
        x, y, yaw = order["navigate"]
        goal.target_pose.header.frame_id = order["frame"]
        goal.target_pose.pose.position.x, goal.target_pose.pose.position.y = x, y
        turn = goal.target_pose.pose.orientation
        turn.x, turn.y, turn.z, turn.w = quaternion_of(yaw)
        handles.append(
            client.send_goal(
                goal, lambda handle, n=number: changed(handle, n), lambda _, told_, n=number: told(told_, n)
            )
        )
    rospy.signal_shutdown("done")


if __name__ == "__main__":
    main()
