"""How a run on several cores is shared out: pytest -n 2 --dist worksteal, which is make test.

conftest.py imports the functions, which pytest calls.
"""

from typing import Any

import pytest
from xdist.scheduler.worksteal import MIN_PENDING, WorkStealingScheduling

NAMES = "adrl/realtime"
"""Where in pytest's cache the workers, which see the markers, leave the names for the scheduler, which does not."""


class RealtimeLast(WorkStealingScheduling):
    """Each worker has a stretch of the tests, and takes from another's when its own are done.

    The tests marked realtime need a quiet machine: when all others have ended, one worker runs them.
    """

    def __init__(self, config: pytest.Config, log: Any = None) -> None:
        super().__init__(config, log)
        self.waiting: list[int] = []

    @property
    def tests_finished(self) -> bool:
        return not self.waiting and super().tests_finished

    def check_schedule(self) -> None:
        self.hold_back()
        working = [node for node in self.nodes if not node.shutting_down]
        idle = [node for node in working if len(self.node2pending[node]) < MIN_PENDING]
        for i, node in enumerate(idle):
            self._send_tests(node, len(self.pending) // (len(idle) - i))
        # A worker keeps its last test back until it knows whether there is another.
        busy = any(len(self.node2pending[node]) >= MIN_PENDING for node in working)
        if not self.waiting or not working or busy or self.steal_requested_from_node:
            super().check_schedule()
            return
        last, *others = working
        for node in others:
            node.shutdown()
        if all(node is last or not tests for node, tests in self.node2pending.items()):
            self.pending, self.waiting = self.waiting, []
            self._send_tests(last, len(self.pending))

    def hold_back(self) -> None:
        """Of the tests that no worker has, those that have to wait."""
        if self.pending:
            assert self.collection is not None
            realtime = set(self.config.cache.get(NAMES, []))
            self.waiting += [test for test in self.pending if self.collection[test] in realtime]
            self.pending = [test for test in self.pending if self.collection[test] not in realtime]


def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> RealtimeLast | None:
    return RealtimeLast(config, log) if config.getoption("dist") == "worksteal" else None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_finish(session: pytest.Session) -> None:
    """In each worker, before it tells the scheduler that it has collected."""
    if hasattr(session.config, "workerinput"):
        names = [item.nodeid for item in session.items if item.get_closest_marker("realtime")]
        session.config.cache.set(NAMES, names)
