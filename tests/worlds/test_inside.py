"""Tasks in Gazebo worlds lie inside what stands there, and a floor is no obstacle."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl.types import Array, RobotConfig, Task, World
from adrl.worlds import ROBOTS, SdfScenario, task_set
from adrl.worlds.fixed import FixedWorld
from adrl.worlds.sdf_write import save_sdf
from adrl.worlds.shapes import box
from adrl.worlds.shapes import place as moved

DIFFBOT = ROBOTS["diffbot"]


def room(x: float, y: float, side: float, doorway: float = 0.0) -> tuple[Array, ...]:
    """Four walls of 0.2 m about (x, y); the eastern one with a doorway in its middle."""
    half, wall = 0.5 * side, 0.5 * (side - doorway)
    east = [
        box(x + half, y + sign * 0.5 * (doorway + wall), 0.2, wall, 0.0)
        for sign in ((1, -1) if doorway else ())
    ] or [box(x + half, y, 0.2, side, 0.0)]
    return (
        box(x, y + half, side + 0.2, 0.2, 0.0),
        box(x, y - half, side + 0.2, 0.2, 0.0),
        box(x - half, y, 0.2, side + 0.2, 0.0),
        *east,
    )


def scenario(
    folder: Path, *polygons: Array, circles: list[tuple[float, float, float]] | None = None
) -> SdfScenario:
    world = World(
        bounds=(0.0, 0.0, 1.0, 1.0), polygons=polygons, circles=np.array(circles or []).reshape(-1, 3)
    )
    path = folder / "place.sdf"
    save_sdf(path, world)
    return SdfScenario(path)


def ends(tasks: list[Task]) -> Array:
    """(2 N, 2) all starts and goals."""
    return np.array([point for task in tasks for point in (task.start[:2], task.goal)])


def test_tasks_of_a_closed_room_lie_in_it(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    place = scenario(tmp_path, *room(0.0, 0.0, 8.0), circles=[(0.0, 0.0, 0.5)])
    for split in ("train", "validation", "test"):
        assert (np.abs(ends(task_set(place, DIFFBOT, split, 50))) < 4.0).all()
    assert caplog.messages == []  # there was no choice


@pytest.mark.parametrize("doorway", [0.8, 2.0])
def test_a_doorway_does_not_let_tasks_out(
    tmp_path: Path, doorway: float, caplog: pytest.LogCaptureFixture
) -> None:
    place = scenario(tmp_path, *room(0.0, 0.0, 8.0, doorway))
    assert (np.abs(ends(task_set(place, DIFFBOT, "test", 50))) < 4.2).all()
    assert caplog.messages == []


@given(
    side=st.floats(4.0, 9.0),
    yaw=st.floats(-math.pi, math.pi),
    x=st.floats(-50.0, 50.0),
    y=st.floats(-50.0, 50.0),
)
def test_a_room_that_is_moved_and_turned_keeps_its_tasks_inside(
    side: float, yaw: float, x: float, y: float
) -> None:
    walls = tuple(moved(wall, x, y, yaw) for wall in room(0.0, 0.0, side))
    corners = np.concatenate(walls)
    bounds = (*(corners.min(axis=0) - 1.0), *(corners.max(axis=0) + 1.0))
    world = FixedWorld("room", World(bounds=bounds, polygons=walls), open_bounds=True)  # pyright: ignore
    c, s = math.cos(yaw), math.sin(yaw)
    inside = (ends(task_set(world, DIFFBOT, "test", 5)) - (x, y)) @ np.array([(c, -s), (s, c)])
    assert (np.abs(inside) < 0.5 * side).all()


def test_the_largest_of_several_rooms_is_taken_and_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    place = scenario(tmp_path, *room(0.0, 0.0, 6.0), *room(20.0, 3.0, 8.0), *room(0.0, 10.0, 3.0))
    points = ends(task_set(place, DIFFBOT, "test", 50)) - (20.0, 3.0)
    assert (np.abs(points) < 4.0).all()
    (line,) = caplog.messages
    assert "sdf:place, robot 'diffbot': tasks lie in the largest enclosed region" in line
    assert "about (20.0, 3.0); left out: smaller enclosed ones (2), open ground (" in line


def test_a_shed_in_a_wide_field_is_not_where_one_drives(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    posts = [(x, y, 0.3) for x in (-15.0, 15.0) for y in (-15.0, 15.0)]
    place = scenario(tmp_path, *room(0.0, 0.0, 3.0), circles=posts)
    points = ends(task_set(place, DIFFBOT, "test", 50))
    assert (np.abs(points) < 15.4).all()
    assert (np.abs(points).max(axis=1) > 1.5).all()
    (line,) = caplog.messages
    assert "of open ground: the largest of 1 enclosed regions has" in line


def test_around_a_lone_pillar_is_all_that_there_is(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    place = scenario(tmp_path, circles=[(0.0, 0.0, 0.5)])
    assert len(task_set(place, DIFFBOT, "test", 5)) == 5
    assert "tasks lie around what stands there" in caplog.messages[0]


def test_a_doorway_too_narrow_for_a_robot_closes_a_room(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rooms = (*room(0.0, 0.0, 8.0, 0.8), box(20.0, 0.0, 0.2, 8.0, 0.0))
    wide = RobotConfig(name="wide", radius_m=0.5)
    assert (np.abs(ends(task_set(scenario(tmp_path, *rooms), wide, "test", 20))) < 4.0).all()
    assert "'wide': tasks lie in the largest enclosed region" in caplog.messages[0]
    slim = ends(task_set(scenario(tmp_path, *rooms), DIFFBOT, "test", 50))
    assert slim[:, 0].max() > 5.0  # it may be sent from the room to the wall
