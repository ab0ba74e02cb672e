"""What the core refuses: geometry that would lead its kernels out of their arrays or into endless loops."""

import math
from typing import Any

import numpy as np
import pytest

from adrl import _core
from adrl.errors import ConfigError
from adrl.types import World
from core.fleet import EMPTY

NONE = {width: np.empty((0, width)) for width in (2, 3, 4, 8)}
TRIANGLE = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
BAD = (math.nan, math.inf, -math.inf)


def a_world(**changes: Any) -> _core.World:
    good: dict[str, Any] = dict(
        circles=np.array([[0.0, 0.0, 1.0]]),
        polygon_corners=TRIANGLE,
        polygon_offsets=np.array([0, 3], dtype=np.int32),
        segments=np.array([[0.0, 0.0, 1.0, 1.0]]),
        discs=np.array([[0.0, 0.0, 1.0, 1.0, 0.3, 0.5, 0.0, math.inf]]),
        solid=np.zeros((2, 2), dtype=np.uint8),
        resolution_m=0.05,
        origin=(0.0, 0.0, 0.0),
    )
    return _core.World(**(good | changes))


def a_robot(**changes: Any) -> _core.Robot:
    good: dict[str, Any] = dict(
        radius_m=0.2,
        footprint=NONE[2],
        speed_limits=(1.0, 0.0, 1.0),
        num_beams=8,
        angle_min_rad=0.0,
        angle_increment_rad=0.1,
        mount=(0.0, 0.0, 0.0),
        max_range_m=6.0,
        dt_s=0.1,
    )
    return _core.Robot(**(good | changes))


def a_task(**changes: Any) -> _core.Task:
    good: dict[str, Any] = dict(
        world=EMPTY.native,
        start=(0.0, 0.0, 0.0),
        goal=(1.0, 0.0),
        goal_tolerance_m=0.3,
        path=np.zeros((1, 2)),
    )
    return _core.Task(**(good | changes))


@pytest.mark.parametrize(
    "offsets", [[0, 4], [0, 2, 3], [-1, 3], [0, 3, 2], [0, 2], [1, 3], [0, 0, 3], [3], []]
)
def test_offsets_out_of_step_with_the_corners(offsets: list[int]):
    with pytest.raises(ValueError, match="polygon_offsets"):
        a_world(polygon_offsets=np.array(offsets, dtype=np.int32))


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("name", ["circles", "polygon_corners", "segments", "discs"])
def test_worlds_of_numbers_that_are_not_finite(name: str, bad: float):
    array = np.full((3, {"circles": 3, "polygon_corners": 2, "segments": 4, "discs": 8}[name]), 0.5)
    array[1, 1] = bad
    with pytest.raises(ValueError, match=name):
        a_world(**{name: array})
    if name != "polygon_corners":
        with pytest.raises(ConfigError, match=name):
            World(bounds=(0.0, 0.0, 1.0, 1.0), **{name: array})  # pyright: ignore[reportArgumentType]


def test_a_disc_may_never_stop_but_not_at_no_number():
    discs = np.array([[0.0, 0.0, 1.0, 1.0, 0.3, 0.5, 0.0, math.inf]])
    World(bounds=(0.0, 0.0, 1.0, 1.0), discs=discs)
    discs[0, 7] = math.nan
    with pytest.raises(ConfigError, match="discs"):
        World(bounds=(0.0, 0.0, 1.0, 1.0), discs=discs)
    with pytest.raises(ValueError, match="discs"):
        a_world(discs=discs)


@pytest.mark.parametrize("resolution_m", [0.0, -0.05, math.nan])
def test_cells_without_a_side(resolution_m: float):
    with pytest.raises(ValueError, match="resolution_m"):
        a_world(resolution_m=resolution_m)


@pytest.mark.parametrize("bad", BAD)
def test_places_that_are_not_finite(bad: float):
    pose = np.array([[0.0, 0.0, 0.0], [0.0, bad, 0.0]])
    with pytest.raises(ValueError, match="poses"):
        _core.raycast(EMPTY.native, pose, np.zeros(1), 6.0)
    with pytest.raises(ValueError, match="angles_rad"):
        _core.raycast(EMPTY.native, pose[:1], np.array([bad]), 6.0)
    with pytest.raises(ValueError, match="poses"):
        _core.clearance(EMPTY.native, pose, 0.2, NONE[2], 1.0)
    with pytest.raises(ValueError, match="origin"):
        a_world(origin=(0.0, 0.0, bad))
    with pytest.raises(ValueError, match="start"):
        a_task(start=(0.0, bad, 0.0))
    with pytest.raises(ValueError, match="goal"):
        a_task(goal=(bad, 0.0))
    with pytest.raises(ValueError, match="path"):
        a_task(path=np.array([[0.0, bad]]))


def test_a_task_without_a_path():
    with pytest.raises(ValueError, match="path"):
        a_task(path=NONE[2])
    with pytest.raises(TypeError):
        a_task(world=None)


@pytest.mark.parametrize("beams", [0, -1, 2049])
def test_scans_of_too_few_or_too_many_beams(beams: int):
    with pytest.raises(ValueError, match="beams"):
        a_robot(num_beams=beams)
    a_robot(num_beams=2048)


@pytest.mark.parametrize("bad", BAD)
def test_robots_of_numbers_that_are_not_finite(bad: float):
    for changes in (
        dict(speed_limits=(bad, 0.0, 1.0)),
        dict(angle_min_rad=bad),
        dict(angle_increment_rad=bad),
        dict(mount=(0.0, 0.0, bad)),
        dict(max_range_m=math.nan),
        dict(dt_s=math.nan),
        dict(dt_s=0.0),
        dict(footprint=np.array([[0.0, 0.0], [1.0, bad], [0.0, 1.0]])),
        dict(radius_m=bad),
    ):
        with pytest.raises(ValueError):  # noqa: PT011
            a_robot(**changes)


def test_footprints_of_too_many_corners():
    with pytest.raises(ValueError, match="16"):
        a_robot(footprint=np.zeros((17, 2)))
