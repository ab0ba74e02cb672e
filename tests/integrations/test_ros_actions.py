"""Goals of an action and of topics, whatever order and instant they come in: each one result, the last one driven."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adrl.deploy.driver import Report
from adrl.errors import GoalRefused
from adrl.integrations.ros.actions import ActionFailed, Actions, End
from adrl.integrations.ros.drive import DriveTopics
from integrations.test_ros_topics import Node, new

EMPTY = new("std_msgs/msg/Empty", structure_needs_at_least_one_member=0)
REFUSED, HOPELESS = "world", 7
"""A frame that is not known, and the code of a goal that is given up."""
FAR_M, HERE_M = 3.0, 0.1
"""A goal ahead, and one that is reached at once."""


class Straight:
    """A task: so far ahead, in a frame."""

    def __init__(self, topics: DriveTopics) -> None:
        self._driver = topics.driver
        self.hopeless = False
        self.goes_on: list[bool] = []

    def begin(self, goal: Any, now_s: float, *, goes_on: bool) -> None:
        self.goes_on.append(goes_on)
        try:
            self._driver.set_goal((goal[0], 0.0), goal[1])
        except GoalRefused as refusal:
            raise ActionFailed(1, str(refusal)) from None

    def check(self, report: Report, now_s: float) -> None:
        if self.hopeless:
            raise ActionFailed(HOPELESS, "held")

    def feedback(self, report: Report, now_s: float) -> Any:
        return report.command.distance_m

    def result(self, code: int, message: str) -> Any:
        return code, message


class Goal:
    """A goal as an action server keeps it."""

    def __init__(self, ahead_m: float, frame: str) -> None:
        self.goal = (ahead_m, frame)
        self.cancel_is_wanted = False
        self.ends: list[tuple[End, int]] = []

    def tell(self, feedback: Any) -> None:
        assert not self.ends

    def end(self, how: End, result: Any, message: str) -> None:
        self.ends.append(("canceled" if self.cancel_is_wanted else how, result[0]))


class Client:
    """Goals by an action and by topics, and which of them the robot should be on the way to."""

    def __init__(self, node: Node) -> None:
        node.topics.driver.cancel()
        node.topics.heed.clear()
        node.run(1).statuses()
        self.node, self.task = node, Straight(node.topics)
        self.actions = Actions(node.topics, self.task)
        self.sent: list[Goal] = []
        self.wanted: Goal | tuple[float, str] | None = None
        """The action's goal, one by the topic, or none."""

    def send(self, ahead_m: float, frame: str = "odom") -> Goal:
        goal, before = Goal(ahead_m, frame), self.wanted
        self.sent.append(goal)
        self.actions.accept(goal, self.node.now_s)
        if frame != REFUSED:
            self.wanted = goal
        elif isinstance(before, Goal):
            self.wanted = None
        return goal

    def cancel(self) -> None:
        """As servers do: asks the node, and then the goal is one that is being cancelled."""
        for goal in self.sent[-1:]:
            if not goal.ends:
                self.actions.cancel()
                goal.cancel_is_wanted = True
                self.wanted = None if self.wanted is goal else self.wanted

    def say(self, ahead_m: float, frame: str = "odom") -> None:
        self.node.goal(ahead_m, frame)
        self.wanted = self.wanted if frame == REFUSED else (ahead_m, frame)

    def say_cancel(self) -> None:
        self.node.hear("adrl/cancel", EMPTY)
        self.wanted = None

    def step(self) -> None:
        self.node.run(1)
        wanted = self.wanted.goal if isinstance(self.wanted, Goal) else self.wanted
        if wanted == (HERE_M, "odom"):
            if isinstance(self.wanted, Goal):
                assert self.wanted.ends == [("succeeded", 0)]
            self.wanted = wanted = None
        going = self.node.topics.driver.stand("command_late", self.node.now_s).goal
        assert going == (None if wanted is None else (wanted[0], 0.0))
        for goal in self.sent:
            assert len(goal.ends) == int(goal is not self.wanted), "one result, once it is over"


@pytest.fixture(scope="module")
def node() -> Node:
    return Node().run(2)


MOVES = st.lists(
    st.one_of(
        st.tuples(
            st.sampled_from(["send", "say"]),
            st.sampled_from([(FAR_M,), (FAR_M + 1.0,), (HERE_M,), (FAR_M, REFUSED)]),
        ),
        st.tuples(st.sampled_from(["cancel", "say_cancel", "step", "step"]), st.just(())),
    ),
    max_size=12,
)


@settings(deadline=None, max_examples=150)
@given(moves=MOVES)
def test_each_goal_has_one_result_and_the_last_one_is_driven_to(node: Node, moves: list[Any]) -> None:
    """Steps lie between some of what comes, and not between others: those are of the same instant."""
    client = Client(node)
    for move, arguments in [*moves, ("step", ())]:
        getattr(client, move)(*arguments)


def test_a_goal_after_one_that_was_cancelled_in_the_same_instant_does_not_go_on_with_it(node: Node) -> None:
    client = Client(node)
    for _ in range(2):
        client.send(FAR_M)
    client.cancel()
    client.send(FAR_M)
    assert client.task.goes_on == [False, True, False]
    assert [goal.ends for goal in client.sent] == [[("replaced", 0)], [("canceled", 0)], []]


def test_a_goal_that_is_given_up_is_failed_with_its_reason_and_the_next_is_driven_to(node: Node) -> None:
    client = Client(node)
    goal = client.send(FAR_M)
    client.task.hopeless = True
    node.run(2)
    assert goal.ends == [("aborted", HOPELESS)]
    level, values = node.statuses()[-1]
    assert (level, values["outcome"]) == (2, "failed")
    client.task.hopeless = False
    after = client.send(FAR_M)
    node.run(2)
    assert after.ends == []
    assert node.statuses()[-1][1]["status"] == "driving"
