"""People of the core: against a plain twin and RVO2, and the laws of walking."""

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from adrl import _core
from adrl.errors import ConfigError
from adrl.types import Array, People, World
from adrl.worlds.shapes import box, enclosure
from core.fleet import OUTPUTS, Fleet, a_robot, a_task, assert_equal_bytes
from core.orca_twin import avoid_mover, excess, nearest_allowed

X, Y, VX, VY, HEADING, WALKED, GOAL, ONWARD, WAIT, HELD = range(10)
BOUNDS = (-10.0, -10.0, 10.0, 10.0)
FAR = (90.0, 90.0, 0.0)
"""A robot there meets nobody."""
HORIZON_S, WALL_HORIZON_S, HURRY, SPACE_M = 3.0, 1.0, 1.25, 0.05


def people(routes: list[list[tuple[float, float]]], **more: Any) -> People:
    """Walkers of 1.2 m/s and 0.3 m who decide at every step."""
    count = len(routes)
    values: dict[str, Any] = dict(radius_m=0.3, speed_mps=1.2, share=0.5, reaction_s=0.0, group=-1) | more
    legs = values.pop("legs", False)
    rows = {name: np.broadcast_to(value, (count,)) for name, value in values.items()}
    return People(routes=tuple(np.array(route) for route in routes), legs=legs, **rows)


def walk(who: People, start: tuple[float, float, float] = FAR, **world: Any) -> Fleet:
    """A robot at rest at `start` among people at the beginning of their routes."""
    place = World(bounds=BOUNDS, **world)
    fleet = Fleet([a_task(place, start, (start[0] + 50.0, start[1]), people=who)], a_robot()).reset()
    fleet.b["people"][:, :, WAIT] = 0.0
    return fleet


def course(fleet: Fleet, steps: int, command: object = (0.0, 0.0)) -> Array:
    """(steps + 1, P, 10) of the people of robot 0."""
    rows = [fleet.b["people"][0].copy()]
    count = int((rows[0][:, ONWARD] != 0.0).sum())
    for _ in range(steps):
        rows.append(fleet.step(command).b["people"][0].copy())
    return np.array(rows)[:, :count]


def crowd(rng: np.random.Generator, count: int, side_m: float = 2.2, **more: Any) -> People:
    """Walkers crossing a square, none touching at the start."""
    starts: list[Array] = []
    while len(starts) < count:
        place = rng.uniform(-side_m, side_m, 2)
        if all(math.dist(place, other) > 0.7 for other in starts):
            starts.append(place)
    goals = rng.uniform(-8.0, 8.0, (count, 2))
    routes = [[tuple(a), tuple(b)] for a, b in zip(starts, goals, strict=True)]
    return people(
        routes, speed_mps=rng.uniform(0.5, 1.6, count), radius_m=rng.uniform(0.2, 0.35, count), **more
    )


def complex_(row: Array, at: int) -> complex:
    return complex(row[at], row[at + 1])


def half_planes(who: People, now: Array, k: int) -> list[tuple[complex, complex]]:
    """Those of person k among the others, as `now` (P, 10) is."""
    return [
        avoid_mover(
            complex_(now[k], X),
            complex_(now[k], VX),
            complex_(now[j], X),
            complex_(now[j], VX),
            float(who.radius_m[k] + who.radius_m[j]) + 2.0 * SPACE_M,
            0.5,
            HORIZON_S,
            0.1,
        )
        for j in range(len(who))
        if j != k
    ]


@pytest.mark.parametrize("seed", range(20))
def test_half_planes_hold_after_each_step(seed: int) -> None:
    """The velocity is in all half-planes of the twin and, of those, the nearest to the preferred one."""
    who = crowd(np.random.default_rng(seed), 6)
    rows = course(walk(who), 12)
    met = 0
    for before, after in pairwise(rows):
        for k in range(len(who)):
            planes = half_planes(who, before, k)
            toward = complex(*who.routes[k][int(before[k, GOAL])]) - complex_(before[k], X)
            preferred = toward / abs(toward) * who.speed_mps[k]
            best = nearest_allowed(planes, HURRY * who.speed_mps[k], preferred)
            if best is None:
                continue
            met += 1
            assert abs(complex_(after[k], VX) - best) < 1e-6
            assert max(excess(plane, complex_(after[k], VX)) for plane in planes) < 1e-9
    assert met > 30


def boxes_and_walls(rng: np.random.Generator) -> dict[str, Any]:
    """Convex boxes around a free middle, and walls without thickness."""
    turned = [box(3.2, 0.5, 0.8, 0.6, 0.4), box(-3.1, -1.0, 0.9, 0.7, 1.1), box(0.3, 3.2, 1.4, 0.5, -0.3)]
    return {
        "polygons": tuple(turned),
        "segments": np.array([(-2.0, -3.0, 2.5, -2.9), (2.9, -2.4, 2.6, -1.2)]),
    }


@pytest.mark.parametrize("walled", [False, True])
@pytest.mark.parametrize("seed", range(40))
def test_velocities_are_those_of_rvo2(seed: int, walled: bool) -> None:
    pyrvo = pytest.importorskip("pyrvo")
    rng = np.random.default_rng(seed)
    who = crowd(rng, 7, reaction_s=0.1)
    shapes = boxes_and_walls(rng) if walled else {}
    fleet = walk(who, **shapes)
    rvo = pyrvo.RVOSimulator()
    rvo.set_time_step(0.1)
    for k, route in enumerate(who.routes):
        top = HURRY * float(who.speed_mps[k])
        rvo.add_agent(
            tuple(route[0]), 15.0, 10, HORIZON_S, WALL_HORIZON_S, float(who.radius_m[k]) + SPACE_M, top
        )
    if walled:
        for polygon in shapes["polygons"]:
            rvo.add_obstacle([tuple(corner) for corner in polygon])
        for ax, ay, bx, by in shapes["segments"]:
            rvo.add_obstacle([(ax, ay), (bx, by)])
        rvo.process_obstacles()
    differences = []
    for _ in range(10):
        now = fleet.b["people"][0].copy()
        for k in range(len(who)):
            rvo.set_agent_position(k, tuple(now[k, :2]))
            rvo.set_agent_velocity(k, tuple(now[k, 2:4]))
            toward = who.routes[k][int(now[k, GOAL])] - now[k, :2]
            rvo.set_agent_pref_velocity(k, tuple(toward / np.hypot(*toward) * who.speed_mps[k]))
        rvo.do_step()
        fleet.step((0.0, 0.0))
        for k in range(len(who)):
            theirs = rvo.get_agent_velocity(k)
            differences.append(np.hypot(*(fleet.b["people"][0, k, 2:4] - (theirs.x, theirs.y))))
    # RVO2 counts in single precision, and where it must choose the least bad velocity rounding is amplified.
    assert np.quantile(differences, 0.9) < 1e-6
    assert np.max(differences) < 1e-3


@pytest.mark.parametrize("offset", [0.0, 0.05, 0.3, 1.0])
@pytest.mark.parametrize("angle", [0.7, 1.6, 2.5, math.pi])
def test_two_alone_reach_their_goals_and_never_touch(angle: float, offset: float) -> None:
    """Met head-on, crossing and while overtaking one another."""
    ahead = np.array([math.cos(angle), math.sin(angle)])
    side = offset * np.array([-ahead[1], ahead[0]])
    who = people([[(-4.0, 0.0), (4.0, 0.0)], [tuple(-4.0 * ahead + side), tuple(4.0 * ahead + side)]])
    rows = course(walk(who), 150)
    apart = np.hypot(*(rows[:, 0, :2] - rows[:, 1, :2]).T)
    assert apart.min() >= 0.6 - 1e-6
    turned = (rows[:, :, ONWARD] < 0).any(axis=0)
    reached = [np.hypot(*(rows[:, k, :2] - who.routes[k][-1]).T).min() for k in range(2)]
    assert turned.all() or offset == 0.0, "who reaches the goal turns back"
    assert max(reached) < 0.6 or offset == 0.0


def mirrored(who: People) -> People:
    return replace(who, routes=tuple(route * (1.0, -1.0) for route in who.routes))


@pytest.mark.parametrize("seed", range(8))
def test_a_mirrored_scene_mirrors(seed: int) -> None:
    rng = np.random.default_rng(seed)
    who = crowd(
        rng, 6, group=np.array([0, 0, -1, -1, -1, -1]), share=np.array([0.0, 0.5, 1.0, 0.5, 0.5, 0.5])
    )
    shapes = boxes_and_walls(rng)
    flipped = {
        "polygons": tuple((polygon * (1.0, -1.0))[::-1] for polygon in shapes["polygons"]),
        "segments": shapes["segments"] * (1.0, -1.0, 1.0, -1.0),
    }
    one, other = walk(who, (0.0, 2.9, 0.3), **shapes), walk(mirrored(who), (0.0, -2.9, -0.3), **flipped)
    rows, mirror = course(one, 20, (0.3, 0.4)), course(other, 20, (0.3, -0.4))
    np.testing.assert_allclose(rows[:, :, :4], mirror[:, :, :4] * (1.0, -1.0, 1.0, -1.0), atol=1e-6)


def test_groups_keep_together_and_strangers_part() -> None:
    """Three who start apart, in one group and as strangers, of speeds that differ, through the same oncoming crowd."""
    starts = [(-7.0, 0.0), (-7.5, 1.6), (-6.2, -1.6)]
    routes = [[start, (7.0, 0.0)] for start in starts] + [[(6.0, y), (-8.0, y)] for y in (-1.5, 0.1, 1.2)]
    spread = {}
    for group in (0, -1):
        who = people(routes, group=np.array([group] * 3 + [-1] * 3), speed_mps=[0.9, 1.1, 1.3, 1.0, 1.0, 1.0])
        places = course(walk(who), 100)[30:, :3, :2]
        spread[group] = np.hypot(*(places - places.mean(axis=1, keepdims=True)).T).max(axis=0)
    assert spread[0].max() < 2.0
    assert spread[0].mean() < 0.6 * spread[-1].mean()


def bitmap_room(rng: np.random.Generator) -> Any:
    """A walled room with solid blocks, some touching at corners, as a turned bitmap."""
    from adrl.types import OccupancyGrid

    solid = np.zeros((60, 60), dtype=np.uint8)
    solid[[0, -1]] = solid[:, [0, -1]] = 1
    solid[28:32, :24] = solid[28:32, 36:] = 1
    for row, column in rng.integers(4, 54, (10, 2)):
        solid[row : row + 2, column : column + 2] = 1
    return OccupancyGrid(solid=solid, resolution_m=0.2, origin=(-6.0, -5.0, 0.1))


@pytest.mark.parametrize("kind", ["polygons", "segments", "circles", "grid"])
@pytest.mark.parametrize("seed", range(3))
def test_nobody_walks_through_a_wall(seed: int, kind: str) -> None:
    """Routes lead right through them, and a crowd pushes; bodies stay outside of all that stands."""
    rng = np.random.default_rng(seed)
    where = rng.uniform(-4.0, 4.0, (12, 2))
    standing: dict[str, Any] = {
        "polygons": {
            "polygons": tuple(
                box(x, y, 1.2, 0.3, a) for (x, y), a in zip(where, rng.uniform(0, 3, 12), strict=True)
            )
        },
        "segments": {
            "segments": np.vstack([enclosure((-5, -5, 5, 5)), np.column_stack([where, where + 0.9])])
        },
        "circles": {"circles": np.column_stack([where, np.full(12, 0.4)])},
        "grid": {"grid": bitmap_room(rng)},
    }[kind]
    empty = World(bounds=BOUNDS, **standing)
    starts: list[tuple[float, float]] = []
    while len(starts) < 16:
        at = rng.uniform(-4.5, 4.5, 2)
        clear = _core.clearance(empty.native, np.array([[*at, 0.0]]), 0.3, np.empty((0, 2)), 1.0)[0]
        if clear > 0.05 and all(math.dist(at, other) > 0.65 for other in starts):
            starts.append((float(at[0]), float(at[1])))
    who = people(
        [[start, tuple(rng.uniform(-5, 5, 2))] for start in starts], reaction_s=rng.uniform(0.1, 0.4, 16)
    )
    fleet = walk(who, **standing)
    least = []
    for _ in range(120):
        places = np.column_stack([fleet.step((0.0, 0.0)).b["people"][0, :16, :2], np.zeros(16)])
        least.append(_core.clearance(empty.native, places, 0.3, np.empty((0, 2)), 1.0).min())
    assert min(least) > -0.025
    assert np.hypot(*(fleet.b["people"][0, :16, :2] - starts).T).mean() > 0.5, "they do walk"


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_who_does_not_look_does_not_turn_for_the_robot(share: float) -> None:
    """The robot stands in the way: a straight walk into it, or a way round it."""
    rows = course(walk(people([[(-3.0, 0.05), (4.0, 0.05)]], share=share), (0.0, 0.0, 0.0)), 40)
    bend = np.abs(rows[:, 0, Y] - 0.05).max()
    assert bend == 0.0 if share == 0.0 else bend > 0.1
    if share == 1.0:
        assert np.hypot(rows[:, 0, X], rows[:, 0, Y]).min() >= 0.5 - 1e-6


def test_a_greater_share_turns_more() -> None:
    bends = []
    for share in (0.0, 0.25, 0.5, 1.0):
        rows = course(walk(people([[(-3.0, 0.05), (4.0, 0.05)]], share=share), (0.0, 0.0, 0.0)), 3)
        bends.append(abs(rows[-1, 0, VY]))
    assert bends == sorted(bends)
    assert len(set(bends)) == 4


def test_who_stands_stays_and_others_go_round() -> None:
    who = people([[(0.0, 0.02)], [(-4.0, 0.0), (4.0, 0.0)]], speed_mps=[0.0, 1.2])
    rows = course(walk(who), 60)
    assert (rows[:, 0, :2] == (0.0, 0.02)).all()
    assert np.hypot(*(rows[:, 1, :2] - rows[:, 0, :2]).T).min() >= 0.6 - 1e-6
    assert rows[-1, 1, X] > 2.0


def test_reactions_are_held_between_decisions() -> None:
    who = people([[(-4.0, 0.1), (4.0, 0.1)], [(4.0, 0.0), (-4.0, 0.0)]], reaction_s=0.4)
    rows = course(walk(who), 40)
    changed = (np.diff(rows[:, 0, VX : VY + 1], axis=0) != 0.0).any(axis=1)
    assert changed.any()
    assert (np.diff(np.flatnonzero(changed)) % 4 == 0).all()


def test_who_is_held_up_turns_round() -> None:
    """A wall across the way, which no route should have: after a while the walker goes back."""
    wall = np.array([(1.0, -9.0, 1.0, 9.0)])
    rows = course(walk(people([[(-3.0, 0.0), (4.0, 0.0)]]), segments=wall), 150)
    assert (rows[:, 0, X] <= 0.7 + 1e-6).all()
    assert rows[60:, 0, X].min() < -2.0


def busy(**more: Any) -> Fleet:
    """Forty robots that drive among people, each with people of its own."""
    rng = np.random.default_rng(5)
    tasks = []
    for _ in range(40):
        who = crowd(rng, 8, reaction_s=rng.uniform(0.0, 0.4, 8), legs=True)
        place = World(bounds=BOUNDS, segments=enclosure(BOUNDS))
        tasks.append(a_task(place, (0.0, -6.0, 1.5), (0.0, 6.0), people=who))
    return Fleet(tasks, a_robot(), range_noise=0.01, **more).reset()


def test_any_number_of_threads_gives_equal_bytes() -> None:
    one, three = busy(), busy(num_threads=3)
    for _ in range(25):
        one.step((0.4, 0.2))
        three.step((0.4, 0.2))
    assert_equal_bytes(one.b, three.b)


def test_put_back_they_walk_on_to_the_byte() -> None:
    fleet, other = busy(), busy()
    for _ in range(9):
        fleet.step((0.4, 0.2))
    for name, array in fleet.b.items():
        other.b[name][:] = array
    for _ in range(9):
        fleet.step((0.4, -0.1))
        other.step((0.4, -0.1))
    assert_equal_bytes(fleet.b, other.b)


def test_the_seed_decides_when_they_decide() -> None:
    fleet = busy()
    first = fleet.b["people"].copy()
    fleet.b["seed"] += np.uint64(1)
    fleet.reset()
    assert (first[:, :, [X, Y]] == fleet.b["people"][:, :, [X, Y]]).all()
    assert (first[:, :, WAIT] != fleet.b["people"][:, :, WAIT]).any()


def test_people_far_from_the_robot_change_nothing_else() -> None:
    alone = Fleet([a_task(World(bounds=BOUNDS, segments=enclosure(BOUNDS)))], a_robot()).reset()
    among = walk(people([[(70.0, 0.0), (75.0, 0.0)]]), (0.0, 0.0, 0.0), segments=enclosure(BOUNDS))
    among.b["seed"][:] = alone.b["seed"]
    for _ in range(20):
        alone.step((0.6, 0.4))
        among.step((0.6, 0.4))
    for name in set(OUTPUTS) - {"people", "waypoint", "route_left", "memory"}:
        assert alone.b[name].tobytes() == among.b[name].tobytes(), name


def test_a_lidar_sees_bodies_or_legs_within_them() -> None:
    """Legs are behind the body's front; the robot keeps off the body either way."""
    for steps in range(0, 12, 3):
        seen = {}
        for legs in (False, True):
            who = people([[(2.0, 0.3), (2.0, 5.0)]], share=0.0, legs=legs)
            fleet = walk(who, (0.0, 0.3 + 0.12 * steps, 0.0))
            course(fleet, steps)
            seen[legs] = fleet.b["ranges"][0].min(), fleet.b["clearance"][0]
        assert seen[False][0] == pytest.approx(1.7, abs=1e-6)
        assert 1.7 <= seen[True][0] <= 6.0
        assert seen[True][1] == seen[False][1]


def test_legs_swing() -> None:
    who = people([[(2.0, -3.0), (2.0, 5.0)]], legs=True)
    fleet = Fleet([a_task(World(bounds=BOUNDS), people=who)], a_robot(beams=720)).reset()
    widths = []
    for _ in range(20):
        ranges = fleet.step((0.0, 0.0)).b["ranges"][0]
        widths.append(int((ranges < 5.9).sum()))
    assert len(set(widths)) > 4
    assert min(widths) > 0


def test_people_hit_the_robot_and_the_robot_hits_people() -> None:
    """The robot stops where it touches a body; it is at fault where it moved into it."""
    blind = people([[(3.0, 0.0), (-9.0, 0.0)]], share=0.0)
    ends = {}
    for speed in (0.0, 0.5, -0.5):
        fleet = walk(blind, (0.0, 0.0, 0.0))
        for _ in range(60):
            if not fleet.b["collided"][0]:
                fleet.step((speed, 0.0))
        gap = math.hypot(*(fleet.b["people"][0, 0, :2] - fleet.b["pose"][0, :2]))
        assert fleet.b["collided"][0]
        assert gap == pytest.approx(0.5, abs=3e-3)
        ends[speed] = bool(fleet.b["at_fault"][0])
    assert ends == {0.0: False, 0.5: True, -0.5: False}


@pytest.mark.parametrize("polygon", [False, True])
def test_whoever_drives_into_what_stands_is_at_fault(polygon: bool) -> None:
    still = World(bounds=BOUNDS, segments=np.array([(1.0, -9.0, 1.0, 9.0)]))
    for speed in (0.06, 0.5, 3.0):
        fleet = Fleet([a_task(still, (0.5, 0.0, 0.0))], a_robot(polygon=polygon)).reset()
        for _ in range(100):
            if not fleet.b["collided"][0]:
                fleet.step((speed, 0.0))
        assert fleet.b["collided"][0]
        assert fleet.b["at_fault"][0]


def test_a_planner_with_foresight_takes_people_to_walk_on() -> None:
    """One who will have left the path is no obstacle, and one who will come is."""
    from adrl.planning.local_control import LocalControl, dwa_config

    robot = a_robot(max_speed_mps=1.0)
    plans = {}
    for foresee in (True, False):
        who = people([[(1.2, -1.1), (1.2, 6.0)]], share=0.0)
        fleet = Fleet([a_task(World(bounds=BOUNDS), goal=(6.0, 0.0), people=who)], robot).reset()
        fleet.control = LocalControl(1, robot, dwa_config(robot), foresee=foresee)
        plans[foresee] = fleet.plan().tobytes()
    assert plans[True] != plans[False]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"radius_m": 0.05}, "radius_m"),
        ({"radius_m": math.nan}, "radius_m"),
        ({"speed_mps": 9.0}, "speed_mps"),
        ({"share": 1.5}, "share"),
        ({"reaction_s": -0.1}, "reaction_s"),
        ({"group": -2}, "group"),
    ],
)
def test_bad_people_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        people([[(0.0, 0.0), (1.0, 0.0)]], **changes)


def test_routes_must_lead_somewhere_and_there_is_room_for_64() -> None:
    with pytest.raises(ConfigError, match="routes"):
        people([[(0.0, 0.0)]])
    with pytest.raises(ConfigError, match="routes"):
        people([[(0.0, 0.0), (math.inf, 0.0)]])
    with pytest.raises(ConfigError, match="at most 64"):
        people([[(0.0, 0.0), (1.0, 0.0)]] * 65)
    discs = np.array([(0.0, 0.0, 1.0, 0.0, 0.2, 0.3, 0.0, math.inf)] * 5)
    place, who = World(bounds=BOUNDS, discs=discs), people([[(0.0, 0.0), (1.0, 0.0)]] * 60)
    with pytest.raises(ConfigError, match="at most 64"):
        a_task(place, people=who)
