"""adrl ros2 drive: a node that drives a robot to the goals it gets."""

import logging
from collections.abc import Mapping, Sequence
from typing import Any

from adrl.errors import MissingExtra
from adrl.integrations.ros.actions import Actions
from adrl.integrations.ros.config import DriveConfig, RuntimeConfig
from adrl.integrations.ros.drive import LATCHED, NAME, DriveTopics, publications
from adrl.integrations.ros.navigate import ACTION, NavigateToPose
from adrl.integrations.ros2 import node as ros
from adrl.integrations.ros2.action_server import serve

LOG = logging.getLogger("adrl.driver")

SENSORS = ("scan", "odom", "cloud")
"""Topics of which the newest message counts, and a lost one is lost."""
QOS = dict.fromkeys(SENSORS, ros.SENSOR) | dict.fromkeys(LATCHED, ros.LATCHED) | ros.TRANSFORMS


def drive(config: DriveConfig, ros_arguments: Sequence[str]) -> None:
    """Run the node until it is told to end. Raises AdrlError."""
    with ros.a_node(NAME, ros_arguments) as node:
        config = ros.configure(node, config)
        if config.source == "tf":
            ros.require("tf2_msgs")
        publishers = {
            topic: ros.create_publisher(node, topic, kind, latched=topic in LATCHED)
            for topic, kind in publications(config).items()
        }
        topics = drive_topics(node, config, publishers)
        subscribe_all(node, topics)
        task = NavigateToPose(topics, ros.header, config.map_frame, turns=config.goal_yaw)
        try:
            ros.require("nav2_msgs")
            serve(node, ACTION, "navigate_to_pose", Actions(topics, task), ros.clock_of(node), lambda: True)
        except MissingExtra as missing:
            LOG.info("without the action navigate_to_pose: %s", missing)
        node.create_timer(topics.tick_s, topics.tick, clock=ros.steady_clock())
        try:
            ros.spin(node)
        finally:
            topics.stop()
            ros.last_word(publishers["cmd_vel"])


def drive_topics(node: Any, config: RuntimeConfig, publishers: Mapping[str, Any]) -> DriveTopics:
    """What a driving node does, by rclpy's clock, stamps and publishers. Raises AdrlError."""
    return DriveTopics(
        config,
        {topic: publisher.publish for topic, publisher in publishers.items()},
        heard=lambda topic: publishers[topic].get_subscription_count() > 0,
        now_s=ros.clock_of(node),
        seconds=ros.seconds,
        header=ros.header,
        simulated=bool(node.get_parameter("use_sim_time").value),
    )


def subscribe_all(node: Any, topics: DriveTopics) -> list[Any]:
    """Have a driving node's messages taken. Returns rclpy's subscriptions."""
    return [
        ros.subscribe(node, topic, kind, take, QOS.get(topic, ros.RELIABLE))
        for topic, (kind, take) in topics.subscriptions().items()
    ]
