"""adrl ros2 drive: a node that drives a robot to the goals it gets."""

from collections.abc import Sequence

from adrl.integrations.ros.config import DriveConfig
from adrl.integrations.ros.drive import LATCHED, NAME, DriveTopics, publications
from adrl.integrations.ros2 import node as ros

SENSORS = ("scan", "odom")
"""Topics of which the newest message counts, and a lost one is lost."""


def drive(config: DriveConfig, ros_arguments: Sequence[str]) -> None:
    """Run the node until it is told to end. Raises AdrlError."""
    with ros.a_node(NAME, ros_arguments) as node:
        config = ros.configure(node, config)
        publish = {
            topic: ros.publisher(node, topic, kind, latched=topic in LATCHED)
            for topic, kind in publications(config).items()
        }
        clock = node.get_clock()
        topics = DriveTopics(
            config,
            publish,
            now_s=lambda: 1e-9 * clock.now().nanoseconds,
            seconds=ros.seconds,
            header=ros.header,
            simulated=bool(node.get_parameter("use_sim_time").value),
        )
        for topic, (kind, take) in topics.subscriptions().items():
            qos = ros.SENSOR if topic in SENSORS else ros.LATCHED if topic in LATCHED else ros.RELIABLE
            ros.subscribe(node, topic, kind, take, qos)
        node.create_timer(topics.tick_s, topics.tick, clock=ros.steady_clock())
        try:
            ros.spin(node)
        finally:
            topics.stop()
