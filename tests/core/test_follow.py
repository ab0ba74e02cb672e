"""BatchSim.follow: a robot moved by something else is judged and guided as one that the simulator moved."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from adrl import _core
from core.fleet import WALLED, Fleet, a_robot, a_task


@pytest.mark.parametrize("lookahead_m", [0.0, 1.5])
def test_it_tells_of_a_pose_what_step_tells(lookahead_m: float) -> None:
    config = _core.SimConfig()
    config.lookahead_m = lookahead_m
    rng = np.random.default_rng(1)
    starts = [(float(x), float(y), float(yaw)) for x, y, yaw in rng.uniform(-1.0, 0.5, (12, 3))]
    tasks = [a_task(WALLED, start=start, goal=(start[0] + 1.0, start[1])) for start in starts]
    driven, moved = (Fleet(tasks, a_robot(), config=config).reset() for _ in range(2))
    for step in range(12):
        before = driven.b["pose"].copy()
        driven.step(rng.uniform(-0.5, 1.5, (12, 2)))
        for name in ("pose", "time", "collided"):
            moved.b[name][:] = driven.b[name]
        moved.sim.follow(before)
        for name in ("reached", "waypoint", "route_left"):
            assert_array_equal(moved.b[name], driven.b[name], err_msg=f"{name}, step {step}")
        free = driven.b["collided"] == 0
        np.testing.assert_allclose(moved.b["clearance"][free], driven.b["clearance"][free], atol=1e-9)
        for fleet in (driven, moved):
            fleet.b["active"][:] = free & (driven.b["reached"] == 0)
    assert driven.b["reached"].any()


@pytest.mark.parametrize("latency_s", [0.0, 0.04, 0.13, 0.5])
def test_planners_know_of_the_commands_that_are_on_their_way(latency_s: float) -> None:
    robot = a_robot()
    tasks = [a_task(WALLED, start=(-3.0, y, 0.3), goal=(3.0, y)) for y in (-3.0, -0.5, 3.0)]
    driven, moved = (Fleet(tasks, robot, latency_s=latency_s).reset() for _ in range(2))
    for _ in range(12):
        before, plan = driven.b["pose"].copy(), driven.plan()
        assert_array_equal(moved.plan(), plan)
        driven.step(plan)
        moved.b["command"][:] = plan
        for name in ("pose", "twist", "time"):
            moved.b[name][:] = driven.b[name]
        moved.sim.follow(before)


def test_robots_that_are_not_active_are_left_alone() -> None:
    fleet = Fleet([a_task(WALLED)] * 2, a_robot()).reset()
    fleet.b["active"][:] = (1, 0)
    before = fleet.snapshot()
    fleet.b["pose"][:, 0] = 0.5
    fleet.sim.follow(before["pose"])
    assert fleet.b["clearance"][1] == before["clearance"][1] != fleet.b["clearance"][0]


def test_a_bad_shape_is_refused() -> None:
    fleet = Fleet([a_task(WALLED)] * 2, a_robot()).reset()
    with pytest.raises((ValueError, TypeError)):
        fleet.sim.follow(np.zeros((3, 3)))
