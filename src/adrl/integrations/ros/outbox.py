"""What a driving node publishes, and how often: the command at once, the rest as people and monitors need it."""

import logging
import math
import threading
from collections.abc import Callable, Mapping
from typing import Any

from adrl.bags.messages import New, path, twist
from adrl.deploy import Twist
from adrl.deploy.driver import Report
from adrl.integrations.ros.config import RuntimeConfig
from adrl.integrations.ros.messages import status_message

PLAN_S = 0.5
"""Least time between two plans of one goal."""
STATUS_S = 1.0
"""A status is repeated so often when it does not change."""

Publish = Callable[[Any], None]


class Outbox:
    """Publishers of a driving node: topic -> cmd_vel, plan and adrl/status."""

    def __init__(
        self,
        config: RuntimeConfig,
        robot: str,
        publish: Mapping[str, Publish],
        header: Callable[[float, str], Any],
        new: New,
        wall_s: Callable[[], float],
        policy: str | None,
    ) -> None:
        """publish: of topic -> cmd_vel, plan and adrl/status. header(stamp_s, frame): a std_msgs/Header. new: makes the
        messages. wall_s: a clock that nobody sets. policy: what the status says of it, if anything."""
        self._config = config
        self._robot = robot
        self._publish = publish
        self._header = header
        self._new = new
        self._wall_s = wall_s
        self._policy = policy
        self._lock = threading.Lock()
        self._closed = False
        self._told: tuple[Any, ...] = ()
        self._told_s = self._planned_s = -math.inf
        self._plan_of: int | None = None
        """Number of the goal whose plan is on display."""

    def deliver(self, report: Report, now_s: float) -> None:
        """Publish what is due."""
        with self._lock:
            if self._closed:
                return
            if report.send:
                self._command(report.command.twist, now_s)
            self._tell(report, now_s)
            self._show_plan(report, now_s)

    def stand(self, now_s: float) -> None:
        """Tell the base to stand."""
        with self._lock:
            if not self._closed:
                self._command((0.0, 0.0), now_s)

    def close(self, now_s: float, *, stand: bool) -> None:
        """Publish nothing more, whatever thread is on its way; before that, with stand, tell the base to stand."""
        with self._lock:
            if stand and not self._closed:
                self._command((0.0, 0.0), now_s)
            self._closed = True

    def _command(self, speeds: Twist, now_s: float) -> None:
        """Tell the base."""
        message = twist(self._new, speeds)
        if self._config.commands_are_stamped:
            header = self._header(now_s, self._config.base_frame)
            message = self._new("geometry_msgs/msg/TwistStamped", header=header, twist=message)
        self._publish["cmd_vel"](message)

    def _tell(self, report: Report, now_s: float) -> None:
        reasons = set(report.command.reasons) - {"limited"}
        told = (report.command.status, reasons, report.outcome, report.refusal, report.goals)
        wall_s = self._wall_s()
        if told != self._told or not 0.0 <= wall_s - self._told_s < STATUS_S:
            self._told, self._told_s = told, wall_s
            status = status_message(self._new, report, self._robot, self._header(now_s, ""), self._policy)
            self._publish["adrl/status"](status)

    def _show_plan(self, report: Report, now_s: float) -> None:
        plan = report.command.plan
        number = report.goals if len(plan) else None
        if number is None and (report.goal is not None or self._plan_of is None):
            return  # held on the way, or nothing on display
        if number != self._plan_of or not 0.0 <= now_s - self._planned_s < PLAN_S:
            self._plan_of, self._planned_s = number, now_s
            self._publish["plan"](path(self._new, self._header(now_s, report.frame), plan))


class RosLogHandler(logging.Handler):
    """What ADRL logs, in the node's log."""

    def __init__(self, write: Mapping[int, Callable[[str], Any]]) -> None:
        """write: of logging's INFO, WARNING and ERROR."""
        super().__init__(logging.INFO)
        self._write = write

    def emit(self, record: logging.LogRecord) -> None:
        """Pass it on."""
        level = max((known for known in self._write if known <= record.levelno), default=logging.INFO)
        self._write[level](record.getMessage())


def log_to(write: Mapping[int, Callable[[str], Any]]) -> None:
    """Send what ADRL logs to a node's log."""
    log = logging.getLogger("adrl")
    log.setLevel(logging.INFO)
    log.addHandler(RosLogHandler(write))
    log.propagate = False
