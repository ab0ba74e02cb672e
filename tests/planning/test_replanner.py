"""The replanner: triggers, thresholds and waypoints beside hand-computed numbers and slow twins."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from adrl import _core
from adrl.errors import ConfigError
from adrl.planning.path_guide import LOOKAHEAD_M
from adrl.planning.replanner import (
    THROUGH_WHAT_MAY_GO,
    Motion,
    Replanner,
    Thresholds,
    adapt,
    on_course,
    stagnant,
)
from adrl.planning.replanner_config import Form, ReplannerConfig
from adrl.types import RobotConfig
from core.replan_twins import WALL, Costs, Grid

Array = NDArray[Any]
ROBOT = RobotConfig()
BEAMS = ROBOT.lidar.num_beams
RANGE = ROBOT.lidar.max_range_m
BASIC = Thresholds(displacement_m=0.3, speed_mps=0.2, obstacle_change_m=0.4)
SMALL: dict[str, Any] = {"cells": 80, "eq18": "corrected"}


def motion(**values: float) -> Motion:
    numbers = dict(travelled_m=0.0, progress_m=0.0, net_m=0.0, obstacle_change_m=0.0) | values
    return Motion(**{name: np.array([value]) for name, value in numbers.items()}, duration_s=2.0)


@pytest.mark.parametrize(
    ("form", "threat", "maturity", "factor"),
    [
        ("corrected", 0.0, 0.0, 1.0),
        ("corrected", 1.0, 0.0, 1.5),  # eq 19 alone
        ("corrected", 0.5, 1.0, 1.25 / 1.2),
        ("literal", 0.5, 1.0, 1.25 * 1.2),
        ("literal", 0.0, 0.5, 1.1),
    ],
)
def test_thresholds_follow_threat_and_maturity(
    form: Form, threat: float, maturity: float, factor: float
) -> None:
    """Eqs 19 and 20, alpha 0.5 and beta 0.2: all three thresholds alike."""
    adapted = adapt(BASIC, np.array([threat]), maturity, ReplannerConfig(eq20=form))
    for name in ("displacement_m", "speed_mps", "obstacle_change_m"):
        assert getattr(adapted, name)[0] == pytest.approx(factor * getattr(BASIC, name))


@pytest.mark.parametrize(
    ("what", "moved", "literal", "corrected"),
    [
        ("stands", motion(), True, True),
        ("oscillates", motion(travelled_m=1.2, net_m=0.1, progress_m=0.05), False, True),
        ("circles", motion(travelled_m=1.2, net_m=0.3, progress_m=-0.2), False, True),
        ("drives to the goal", motion(travelled_m=1.2, net_m=1.2, progress_m=1.1), False, False),
        ("is on a fast detour", motion(travelled_m=1.2, net_m=1.1, progress_m=-0.1), False, False),
        ("nears an obstacle", motion(obstacle_change_m=0.5), False, False),
        ("creeps", motion(travelled_m=0.35, net_m=0.35, progress_m=0.35), False, False),
        ("creeps sideways", motion(travelled_m=0.35, net_m=0.35, progress_m=0.0), False, True),
    ],
)
def test_stagnation(what: str, moved: Motion, literal: bool, corrected: bool) -> None:
    """Eq 18 with d_m 0.3 m, v_min 0.2 m/s, delta 0.4 m over 2 s. The literal form misses trapped robots that move."""
    assert stagnant(moved, BASIC, "literal")[0] == literal, what
    assert stagnant(moved, BASIC, "corrected")[0] == corrected, what


def test_on_course() -> None:
    assert on_course(motion(travelled_m=0.2, progress_m=0.19), 0.01)[0]
    assert not on_course(motion(travelled_m=0.2, progress_m=0.1), 0.01)[0]
    assert not on_course(motion(travelled_m=0.005, progress_m=0.005), 0.01)[0]


def drive(replanner: Replanner, poses: Array, ranges: Array) -> Array:
    """The waypoints (T, 2) of one robot carried along poses (T, 3) with one and the same scan."""
    ranges = np.asarray(ranges, dtype=np.float32)[None]
    return np.array([replanner.update(ranges, pose[None])[0] for pose in poses])


def see(replanner: Replanner, scan: Array) -> None:
    """Enter one scan of the one robot at (0, 0, 0) into its map, and plan nothing."""
    replanner.native.observe(np.ones(1, np.uint8), np.zeros((1, 3)), np.asarray(scan, np.float32)[None])


def one_robot(goal: tuple[float, float], maturity: float = 0.0, **changes: Any) -> Replanner:
    replanner = Replanner(1, ROBOT, ReplannerConfig(**(SMALL | changes)), maturity=maturity)
    replanner.reset(np.array([0]), np.array([goal]), np.zeros((1, 3)))
    return replanner


def facing_wall(distance_m: float = 0.6, half_width_m: float = 0.8) -> Array:
    """(K,) a scan from (0, 0, 0) of a wall across the way, and nothing else."""
    angles = ROBOT.lidar.angles_rad
    with np.errstate(divide="ignore"):
        reach = np.where(np.abs(angles) < 0.5 * math.pi - 1e-6, distance_m / np.cos(angles), np.inf)
    hits = np.abs(reach * np.sin(angles)) < half_width_m
    return np.where(hits, reach, RANGE)


@pytest.mark.parametrize("speed_mps", [0.02, 0.1, 0.3, 0.6])
def test_no_trigger_on_a_free_straight_run(speed_mps: float) -> None:
    replanner = one_robot((30.0, 0.0))
    x = speed_mps * 0.1 * np.arange(80)
    waypoints = drive(replanner, np.column_stack([x, 0 * x, 0 * x]), np.full(BEAMS, RANGE))
    assert replanner.replans[0] == 0
    np.testing.assert_array_equal(waypoints, np.full((80, 2), [30.0, 0.0]))


def stuck_drives() -> Iterator[tuple[str, Array]]:
    t = 0.1 * np.arange(31)
    yield "stands", np.zeros((31, 3))
    yield "spins", np.column_stack([0 * t, 0 * t, t])
    yield "oscillates", np.column_stack([0 * t, 0.2 * np.sin(3.0 * t), 0 * t])
    yield "circles", np.column_stack([0.15 * np.sin(3.0 * t), 0.15 * np.cos(3.0 * t) - 0.15, 0 * t])


@pytest.mark.parametrize(
    ("name", "poses"), list(stuck_drives()), ids=lambda x: x if isinstance(x, str) else ""
)
def test_a_trapped_robot_triggers_within_three_seconds(name: str, poses: Array) -> None:
    replanner = one_robot((5.0, 0.0))
    for pose in poses:
        turned = np.roll(facing_wall(), -round(pose[2] / ROBOT.lidar.angle_increment_rad)).astype(np.float32)
        replanner.update(turned[None], pose[None])
    assert replanner.replans[0] == 1
    assert replanner.following[0]
    assert replanner.waypoints[0, 0] < 2.0
    assert abs(replanner.waypoints[0, 1]) > 0.1  # round the wall


@pytest.mark.parametrize("reading", [math.nan, math.inf, -math.inf, 0.0, -1.0])
def test_beams_that_tell_nothing_do_not_change_the_trigger(reading: float) -> None:
    """Of a robot stuck before a wall, and of one that drives on freely with a few broken beams."""
    broken = np.arange(0, BEAMS, 7)
    for poses, scan in (
        (np.zeros((31, 3)), facing_wall()),
        (np.column_stack([0.06 * np.arange(31.0), np.zeros(31), np.zeros(31)]), np.full(BEAMS, RANGE)),
    ):
        plain, faulty = scan.copy(), scan.copy()
        plain[broken], faulty[broken] = RANGE, reading
        trails = []
        for ranges in (plain, faulty):
            replanner = one_robot((5.0, 0.0))
            drive(replanner, poses, ranges)
            trails.append((replanner.replans[0], replanner.b["clearances"].copy()))
        assert trails[0][0] == trails[1][0]
        np.testing.assert_array_equal(trails[0][1], trails[1][1])
        assert trails[0][0] == (poses[-1, 0] == 0.0)


@pytest.mark.parametrize(
    ("changes", "planned"),
    [
        ({}, True),
        ({"foresight_m": 1.4}, True),
        ({"foresight_m": 1.0}, False),
        ({"foresight_m": 0.0}, False),
        ({"eq18": "literal"}, False),
    ],
)
def test_a_known_obstacle_on_the_way_is_planned_round_before_the_robot_is_stuck(
    changes: dict[str, Any], planned: bool
) -> None:
    """A wall 1.5 m ahead, met at the first scan: its corridor of 0.225 m ends 1.275 m ahead."""
    replanner = one_robot((5.0, 0.0), **changes)
    waypoints = drive(replanner, np.zeros((3, 3)), facing_wall(1.5))
    assert replanner.replans[0] == planned
    assert replanner.following[0] == planned
    assert np.array_equal(waypoints[-1], [5.0, 0.0]) != planned


def test_an_obstacle_beside_the_way_is_passed_without_a_plan() -> None:
    scan = np.full(BEAMS, RANGE)
    ahead = np.abs(ROBOT.lidar.angles_rad - 0.4) < 0.1  # a thing 2 m away, 0.6 m or more off the line
    scan[ahead] = 2.0
    replanner = one_robot((5.0, 0.0))
    drive(replanner, np.zeros((15, 3)), scan)
    assert replanner.b["log_odds"][0].max() > 0
    assert replanner.replans[0] == 0


@pytest.mark.parametrize("foresight_m", [0.0, 8.0])
def test_a_robot_that_finds_no_way_asks_again_only_after_the_interval(foresight_m: float) -> None:
    """Shut in, stagnant or not: eq 18 needs its window of 2 s anew, foresight the interval of 1 s."""
    replanner = one_robot((5.0, 0.0), foresight_m=foresight_m)
    ring = np.full(BEAMS, 0.22)
    see(replanner, ring)  # one scan more makes walls of it
    drive(replanner, np.zeros((100, 3)), ring)
    assert replanner.replans[0] == (10 if foresight_m else 4)


@pytest.mark.parametrize(("scans", "to_the_door"), [(30, True), (0, False)])
def test_who_came_to_stand_in_the_only_door_has_not_walled_it_up(scans: int, to_the_door: bool) -> None:
    """Where the door has been seen open, the robot heads for it, and not for the place nearest to the goal."""
    room = np.full(BEAMS, 1.5)
    door = np.abs(ROBOT.lidar.angles_rad - 1.2) < 0.4
    goal = np.array([[3.0, -1.5]])
    replanner = one_robot((3.0, -1.5), cells=200)
    for _ in range(scans):
        see(replanner, np.where(door, RANGE, room))
    for _ in range(3):
        see(replanner, room)
    replanner.native.plan(np.ones(1, np.uint8), np.zeros((1, 3)), goal)
    assert replanner.b["found"][0] == (THROUGH_WHAT_MAY_GO if to_the_door else 2)
    assert (replanner.b["waypoint"][0, 1] > 0.5) == to_the_door


def test_the_literal_trigger_misses_an_oscillating_robot() -> None:
    poses = dict(stuck_drives())["oscillates"]
    replanner = one_robot((5.0, 0.0), eq18="literal")
    drive(replanner, np.tile(poses, (3, 1)), facing_wall())
    assert replanner.replans[0] == 0


def test_a_mature_policy_is_left_alone_for_longer() -> None:
    """Progress of 0.27 m in 2 s: below d_m0 = 0.3 m, above 0.3 / 1.2. The literal form asks 0.36 m."""
    x = 0.0135 * np.arange(25)
    poses = np.column_stack([x, 0.0 * x, 0.0 * x])
    scan = facing_wall(1.5, 3.0)

    def replans(maturity: float, eq20: Form) -> int:
        replanner = one_robot((5.0, 0.0), maturity, eq20=eq20, foresight_m=0.0)
        drive(replanner, poses, scan)
        return int(replanner.replans[0])

    assert replans(0.0, "corrected") == 1
    assert replans(1.0, "corrected") == 0
    assert replans(1.0, "literal") == 1


@pytest.mark.parametrize("ring_m", [0.22, 0.3])
def test_a_robot_that_can_reach_no_other_place_keeps_the_goal(ring_m: float) -> None:
    replanner, ring = one_robot((5.0, 0.0)), np.full(BEAMS, ring_m)
    see(replanner, ring)
    waypoints = drive(replanner, np.zeros((40, 3)), ring)
    assert replanner.replans[0] >= 1
    np.testing.assert_array_equal(waypoints, np.tile([5.0, 0.0], (40, 1)))


def test_a_robot_shut_in_with_room_heads_for_the_place_nearest_to_the_goal() -> None:
    """0.35 m all round: the radius of 0.2 m and the margin leave a cell or two on the goal's side."""
    replanner, ring = one_robot((5.0, 0.0)), np.full(BEAMS, 0.35)
    see(replanner, ring)
    waypoints = drive(replanner, np.zeros((40, 3)), ring)
    assert replanner.replans[0] == 1
    assert 0.0 < waypoints[-1, 0] <= 0.15
    assert abs(waypoints[-1, 1]) < 0.05


@given(
    polar=st.tuples(st.floats(0.01, 3.0), st.floats(-math.pi, math.pi)),
    beyond_m=st.floats(0.0, 30.0),
    lookahead_m=st.floats(0.3, 5.0),
)
def test_a_waypoint_is_shown_as_a_goal_that_is_not_yet_near(
    polar: tuple[float, float], beyond_m: float, lookahead_m: float
) -> None:
    """In its direction, never nearer than it is, lookahead_m away unless the goal itself is nearer along the route."""
    distance, angle = polar
    replanner = Replanner(2, ROBOT, ReplannerConfig(cells=40, lookahead_m=lookahead_m))
    replanner.b["beyond"][:] = 0.0, beyond_m
    point = distance * np.array([[math.cos(angle), math.sin(angle)]])
    goal, waypoint = replanner.as_goals(np.repeat(point, 2, axis=0))
    np.testing.assert_array_equal(goal, point[0])
    assert math.hypot(*waypoint) == pytest.approx(max(distance, min(lookahead_m, distance + beyond_m)))
    assert math.atan2(*waypoint[::-1]) == pytest.approx(math.atan2(*point[0, ::-1]))
    np.testing.assert_array_equal(replanner.as_goals(point, np.array([1])), [waypoint])


@given(st.floats(0.01, 30.0), st.floats(-math.pi, math.pi), st.floats(0.3, 5.0))
def test_who_learnt_by_near_points_is_shown_no_other(
    distance: float, angle: float, lookahead_m: float
) -> None:
    """Waypoint and goal alike: in their direction, where they are, but at most as far away as guidance map has them."""
    replanner = Replanner(2, ROBOT, ReplannerConfig(cells=40, lookahead_m=lookahead_m, near=True))
    replanner.b["beyond"][:] = 0.0, 5.0
    point = distance * np.array([[math.cos(angle), math.sin(angle)]])
    goal, waypoint = replanner.as_goals(np.repeat(point, 2, axis=0))
    np.testing.assert_array_equal(goal, waypoint)
    np.testing.assert_allclose(goal, point[0] * min(1.0, LOOKAHEAD_M / distance), atol=1e-12)


def test_handed_back_when_the_goal_is_seen() -> None:
    replanner = one_robot((1.5, 0.0))
    drive(replanner, np.zeros((22, 3)), facing_wall())
    assert replanner.following[0]
    assert replanner.beyond_m[0] >= 0.0
    drive(replanner, np.zeros((60, 3)), np.full(BEAMS, RANGE))  # the wall is gone
    assert not replanner.following[0]
    np.testing.assert_array_equal(replanner.waypoints[0], [1.5, 0.0])
    assert replanner.beyond_m[0] == 0.0


@pytest.mark.parametrize("form", ["literal", "corrected"])
@pytest.mark.parametrize("seed", range(4))
def test_the_waypoint_is_the_twins(form: Form, seed: int) -> None:
    """Eqs 21 and 23 on random clutter: the score of every candidate worked out from the definitions."""
    config = ReplannerConfig(cells=80, eq21=form)
    replanner = Replanner(1, ROBOT, config)
    pose = np.array([0.02, 0.03, 0.3])
    goal = np.array([1.62, 0.87])
    replanner.reset(np.array([0]), goal[None], pose[None])
    solid = np.random.default_rng(seed).random((80, 80)) < 0.004
    solid[34:46, 34:46] = False  # room about the robot
    solid[55:60, 70:75] = False  # and the goal
    replanner.b["log_odds"][0] = np.where(solid, WALL, 0)
    mask = np.ones(1, dtype=np.uint8)
    replanner.native.plan(mask, pose[None], goal[None])
    assert replanner.b["found"][0] == 1
    scores = candidate_scores(replanner, solid, pose, goal, form)
    best = min(scores.values())
    farthest = [point for point, score in scores.items() if score <= best + 1e-9][-1]
    np.testing.assert_allclose(replanner.b["waypoint"][0], farthest)


def candidate_scores(
    replanner: Replanner, solid: Array, pose: Array, goal: Array, form: Form
) -> dict[tuple[float, float], float]:
    config, res = replanner.config, replanner.config.resolution_m
    native = config.route_costs(ROBOT)
    origin = replanner.b["origin"][0]

    def cell(p: Array) -> tuple[int, int]:
        return int(math.floor(p[1] / res) - origin[0]), int(math.floor(p[0] / res) - origin[1])

    start, target = cell(pose), cell(goal)
    plan = _core.RoutePlanner(80, 80, res, native).plan
    route, _, _ = plan(solid.astype(np.int8), start, target)
    names = ("inflation_m", "comfort_m", "near_goal_m", "weight", "k_obstacle", "k_goal", "k_turn")
    costs = Costs(**{name: getattr(native, name) for name in names}, resolution_m=res)
    grid = Grid(solid.astype(bool), costs, start, target)
    centres = (route[:, ::-1] + origin[::-1] + 0.5) * res
    to_go = [0.0]
    for a, b in zip(route[::-1][1:], route[::-1], strict=False):
        units = next(
            u for _, cell_, u in grid.moves((int(a[0]), int(a[1]))) if cell_ == (int(b[0]), int(b[1]))
        )
        to_go.insert(0, to_go[0] + units * res / 64)
    scores: dict[tuple[float, float], float] = {}
    along = total = 0.0
    for k in range(1, len(route)):
        along += math.dist(centres[k], centres[k - 1])
        point = goal if k == len(route) - 1 else centres[k]
        total += literal_density(grid, route, centres, goal, k)
        if along > config.lookahead_m or (along < config.min_interval_m and k < len(route) - 1):
            continue
        seen = np.zeros(1, dtype=np.uint8)
        replanner.native.see(np.ones(1, np.uint8), pose[None], point[None], np.inf, False, seen)
        if seen[0] and form == "literal":
            scores[tuple(point)] = math.dist(point, goal) + total
        elif seen[0]:
            scores[tuple(point)] = to_go[k] + straight_cost(grid, pose, point, goal, cell)
    return scores


def near(grid: Grid, p: Array, goal: Array) -> float:
    return min(max(1.0 - math.dist(p, goal) / grid.costs.near_goal_m, 0.0), 1.0)


def literal_density(grid: Grid, route: Array, centres: Array, goal: Array, k: int) -> float:
    turn = 0.0
    if k + 1 < len(route):
        a, b = centres[k] - centres[k - 1], centres[k + 1] - centres[k]
        turn = abs(math.atan2(a[0] * b[1] - a[1] * b[0], a @ b))
    c = grid.costs
    o = grid.obstacle_density((int(route[k][0]), int(route[k][1])))
    return 1.0 / (
        1.0 + c.k_obstacle * o + c.k_goal * near(grid, centres[k], goal) + c.k_turn * turn / math.pi
    )


def straight_cost(grid: Grid, pose: Array, point: Array, goal: Array, cell: Any) -> float:
    c, length = grid.costs, math.dist(pose[:2], point)
    pieces = max(1, math.ceil(2.0 * length / c.resolution_m))
    places = [pose[:2] + (k + 0.5) / pieces * (point - pose[:2]) for k in range(pieces)]
    density = np.mean(
        [
            c.k_obstacle * grid.obstacle_density(cell(p)) + c.k_goal * (1.0 - near(grid, p, goal))
            for p in places
        ]
    )
    turn = math.remainder(math.atan2(*(point - pose[:2])[::-1]) - pose[2], math.tau)
    return length * (1.0 + c.weight * (float(density) + c.k_turn * abs(turn) / math.pi))


def test_the_literal_density_is_least_among_obstacles() -> None:
    """Eq 21 by hand: D is 1 in the open and 1 / 1.6 at an obstacle, so minimising its sum seeks obstacles out."""
    solid = np.zeros((20, 20), dtype=bool)
    solid[10, 10] = True
    grid = Grid(solid, Costs(inflation_m=0.05, comfort_m=0.15), (0, 0), (19, 19))
    route = np.array([[10, 12], [10, 11], [0, 0]])
    centres, goal = 0.05 * route[:, ::-1], np.array([9.0, 9.0])
    beside = literal_density(grid, route[:2], centres[:2], goal, 1)
    assert beside == pytest.approx(1.0 / 1.6)
    far = np.array([[0, 1], [0, 0]])
    assert literal_density(grid, far, 0.05 * far[:, ::-1], goal, 1) == 1.0


def test_state_round_trip() -> None:
    """Continued from a copy, a replanner gives the same bytes."""
    rng = np.random.default_rng(0)
    config = ReplannerConfig(cells=80)
    poses = np.cumsum(rng.normal(0.0, 0.02, (60, 3, 3)), axis=0)
    scans = rng.uniform(0.3, 3.0, (60, 3, BEAMS)).astype(np.float32)
    goals = rng.uniform(-4.0, 4.0, (3, 2))
    one, other = (Replanner(3, ROBOT, config, num_threads=k) for k in (1, 2))
    one.reset(np.arange(3), goals, poses[0])
    for pose, scan in zip(poses[:40], scans[:40], strict=True):
        one.update(scan, pose)
    other.set_state(one.state())
    for pose, scan in zip(poses[40:], scans[40:], strict=True):
        a, b = (r.update(scan, pose) for r in (one, other))
        np.testing.assert_array_equal(a, b)
    assert one.replans.sum() > 0
    for name, array in one.state().items():
        np.testing.assert_array_equal(array, other.state()[name], err_msg=name)


def test_robots_that_are_not_active_are_left_alone() -> None:
    replanner = Replanner(2, ROBOT, ReplannerConfig(cells=80))
    replanner.reset(np.arange(2), np.full((2, 2), 5.0), np.zeros((2, 3)))
    before = replanner.state()
    scan = np.tile(facing_wall().astype(np.float32), (2, 1))
    for _ in range(30):
        replanner.update(scan, np.zeros((2, 3)), np.array([True, False]))
    assert replanner.replans.tolist() == [1, 0]
    for name, array in replanner.state().items():
        np.testing.assert_array_equal(array[1], before[name][1], err_msg=name)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("window_s", 0.0),
        ("eq18", "printed"),
        ("cells", 10),
        ("lookahead_m", 0.2),
        ("density_weight", 100.1),
    ],
)
def test_bad_config(field: str, value: Any) -> None:
    with pytest.raises(ConfigError, match=field):
        ReplannerConfig(**{field: value})


def test_as_printed_turning_costs_in_the_search() -> None:
    """Eq 22 has Cost_kin. 0.1 m a radian: the route out of a robot that faces away costs pi / 10 m more."""
    literal = ReplannerConfig(cells=80, density_weight=0.0).literal()
    plan = _core.RoutePlanner(80, 80, literal.resolution_m, literal.route_costs(ROBOT)).plan
    free = np.zeros((80, 80), dtype=np.int8)
    ahead, behind = (plan(free, (40, 10), (40, 70), heading)[1] for heading in (0.0, math.pi))
    assert ahead == pytest.approx(3.0)
    assert behind - ahead == pytest.approx(0.1 * math.pi, abs=0.01)


def test_clearance_beyond_what_is_measured_is_refused() -> None:
    """181 cells are 9.05 m at 0.05 m: the robot's 0.2 m, the margin of 0.05 m and 8.8 m of comfort."""
    radius_m = ROBOT.circumscribed_radius_m
    fits = ReplannerConfig(comfort_m=9.0 - radius_m)
    assert fits.route_costs(ROBOT).comfort_m == fits.comfort_m
    with pytest.raises(ConfigError, match="comfort_m"):
        ReplannerConfig(comfort_m=9.1 - radius_m).route_costs(ROBOT)
    ReplannerConfig(comfort_m=9.1 - radius_m, resolution_m=0.06).route_costs(ROBOT)
