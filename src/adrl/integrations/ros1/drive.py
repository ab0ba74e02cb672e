"""adrl ros1 drive: a node that drives a robot to the goals it gets."""

from collections.abc import Sequence

from adrl.integrations.ros.config import DriveConfig
from adrl.integrations.ros.drive import LATCHED, NAME, DriveTopics, publications
from adrl.integrations.ros1 import node as ros


def drive(config: DriveConfig, ros_arguments: Sequence[str]) -> None:
    """Run the node until it is told to end. Raises AdrlError."""
    with ros.a_node(NAME, config, ros_arguments) as (rospy, config):
        publish = {
            topic: ros.publisher(rospy, topic, kind, latched=topic in LATCHED)
            for topic, kind in publications(config).items()
        }
        topics = DriveTopics(
            config,
            publish,
            now_s=rospy.get_time,
            seconds=lambda stamp: stamp.to_sec(),
            header=ros.header,
            simulated=bool(rospy.get_param("/use_sim_time", False)),
        )
        ros.before_shutdown(rospy, topics.stop)
        alone = ros.Alone()
        for topic, (kind, take) in topics.subscriptions().items():
            ros.subscribe(rospy, topic, kind, alone(take))
        ros.spin(rospy, alone(topics.tick), topics.tick_s)
