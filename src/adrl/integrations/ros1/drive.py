"""adrl ros1 drive: a node that drives a robot to the goals it gets."""

import logging
from collections.abc import Sequence

from adrl.errors import MissingExtra
from adrl.integrations.ros.actions import Actions
from adrl.integrations.ros.config import DriveConfig
from adrl.integrations.ros.drive import LATCHED, NAME, DriveTopics, publications
from adrl.integrations.ros.navigate import MoveBase
from adrl.integrations.ros1 import node as ros
from adrl.integrations.ros1.action_server import Server

LOG = logging.getLogger("adrl.driver")


def drive(config: DriveConfig, ros_arguments: Sequence[str]) -> None:
    """Run the node until it is told to end. Raises AdrlError."""
    with ros.a_node(NAME, config, ros_arguments) as (rospy, config):
        if config.source == "tf":
            ros.require("tf2_msgs")
        publishers = {
            topic: ros.create_publisher(rospy, topic, kind, latched=topic in LATCHED)
            for topic, kind in publications(config).items()
        }
        topics = DriveTopics(
            config,
            {topic: ros.publishing(rospy, publisher) for topic, publisher in publishers.items()},
            heard=lambda topic: publishers[topic].get_num_connections() > 0,
            now_s=rospy.get_time,
            seconds=lambda stamp: stamp.to_sec(),
            header=ros.header,
            simulated=bool(rospy.get_param("/use_sim_time", False)),
        )
        ros.before_shutdown(rospy, topics.stop)
        task = MoveBase(topics, ros.header, config.map_frame, turns=config.goal_yaw)
        calls = [topics.tick]
        try:
            server = Server(
                "move_base_msgs/msg/MoveBaseAction", "move_base", Actions(topics, task), rospy.get_time
            )
            calls.insert(0, server.heed)
        except MissingExtra as missing:
            LOG.info("without the action move_base: %s", missing)

        def beat() -> None:
            for call in calls:
                call()

        alone = ros.Alone()
        for topic, (kind, take) in topics.subscriptions().items():
            ros.subscribe(rospy, topic, kind, alone(take))
        ros.spin(rospy, alone(beat), topics.tick_s)
