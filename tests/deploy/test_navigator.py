"""The runtime is the simulator's guidance, encoder and policy: equal actions on recorded scans."""

import dataclasses
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from adrl.deploy import MlpPolicy, Navigator, Odometry, Pose, Scan, SupervisorConfig
from adrl.deploy.another_robot import as_trained
from adrl.envs import NavSim
from adrl.errors import AdrlError, ConfigError
from adrl.observation import EncoderConfig, to_twist
from adrl.observation.motion import F32
from adrl.planning.replanner_config import ReplannerConfig
from adrl.types import LidarConfig, RobotConfig, Task, World
from adrl.worlds import FAMILIES, ROBOTS, get_scenario, single_task, task_set
from adrl.worlds.people import among_people
from deploy.recorded import Moment, a_policy, a_policy_of_a_family, record
from env_tasks import room

DRIFTING = dataclasses.replace(ROBOTS["diffbot"], odometry_drift=0.05)


def replay(navigator: Navigator, moments: list[Moment]) -> F32:
    """(T, 2) commands of the runtime on what was recorded."""
    period_s = navigator.robot.control_period_s
    commands = [
        navigator.step(m.scan, m.odometry, k * period_s, map_pose=m.map_pose) for k, m in enumerate(moments)
    ]
    driven = [command.twist for command in commands if command.status == "driving"]
    # It ends where odometry, which drifts, says that the goal is reached.
    assert {command.status for command in commands[len(driven) :]} <= {"reached", "idle"}
    return np.array(driven, dtype=np.float32)


def driven(
    robot: RobotConfig,
    guidance: str,
    task: Task,
    history_steps: int,
    steps: int = 250,
    policy: MlpPolicy | None = None,
):
    """The runtime's commands, those of the simulator, and the simulator."""
    policy = policy or a_policy(robot, history_steps=history_steps)
    encoder = EncoderConfig(**policy.config.encoder)
    sim = NavSim(
        1,
        robot,
        guidance=guidance,
        encoder=encoder,
        maturity=policy.config.maturity,
        replanner=ReplannerConfig(),
    )
    moments = record(sim, policy, task, steps)
    world = task.world if guidance == "map" else None
    navigator = Navigator(policy, robot=robot, guidance=guidance, world=world, supervisor=None)
    # A car that stands is given another path, but not where it was told to follow this one.
    given = guidance == "map" and not robot.is_car
    navigator.set_goal(task.goal, task.path if given else None)
    ours = replay(navigator, moments)
    theirs = to_twist(np.array([m.action for m in moments]), robot)
    return ours, theirs, sim


@pytest.mark.parametrize("history_steps", [0, 5])
@pytest.mark.parametrize("guidance", ["goal", "map"])
@pytest.mark.parametrize(
    "robot", [DRIFTING, ROBOTS["jackal"], ROBOTS["turtlebot3_burger"]], ids=lambda r: r.name
)
def test_commands_are_those_of_the_simulator(robot: RobotConfig, guidance: str, history_steps: int):
    (task,) = task_set(get_scenario("dynamic"), robot, "test", 1)
    ours, theirs, _ = driven(robot, guidance, task, history_steps)
    assert len(ours) > 20
    np.testing.assert_allclose(ours, theirs[: len(ours)], atol=1e-5)


@pytest.mark.parametrize("history_steps", [0, 2])
def test_commands_are_those_of_the_simulator_with_tracks(history_steps: int):
    (task,) = task_set(among_people(get_scenario("crowd"), 12, None, legs=False), DRIFTING, "test", 1)
    policy = a_policy(DRIFTING, history_steps=history_steps, num_tracks=3)
    ours, theirs, _ = driven(DRIFTING, "goal", task, history_steps, policy=policy)
    assert len(ours) > 20
    np.testing.assert_allclose(ours, theirs[: len(ours)], atol=1e-5)


@pytest.mark.parametrize("guidance", ["goal", "map", "replan"])
def test_commands_are_those_of_the_simulator_with_the_path_ahead(guidance: str):
    (task,) = task_set(get_scenario("complex"), DRIFTING, "test", 1)
    policy = a_policy(DRIFTING, path=True)
    ours, theirs, sim = driven(DRIFTING, guidance, task, 0, steps=300, policy=policy)
    assert len(ours) > 100
    if sim.replanner is not None:
        assert sim.replanner.replans[0] > 0
    np.testing.assert_allclose(ours, theirs[: len(ours)], atol=1e-5)


@pytest.mark.parametrize("number", range(6))
def test_a_policy_of_a_family_commands_each_robot_as_in_the_simulator(number: int):
    robot = FAMILIES["any"].draw("test", number)
    policy = a_policy_of_a_family(history_steps=2, path=True)
    (task,) = task_set(get_scenario("dynamic"), robot, "test", 1)
    ours, theirs, _ = driven(robot, "map", task, 2, policy=policy)
    assert len(ours) > 5
    assert np.ptp(theirs[:, 1]) > 0.0
    np.testing.assert_allclose(ours, theirs[: len(ours)], atol=2e-5)


def test_a_policy_of_a_family_says_which_numbers_of_a_robot_it_does_not_know():
    policy = a_policy_of_a_family()
    assert Navigator(policy, robot=ROBOTS["jackal"], guidance="goal").other_robot is None
    slow = dataclasses.replace(ROBOTS["jackal"], max_speed_mps=0.1, max_acceleration_mps2=0.5)
    told = Navigator(policy, robot=slow, guidance="goal").other_robot
    assert told is not None
    assert "max_speed_mps 0.1; the family has 0.2 to 2" in told
    with pytest.raises(ConfigError, match="does not say which robot it drives; give robot"):
        Navigator(policy, guidance="goal")


@pytest.mark.parametrize("history_steps", [0, 5])
def test_commands_are_those_of_the_simulator_when_stuck(history_steps: int):
    """Behind a wall the replanner takes over; its routes are the same too."""
    wall = np.array([[0.0, -2.0, 0.0, 2.0], [-1.5, -2.0, 0.0, -2.0], [-1.5, 2.0, 0.0, 2.0]])
    task = single_task(World(bounds=(-5, -5, 5, 5), segments=wall), (-1.0, 0.0, 0.0), (2.0, 0.0), DRIFTING)
    ours, theirs, sim = driven(DRIFTING, "replan", task, history_steps, steps=300)
    assert sim.replanner is not None
    assert sim.replanner.replans[0] > 0
    assert len(ours) > 100
    np.testing.assert_allclose(ours, theirs[: len(ours)], atol=1e-5)


def test_a_path_of_its_own_is_the_simulators():
    """Without a path it plans as tasks are planned."""
    robot = ROBOTS["diffbot"]
    (drawn,) = task_set(get_scenario("complex"), robot, "test", 1)
    task = single_task(drawn.world, drawn.start, drawn.goal, robot)
    policy = a_policy(robot)
    moments = record(NavSim(1, robot, guidance="map"), policy, task, 100)
    navigator = Navigator(policy, guidance="map", world=task.world, supervisor=None)
    navigator.set_goal(task.goal)
    theirs = to_twist(np.array([m.action for m in moments]), robot)
    np.testing.assert_allclose(replay(navigator, moments), theirs, atol=1e-5)


def still(at: Pose, now_s: float) -> tuple[Scan, Odometry]:
    """What a robot that stands in the open receives."""
    ranges = np.full(180, 4.0) + 1e-3 * np.sin(now_s + np.arange(180.0))
    around = Scan(
        ranges=ranges, angle_min_rad=-np.pi, angle_increment_rad=np.pi / 90, range_max_m=6.0, stamp_s=now_s
    )
    return around, Odometry(pose=at, twist=(0.0, 0.0), stamp_s=now_s)


def test_a_jump_of_localisation_plans_anew():
    """And driving does not."""
    navigator = Navigator(a_policy(ROBOTS["diffbot"]), guidance="map", world=room())
    navigator.set_goal((4.0, 0.0))
    scan, odometry = still((0.0, 0.0, 0.0), 0.0)
    first = navigator.step(scan, odometry, 0.0, map_pose=(-4.0, 0.0, 0.0)).plan
    np.testing.assert_allclose(first[0], (-4.0, 0.0))
    scan, odometry = still((0.0, 0.0, 0.0), 0.1)
    command = navigator.step(scan, odometry, 0.1, map_pose=(-4.0, 4.0, 0.0))
    np.testing.assert_allclose(command.plan[0], (-4.0, 4.0))
    assert command.distance_m == pytest.approx(np.hypot(8.0, 4.0), abs=0.1)


def test_localisation_that_jumps_across_the_goal_has_not_reached_it():
    """Driving across it between two steps has."""
    goal, ends = (0.0, 0.0), []
    for beyond_m in (3.0, 0.06):
        navigator = Navigator(
            a_policy(ROBOTS["diffbot"]), guidance="map", world=room(), goal_tolerance_m=0.02
        )
        navigator.set_goal(goal)
        assert (
            navigator.step(*still((0.0, 0.0, 0.0), 0.0), 0.0, map_pose=(-0.05, 0.0, 0.0)).status == "driving"
        )
        command = navigator.step(*still((0.0, 0.0, 0.0), 0.1), 0.1, map_pose=(beyond_m, 0.0, 0.0))
        ends.append(command.status)
    assert ends == ["driving", "reached"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"guidance": "map"}, "needs a map"),
        ({"guidance": "goal", "world": room()}, "uses no map"),
        ({"guidance": "maps"}, "did you mean 'map'"),
    ],
)
def test_guidance_and_map_belong_together(options: dict[str, Any], message: str):
    with pytest.raises(AdrlError, match=message):
        Navigator(a_policy(ROBOTS["diffbot"]), **options)


def test_goals_are_checked_when_they_are_set():
    navigator = Navigator(a_policy(ROBOTS["diffbot"]), guidance="goal")
    with pytest.raises(ConfigError, match="not finite"):
        navigator.set_goal((np.nan, 0.0))
    with pytest.raises(ConfigError, match="follows no path"):
        navigator.set_goal((1.0, 0.0), np.zeros((2, 2)))
    mapped = Navigator(a_policy(ROBOTS["diffbot"]), guidance="map", world=room())
    for path in (np.empty((0, 2)), np.array([[0.0, np.nan]]), np.zeros((3, 3)), np.zeros(2)):
        for one in (mapped, Navigator(a_policy(ROBOTS["diffbot"]), guidance="path")):
            with pytest.raises(ConfigError, match="the path has shape"):
                one.set_goal((1.0, 0.0), path)
    short: Any = (0.0, 0.0)
    for mount in (short, (np.nan, 0.0, 0.0)):
        with pytest.raises(ConfigError, match="mount"):
            Navigator(a_policy(ROBOTS["diffbot"]), guidance="goal", mount=mount)
    for tolerance_m in (0.0, -1.0, np.nan):
        with pytest.raises(ConfigError, match="goal_tolerance_m"):
            Navigator(a_policy(ROBOTS["diffbot"]), guidance="goal", goal_tolerance_m=tolerance_m)


def test_a_goal_given_while_the_robot_turns_is_driven_to():
    """A little farther, with the same heading: it has not been reached yet."""
    navigator = Navigator(a_policy(ROBOTS["diffbot"]), guidance="goal", supervisor=None)
    navigator.set_goal((1.0, 0.0), yaw_rad=1.5)
    navigator.step(*still((0.75, 0.0, 0.0), 0.0), 0.0)
    assert navigator.is_turning
    navigator.set_goal((1.29, 0.0), yaw_rad=1.5)
    command = navigator.step(*still((0.75, 0.0, 0.0), 0.1), 0.1)
    assert not navigator.is_turning
    assert command.distance_m == pytest.approx(0.54)


def test_what_it_says_of_itself():
    """No goal, no sensors, at the goal."""
    navigator = Navigator(a_policy(ROBOTS["diffbot"]), guidance="goal")
    assert navigator.step(*still((0.0, 0.0, 0.0), 0.0), 0.0).status == "idle"
    navigator.set_goal((2.0, 0.0))
    command = navigator.step(*still((0.0, 0.0, 0.0), 0.1), 0.1)
    assert (command.status, command.waypoint, command.distance_m) == ("driving", (2.0, 0.0), 2.0)
    command = navigator.step(None, None, 0.5)
    assert (command.status, command.twist) == ("stopped", (0.0, 0.0))
    assert set(command.reasons) == {"scan_stale", "odometry_stale"}
    navigator.set_goal((0.1, 0.0))
    assert navigator.step(*still((0.05, 0.0, 0.0), 0.6), 0.6).status == "reached"
    assert navigator.step(*still((0.0, 0.0, 0.0), 0.7), 0.7).status == "idle"


def test_a_robot_needs_numpy_safetensors_msgspec_and_the_core_only():
    """With every other package out of reach it loads the shipped policy and drives."""
    code = """
import sys
class Only:
    def find_spec(self, name, path=None, target=None):
        top = name.partition('.')[0]
        ours = top in {'numpy', 'safetensors', 'msgspec', 'adrl'} or top.startswith('_adrl')
        if ours or top in sys.stdlib_module_names:
            return None
        raise ModuleNotFoundError(f'no {name} on a robot')
sys.meta_path.insert(0, Only())
import math
from adrl.deploy import Navigator, Odometry, Scan
navigator = Navigator.load('diffbot', guidance='replan')
navigator.set_goal((3.0, 0.0))
scan = Scan(ranges=[4.0] * 180, angle_min_rad=-math.pi, angle_increment_rad=math.tau / 180, range_max_m=6.0,
            stamp_s=0.0)
command = navigator.step(scan, Odometry(pose=(0, 0, 0), twist=(0, 0), stamp_s=0.0), 0.0)
print(command.status, command.twist[0] > 0.0)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["driving", "True"], done.stderr


class Says:
    """A policy that says what it is told to, and remembers what it was told that it did."""

    def __init__(self, navigator: Navigator, actions: list[tuple[float, float]]) -> None:
        self._actions, self.told = list(actions), []
        sectors = EncoderConfig(**navigator.policy.config.encoder).num_sectors
        self._last = slice(sectors + 6, sectors + 8)
        navigator.policy.act = self

    def __call__(self, observation: F32) -> F32:
        self.told.append(observation[0, self._last].tolist())
        return np.array([self._actions.pop(0)], np.float32)


STANDS = (-1.0, 0.0)
"""The action that asks diffbot to stand."""


@pytest.mark.parametrize("supervisor", [SupervisorConfig(), None])
@pytest.mark.parametrize("bad", [(np.nan, 0.0), (0.0, np.inf), (-np.inf, np.nan)])
def test_an_action_that_is_not_finite_costs_one_step(
    bad: tuple[float, float], supervisor: SupervisorConfig | None
):
    """It stands and says so; the next step drives, and the policy is told that it stood."""
    navigator = Navigator(a_policy(ROBOTS["diffbot"]), guidance="goal", supervisor=supervisor)
    navigator.set_goal((5.0, 0.0))
    policy = Says(navigator, [(0.5, 0.0), bad, (0.5, 0.0), (0.5, 0.0)])
    commands = [navigator.step(*still((1e-3 * k, 0.0, 0.0), 0.1 * k), 0.1 * k) for k in range(4)]
    assert [c.status for c in commands] == ["driving", "stopped", "driving", "driving"]
    assert commands[1].twist == (0.0, 0.0)
    assert commands[1].reasons == ("command_invalid",)
    assert commands[2].twist[0] > 0.0
    np.testing.assert_allclose(policy.told, [STANDS, (0.5, 0.0), STANDS, (0.5, 0.0)], atol=1e-6)


def test_the_policy_is_told_what_the_base_was_told():
    """A LiDAR that looks back only: no driving ahead (unseen). What was never sent was never done."""
    navigator = Navigator(a_policy(ROBOTS["diffbot"]), guidance="goal")
    navigator.set_goal((5.0, 0.0))
    policy = Says(navigator, [(0.9, 0.0)] * 3)
    for k in range(3):
        around, odometry = still((1e-3 * k, 0.0, 0.0), 0.1 * k)
        behind = dataclasses.replace(around, ranges=around.ranges[:100], angle_min_rad=0.55 * np.pi)
        behind = dataclasses.replace(behind, angle_increment_rad=0.9 * np.pi / 100)
        command = navigator.step(behind, odometry, 0.1 * k)
        assert command.twist == (0.0, 0.0)
        assert "unseen" in command.reasons
    np.testing.assert_allclose(policy.told, [STANDS] * 3, atol=1e-6)


BIG = dataclasses.replace(
    ROBOTS["diffbot"],
    name="big",
    radius_m=0.31,
    max_speed_mps=0.9,
    min_speed_mps=-0.3,
    control_period_s=0.05,
    lidar=LidarConfig(num_beams=541, fov_rad=1.5 * np.pi, max_range_m=25.0, mount_x_m=0.1),
)


def test_on_another_robot_the_policy_sees_shares_of_its_speeds_and_its_own_scale_of_distances():
    """The robot that drives is what supervisor and LiDAR belong to; it is said what is other."""
    policy = a_policy(ROBOTS["diffbot"])
    navigator = Navigator(policy, guidance="goal", robot=BIG)
    assert navigator.robot == BIG
    assert navigator.supervisor is not None
    assert navigator.supervisor.robot == BIG
    assert navigator.other_robot is not None
    for number in (
        "radius_m 0.31 instead of 0.2",
        "max_speed_mps 0.9 instead of 0.6",
        "lidar.max_range_m 25",
    ):
        assert number in navigator.other_robot
    navigator.set_goal((5.0, 0.0))
    says = Says(navigator, [(1.0, 0.5), (-1.0, 0.0)])
    seen, twists = [], []
    act = navigator.policy.act
    navigator.policy.act = lambda observation: (seen.append(observation[0].copy()), act(observation))[1]
    for k, speed in enumerate((0.45, 0.45)):
        around, odometry = still((0.45 * 0.05 * k, 0.0, 0.0), 0.05 * k)
        odometry = dataclasses.replace(odometry, twist=(speed, 0.0))
        twists.append(navigator.step(around, odometry, 0.05 * k).twist)
    sectors = 36
    assert seen[0][sectors + 4] == pytest.approx(0.5)  # half of its greatest speed
    # 4 m from the LiDAR straight ahead, in a scale that ends at the trained LiDAR's 6 m.
    ahead = np.log1p((4.0 - 0.21) / 0.3) / np.log1p(6.0 / 0.3)
    assert seen[0][sectors // 2] == pytest.approx(ahead, abs=0.01)
    assert twists[0][0] > 0.45
    assert 0.0 <= twists[1][0] < 0.45  # its own robot does not reverse: the least action stands
    assert says.told[1] == pytest.approx((1.0, 0.5))


def test_on_its_own_robot_nothing_is_other():
    for robot in (ROBOTS["diffbot"], dataclasses.replace(ROBOTS["diffbot"], min_speed_mps=-0.2)):
        assert Navigator(a_policy(robot), guidance="goal", robot=robot).other_robot is None
        assert as_trained(robot, robot) == robot
