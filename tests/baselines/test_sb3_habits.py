"""Our habits in Stable-Baselines3's algorithms: each does what it does in our learner, and nothing else changes."""

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box

from adrl.agents.config import Td3Config, TrainConfig
from adrl.agents.failures import FAILURE_STEPS
from adrl.baselines import SB3_METHODS
from adrl.deploy.policy import PolicyConfig, load_policy
from adrl.envs import NavVectorEnv
from adrl.types import RobotConfig
from adrl.worlds import single_task
from env_tasks import OneTask, quiet, room, straight_task

# On a laptop without it these are skipped; in CI the import below fails.
if os.environ.get("CI") != "true":
    pytest.importorskip("stable_baselines3")

import torch

from adrl.baselines.sb3 import ALGORITHMS, Sb3VecEnv, acting, make_model, to_policy, train_sb3
from adrl.baselines.sb3_habits import HabitReplay, averaged

OFF_POLICY = ("TD3", "SAC")
NUM_ENVS = 8
FAILURE_SHARE = 0.25
NETWORKS = ("actor", "critic", "actor_target", "critic_target")


def small(**options: Any) -> TrainConfig:
    td3 = Td3Config(widths=(16, 12), batch_size=16, gamma=0.95, n_step=1)
    return TrainConfig(**{"steps": 64 * NUM_ENVS, "start_steps": 80, "td3": td3} | options)


def beside_a_pillar(side: float, time_limit_s: float = 60.0) -> NavVectorEnv:
    """The goal is straight ahead and a pillar beside the way to it, to the left (1) or to the right (-1)."""
    robot = quiet(RobotConfig())
    world = room(circles=[[-0.5, 0.8 * side, 0.4]])
    task = replace(single_task(world, (-2.0, 0.0, 0.0), (1.5, 0.0), robot), time_limit_s=time_limit_s)
    return NavVectorEnv(NUM_ENVS, scenario=OneTask(task), robot=robot, randomize=False)


def drive(env: NavVectorEnv, buffer: HabitReplay, actions: np.ndarray) -> dict[str, np.ndarray]:
    """Write the steps of actions (T, N, 2) to the replay; returns them, (T, N, ...), and which ones were failures."""
    adapter = Sb3VecEnv(env)
    observation = adapter.reset()
    kept: dict[str, list[Any]] = {
        name: [] for name in ("observations", "actions", "next_observations", "failed")
    }
    kept["rewards"] = []
    for action in actions.astype(np.float32):
        adapter.step_async(action)
        following, rewards, dones, infos = adapter.step_wait()
        successor = following.copy()
        for i in np.flatnonzero(dones):
            successor[i] = infos[i]["terminal_observation"]
        buffer.add(observation, successor, action, rewards, dones, infos)
        failed = [
            bool(done) and not (info["is_success"] or info["TimeLimit.truncated"])
            for done, info in zip(dones, infos, strict=True)
        ]
        for name, rows in (("observations", observation), ("actions", action), ("rewards", rewards)):
            kept[name].append(rows)
        kept["next_observations"].append(successor)
        kept["failed"].append(failed)
        observation = following
    return {name: np.array(rows) for name, rows in kept.items()}


def rows_of(transitions: dict[str, np.ndarray]) -> np.ndarray:
    """(T N, 2 D + 3) each transition as one row."""
    parts = (transitions[name] for name in ("observations", "actions", "next_observations"))
    rewards = transitions["rewards"].reshape(-1, 1)
    return np.concatenate([*(part.reshape(len(rewards), -1) for part in parts), rewards], axis=1)


def is_one_of(batch: np.ndarray, rows: np.ndarray) -> np.ndarray:
    return np.array([np.abs(rows - one).max(axis=1).min() < 1e-4 for one in batch])


@pytest.mark.parametrize("algorithm", OFF_POLICY)
def test_a_mirrored_row_is_a_step_of_the_mirrored_world(algorithm: str) -> None:
    """Every other row of a batch happened in the world; the others happen in its mirror image, reward and all."""
    actions = np.random.default_rng(0).uniform((0.0, -1.0), 1.0, (120, NUM_ENVS, 2))
    here, there = [
        make_model(algorithm, beside_a_pillar(side), small(), {}, habits=True) for side in (1.0, -1.0)
    ]
    buffers: list[Any] = [here.replay_buffer, there.replay_buffer]  # pyright: ignore
    seen = rows_of(drive(beside_a_pillar(1.0), buffers[0], actions))
    mirrored = rows_of(drive(beside_a_pillar(-1.0), buffers[1], actions * [1.0, -1.0]))
    batch = buffers[0].sample(64)
    fields = {name: getattr(batch, name).numpy() for name in batch._fields}
    rows = rows_of(fields)
    assert is_one_of(rows[1::2], seen).all()
    assert is_one_of(rows[::2], mirrored).all()
    assert not is_one_of(rows[::2], seen).any(), (
        "the pillar stands on one side, and no action is straight ahead"
    )


def test_a_robot_that_is_not_symmetric_is_never_mirrored() -> None:
    lidar = replace(RobotConfig().lidar, mount_y_m=0.1)
    env = NavVectorEnv(2, robot=replace(RobotConfig(), lidar=lidar), scenario="clutter", task_pool=1)
    model: Any = make_model("SAC", env, small(), {}, habits=True)
    seen = rows_of(drive(env, model.replay_buffer, np.full((40, 2, 2), 0.5)))
    fields = {name: value.numpy() for name, value in model.replay_buffer.sample(64)._asdict().items()}
    assert is_one_of(rows_of(fields), seen).all()


@pytest.mark.parametrize("rows", [500_000, 30 * NUM_ENVS], ids=["whole", "ring"])
def test_the_failure_share_of_a_batch_leads_to_failures(rows: int) -> None:
    """The last rows of a batch are of the last ten steps before a failure, or of fewer where the episode had fewer."""
    config = small(failure_share=FAILURE_SHARE, mirror=False, replay_capacity=rows)
    env = beside_a_pillar(1.0)
    model: Any = make_model("TD3", env, config, {}, habits=True)
    buffer = model.replay_buffer
    steps = drive(env, buffer, np.random.default_rng(1).uniform((0.5, 0.0), (1.0, 0.3), (300, NUM_ENVS, 2)))
    times, envs = np.nonzero(steps["failed"])
    assert len(times) > NUM_ENVS, "the curves end at the pillar"
    leading = np.zeros(steps["failed"].shape, bool)
    for time, i in zip(times, envs, strict=True):
        before = times[(envs == i) & (times < time)]
        first = max(time - FAILURE_STEPS + 1, before.max() + 1 if len(before) else 0)
        leading[first : time + 1, i] = True
    kept = rows_of(steps)
    to_failures = round(FAILURE_SHARE * 40)
    for _ in range(5):
        fields = {name: value.numpy() for name, value in buffer.sample(40)._asdict().items()}
        assert len(fields["rewards"]) == 40
        assert is_one_of(rows_of(fields)[-to_failures:], kept[leading.ravel()]).all()
        assert is_one_of(rows_of(fields), kept).all()
    assert buffer.failures.size() == min(leading.sum(), buffer.failures.buffer_size)
    assert buffer.failures.dones[: buffer.failures.size()].sum() >= 1


def test_failures_cost_a_tenth_of_the_replay_s_memory() -> None:
    """Ten times as many failing steps as there is room for keep the newest; a small replay has room for one failure."""
    spaces = Box(-1.0, 1.0, (40,), np.float32), Box(-1.0, 1.0, (2,), np.float32)
    replay = HabitReplay(8000, *spaces, n_envs=NUM_ENVS)
    sizes = [
        sum(array.nbytes for array in vars(buffer).values() if isinstance(array, np.ndarray))
        for buffer in (replay, replay.failures)
    ]
    assert sizes[1] == pytest.approx(0.1 * sizes[0], rel=0.01)
    for step in range(1000):
        rows, every = np.full((NUM_ENVS, 40), step / 1000, np.float32), np.ones(NUM_ENVS)
        replay.add(rows, rows, rows[:, :2], every, every, [{"is_success": False}] * NUM_ENVS)
    assert replay.failures.observations.min() == pytest.approx(0.9)
    assert HabitReplay(16, *spaces, n_envs=NUM_ENVS).failures.buffer_size == FAILURE_STEPS


def test_arrivals_and_timeouts_are_no_failures() -> None:
    for env in (
        NavVectorEnv(2, scenario=OneTask(straight_task(RobotConfig(), 1.0)), randomize=False),
        NavVectorEnv(
            2, scenario=OneTask(straight_task(RobotConfig(), 3.0, time_limit_s=1.0)), randomize=False
        ),
    ):
        model: Any = make_model("TD3", env, small(), {}, habits=True)
        drive(env, model.replay_buffer, np.tile([1.0, 0.0], (60, 2, 1)))
        assert model.replay_buffer.dones.sum() > 1
        assert model.replay_buffer.failures.size() == 0


@pytest.mark.parametrize("algorithm", OFF_POLICY)
def test_n_step_returns_are_the_library_s(algorithm: str) -> None:
    """Equal draws of a plain model's replay and of one with habits, none of them to be seen, are equal batches."""
    env = beside_a_pillar(1.0)
    config = small(failure_share=0.0, mirror=False, td3=replace(small().td3, n_step=3))
    models: list[Any] = [make_model(algorithm, env, config, {}, habits=habits) for habits in (False, True)]
    actions = np.random.default_rng(2).uniform((0.0, -1.0), 1.0, (100, NUM_ENVS, 2))
    batches = []
    for model in models:
        env.reset(seed=0)
        drive(env, model.replay_buffer, actions)
        np.random.seed(5)  # noqa: NPY002, the library draws from the global generator
        batches.append(model.replay_buffer.sample(64))
    for name, plain, ours in zip(batches[0]._fields, *batches, strict=True):
        np.testing.assert_array_equal(ours, plain, err_msg=name)
    assert batches[0].discounts.min() == pytest.approx(0.95**3)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_layer_norm_is_in_the_critics_alone(algorithm: str) -> None:
    """One for each hidden layer, of the targets too, and what is new in them is trained."""

    def norms(habits: bool) -> dict[str, int]:
        policy: Any = make_model(algorithm, beside_a_pillar(1.0), small(), {}, habits=habits).policy
        if algorithm == "PPO":
            extractor = policy.mlp_extractor
            networks = {"actor": [extractor.policy_net, policy.action_net]}
            networks["critic"] = [extractor.value_net, policy.value_net]
            optimizer = policy.optimizer
        else:
            names = [name for name in NETWORKS if hasattr(policy, name)]
            networks = {name: [getattr(policy, name)] for name in names}
            optimizer = policy.critic.optimizer
        trained = {id(p) for group in optimizer.param_groups for p in group["params"]}
        assert all(id(p) in trained for module in networks["critic"] for p in module.parameters())
        return {
            name: sum(isinstance(m, torch.nn.LayerNorm) for module in modules for m in module.modules())
            for name, modules in networks.items()
        }

    assert not any(norms(habits=False).values())
    each = 2 if algorithm == "PPO" else 4
    assert norms(habits=True) == {
        name: each if name.startswith("critic") else 0 for name in norms(habits=False)
    }


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_the_averaged_actor_is_the_average(algorithm: str) -> None:
    """After each update of the actor a share (1 + 15) / (t + 15) of it, never less than our learner's constant."""
    model: Any = make_model(algorithm, beside_a_pillar(1.0), small(), {}, habits=True)
    actor = acting(model)
    optimizer: Any = actor.optimizer
    average = averaged(actor)
    expected: list[np.ndarray] = []
    rng = np.random.default_rng(0)
    for t in range(1, 41):
        for parameter in actor.parameters():
            parameter.grad = torch.as_tensor(rng.standard_normal(parameter.shape).astype(np.float32))
        optimizer.step()
        share = max(0.0025, 16.0 / (t + 15.0))
        now = [parameter.detach().numpy().astype(np.float64) for parameter in actor.parameters()]
        expected = [a + share * (new - a) for a, new in zip(expected, now, strict=True)] if expected else now
    for got, wanted, last in zip(average.parameters(), expected, actor.parameters(), strict=True):
        np.testing.assert_allclose(got.detach().numpy(), wanted, atol=1e-5)
        assert not torch.equal(got, last)


@pytest.mark.parametrize("algorithm", OFF_POLICY)
def test_noise_grows_from_robot_to_robot(algorithm: str) -> None:
    model: Any = make_model(algorithm, beside_a_pillar(1.0), small(), {}, habits=True)
    noise = np.array([model.action_noise() for _ in range(4000)])  # (4000, N, 2)
    stds = np.linspace(*TrainConfig().exploration_std, NUM_ENVS)
    np.testing.assert_allclose(noise.std(axis=0), np.tile(stds[:, None], 2), rtol=0.06)
    np.testing.assert_allclose(noise.mean(axis=0), 0.0, atol=0.04)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_what_is_evaluated_and_saved_is_the_averaged_actor(algorithm: str, tmp_path: Path) -> None:
    """It acts as the library's own actor with the averaged weights does, to 1e-6, and not as the last one."""
    env = beside_a_pillar(1.0, time_limit_s=5.0)
    models: list[Any] = []
    averages: list[Any] = []

    def remember(actor: Any) -> Any:
        averages.append(averaged(actor))
        return averages[-1]

    def make(*args: Any, **options: Any) -> Any:
        models.append(make_model(*args, **options))
        return models[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("adrl.baselines.sb3.averaged", remember)
        patch.setattr("adrl.baselines.sb3.make_model", make)
        result = train_sb3(
            algorithm,
            env,
            small(),
            tmp_path,
            policy_config=PolicyConfig(input_size=1, widths=(1,)),
            tuned={"n_steps": 8, "batch_size": 16} if algorithm == "PPO" else {},
            habits=True,
        )
    (model,), (average,) = models, averages
    observation = (
        np.random.default_rng(0).standard_normal((50, result.policy.config.input_size)).astype(np.float32)
    )
    last = model.predict(observation, deterministic=True)[0]
    acting(model).load_state_dict(average.state_dict())
    expected = model.predict(observation, deterministic=True)[0]
    np.testing.assert_allclose(load_policy(tmp_path).act(observation), expected, atol=1e-6)
    np.testing.assert_allclose(
        to_policy(model, PolicyConfig(input_size=1, widths=(1,))).act(observation), expected, atol=1e-6
    )
    assert np.abs(last - expected).max() > 1e-4


def test_both_columns_of_each_algorithm_are_there() -> None:
    named = {(baseline.algorithm, baseline.habits) for baseline in SB3_METHODS.values()}
    assert named == {(algorithm, habits) for algorithm in ALGORITHMS for habits in (False, True)}
