"""adrl ros2 sim: a simulated robot on the topics of one."""

from collections.abc import Sequence

from adrl.integrations.ros.config import SimConfig
from adrl.integrations.ros.robot import SimulatedRobot
from adrl.integrations.ros.sim import LATCHED, NAME, SimTopics, publications, subscription
from adrl.integrations.ros2 import node as ros


def sim(config: SimConfig, ros_arguments: Sequence[str]) -> None:
    """Run the node until it is told to end. Raises AdrlError."""
    with ros.a_node(NAME, ros_arguments) as node:
        config = ros.configure(node, config)
        publish = {
            topic: ros.publisher(node, topic, kind, latched=topic in LATCHED)
            for topic, kind in publications(config).items()
        }
        with SimulatedRobot.of(config) as robot:
            topics = SimTopics(config, robot, publish, ros.header)
            ros.subscribe(node, "cmd_vel", subscription(config), topics.take_command, ros.RELIABLE)
            node.create_timer(topics.tick_s, topics.tick, clock=ros.steady_clock())
            ros.spin(node)
