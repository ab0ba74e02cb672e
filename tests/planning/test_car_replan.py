"""Routes of a car on its own map: curves that it can steer, and drives that arrive."""

import math
from itertools import pairwise

import numpy as np
import pytest

import adrl
from adrl import _core
from adrl.planning.replanner import THROUGH_WHAT_MAY_GO, Replanner
from adrl.planning.replanner_config import ReplannerConfig
from adrl.types import Array
from core.replan_twins import GUEST, LOW, WALL, log_odds
from planning.test_car_path import CAR, gears, headings

CELLS, RESOLUTION_M = 200, 0.05
MIDDLE = 0.5 * CELLS * RESOLUTION_M


def route(
    solid: Array,
    pose: tuple[float, float, float],
    goal: tuple[float, float],
    guests: Array | bool = False,
    found: int = 1,
) -> tuple[Array, Array]:
    """(P, 2) corners of the route, and (2,) the waypoint, on a map whose window begins at (0, 0).

    guests: which of the solid cells may go. found: what the replanner should say of the route.
    """
    replanner = Replanner(1, CAR, ReplannerConfig(cells=CELLS, resolution_m=RESOLUTION_M))
    cells = np.where(guests, GUEST, WALL)
    replanner.b["log_odds"][0] = np.where(solid, cells, log_odds(LOW, once_free=True))
    corners, count = np.zeros((1, _core.ROUTE_CORNERS, 2)), np.zeros(1, np.int32)
    mask = np.ones(1, np.uint8)
    replanner.native.plan_routes(mask, np.array([pose]), np.array([goal]), corners, count)
    assert replanner.b["found"][0] == found
    return corners[0, : count[0]], replanner.b["waypoint"][0]


def wall_beside() -> Array:
    """(CELLS, CELLS) a wall along x = MIDDLE + 1, open below."""
    solid = np.zeros((CELLS, CELLS), dtype=bool)
    column = int((MIDDLE + 1.0) / RESOLUTION_M)
    solid[40:, column : column + 3] = True
    return solid


@pytest.mark.parametrize("yaw", [0.0, 1.5, 3.0, -1.5])
def test_a_route_is_one_that_the_car_can_steer(yaw: float):
    start, goal = (MIDDLE, MIDDLE, yaw), (MIDDLE + 3.0, MIDDLE)
    corners, waypoint = route(wall_beside(), start, goal)
    assert corners[0] == pytest.approx(start[:2])
    chords, yaws = np.diff(corners, axis=0), headings(corners, start)
    lengths = np.hypot(*chords.T)
    most = 0.5 * (lengths[1:] + lengths[:-1]).clip(max=0.2) / CAR.min_turning_radius_m
    turns = np.abs([math.remainder(b - a, 2.0 * math.pi) for a, b in pairwise(yaws)])
    assert (turns <= 1.01 * most + 1e-6).all()
    # The waypoint is ahead of the car where the route begins forward, else behind it, and not beyond the first cusp.
    ahead = (waypoint - start[:2]) @ [math.cos(yaw), math.sin(yaw)]
    first = gears(corners, start)
    if abs(ahead) > 0.1:
        assert np.sign(ahead) == first[0]
    turned = np.flatnonzero(first != first[0])
    end = turned[0] if len(turned) else len(corners) - 1
    along = np.concatenate([[0.0], np.cumsum(lengths)])[end]
    assert math.dist(waypoint, start[:2]) <= min(along, 1.5) + 1e-6


@pytest.mark.parametrize("may_go", [True, False])
def test_a_car_that_is_shut_off_drives_to_the_goal_through_what_may_go_alone(may_go: bool) -> None:
    """A closed room with a wall across and a door in it, where somebody stands, or a wall."""
    solid = wall_beside()
    solid[:40] = solid[40:41]
    solid[[2, -3]] = solid[:, [2, -3]] = True
    door = np.zeros_like(solid)
    door[130:150] = solid[40:41]
    goal = (MIDDLE + 3.0, MIDDLE)
    found = THROUGH_WHAT_MAY_GO if may_go else 2
    corners, _ = route(solid, (MIDDLE, MIDDLE, 0.0), goal, door if may_go else False, found)
    assert (math.dist(corners[-1], goal) < 0.3) == may_go


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("planner", ["astar-dwa", "astar-mppi"])
def test_planners_drive_a_car_on_its_own_map(planner: str):
    assert (
        adrl.evaluate(planner, robot=CAR, scenario="clutter", guidance="replan", episodes=6).summary[
            "success"
        ]
        == 1.0
    )
