"""An action server of actionlib, whose goals a driving node heeds between its other messages."""

from collections import deque
from collections.abc import Callable
from typing import Any

from adrl.integrations.ros.actions import Actions, End
from adrl.integrations.ros.messages import message_class
from adrl.integrations.ros1 import node as ros


class GoalHandle:
    """See actions.Handle."""

    def __init__(self, theirs: Any) -> None:
        self._theirs = theirs

    @property
    def goal(self) -> Any:
        """See Handle."""
        return self._theirs.get_goal()

    @property
    def cancel_is_wanted(self) -> bool:
        """See Handle."""
        status = self._theirs.get_goal_status()
        return status.status in (status.PREEMPTING, status.RECALLING)

    def tell(self, feedback: Any) -> None:
        """See Handle."""
        self._theirs.publish_feedback(feedback)

    def end(self, how: End, result: Any, message: str) -> None:
        """See Handle. A goal that another one replaces is PREEMPTED, as move_base's is."""
        if self.cancel_is_wanted or how == "replaced":
            self._theirs.set_canceled(result, message)
        elif how == "succeeded":
            self._theirs.set_succeeded(result, message)
        else:
            self._theirs.set_aborted(result, message)


class Server:
    """The server of an action. What clients want waits for heed(): actionlib calls with its own lock held."""

    def __init__(self, kind: str, name: str, actions: Actions, now_s: Callable[[], float]) -> None:
        """kind: such as "move_base_msgs/msg/MoveBaseAction". Raises MissingExtra."""
        ros.require("actionlib", kind.split("/")[0])
        import actionlib  # pyright: ignore[reportMissingImports]

        self._actions, self._now_s = actions, now_s
        self._came: deque[Any] = deque()
        """Goals, and None for each that is to be cancelled."""
        self._newest: GoalHandle | None = None
        self._server = actionlib.ActionServer(
            name,
            message_class(kind),
            self._came.append,
            lambda _: self._came.append(None),
            auto_start=False,
        )
        self._server.start()

    def heed(self) -> None:
        """Take what has come, in its order."""
        while self._came:
            theirs = self._came.popleft()
            if theirs is not None:
                theirs.set_accepted()
                self._newest = GoalHandle(theirs)
                self._actions.accept(self._newest, self._now_s())
            # The newest alone is on the way, whichever goal was cancelled.
            if self._newest is not None and self._newest.cancel_is_wanted:
                self._actions.cancel()
