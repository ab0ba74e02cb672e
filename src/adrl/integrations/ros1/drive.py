"""adrl ros1 drive: a node that drives a robot to the goals it gets."""

from collections.abc import Sequence
from contextlib import suppress

from adrl.integrations.ros.config import DriveConfig
from adrl.integrations.ros.drive import LATCHED, NAME, DriveTopics, publications
from adrl.integrations.ros1 import node as ros


def drive(config: DriveConfig, ros_arguments: Sequence[str]) -> None:
    """Run the node until it is told to end. Raises AdrlError."""
    rospy, config = ros.start(NAME, config, ros_arguments)
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
    alone = ros.Alone()
    for topic, (kind, take) in topics.subscriptions().items():
        ros.subscribe(rospy, topic, kind, alone(take))
    # rospy closes the topics as soon as the node is told to end.
    rospy.core.add_preshutdown_hook(lambda _: topics.stop())
    pause, tick = rospy.Duration.from_sec(topics.tick_s), alone(topics.tick)
    while not rospy.is_shutdown():
        with suppress(rospy.ROSInterruptException):  # the clock went back, or the node ends
            rospy.sleep(pause)
        tick()
