"""The Python API, with scenarios, robots and policies of the user's own."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import adrl
from adrl.agents.config import Td3Config, TrainConfig
from adrl.deploy.policy import MlpPolicy
from adrl.errors import CheckpointError, ConfigError
from adrl.types import LidarConfig, RobotConfig, Task, World
from adrl.worlds.shapes import enclosure
from adrl.worlds.tasks import single_task
from small_run import finished_run


class Corridor:
    """A hall of 8 m x 4 m; the goal is 5 m ahead of the robot."""

    name = "corridor"

    def task(self, rng: np.random.Generator, robot: RobotConfig) -> Task:
        bounds = (0.0, 0.0, 8.0, 4.0)
        y = float(rng.uniform(1.5, 2.5))
        return single_task(World(bounds=bounds, segments=enclosure(bounds)), (1.0, y, 0.0), (6.0, y), robot)


class Act:
    """The same action always."""

    def __init__(self, speed: float, yaw_rate: float = 0.0) -> None:
        self.action = np.array([speed, yaw_rate], np.float32)
        self.sizes: set[int] = set()

    def act(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        self.sizes.add(observation.shape[1])
        return np.tile(self.action, (len(observation), 1))


CART = RobotConfig(name="cart", radius_m=0.15, max_speed_mps=1.0, lidar=LidarConfig(num_beams=24))


@pytest.fixture
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished_run(tmp_path_factory)


def test_train_on_own_scenario_and_robot(tmp_path: Path) -> None:
    config = adrl.RunConfig(
        scenario=Corridor(),  # pyright: ignore[reportArgumentType]
        robot=CART,
        out=tmp_path / "run",
        num_envs=16,
        task_pool=4,
        demonstration_steps=1024,
        learner=adrl.TrainConfig(
            steps=1024, start_steps=256, pretrain_updates=8, td3=Td3Config(widths=(16, 16), batch_size=64)
        ),
    )
    fractions: list[float] = []
    result = adrl.train(config, on_progress=lambda progress: fractions.append(progress.fraction))
    assert result.env_steps == 1024
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    policy = adrl.load_policy(tmp_path / "run")
    assert policy.config.robot["name"] == "cart"
    summary = adrl.evaluate(policy, scenario=Corridor(), episodes=4).summary
    assert (summary["robot"], summary["scenario"], summary["episodes"]) == ("cart", "corridor", 4)


def test_folder_and_loaded_policy_drive_alike(run: Path) -> None:
    policy = adrl.load_policy(run)
    assert isinstance(policy, MlpPolicy)
    results = [adrl.evaluate(choice, episodes=6).summary for choice in (run, str(run), policy)]
    assert results[0] == results[1] == results[2]


def test_the_number_of_threads_changes_nothing(run: Path) -> None:
    results = [adrl.evaluate(run, episodes=6, num_threads=threads).summary for threads in (1, 2)]
    assert results[0] == results[1]


def test_the_planner_solves_the_corridor() -> None:
    result = adrl.evaluate("astar-dwa", scenario=Corridor(), robot=CART, episodes=4, record=2)
    assert result.summary["success"] == 1.0
    assert result.summary["optimality"] == pytest.approx(1.0, abs=0.1)
    assert len(result.tasks) == 4
    for route, task in zip(result.rollout.routes, result.tasks[:2], strict=True):
        assert np.allclose(route[0], task.start[:2])
    assert len(result.rollout.routes) == 2


def test_own_policies_end_as_they_must() -> None:
    straight, still = Act(1.0), Act(-1.0)
    ahead = adrl.evaluate(straight, scenario=Corridor(), robot=CART, episodes=4).summary
    assert (ahead["success"], ahead["method"], ahead["policy"]) == (1.0, "external", "Act")
    assert len(straight.sizes) == 1
    waiting = adrl.evaluate(still, scenario=Corridor(), robot=CART, episodes=4)
    assert waiting.summary["timeout"] == 1.0
    assert np.allclose(waiting.rollout.episodes.distance_m, 0.0, atol=1e-6)
    limit_s = [task.time_limit_s for task in waiting.tasks]
    assert np.allclose(waiting.rollout.episodes.time_s, limit_s, atol=CART.control_period_s)


def test_running_into_the_wall_is_a_collision() -> None:
    tasks = [
        single_task(task.world, (1.0, task.start[1], 3.14159), task.goal, CART)
        for task in adrl.evaluate("astar-dwa", scenario=Corridor(), robot=CART, episodes=2).tasks
    ]
    summary = adrl.evaluate(Act(1.0), scenario=Corridor(), robot=CART, tasks=tasks).summary
    assert summary["collision"] == 1.0


def test_tasks_of_a_split_do_not_depend_on_their_number() -> None:
    few, many = (adrl.evaluate("astar-dwa", episodes=count).tasks for count in (2, 4))
    assert [task.start for task in few] == [task.start for task in many[:2]]


def test_what_evaluate_refuses(run: Path, tmp_path: Path) -> None:
    for bad in ({"episodes": 0}, {"seed": -1}, {"num_threads": -1}):
        with pytest.raises(ConfigError, match=next(iter(bad))):
            adrl.evaluate("astar-dwa", **bad)  # pyright: ignore[reportArgumentType]
    with pytest.raises(CheckpointError, match="absent"):
        adrl.evaluate(tmp_path / "absent")


@pytest.mark.parametrize(
    "actions", [None, np.zeros(2), np.zeros((2, 3)), np.full((2, 2), np.nan), np.zeros((1, 2))]
)
def test_what_is_no_action_is_told_with_the_policys_name(actions: object) -> None:
    act = Act(0.0)
    act.act = lambda observation: actions  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(ConfigError, match=r"policy Act gave .* give \(2, 2\) numbers"):
        adrl.evaluate(act, scenario=Corridor(), robot=CART, episodes=2)


def test_what_cannot_act_is_no_policy() -> None:
    with pytest.raises(ConfigError, match="policy 7 has no act"):
        adrl.evaluate(7)  # pyright: ignore[reportArgumentType]


def test_a_run_needs_an_end(tmp_path: Path) -> None:
    config = adrl.RunConfig(out=tmp_path / "run")
    with pytest.raises(ConfigError, match="max-seconds"):
        adrl.train(config)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("there", [False, True], ids=["new folder", "folder of before"])
def test_a_training_that_makes_no_policy_leaves_nothing_that_looks_like_a_run(
    there: bool, tmp_path: Path
) -> None:
    out = tmp_path / "runs" / "mine"
    if there:
        out.mkdir(parents=True)
    learner = TrainConfig(steps=64, start_steps=10_000, pretrain_updates=0, td3=Td3Config(widths=(8,)))
    config = adrl.RunConfig(
        scenario=Corridor(),  # pyright: ignore[reportArgumentType]
        method="td3",
        num_envs=8,
        task_pool=2,
        out=out,
        learner=learner,
    )
    with pytest.raises(ConfigError, match="no policy: 64 environment steps"):
        adrl.train(config)
    assert [path.name for path in tmp_path.rglob("*")] == (["runs", "mine"] if there else [])


def test_settings_are_checked_when_they_are_made() -> None:
    with pytest.raises(ConfigError, match="num_beams"):
        dataclasses.replace(CART.lidar, num_beams=0)
    with pytest.raises(ConfigError, match="num_envs"):
        adrl.RunConfig(num_envs=0)
