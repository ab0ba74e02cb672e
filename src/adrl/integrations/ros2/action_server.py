"""An action server of rclpy, whose goals a driving node heeds between its other messages."""

from collections.abc import Callable
from typing import Any

from rclpy.action import (  # pyright: ignore[reportMissingImports]
    ActionServer,
    CancelResponse,
    GoalResponse,
)
from rclpy.task import Future  # pyright: ignore[reportMissingImports]

from adrl.integrations.ros.actions import Actions, End
from adrl.integrations.ros.messages import message_class


class GoalHandle:
    """See actions.Handle."""

    def __init__(self, theirs: Any, result: Any) -> None:
        """result: future of the action's result, which rclpy's task for this goal waits for."""
        self._theirs, self._result = theirs, result

    @property
    def goal(self) -> Any:
        """See Handle."""
        return self._theirs.request

    @property
    def cancel_is_wanted(self) -> bool:
        """See Handle."""
        return self._theirs.is_cancel_requested

    def tell(self, feedback: Any) -> None:
        """See Handle."""
        self._theirs.publish_feedback(feedback)

    def end(self, how: End, result: Any, message: str) -> None:
        """See Handle. Nav2 aborts what is replaced; a goal that is being cancelled cannot be aborted any more."""
        if self._theirs.is_cancel_requested:
            self._theirs.canceled()
        elif how == "succeeded":
            self._theirs.succeed()
        else:
            self._theirs.abort()
        self._result.set_result(result)


def serve(
    node: Any, kind: str, name: str, actions: Actions, now_s: Callable[[], float], takes: Callable[[], bool]
) -> Any:
    """The server of an action. takes: whether goals are taken at all."""

    def accepted(theirs: Any) -> None:
        theirs.result_is_known = Future(executor=node.executor)
        theirs.execute()
        actions.accept(GoalHandle(theirs, theirs.result_is_known), now_s())

    async def execute(theirs: Any) -> Any:
        return await theirs.result_is_known

    def cancel(_: Any) -> Any:
        actions.cancel()
        return CancelResponse.ACCEPT

    return ActionServer(
        node,
        message_class(kind),
        name,
        execute,
        goal_callback=lambda _: GoalResponse.ACCEPT if takes() else GoalResponse.REJECT,
        handle_accepted_callback=accepted,
        cancel_callback=cancel,
    )
