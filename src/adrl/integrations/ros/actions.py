"""Goals that come as actions of Nav2, one at a time: taken, replaced, cancelled, told of, ended. No middleware.

What an action is about is its Task: `follow_path.py`, `navigate.py`.
"""

import logging
from typing import Any, Literal, Protocol

from adrl.deploy.driver import Report
from adrl.integrations.ros.drive import DriveTopics

LOG = logging.getLogger("adrl.driver")

End = Literal["succeeded", "aborted", "canceled", "replaced"]
"""replaced: by another goal. What clients are told then, each generation of ROS has settled in its own way."""


class ActionFailed(Exception):
    """A goal of an action is aborted: the code is of the action's result."""

    def __init__(self, code: int, message: str) -> None:
        super().__init__(message)
        self.code = code


class Handle(Protocol):
    """A goal of an action server, of either generation of ROS."""

    @property
    def goal(self) -> Any:
        """The message."""
        ...

    @property
    def cancel_is_wanted(self) -> bool:
        """Whether who sent it wants it to end."""
        ...

    def tell(self, feedback: Any) -> None:
        """Publish feedback."""
        ...

    def end(self, how: End, result: Any, message: str) -> None:
        """It is over. message: why, for people."""
        ...


class Task(Protocol):
    """What one kind of action is about."""

    def begin(self, goal: Any, now_s: float, *, goes_on: bool) -> None:
        """Set the driver's goal. goes_on: in the place of another one on the way. Raises ActionFailed."""
        ...

    def check(self, report: Report, now_s: float) -> None:
        """A step has been driven. Raises ActionFailed where it is to end, for the goal's or the robot's sake."""
        ...

    def feedback(self, report: Report, now_s: float) -> Any:
        """The message."""
        ...

    def result(self, code: int, message: str) -> Any:
        """The message; code 0 for success."""
        ...


class Actions:
    """The goals of one action, which a driving node heeds."""

    def __init__(self, topics: DriveTopics, task: Task) -> None:
        self._topics, self._task = topics, task
        self._handle: Handle | None = None
        self._number = 0
        """The driver's, of the goal that is this action's."""
        topics.heed.append(self.heed)

    def accept(self, handle: Handle, now_s: float) -> None:
        """A goal. It takes the place of the one before: the robot drives on, to the new one."""
        goes_on = self._has_driver and self._handle is not None and not self._handle.cancel_is_wanted
        self._replace()
        self._handle = handle
        try:
            self._task.begin(handle.goal, now_s, goes_on=goes_on)
        except ActionFailed as failed:
            LOG.warning("goal aborted with error %d: %s", failed.code, failed)
            if goes_on:  # what it was to replace is no more; another's goal stays
                self._topics.driver.cancel()
            self._end("aborted", failed.code, str(failed))
            return
        self._number = self._topics.driver.taken

    def cancel(self) -> None:
        """The robot stands from the next step on, where it is on the way to this goal; heed() ends it."""
        if self._has_driver:
            self._topics.driver.cancel()

    def abort(self, message: str) -> None:
        """End the goal, if there is one. The driver is left as it is."""
        if self._handle is not None:
            self._end("aborted", 0, message)

    def heed(self, report: Report, now_s: float) -> None:
        """After each step."""
        if self._handle is None:
            return
        if self._handle.cancel_is_wanted:
            self._end("canceled", 0, "cancelled")
        elif not self._has_driver:
            self._replace()
        elif report.outcome == "reached":
            self._end("succeeded", 0, "")
        elif report.outcome == "cancelled":
            self.abort("cancelled by the node's own topic")
        else:
            try:
                self._task.check(report, now_s)
                self._handle.tell(self._task.feedback(report, now_s))
            except ActionFailed as failed:
                self._topics.driver.fail(f"error {failed.code}: {failed}")
                self._end("aborted", failed.code, str(failed))

    @property
    def _has_driver(self) -> bool:
        """Whether the driver's newest goal is this action's: else one by a topic has come since."""
        return self._topics.driver.taken == self._number

    def _replace(self) -> None:
        if self._handle is not None:
            self._end("replaced", 0, "another goal has taken its place")

    def _end(self, how: End, code: int, message: str) -> None:
        handle, self._handle = self._handle, None
        assert handle is not None
        handle.end(how, self._task.result(code, message), message)
