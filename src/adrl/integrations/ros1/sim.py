"""adrl ros1 sim: a simulated robot on the topics of one."""

from collections.abc import Sequence

from adrl.integrations.ros.config import SimConfig
from adrl.integrations.ros.robot import SimulatedRobot
from adrl.integrations.ros.sim import LATCHED, NAME, SimTopics, publications, subscription
from adrl.integrations.ros1 import node as ros


def sim(config: SimConfig, ros_arguments: Sequence[str]) -> None:
    """Run the node until it is told to end. Raises AdrlError."""
    with ros.a_node(NAME, config, ros_arguments) as (rospy, config):
        publish = {
            topic: ros.publisher(rospy, topic, kind, latched=topic in LATCHED)
            for topic, kind in publications(config).items()
        }
        with SimulatedRobot.of(config) as robot:
            topics = SimTopics(config, robot, publish, ros.header)
            alone = ros.Alone()
            ros.subscribe(rospy, "cmd_vel", subscription(config), alone(topics.take_command))
            ros.spin(rospy, alone(topics.tick), topics.tick_s)
