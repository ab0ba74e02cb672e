"""adrl ros2 controller: a lifecycle node in the place of Nav2's controller_server."""

import logging
import math
from collections.abc import Sequence
from typing import Any

from rclpy.lifecycle import (  # pyright: ignore[reportMissingImports]
    LifecycleNode,
    TransitionCallbackReturn,
)

from adrl.errors import AdrlError
from adrl.integrations.ros.actions import Actions
from adrl.integrations.ros.config import ControllerConfig
from adrl.integrations.ros.drive import LATCHED, DriveTopics, publications
from adrl.integrations.ros.follow_path import ACTION, FollowPath, Plugins
from adrl.integrations.ros.messages import message_class
from adrl.integrations.ros2 import node as ros
from adrl.integrations.ros2.action_server import serve
from adrl.integrations.ros2.bond import Bond
from adrl.integrations.ros2.drive import drive_topics, subscribe_all

LOG = logging.getLogger("adrl.driver")

NAME = "controller_server"
"""Of the node, as Nav2's parameter files and lifecycle manager name it."""
CLEAR, CLEAR_SERVICE = "nav2_msgs/srv/ClearEntireCostmap", "local_costmap/clear_entirely_local_costmap"
"""Nav2's own controller server holds the local costmap; its behaviour trees do not load where nobody offers this."""


def controller(config: ControllerConfig, ros_arguments: Sequence[str]) -> None:
    """Run the node until it is told to end. Raises AdrlError."""
    ros.require("nav2_msgs.srv", "tf2_msgs")  # environments of before have no services
    with ros.a_node(NAME, ros_arguments, make=Controller) as node:
        node.config = config
        try:
            ros.spin(node)
        finally:
            node.close()


class Controller(LifecycleNode):
    """Configured, it has its topics and its policy; active, it takes paths and drives."""

    config = ControllerConfig()
    """What parameters change."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._topics: DriveTopics | None = None
        self._actions: Actions | None = None
        self._bond: Bond | None = None
        self._made: list[tuple[Any, Any]] = []
        """How each thing of the configured state is destroyed, and the thing."""

    def on_configure(self, state: Any) -> Any:
        """Read the parameters, load the policy, open the topics."""
        try:
            self._configure()
        except AdrlError as error:
            self.get_logger().error(str(error))
            self._clean_up()
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: Any) -> Any:
        """Take paths from now on."""
        assert self._topics is not None
        self._topics.active = True
        if self.config.bond_heartbeat_period > 0.0:
            try:
                self._bond = Bond(self, self.config.bond_heartbeat_period)
            except ImportError as error:
                LOG.warning("no bond to the lifecycle manager (%s): set its bond_timeout to 0.0", error)
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: Any) -> Any:
        """The robot stands, its goal is aborted."""
        assert self._topics is not None
        assert self._actions is not None
        self._topics.stand()
        self._topics.active = False
        self._actions.abort("the controller was deactivated")
        self._let_go()
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state: Any) -> Any:
        """As before it was configured."""
        self._clean_up()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: Any) -> Any:
        """As on_cleanup, whatever it was doing."""
        self.close()
        return TransitionCallbackReturn.SUCCESS

    def close(self) -> None:
        """Stand, and end."""
        if self._topics is not None and self._actions is not None:
            self._topics.stop()
            self._actions.abort("the controller has ended")
        self._let_go()
        self._clean_up()

    def _let_go(self) -> None:
        if self._bond is not None:
            self._bond.break_off()
            self._bond = None

    def _configure(self) -> None:
        self.config = config = ros.configure(self, self.config)
        plugins = Plugins.of(ros.reader(self))
        publishers = {}
        for topic, kind in publications(config).items():
            publisher = ros.create_publisher(self, topic, kind, latched=topic in LATCHED)
            self._made.append((self.destroy_publisher, publisher))
            publishers[topic] = publisher
        self._made.append((ros.last_word, publishers["cmd_vel"]))
        topics = drive_topics(self, config, publishers)
        topics.active = False
        self._made += [(self.destroy_subscription, one) for one in subscribe_all(self, topics)]
        limit = ros.subscribe(
            self, config.speed_limit_topic, "nav2_msgs/msg/SpeedLimit", self._limit, ros.RELIABLE
        )
        timer = self.create_timer(topics.tick_s, topics.tick, clock=ros.steady_clock())
        self._made += [(self.destroy_subscription, limit), (self.destroy_timer, timer)]
        self._actions = Actions(topics, FollowPath(config, plugins, topics))
        server = serve(self, ACTION, "follow_path", self._actions, ros.clock_of(self), lambda: topics.active)
        self._made.append((lambda server: server.destroy(), server))
        clear = self.create_service(message_class(CLEAR), CLEAR_SERVICE, self._clear)
        self._made.append((self.destroy_service, clear))
        self._topics = topics

    def _clean_up(self) -> None:
        if self._topics is not None:
            self._topics.open = False
        for destroy, made in reversed(self._made):
            destroy(made)
        self._made.clear()
        self._topics = self._actions = None

    def _clear(self, request: Any, response: Any) -> Any:
        """A nav2_msgs/ClearEntireCostmap: what the robot has mapped itself is forgotten."""
        assert self._topics is not None
        self._topics.driver.navigator.guide.forget()
        if hasattr(response, "success"):  # newer than Kilted
            response.success = True
        return response

    def _limit(self, message: Any) -> None:
        """A nav2_msgs/SpeedLimit: m/s, or percent of the greatest speed; 0 for no limit."""
        assert self._topics is not None
        limit = message.speed_limit
        if not (math.isfinite(limit) and limit >= 0.0):
            LOG.warning("speed limit %r is not used: give 0, for none, or more", limit)
            return
        navigator = self._topics.driver.navigator
        if message.percentage:
            limit *= 0.01 * navigator.robot.max_speed_mps
        navigator.speed_limit_mps = limit or math.inf
