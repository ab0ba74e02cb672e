"""Collisions on the way: a robot stops at the geometry that its LiDAR sees, at any speed, from any side."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from adrl import _core
from adrl.types import Array, LidarConfig, OccupancyGrid, RobotConfig, World
from core import twins
from core.arenas import BOUNDS, box, moved, poses, random_world, worlds
from core.fleet import Fleet, a_robot, a_task
from core.twins import Pose

CONTACT_M = 1e-3
"""Contacts are found to within this."""
FAST_MPS = 3.0
NOWHERE = World(bounds=BOUNDS)


def launched(world: World, pose: Pose, robot: RobotConfig, v: float, w: float = 0.0) -> Fleet:
    """A robot already under way at its speed."""
    fleet = Fleet([a_task(world, start=pose)], robot).reset()
    fleet.b["twist"][:] = fleet.b["command"][:] = (v, w)
    return fleet


def footprint_clearance(world: World, pose: Array, robot: RobotConfig, time_s: float = 0.0) -> float:
    return float(
        _core.clearance(world.native, pose[None].copy(), robot.radius_m or 0.0, robot.polygon, 1.0, time_s)[0]
    )


def shrunk(robot: RobotConfig, by_m: float) -> RobotConfig:
    """The same robot with a footprint smaller by at least by_m all around."""
    if robot.radius_m is not None:
        return replace(robot, radius_m=robot.radius_m - by_m)
    middle = robot.polygon.mean(axis=0)
    scale = 1.0 - by_m / 0.2
    return replace(
        robot, footprint_m=tuple((float(x), float(y)) for x, y in middle + scale * (robot.polygon - middle))
    )


# Obstacles across the way of a robot that starts at the origin and faces +x, and how far their front is.
THIN_CELLS = OccupancyGrid(solid=np.ones((40, 1), dtype=np.uint8), resolution_m=0.05, origin=(2.0, -1.0, 0.0))
THIN = {
    "segment": (replace(NOWHERE, segments=np.array([[2.0, -1.0, 2.0, 1.0]])), 2.0),
    "slanted segment": (
        replace(NOWHERE, segments=np.array([[2.0, 0.0, 3.0, 2.0], [2.0, 0.0, 3.0, -2.0]])),
        2.0,
    ),
    "row of cells": (replace(NOWHERE, grid=THIN_CELLS), 2.0),
    "circle": (replace(NOWHERE, circles=np.array([[2.002, 0.0, 0.002]])), 2.0),
    "disc": (replace(NOWHERE, discs=np.array([[2.002, 0, 9, 0, 0.002, 0.0, 0.0, 0.0]])), 2.0),
    "box": (replace(NOWHERE, polygons=(box(2.0005, 0.0, 0.0005, 1.0),)), 2.0),
}
FLAT_ENOUGH = {"disc": 0.2, "polygon": 0.3}


@pytest.mark.parametrize("thing", THIN)
@pytest.mark.parametrize("shape", FLAT_ENOUGH)
@pytest.mark.parametrize("backwards", [False, True])
@given(by=poses, period_s=st.sampled_from([0.02, 0.1, 0.5]), farther_m=st.floats(0.0, 0.5))
@settings(max_examples=15)
def test_nothing_is_too_thin_to_stop_a_robot(
    thing: str, shape: str, backwards: bool, by: Pose, period_s: float, farther_m
):
    world, front_m = THIN[thing]
    robot = a_robot(polygon=shape == "polygon", control_period_s=period_s)
    start = twins.placed(by, (-farther_m, 0.0))
    heading = by[2] + (math.pi if backwards else 0.0)
    fleet = launched(moved(world, by), (*start, heading), robot, -FAST_MPS if backwards else FAST_MPS)
    gap_m = front_m + farther_m - FLAT_ENOUGH[shape]
    for _ in range(math.ceil(gap_m / (FAST_MPS * period_s)) + 1):
        assert not fleet.b["collided"][0]
        assert fleet.b["travelled"][0] <= gap_m + CONTACT_M
        fleet.step()
        if fleet.b["collided"][0]:
            break
    b = fleet.b
    assert b["collided"][0] == 1
    assert b["reached"][0] == 0
    assert gap_m - 1e-9 <= b["travelled"][0] <= gap_m + CONTACT_M + 1e-9
    assert_allclose(math.dist(b["pose"][0, :2], start), b["travelled"][0], atol=1e-9)
    assert -CONTACT_M - 1e-9 <= b["clearance"][0] <= 0.0
    assert b["least_clearance"][0] <= 0.0
    assert_allclose(b["time"][0], b["travelled"][0] / FAST_MPS, atol=1e-9)
    assert np.all(b["twist"] == 0.0)


def test_a_robot_in_contact_stays_where_it_is():
    world = replace(NOWHERE, segments=np.array([[2.0, -1.0, 2.0, 1.0]]))
    fleet = launched(world, (1.9, 0.0, 0.0), a_robot(), FAST_MPS)
    assert fleet.b["collided"][0] == 1
    fleet.step()
    assert_allclose(fleet.b["pose"][0], [1.9, 0.0, 0.0])
    assert fleet.b["collided"][0] == 1


@pytest.mark.parametrize("w", [3.0, -3.0])
def test_a_corner_that_sweeps_round_hits_what_a_disc_would_turn_past(w: float):
    """0.34 m from the centre: outside the rectangle's sides, inside the circle of its corners (0.36 m)."""
    world = replace(NOWHERE, segments=np.array([[0.0, 0.33, 0.0, 0.34]]))
    turning = launched(world, (0.0, 0.0, 0.0), a_robot(polygon=True), 0.0, w)
    for _ in range(20):
        turning.step()
    assert turning.b["collided"][0] == 1
    # The side, 0.2 m off, meets the inner end, 0.33 m off, at this heading.
    first_touch = 0.5 * math.pi - math.asin(0.2 / 0.33)
    assert_allclose(turning.b["pose"][0, 2], math.copysign(first_touch, w), atol=CONTACT_M / 0.26)
    disc = launched(world, (0.0, 0.0, 0.0), a_robot(radius_m=0.32), 0.0, w)
    for _ in range(20):
        disc.step()
    assert disc.b["collided"][0] == 0
    assert_allclose(disc.b["time"], 2.0)


@settings(max_examples=100)
@given(worlds(), poses, st.booleans(), st.floats(-FAST_MPS, FAST_MPS), st.integers(-300, 300))
def test_no_arc_passes_through_anything(world: World, pose: Pose, polygon: bool, v: float, turn: int):
    """Until the robot stops, a footprint 1.5 mm smaller is free; in contact, the true one is not."""
    w = 0.01 * turn
    robot = a_robot(polygon=polygon, control_period_s=0.5)
    fleet = launched(world, pose, robot, v, w)
    assume(fleet.b["clearance"][0] > 0.0)
    fleet.step()
    end_s = float(fleet.b["time"][0])
    smaller = shrunk(robot, 1.5 * CONTACT_M)
    for time_s in np.linspace(0.0, end_s, 60):
        there = np.array(twins.integrate(pose, v, w, time_s))
        assert footprint_clearance(world, there, smaller, time_s) > 0.0
    final = footprint_clearance(world, fleet.b["pose"][0], robot, end_s)
    assert_allclose(final, fleet.b["clearance"][0], atol=1e-12)
    if fleet.b["collided"][0]:
        assert final <= 0.0
    else:
        assert final > 0.0
        assert_allclose(end_s, 0.5, atol=1e-12)


def test_a_moving_disc_runs_into_a_robot_that_stands():
    coming = replace(NOWHERE, discs=np.array([[2.03, 0.0, -2.0, 0.0, 0.3, 1.0, 0.0, math.inf]]))
    fleet = launched(coming, (0.0, 0.0, 0.0), a_robot(), 0.0)
    for _ in range(30):
        if not fleet.b["collided"][0]:
            fleet.step()
    assert fleet.b["collided"][0] == 1
    assert_allclose(fleet.b["time"][0], 1.53, atol=CONTACT_M)
    assert_allclose(fleet.b["pose"][0], 0.0)
    stops = replace(coming, discs=np.array([[2.03, 0.0, -2.0, 0.0, 0.3, 1.0, 0.0, 1.43]]))
    fleet = launched(stops, (0.0, 0.0, 0.0), a_robot(), 0.0)
    for _ in range(30):
        fleet.step()
    assert fleet.b["collided"][0] == 0
    assert_allclose(fleet.b["clearance"][0], 0.1, atol=1e-12)


def front(robot: RobotConfig, wider_m: float) -> Array:
    """(P, 2) points along the footprint's outline in the robot's frame, each side moved out by wider_m."""
    if robot.radius_m is not None:
        around = np.linspace(-math.pi, math.pi, 4001)
        outline = robot.radius_m * np.column_stack([np.cos(around), np.sin(around)])
    else:
        part = np.linspace(0.0, 1.0, 1500)[:, None]
        corners = robot.polygon
        outline = np.vstack(
            [a + part * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
        )
    width = np.abs(outline[:, 1]).max()
    return outline * [1.0, 1.0 + wider_m / width]


@pytest.mark.parametrize("shape", ["disc", "polygon"])
@pytest.mark.parametrize("seed", range(20))
def test_a_robot_drives_as_far_as_beams_from_its_outline_see(shape: str, seed: int):
    """Beams straight ahead from all points of the outline: the shortest is the way to the first contact."""
    rng = np.random.default_rng(seed)
    world = replace(random_world(rng, 6), discs=np.empty((0, 8)))
    if seed % 2:
        solid = (rng.random((40, 40)) < 0.04).astype(np.uint8)
        world = replace(NOWHERE, grid=OccupancyGrid(solid=solid, resolution_m=0.15, origin=(-3.0, -2.5, 0.4)))
    robot = a_robot(polygon=shape == "polygon", lidar=LidarConfig(num_beams=4))
    pose: Pose = (0.0, 0.0, 0.0)
    while footprint_clearance(world, np.array(pose), robot) < 0.02:
        pose = (*rng.uniform(-4, 4, 2), rng.uniform(-3, 3))
    seen = {}
    for wider_m in (-2e-3, 2e-3):
        sensors = np.array([(*twins.placed(pose, tuple(p)), pose[2]) for p in front(robot, wider_m)])
        seen[wider_m] = float(_core.raycast(world.native, sensors, np.zeros(1), 8.0).min())
    fleet = launched(world, pose, robot, 1.0)
    while not fleet.b["collided"][0] and fleet.b["travelled"][0] < 8.0:
        fleet.step()
    driven = float(fleet.b["travelled"][0])
    # A narrower outline sees contacts later or misses them, a wider one sees them sooner.
    assert seen[2e-3] - 5e-3 <= driven <= seen[-2e-3] + 0.1 * (seen[-2e-3] >= 8.0) + 5e-3
    assert fleet.b["collided"][0] or seen[2e-3] >= 7.99
