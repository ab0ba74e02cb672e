"""Paths of cars: free of collision with the exact footprint, no tighter than the car turns, and from cusp to cusp."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from adrl import _core
from adrl.errors import NoPath, PlanningError, StartOccupied
from adrl.planning.global_planner import length_m, plan
from adrl.planning.grid import clearance_limit_m, planning_grid
from adrl.planning.path_guide import MapGuide
from adrl.types import Array, RobotConfig, World
from adrl.worlds import get_scenario, task_set
from adrl.worlds.shapes import box, enclosure

CAR = RobotConfig(
    name="car",
    radius_m=None,
    footprint_m=((0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2)),
    max_speed_mps=1.0,
    min_speed_mps=-0.5,
    min_turning_radius_m=1.0,
)
TRUCK = replace(
    CAR,
    name="truck",
    footprint_m=((0.6, 0.2), (-0.1, 0.2), (-0.1, -0.2), (0.6, -0.2)),
    min_turning_radius_m=0.6,
)
"""Its frame's origin on the rear axle."""
DISC = RobotConfig(name="disc", min_speed_mps=-0.6, min_turning_radius_m=0.5)
CARS = {car.name: car for car in (CAR, TRUCK, DISC)}
BOUNDS = (0.0, 0.0, 6.0, 4.5)
CIRCLES = st.lists(
    st.tuples(st.floats(0.0, 6.0), st.floats(0.0, 4.5), st.floats(0.1, 0.6)), min_size=0, max_size=6
)
POSE = st.tuples(st.floats(0.31, 5.7), st.floats(0.31, 4.2), st.floats(-3.1, 3.1))
PLACE = st.tuples(st.floats(0.31, 5.7), st.floats(0.31, 4.2))
Pose = tuple[float, float, float]


def room(circles: list[tuple[float, float, float]]) -> World:
    return World(bounds=BOUNDS, circles=np.array(circles).reshape(-1, 3), segments=enclosure(BOUNDS))


def poses_along(world: World, start: Pose, goal: tuple[float, float], car: RobotConfig) -> Array:
    """(P, 3) as the planner has them."""
    grid = planning_grid(world, clearance_limit_m(car))
    height, width = grid.clearance_m.shape
    planner = _core.CarPlanner(car.native, 0.1, height, width, grid.resolution_m)
    return planner.plan(grid.clearance_m, grid.origin_m, start, goal)


def gears(path: Array, start: Pose) -> Array:
    """(P - 1,) 1 for a chord that is driven forward, -1 backward: it turns at cusps."""
    chords = np.diff(path[:, :2], axis=0)
    turned = (chords[1:] * chords[:-1]).sum(axis=1) < 0.0
    first = 1.0 if chords[0] @ [math.cos(start[2]), math.sin(start[2])] >= 0.0 else -1.0
    return np.cumprod(np.concatenate([[first], np.where(turned, -1.0, 1.0)]), dtype=np.float64)


def headings(path: Array, start: Pose) -> Array:
    """(P - 1,) of the car on its chords."""
    chords = np.diff(path[:, :2], axis=0) * gears(path, start)[:, None]
    return np.arctan2(chords[:, 1], chords[:, 0])


def footprint_clearance(world: World, path: Array, start: Pose, car: RobotConfig) -> float:
    """Least, of the exact footprint on its way; on an arc the chord is off it by 1 mm or so."""
    dense = []
    for (a, b), yaw in zip(pairwise(path[:, :2]), headings(path, start), strict=True):
        t = np.linspace(0.0, 1.0, 2 + int(math.dist(a, b) / 0.02))[:, None]
        dense.append(np.column_stack([a + t * (b - a), np.full(len(t), yaw)]))
    poses = np.ascontiguousarray(np.concatenate(dense))
    return float(_core.clearance(world.native, poses, car.radius_m or 0.0, car.polygon, 1.0).min())


@settings(max_examples=30, deadline=None)
@given(circles=CIRCLES, start=POSE, goal=PLACE, name=st.sampled_from(list(CARS)))
def test_a_path_is_one_that_the_car_can_drive(
    circles: list[tuple[float, float, float]], start: Pose, goal: tuple[float, float], name: str
):
    car, world = CARS[name], room(circles)
    try:
        path = plan(world, start, goal, car)
    except PlanningError:
        return
    assert_array_equal(path[0], start[:2])
    assert path[-1] == pytest.approx(goal, abs=1e-9)
    before = _core.clearance(world.native, np.array([start]), car.radius_m or 0.0, car.polygon, 1.0)[0]
    least = footprint_clearance(world, path, start, car)
    assert least > (
        0.0 if before > 0.12 else -0.02
    )  # a start nearer than the margin is left as near as it is
    chords, yaws = np.diff(path, axis=0), headings(path, start)
    lengths = np.hypot(*chords.T)
    # Between two chords of an arc the heading turns by half of each. The first begins at the start's.
    most = 0.5 * (lengths[1:] + lengths[:-1]).clip(max=0.2) / car.min_turning_radius_m
    turns = np.abs([math.remainder(b - a, 2.0 * math.pi) for a, b in pairwise(yaws)])
    assert (turns <= 1.01 * most + 1e-6).all()
    first = abs(math.remainder(yaws[0] - start[2], 2.0 * math.pi))
    assert first <= 0.51 * min(lengths[0], 0.2) / car.min_turning_radius_m + 1e-6


@settings(max_examples=10, deadline=None)
@given(circles=CIRCLES, start=POSE, goal=PLACE)
def test_equal_inputs_equal_bytes(
    circles: list[tuple[float, float, float]], start: Pose, goal: tuple[float, float]
):
    one, other = (poses_along(room(circles), start, goal, CAR) for _ in range(2))
    assert_array_equal(one, other)


@settings(max_examples=10, deadline=None)
@given(circles=CIRCLES, start=POSE, goal=PLACE)
def test_mirrored_worlds_have_mirrored_ways(
    circles: list[tuple[float, float, float]], start: Pose, goal: tuple[float, float]
):
    """As long but for which of equal ways is found first, and free where the other is."""
    across = BOUNDS[3]
    mirrored = [(x, across - y, r) for x, y, r in circles]
    one = poses_along(room(circles), start, goal, CAR)
    other = poses_along(
        room(mirrored), (start[0], across - start[1], -start[2]), (goal[0], across - goal[1]), CAR
    )
    assert (len(one) > 0) == (len(other) > 0)
    if len(one) > 0:
        assert length_m(other[:, :2]) == pytest.approx(length_m(one[:, :2]), rel=0.15, abs=0.6)


def test_in_the_open_it_is_the_shortest_curve():
    """To a point ahead a line; to one behind backward, unless turning round pays; sideways an arc and a line."""
    world = World(bounds=(-20.0, -20.0, 20.0, 20.0))
    for goal, length in (((5.0, 0.0), 5.0), ((-2.0, 0.0), 2.0), ((1.0, 1.0), 0.5 * math.pi)):
        path = plan(world, (0.0, 0.0, 0.0), goal, CAR)
        assert length_m(path) == pytest.approx(length, rel=1e-3)
    far_behind = plan(world, (0.0, 0.0, 0.0), (-15.0, 0.0), CAR)
    assert gears(far_behind, (0.0, 0.0, 0.0))[-1] == 1.0  # backward costs double


@pytest.mark.parametrize("place", ["complex", "rooms"])
def test_no_way_of_a_car_is_shorter_than_one_that_turns_on_the_spot(place: str):
    """Even of one that nearly does. A* is pulled taut within its cells, and may be 2 % longer than need be."""
    turns = RobotConfig(name="disc", min_speed_mps=-0.6)
    for task in task_set(get_scenario(place), turns, "validation", 2):
        for radius_m in (0.05, 0.5):
            car = replace(turns, min_turning_radius_m=radius_m)
            path = plan(task.world, task.start, task.goal, car)
            assert length_m(path) >= 0.98 * task.shortest_m
            if radius_m < 0.1:
                assert length_m(path) <= 1.06 * task.shortest_m


def lane(width_m: float) -> World:
    """A dead end along x, closed at x = 5."""
    half = 0.5 * width_m
    walls = [
        [0.0, 3.0 - half, 5.0, 3.0 - half],
        [0.0, 3.0 + half, 5.0, 3.0 + half],
        [5.0, 3.0 - half, 5.0, 3.0 + half],
    ]
    return World(bounds=(-4.0, 0.0, 6.0, 6.0), segments=np.array(walls))


def test_out_of_a_dead_end_a_car_backs():
    start, goal = (4.3, 3.0, 0.0), (-2.0, 3.0)
    path = plan(lane(0.9), start, goal, CAR)
    assert gears(path, start)[0] == -1.0
    with pytest.raises(NoPath, match=r"robot 'car' finds no room for curves .* and it cannot back"):
        plan(lane(0.9), start, goal, replace(CAR, min_speed_mps=0.0))
    turned = (4.3, 3.0, math.pi)
    assert (gears(plan(lane(0.9), turned, goal, replace(CAR, min_speed_mps=0.0)), turned) == 1.0).all()


def test_a_start_inside_an_obstacle_is_refused():
    world = World(bounds=BOUNDS, polygons=(box(2.0, 3.0, 1.0, 1.0),))
    with pytest.raises(StartOccupied):
        plan(world, (2.0, 3.0, 0.0), (5.0, 3.0), CAR)


def test_a_start_near_a_wall_is_left():
    """But not by a car whose tail would swing into it."""
    world = World(bounds=BOUNDS, segments=np.array([[0.0, 1.0, 6.0, 1.0]]))
    away, along = (2.0, 1.29, 0.2), (2.0, 1.22, 0.0)
    near = _core.clearance(world.native, np.array([away, along]), 0.0, CAR.polygon, 1.0)
    assert (near > 0.0).all()
    assert (near < 0.05).all()
    path = plan(world, away, (5.0, 3.0), CAR)
    assert footprint_clearance(world, path, away, CAR) > 0.0
    with pytest.raises(NoPath):
        plan(world, along, (5.0, 3.0), CAR)


def test_no_waypoint_lies_beyond_a_cusp_before_the_car_is_there():
    """Forward by 2 m, back to the left, and on: the car is led to each cusp, then on."""
    forward = [(x, 0.0) for x in np.linspace(0.0, 2.0, 21)]
    back = [(2.0 - math.sin(a), 1.0 - math.cos(a)) for a in np.linspace(0.0, 1.5, 16)[1:]]
    x, y = back[-1]
    on = [(x + 0.1 * k * math.cos(-1.5), y + 0.1 * k * math.sin(-1.5)) for k in range(1, 10)]
    path = np.array([*forward, *back, *on])
    guide = MapGuide(World(bounds=(-5.0, -5.0, 5.0, 5.0)), CAR)
    guide.follow(path)
    for at in np.linspace(0.0, 1.9, 20):
        waypoint, left_m = guide.waypoint((float(at), 0.0, 0.0))
        assert waypoint == pytest.approx((min(at + 1.5, 2.0), 0.0), abs=1e-9)
        assert left_m == pytest.approx(length_m(path) - at)
    for at in ((1.97, 0.0), (2.2, 0.0)):  # nearly there, and beyond
        waypoint, _ = guide.waypoint((*at, 0.0))
        assert waypoint[0] < 1.1
        assert math.dist(waypoint, back[-1]) < 0.05
    waypoint, _ = guide.waypoint((back[-1][0], back[-1][1], -1.5))
    assert waypoint == pytest.approx(on[-1], abs=1e-9)
    # Who turns on the spot is led round the corner before it is there.
    guide = MapGuide(World(bounds=(-5.0, -5.0, 5.0, 5.0)), replace(CAR, min_turning_radius_m=0.0))
    guide.follow(path)
    waypoint, _ = guide.waypoint((1.5, 0.0, 0.0))
    assert waypoint[1] > 0.3


@pytest.mark.parametrize("place", ["clutter", "rooms"])
def test_tasks_of_cars_are_their_own(place: str):
    """The world, start and goal of a task are those of any robot of that shape, the way is the car's."""
    plain = replace(CAR, min_turning_radius_m=0.0)
    for task, other in zip(
        task_set(get_scenario(place), CAR, "validation", 3),
        task_set(get_scenario(place), plain, "validation", 3),
        strict=True,
    ):
        assert task.start == other.start
        assert task.goal == pytest.approx(other.goal)
        assert task.shortest_m == pytest.approx(length_m(task.path))
        assert task.shortest_m >= 0.98 * other.shortest_m
        assert task.time_limit_s == pytest.approx(10.0 + 2.5 * task.shortest_m / CAR.max_speed_mps)
        assert footprint_clearance(task.world, task.path, task.start, CAR) > 0.0
