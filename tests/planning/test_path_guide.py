"""Paths on a known map outside of the simulator: those of plan(), and the part of them that is left."""

from pathlib import Path

import numpy as np
import pytest

from adrl.errors import NoPath
from adrl.planning.global_planner import length_m, plan
from adrl.planning.path_guide import MapGuide
from adrl.types import World
from adrl.worlds import ROBOTS, load_map, task_set
from adrl.worlds.map_scenario import MapScenario


@pytest.mark.parametrize("name", ["diffbot", "jackal"])
def test_paths_are_those_of_the_planner(maps: Path, name: str):
    """Though the map's clearances are computed once only."""
    path = maps / "depot" / "depot.yaml"
    robot, world = ROBOTS[name], load_map(path)
    guide = MapGuide(world, robot)
    for task in task_set(MapScenario(path), robot, "validation", 3):
        guide.set_goal(task.start, task.goal)
        np.testing.assert_array_equal(guide.path, plan(world, task.start, task.goal, robot))


def test_what_is_left_of_a_path_shrinks_as_it_is_driven():
    corner = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 4.0]])
    guide = MapGuide(World(bounds=(-1.0, -1.0, 5.0, 5.0)), ROBOTS["diffbot"])
    guide.follow(corner)
    for at, left_m, corners in (((0.0, 0.0), 7.0, 2), ((2.0, 0.0), 5.0, 2), ((3.0, 1.0), 3.0, 1)):
        waypoint, left = guide.waypoint((*at, 0.0))
        assert left == pytest.approx(left_m)
        remaining = guide.remaining(left)
        assert len(remaining) == corners
        assert length_m(np.concatenate([[at], remaining])) == pytest.approx(left_m)
        assert 0.2 < np.hypot(*np.subtract(waypoint, at)) <= 1.5 + 1e-9


def test_no_way_is_an_error():
    wall = World(bounds=(-3.0, -3.0, 3.0, 3.0), segments=np.array([[0.0, -9.0, 0.0, 9.0]]))
    with pytest.raises(NoPath):
        MapGuide(wall, ROBOTS["diffbot"]).set_goal((-2.0, 0.0, 0.0), (2.0, 0.0))
