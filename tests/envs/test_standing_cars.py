"""Cars on a known map that do not get on: another path from where they stand, in the simulator and on a robot."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl.deploy import Navigator
from adrl.deploy.guidance import KnownMapGuide, View
from adrl.envs import NavSim
from adrl.errors import NoPath
from adrl.geometry import in_robot_frame
from adrl.observation import EncoderConfig
from adrl.planning import global_planner
from adrl.planning.standstill import GOT_ON_M, WAIT_S, Standstill
from adrl.types import RobotConfig, Task
from adrl.worlds import ROBOTS, single_task
from deploy.recorded import record
from env_tasks import room

CAR = RobotConfig(name="car", max_speed_mps=0.6, min_speed_mps=-0.3, min_turning_radius_m=0.6)
STAND = np.array([[-1.0 / 3.0, 0.0]], np.float32)
"""The action of no speed."""
AWAY = (-3.0, 0.0, 0.0)


def begun(robot: RobotConfig, guidance: str, task: Task) -> NavSim:
    sim = NavSim(1, robot, guidance=guidance)
    sim.reset(np.array([0]), [task], np.zeros(1, np.uint64), np.random.default_rng(0))
    return sim


def task_for(robot: RobotConfig) -> Task:
    return single_task(room(10.0), AWAY, (3.0, 1.0), robot)


def off_the_path(sim: NavSim) -> None:
    """The car stands across its path, as one that was pushed."""
    sim.b["pose"][0] = (-1.0, 1.5, 1.5)


def stand(sim: NavSim, seconds: float) -> None:
    for _ in range(round(seconds / sim.robot.control_period_s)):
        sim.step(STAND)


def test_a_car_that_stands_is_given_a_path_from_where_it_stands() -> None:
    task = task_for(CAR)
    sim = begun(CAR, "map", task)
    off_the_path(sim)
    stand(sim, WAIT_S)
    before = sim.b["waypoint"].copy()
    stand(sim, 0.5)
    assert np.abs(sim.b["waypoint"] - before).max() > 0.1
    path = global_planner.plan(task.world, tuple(sim.b["pose"][0].tolist()), task.goal, CAR)
    assert sim.b["route_left"][0] == pytest.approx(global_planner.length_m(path), abs=0.05)


@pytest.mark.parametrize(
    ("robot", "guidance"), [(ROBOTS["diffbot"], "map"), (CAR, "goal")], ids=["turns on the spot", "no map"]
)
def test_others_are_not(robot: RobotConfig, guidance: str) -> None:
    sim = begun(robot, guidance, task_for(robot))
    left = sim.b["route_left"].copy()
    still = np.array([[-1.0 if robot.min_speed_mps == 0.0 else STAND[0, 0], 0.0]], np.float32)
    for _ in range(60):
        sim.step(still)
    np.testing.assert_allclose(sim.b["route_left"], left, atol=1e-6)
    assert np.isinf(sim.state()["path_from"]).all()


def test_a_car_that_gets_on_keeps_its_path() -> None:
    task = single_task(room(20.0), (-8.0, 0.0, 0.0), (8.0, 0.0), CAR)
    sim = begun(CAR, "map", task)
    for _ in range(round(4 * WAIT_S / CAR.control_period_s)):
        sim.step(np.array([[0.0, 0.0]], np.float32))
    assert np.isinf(sim.state()["path_from"]).all()


def test_where_there_is_no_way_it_keeps_the_path_it_has(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def none(*where: object) -> None:
        asked.append(where)
        raise NoPath("nowhere")

    sim = begun(CAR, "map", task_for(CAR))
    off_the_path(sim)
    stand(sim, 0.1)
    monkeypatch.setattr("adrl.envs.nav_sim.plan", none)
    left = sim.b["route_left"].copy()
    stand(sim, 2 * WAIT_S + 0.5)
    assert len(asked) == 2, "once each WAIT_S"
    np.testing.assert_allclose(sim.b["route_left"], left, atol=1e-6)


def test_its_state_goes_on_to_the_same_bytes() -> None:
    """Far along its new path too, where it is looked for in a window alone."""
    task = single_task(room(24.0), (-10.0, 0.0, 0.0), (10.0, 1.0), CAR)
    first, second = begun(CAR, "map", task), begun(CAR, "map", task)
    first.b["pose"][0] = (-9.0, 2.0, 0.3)
    stand(first, WAIT_S + 1.0)
    assert np.isfinite(first.state()["path_from"]).all()
    for _ in range(150):
        x, y = in_robot_frame(first.b["pose"][0], first.b["waypoint"][0])
        first.step(np.array([[1.0, np.clip(np.arctan2(y, x), -1.0, 1.0)]], np.float32))
    assert first.b["memory"][0, 0] > 4.0
    second.set_state(first.state(), first.tasks)
    assert second.observe().tobytes() == first.observe().tobytes()
    for k in range(60):
        for name, array in first.state().items():
            assert array.tobytes() == second.state()[name].tobytes(), name
        action = np.array([[0.8, np.sin(0.3 * k)]], np.float32)
        for sim in (first, second):
            sim.step(action)


def test_another_goal_under_way_begins_a_path_of_its_own() -> None:
    sim = begun(CAR, "map", task_for(CAR))
    off_the_path(sim)
    stand(sim, WAIT_S + 1.0)
    sim.set_task(0, single_task(room(10.0), (-1.0, 1.5, 1.5), (-3.0, -3.0), CAR))
    assert np.isinf(sim.state()["path_from"]).all()
    assert sim.b["memory"][0, 0] == 0.0


def test_where_a_disc_began_a_car_is_helped() -> None:
    """It has moved on since, and no robot's map shows it."""
    disc = np.array([[-1.0, 1.5, -1.0, 4.5, 0.3, 0.5, 0.0, np.inf]])
    world = dataclasses.replace(room(10.0), discs=disc)
    sim = begun(CAR, "map", dataclasses.replace(task_for(CAR), world=world))
    stand(sim, 2.0)
    off_the_path(sim)
    stand(sim, WAIT_S + 0.5)
    assert not sim.b["collided"][0]
    assert np.isfinite(sim.state()["path_from"]).all()


def test_the_next_task_begins_with_its_own_path() -> None:
    task = task_for(CAR)
    sim = begun(CAR, "map", task)
    off_the_path(sim)
    stand(sim, WAIT_S + 1.0)
    sim.reset(np.array([0]), [task], np.zeros(1, np.uint64), np.random.default_rng(0))
    assert sim.b["route_left"][0] == pytest.approx(global_planner.length_m(task.path), abs=1e-6)
    assert np.isinf(sim.state()["path_from"]).all()


class Stands:
    """A policy that drives on a circle off its path, stands, and drives on. It notes where a simulator leads."""

    encoder = EncoderConfig()

    def __init__(self, sim: NavSim | None = None) -> None:
        self._sim, self._asked = sim, 0
        self.waypoints: list[np.ndarray] = []

    def act(self, observation: np.ndarray) -> np.ndarray:
        self._asked += 1
        if self._sim is not None:
            self.waypoints.append(self._sim.b["waypoint"][0].copy())
        return STAND if 20 < self._asked < 80 else np.array([[0.8, 0.6]], np.float32)


def changes(waypoints: np.ndarray, least_m: float = 0.3) -> list[int]:
    """Steps at which the waypoint jumps."""
    return np.flatnonzero(np.hypot(*np.diff(waypoints, axis=0).T) > least_m).tolist()


def test_a_robot_is_led_as_in_the_simulator() -> None:
    """Both plan anew at the same time, to the same path."""
    car = dataclasses.replace(CAR, lidar=dataclasses.replace(CAR.lidar, noise_std_m=0.0))
    task = single_task(room(12.0), AWAY, (3.0, 1.0), car)
    sim = NavSim(1, car, guidance="map")
    policy = Stands(sim)
    moments = record(sim, policy, task, 100)
    assert len(moments) == 100
    theirs = np.array(policy.waypoints)
    assert any(20 < step < 80 for step in changes(theirs)), "else this shows nothing"
    navigator = Navigator(Stands(), robot=car, guidance="map", world=task.world, supervisor=None)
    navigator.set_goal(task.goal)
    ours = [
        navigator.step(m.scan, m.odometry, k * car.control_period_s, map_pose=m.map_pose).waypoint
        for k, m in enumerate(moments)
    ]
    np.testing.assert_allclose(np.array(ours, float), theirs, atol=1e-6)


def test_a_robot_that_was_held_or_whose_clock_went_back_waits_anew() -> None:
    task = single_task(room(12.0), AWAY, (3.0, 1.0), CAR)
    guide = KnownMapGuide(task.world, CAR, task.goal_tolerance_m)
    guide.set_goal()

    def paths(times_s: list[float]) -> int:
        """How many paths it has had."""
        had = []
        for now_s in times_s:
            view = View(
                ranges=np.empty((1, 0), np.float32), reckoned=np.zeros((1, 3)), place=AWAY, now_s=now_s
            )
            guide.head_for(view, task.goal)
            had.append(guide.head_for(view, task.goal).plan.tobytes() and id(guide._map.path))
        return len(set(had))

    assert paths([100.0, 101.0]) == 1
    assert paths([111.0, 111.5]) == 1, "held for 10 s"
    assert paths([50.0, 51.0, 52.0, 52.9]) == 1, "the clock went back"
    assert paths([53.0, 53.5]) == 2


@given(st.lists(st.floats(0.0, 20.0), min_size=1, max_size=80))
def test_who_gets_on_does_not_stand(left_m: list[float]) -> None:
    """It stands where nothing in the last WAIT_S was less than all before by GOT_ON_M."""
    period, watch = 0.25, Standstill(1)
    watch.begin(np.array([0]), 20.0, 0.0)
    least, since = 20.0, 0.0
    for k, left in enumerate(left_m, 1):
        stands = watch.update(np.array([left]), np.array([k * period]))[0]
        if left < least - GOT_ON_M:
            least, since = left, k * period
        assert stands == (k * period - since > WAIT_S + 1e-6)
