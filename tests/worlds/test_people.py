"""People in scenarios: where they stand and walk, and what stays of the place."""

import math
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
import pytest

from adrl import _core
from adrl.errors import ConfigError, TaskError
from adrl.types import Task
from adrl.worlds import ROBOTS, SCENARIOS, Crowd, MapScenario, Peopled, task_set
from adrl.worlds.complex import Complex
from adrl.worlds.people import among_people
from adrl.worlds.place import Place

ROBOT = ROBOTS["diffbot"]
WITH_PEOPLE = ("crowd", "corridor", "doorway", "office")
DATA = Path(__file__).parents[1] / "data"


def clearance(task: Task, points: np.ndarray, radius_m: float) -> np.ndarray:
    poses = np.column_stack([points, np.zeros(len(points))])
    return _core.clearance(task.world.native, poses, radius_m, np.empty((0, 2)), 5.0)


@pytest.mark.parametrize("name", [*WITH_PEOPLE, "complex", "map"])
def test_people_stand_and_walk_where_there_is_room(name: str, maps: Path) -> None:
    place = MapScenario(maps / "turtlebot3_world" / "map.yaml") if name == "map" else SCENARIOS[name]
    for task in task_set(among_people(place, 8, None, False), ROBOT, "test", 4):
        who = task.people
        assert len(who) == 8
        starts = who.starts
        assert (np.hypot(*(starts - task.start[:2]).T) >= 1.5 + who.radius_m).all()
        for a, b in combinations(range(len(who)), 2):
            assert math.dist(starts[a], starts[b]) >= who.radius_m[a] + who.radius_m[b]
        for route, radius, speed in zip(who.routes, who.radius_m, who.speed_mps, strict=True):
            assert (len(route) >= 2) == (speed > 0.0)
            for a, b in pairwise([*route, route[-1]]):
                line = a + np.linspace(0.0, 1.0, 60)[:, None] * (b - a)
                assert clearance(task, line, float(radius)).min() > 0.0


@pytest.mark.parametrize("name", ["complex", "crowd"])
def test_the_place_stays_what_it_was_and_people_are_fixed_for_ever(name: str) -> None:
    scenario = among_people(SCENARIOS[name], 6, None, False)
    assert isinstance(scenario, Peopled)
    bare, populated = (task_set(one, ROBOT, "test", 3) for one in (scenario.place, scenario))
    (alone,) = task_set(scenario, ROBOT, "test", 1, 2)
    for one, other in zip(bare, populated, strict=True):
        assert (one.start, one.goal, one.shortest_m) == (other.start, other.goal, other.shortest_m)
        assert len(one.people) == 0
    for a, b in zip(alone.people.routes, populated[2].people.routes, strict=True):
        assert a.tobytes() == b.tobytes()
    (other,) = task_set(scenario, ROBOT, "validation", 1, 2)
    assert other.people.starts.tobytes() != alone.people.starts.tobytes()


def test_share_and_legs_change_nothing_else() -> None:
    scenario = Peopled(Complex(), Crowd(heedless=0.4))
    usual, other = (
        task_set(among_people(scenario, 12, share, legs), ROBOT, "test", 1)[0].people
        for share, legs in ((None, False), (0.0, True))
    )
    assert [route.tobytes() for route in usual.routes] == [route.tobytes() for route in other.routes]
    assert usual.speed_mps.tobytes() == other.speed_mps.tobytes()
    assert set(usual.share) == {0.0, 0.5}, "some do not look"
    assert set(other.share) == {0.0}
    assert (usual.legs, other.legs) == (False, True)


def test_who_they_are() -> None:
    """Over many tasks: some stand, some do not look, some walk together at one speed."""
    who = [
        task.people for task in task_set(among_people(SCENARIOS["crowd"], 16, None, False), ROBOT, "test", 25)
    ]
    speed, share, group = (
        np.concatenate([getattr(p, name) for p in who]) for name in ("speed_mps", "share", "group")
    )
    walks = speed > 0.0
    assert 0.05 < 1.0 - walks.mean() < 0.2
    assert 0.02 < (share == 0.0).mean() < 0.1
    assert 0.15 < (group[walks] >= 0).mean() < 0.45
    assert speed[walks].min() >= 0.5
    assert speed.max() <= 1.6
    for people in who:
        for k in set(people.group[people.group >= 0]):
            members = people.group == k
            assert len(set(people.speed_mps[members])) == 1


def test_names_tell_what_was_asked_for() -> None:
    names = [
        among_people(SCENARIOS["crowd"], count, share, legs).name
        for count, share, legs in ((0, None, False), (12, None, False), (12, 0.25, True), (0, 1.0, False))
    ]
    assert names == ["crowd", "crowd-12people", "crowd-12people-share0.25-legs", "crowd-share1"]
    assert among_people(Complex(), 3, None, False).name == "complex-3people"


def test_a_corridor_has_two_flows_and_a_doorway_is_walked_through() -> None:
    for task in task_set(SCENARIOS["corridor"], ROBOT, "test", 4):
        assert 2.0 <= task.world.bounds[3] <= 3.0
        ways = [np.sign(route[-1][0] - route[0][0]) for route in task.people.routes]
        assert {-1.0, 1.0} <= set(ways)
    for task in task_set(SCENARIOS["doorway"], ROBOT, "test", 4):
        middle = 0.5 * task.world.bounds[2]
        for route, speed in zip(task.people.routes, task.people.speed_mps, strict=True):
            assert speed == 0.0 or (route[0][0] - middle) * (route[-1][0] - middle) < 0.0


def test_crowds_cross_in_three_ways() -> None:
    """Through a circle's middle, in two streams, anywhere: the mean miss of the middle tells them apart."""
    misses = []
    for task in task_set(among_people(SCENARIOS["crowd"], 14, None, False), ROBOT, "test", 20):
        walks = [route for route in task.people.routes if len(route) > 1]
        off = [
            abs(np.cross([*(b - a), 0], [5.0 - a[0], 5.0 - a[1], 0])[2]) / math.dist(a, b)
            for a, *_, b in walks
        ]
        misses.append(np.median(off))
    assert min(misses) < 0.5
    assert max(misses) > 1.5


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"people": 65}, "people is 65; give 0 to 64"),
        ({"people": 2, "people_share": 1.5}, "people_share is 1.5; give 0 to 1"),
        ({"scenario": "complex", "legs": True}, "nobody walks in 'complex'; give --people too"),
        ({"scenario": "complex", "people_share": 0.5}, "nobody walks in 'complex'; give --people too"),
    ],
)
def test_bad_options_are_refused(settings: dict, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        Place(**settings).load()


def test_more_people_than_there_is_room_for_are_refused() -> None:
    with pytest.raises(TaskError, match="of 64 people found room; ask for fewer"):
        task_set(among_people(SCENARIOS["corridor"], 64, None, False), ROBOT, "test", 1)
    with pytest.raises(ConfigError, match="give 1 to 64"):
        Crowd(count=(0, 3))
