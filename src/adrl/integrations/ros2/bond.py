"""A sign of life to Nav2's lifecycle manager: a bond (bond_core), whose other end is there."""

import uuid
from typing import Any

from adrl.integrations.ros2 import node as ros

HEARTBEAT_TIMEOUT_S = 4.0
"""Nav2's: without a sign of life for so long, the manager takes the node for dead."""


class Bond:
    """Alive from its making to break_off()."""

    def __init__(self, node: Any, period_s: float) -> None:
        """Raises ImportError where the package bond is not."""
        from bond.msg import Status  # pyright: ignore[reportMissingImports]

        self._status = Status
        self._node, self._period_s = node, period_s
        self._instance = str(uuid.uuid4())
        self._broken = False
        self._publisher = node.create_publisher(Status, "bond", 5)
        self._subscription = node.create_subscription(Status, "bond", self._take, 100)
        self._timer = node.create_timer(period_s, self._live, clock=ros.steady_clock())
        self._live()

    def break_off(self) -> None:
        """Say so, and be silent."""
        self._say(alive=False)
        self._broken = True
        self._node.destroy_timer(self._timer)
        self._node.destroy_subscription(self._subscription)
        self._node.destroy_publisher(self._publisher)

    def _take(self, status: Any) -> None:
        """The other end lets go, and waits to hear the same."""
        theirs = status.id == self._node.get_name() and status.instance_id != self._instance
        if theirs and not status.active and not self._broken:
            self._timer.cancel()
            self._say(alive=False)

    def _live(self) -> None:
        if not self._broken:  # the executor may call once more for a timer that is no more
            self._say(alive=True)

    def _say(self, *, alive: bool) -> None:
        self._publisher.publish(
            self._status(
                header=ros.header(1e-9 * self._node.get_clock().now().nanoseconds, ""),
                id=self._node.get_name(),
                instance_id=self._instance,
                active=alive,
                heartbeat_timeout=HEARTBEAT_TIMEOUT_S,
                heartbeat_period=self._period_s,
            )
        )
