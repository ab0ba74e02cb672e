"""How paths of another planner end when our controller follows them, in the place of Nav2's controller_server.

The client, which does as Nav2's behaviour tree does, and the simulated robot are this process, the controller another.
"""

import os
import subprocess
import sys
import time
from collections import Counter
from typing import Any

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from adrl import _core
from adrl.bags.messages import path as path_message
from adrl.errors import ConfigError, WorldError
from adrl.integrations.ros.config import SimConfig
from adrl.types import Array, RobotConfig, Task, World
from adrl.worlds import get_scenario, load_robot, task_set

CELL_M, MARGIN_M = 0.1, 0.05
"""Of the other planner's grid, and the clearance beyond the robot's disc that its paths keep at least."""
STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))
CONFIGURE, ACTIVATE = 1, 3
PATIENCE_S = 60.0
SUCCEEDED = 4


def grid_path(
    world: World, robot: RobotConfig, start: tuple[float, float], goal: tuple[float, float]
) -> Array:
    """(P, 2) by Dijkstra over a grid of eight neighbours, clearance preferred: as plain global planners plan."""
    x_min, y_min, x_max, y_max = world.bounds
    xs, ys = np.arange(x_min, x_max, CELL_M) + 0.5 * CELL_M, np.arange(y_min, y_max, CELL_M) + 0.5 * CELL_M
    cells = np.stack([axis.ravel() for axis in np.meshgrid(xs, ys)], axis=1)
    poses = np.column_stack([cells, np.zeros(len(cells))])
    clearance = _core.clearance(world.native, poses, robot.circumscribed_radius_m, np.empty((0, 2)), 1.0)
    free = clearance > MARGIN_M
    cost = 1.0 + 0.1 / np.maximum(clearance, 0.01)
    number = np.arange(len(cells)).reshape(len(ys), len(xs))
    begins, ends = [], []
    for down, right in STEPS:
        left = slice(max(0, -right), len(xs) - max(0, right))
        shifted = slice(max(0, right), len(xs) + min(0, right))
        begins.append(number[: len(ys) - down, left].ravel())
        ends.append(number[down:, shifted].ravel())
    a, b = np.concatenate(begins), np.concatenate(ends)
    both = free[a] & free[b]
    a, b = a[both], b[both]
    lengths = np.hypot(*(cells[a] - cells[b]).T) * 0.5 * (cost[a] + cost[b])
    graph = csr_array((lengths, (a, b)), shape=(len(cells), len(cells)))

    def cell(point: tuple[float, float]) -> int:
        return int(np.where(free, np.hypot(*(cells - point).T), np.inf).argmin())

    first, last = cell(start), cell(goal)
    _, before = dijkstra(graph, directed=False, indices=first, return_predecessors=True)
    way = [last]
    while way[-1] != first:
        if before[way[-1]] < 0:
            raise WorldError(f"the other planner finds no path from {start} to {goal}")
        way.append(int(before[way[-1]]))
    return np.vstack([start, cells[way[::-1]], goal])


def bench_nav2(
    policy: str, *, paths: int = 200, robot: str = "diffbot", scenario: str = "complex", speed: float = 1.0
) -> dict[str, Any]:
    """Share of paths that end with success, and the error codes of the rest. speed: times as fast as real time.

    Raises ConfigError, MissingExtra where ROS 2 or nav2_msgs is not, WorldError when the node does not come up.
    """
    if paths < 1:
        raise ConfigError(f"paths is {paths}; give 1 or more")
    os.environ.setdefault("ROS_DOMAIN_ID", "102")
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    command = [sys.executable, "-m", "adrl.cli", "ros2", "controller", "--policy", policy, "--robot", robot]
    node = subprocess.Popen([*command, "--ros-args", "-p", "use_sim_time:=true"], stdin=subprocess.DEVNULL)
    config = load_robot(robot)
    try:
        with _Client(speed) as client:
            ends = [
                client.drive(task, config) for task in task_set(get_scenario(scenario), config, "test", paths)
            ]
    finally:
        node.terminate()
        node.wait()
    codes = Counter(code for code, _ in ends)
    return {
        "schema_version": 1,
        "paths": paths,
        "success": codes[0] / paths,
        "error_codes": {str(code): count for code, count in sorted(codes.items()) if code},
        "collisions": sum(collisions for _, collisions in ends),
        "load": os.getloadavg()[0],
    }


class _Client:
    """A robot a task, one after the other on one clock, and the client of the controller."""

    def __init__(self, speed: float) -> None:
        self._config = SimConfig(speed=speed, tf=True)
        self._ended_s = 0.0
        """On the simulated clock, where the next task begins."""

    def __enter__(self) -> "_Client":
        from adrl.integrations.ros.sim import LATCHED, publications, subscription
        from adrl.integrations.ros2 import node as ros

        ros.require("nav2_msgs", "tf2_msgs")
        self._context = ros.a_node("adrl_bench", [])
        self._node = node = self._context.__enter__()
        self._publish = {
            topic: ros.publisher(node, topic, kind, latched=topic in LATCHED)
            for topic, kind in publications(self._config).items()
        }
        self._topics: Any = None
        self._is_active = False
        ros.subscribe(node, "cmd_vel", subscription(self._config), self._take, ros.RELIABLE)
        from rclpy.action import ActionClient  # pyright: ignore[reportMissingImports]

        from adrl.integrations.ros.messages import message_class

        self._kind = message_class("nav2_msgs/action/FollowPath")
        self._actions = ActionClient(node, self._kind, "follow_path")
        return self

    def __exit__(self, *_: object) -> None:
        self._context.__exit__(None, None, None)

    def drive(self, task: Task, robot: RobotConfig) -> tuple[int, int]:
        """The error code that a task's path ends with, 0 for success, and how often the robot hit something."""
        from adrl.integrations.ros.messages import new_message
        from adrl.integrations.ros.robot import SimulatedRobot
        from adrl.integrations.ros.sim import SimTopics
        from adrl.integrations.ros2 import node as ros

        begin_s = self._ended_s + 1.0
        simulated = SimulatedRobot(task, robot)
        self._topics = SimTopics(
            self._config,
            simulated,
            self._publish,
            lambda stamp_s, frame: ros.header(begin_s + stamp_s, frame),
        )
        timer = self._node.create_timer(self._topics.tick_s, self._topics.tick, clock=ros.steady_clock())
        if not self._is_active:
            self._activate()
        self._spin(lambda: simulated.time_s > 2.0)
        goal = self._kind.Goal()
        goal.path = path_message(
            new_message, ros.header(0.0, "map"), grid_path(task.world, robot, task.start[:2], task.goal)
        )
        handle = self._result(self._actions.send_goal_async(goal))
        if not handle.accepted:
            raise WorldError("the controller takes no path; see what it wrote")
        answer = self._result(handle.get_result_async(), 600.0)
        self._node.destroy_timer(timer)
        self._ended_s = begin_s + simulated.time_s
        code = answer.result.error_code
        return (0 if answer.status == SUCCEEDED else code or -1), simulated.collisions

    def _activate(self) -> None:
        from lifecycle_msgs.srv import ChangeState  # pyright: ignore[reportMissingImports]

        states = self._node.create_client(ChangeState, "controller_server/change_state")
        self._spin(states.service_is_ready)
        for transition in (CONFIGURE, ACTIVATE):
            request = ChangeState.Request()
            request.transition.id = transition
            if not self._result(states.call_async(request)).success:
                raise WorldError("the controller cannot be configured; see what it wrote")
        self._spin(self._actions.server_is_ready)
        self._is_active = True

    def _result(self, future: Any, patience_s: float = PATIENCE_S) -> Any:
        self._spin(future.done, patience_s)
        return future.result()

    def _spin(self, until: Any, patience_s: float = PATIENCE_S) -> None:
        from adrl.integrations.ros2 import node as ros

        give_up_s = time.monotonic() + patience_s
        ros.spin(self._node, lambda: until() or time.monotonic() > give_up_s)
        if not until():
            raise WorldError(f"the controller does not answer in {patience_s:.0f} s; see what it wrote")

    def _take(self, message: Any) -> None:
        if self._topics is not None:
            self._topics.take_command(message)
