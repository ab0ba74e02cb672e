"""adrl view --ros2: a node that only listens, beside the page."""

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from adrl.integrations.ros.watch import Watch
from adrl.integrations.ros2 import node as ros
from adrl.integrations.ros2.drive import QOS
from adrl.types import RobotConfig

NAME = "adrl_view"
"""Of the node."""


@contextmanager
def watching(robot: RobotConfig, ros_arguments: Sequence[str]) -> Iterator[Watch]:
    """What this robot's topics tell, for as long as the context lasts."""
    with ros.a_node(NAME, ros_arguments) as node:
        watch = Watch(robot, ros.seconds)
        for topic, (kind, take) in watch.subscriptions().items():
            ros.subscribe(node, topic, kind, take, QOS.get(topic, ros.RELIABLE))
        ended = threading.Event()
        thread = threading.Thread(target=ros.run, args=(node, ended.is_set), daemon=True)
        thread.start()
        try:
            yield watch
        finally:
            ended.set()
            thread.join()
