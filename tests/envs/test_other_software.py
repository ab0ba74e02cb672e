"""What others wrote for Gymnasium environments takes ours: its wrappers, Stable-Baselines3, Minari, TorchRL."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import minari
import numpy as np
import pytest
from gymnasium.vector import VectorEnv
from gymnasium.wrappers import vector as wrappers

import adrl
from adrl.envs import NavEnv
from adrl.registration import MAX_EPISODE_STEPS
from adrl.types import RobotConfig
from adrl.worlds import ROBOTS, SCENARIOS, task_set
from env_tasks import OneTask, straight_task

FORWARD = np.array([1.0, 0.0], np.float32)

# --- Gymnasium -----------------------------------------------------------------------------------------------------

OBSERVATION: dict[str, Any] = {
    "FlattenObservation": {},
    "RescaleObservation": {"min_obs": np.float32(-1.0), "max_obs": np.float32(1.0)},
    "ReshapeObservation": {"shape": (2, 22)},
    "DtypeObservation": {"dtype": np.float64},
    "NormalizeObservation": {},
}
OTHER: dict[str, Any] = {
    "RecordEpisodeStatistics": {},
    "NormalizeReward": {},
    "ClipReward": {"min_reward": -1.0, "max_reward": 1.0},
    "RescaleAction": {"min_action": np.float32(-2.0), "max_action": np.float32(2.0)},
    "ClipAction": {},
    "DictInfoToList": {},
}


@pytest.mark.parametrize(
    ("name", "mode"),
    [(name, mode) for name in OTHER for mode in ("NextStep", "SameStep")]
    + [(name, "NextStep") for name in OBSERVATION],  # Gymnasium's own refuse SameStep
)
def test_gymnasiums_vector_wrappers_take_ours(name: str, mode: str) -> None:
    inner = gymnasium.make_vec(adrl.ENV_ID, num_envs=4, autoreset_mode=mode, task_pool=16)
    env: VectorEnv = getattr(wrappers, name)(inner, **(OBSERVATION | OTHER)[name])
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation) or name == "NormalizeObservation"
    ended = np.zeros(4)
    for _ in range(150):
        observation, _, terminated, truncated, _ = env.step(np.tile(FORWARD, (4, 1)))
        assert observation.shape == env.observation_space.shape
        assert np.isfinite(observation).all()
        ended += terminated | truncated
    assert (ended > 0).all()


def test_episode_statistics_in_every_mode() -> None:
    """A step that only begins an episode counts for none; a return is the sum of the rewards."""
    for mode in ("NextStep", "SameStep"):
        env = wrappers.RecordEpisodeStatistics(
            gymnasium.make_vec(adrl.ENV_ID, num_envs=6, autoreset_mode=mode)
        )
        env.reset(seed=0)
        length, total, begins = np.zeros(6), np.zeros(6), np.zeros(6, dtype=bool)
        episodes = 0
        for _ in range(150):
            _, rewards, terminated, truncated, info = env.step(np.tile(FORWARD, (6, 1)))
            assert (rewards[begins] == 0.0).all()
            length, total = length + ~begins, total + rewards
            ended = terminated | truncated
            begins = ended if mode == "NextStep" else np.zeros(6, dtype=bool)
            if ended.any():
                np.testing.assert_array_equal(info["episode"]["l"][ended], length[ended])
                np.testing.assert_allclose(info["episode"]["r"][ended], total[ended], rtol=1e-5)
            length[ended] = total[ended] = 0.0
            episodes += int(ended.sum())
        assert episodes > 8


@pytest.mark.slow
def test_checkers_pass_without_pygame() -> None:
    """Gymnasium's and Stable-Baselines3's, rendering included, without a warning."""
    code = (
        "import sys, warnings; sys.modules['pygame'] = None\n"
        "import gymnasium, adrl\n"
        "from gymnasium.utils.env_checker import check_env\n"
        "warnings.simplefilter('error', UserWarning)\n"
        "env = gymnasium.make(adrl.ENV_ID, render_mode='rgb_array')\n"
        "check_env(env.unwrapped)\n"
        "assert env.metadata['render_modes'] == ['rgb_array']\n"
        "try: from stable_baselines3.common.env_checker import check_env as theirs\n"
        "except ModuleNotFoundError: pass\n"
        "else: theirs(gymnasium.make(adrl.ENV_ID))\n"
        "from adrl.envs import NavEnv\n"
        "try: NavEnv(render_mode='human')\n"
        "except adrl.errors.MissingExtra as error: print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "adrl[render]" in done.stdout


def test_the_spec_has_a_bound_that_no_task_reaches() -> None:
    """Others' software wants one; ours ends episodes by each task's own time limit."""
    for name in (adrl.ENV_ID, "adrl/Gazebo-v0"):
        assert gymnasium.spec(name).max_episode_steps == MAX_EPISODE_STEPS
    slowest = min(ROBOTS.values(), key=lambda robot: robot.max_speed_mps)
    for scenario in SCENARIOS.values():
        (task,) = task_set(scenario, slowest, "test", 1)
        assert 10 * task.time_limit_s / slowest.control_period_s < MAX_EPISODE_STEPS


# --- Stable-Baselines3 ---------------------------------------------------------------------------------------------


def straight_on() -> gymnasium.Env:
    """An environment in which driving on arrives."""
    return NavEnv(scenario=OneTask(straight_task(RobotConfig())), task_pool=1)


def plain() -> gymnasium.Env:
    return gymnasium.make(adrl.ENV_ID, task_pool=8)


class Onwards:
    """A model that drives on, for Stable-Baselines3's evaluation."""

    def predict(self, observation: np.ndarray, state: Any = None, **_: Any) -> tuple[np.ndarray, Any]:
        return np.tile(FORWARD, (len(observation), 1)), state


@pytest.mark.slow
def test_sb3_tells_success() -> None:
    """EvalCallback finds is_success at the ends of episodes, and reports the rate."""
    pytest.importorskip("stable_baselines3")
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import EvalCallback
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.evaluation import evaluate_policy

    model = PPO("MlpPolicy", make_vec_env(plain, 2), n_steps=16, batch_size=16, n_epochs=1, device="cpu")
    callback = EvalCallback(make_vec_env(straight_on, 1), n_eval_episodes=3, eval_freq=16, verbose=0)
    callback.init_callback(model)
    evaluate_policy(Onwards(), callback.eval_env, 3, callback=callback._log_success_callback)  # pyright: ignore
    assert callback._is_success_buffer == [True, True, True]
    model.learn(64, callback=callback)
    assert 0.0 <= model.logger.name_to_value["eval/success_rate"] <= 1.0


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["PPO", "SAC"])
@pytest.mark.parametrize("vectorisation", ["DummyVecEnv", "SubprocVecEnv"])
def test_sb3_learns_a_few_steps(algorithm: str, vectorisation: str) -> None:
    sb3 = pytest.importorskip("stable_baselines3")
    from stable_baselines3.common import vec_env

    torch = pytest.importorskip("torch")
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    env = vec_env.VecNormalize(getattr(vec_env, vectorisation)([plain, plain]))
    try:
        options: dict[str, Any] = {"n_steps": 32} if algorithm == "PPO" else {"learning_starts": 32}
        model = getattr(sb3, algorithm)("MlpPolicy", env, device="cpu", seed=1, batch_size=32, **options)
        model.learn(80)
        first, second = env.reset()
        assert not np.array_equal(first, second)
        assert model.predict(np.stack([first, second]))[0].shape == (2, 2)
    finally:
        torch.set_num_threads(threads)
        env.close()


# --- Minari --------------------------------------------------------------------------------------------------------


def test_minari_records_and_recovers(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """DataCollector with infos; the recovered environment is ours, with the bound others want."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    env = minari.DataCollector(gymnasium.make(adrl.ENV_ID, robot="jackal", task_pool=2), record_infos=True)
    for seed in range(2):
        env.reset(seed=seed)
        for _ in range(10):
            _, _, terminated, truncated, _ = env.step(env.action_space.sample())
            if terminated or truncated:
                break
    dataset = env.create_dataset("adrl/test-v0", algorithm_name="random")
    episode = dataset[0]
    assert episode.infos["is_success"].dtype == np.bool_
    assert len(episode.infos["reward_terms"]) == len(episode.observations)
    recovered = minari.load_dataset("adrl/test-v0").recover_environment()
    assert recovered.spec is not None
    assert recovered.spec.max_episode_steps == MAX_EPISODE_STEPS
    assert recovered.unwrapped._env.robot.name == "jackal"  # pyright: ignore


def test_d3rlpy_takes_a_recorded_dataset(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """It wants a bound on the steps of an episode. Its releases pin an old Gymnasium: install it with --no-deps."""
    datasets = pytest.importorskip("d3rlpy.datasets")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    inner = gymnasium.make(adrl.ENV_ID, task_pool=2, max_episode_steps=9)
    env = minari.DataCollector(inner, record_infos=True)
    env.reset(seed=0)
    for _ in range(9):
        env.step(np.array([-1.0, 0.1], np.float32))
    env.create_dataset("adrl/test-v0", algorithm_name="none")
    buffer, recovered = datasets.get_minari("adrl/test-v0")
    assert buffer.transition_count == 8  # a step that truncates has no successor there
    assert recovered.reset(seed=0)[0].shape == env.observation_space.shape
    assert recovered.spec is not None
    assert recovered.spec.max_episode_steps == 9


# --- TorchRL -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["SameStep", "Disabled", None])
def test_torchrl_rolls_out(mode: str | None) -> None:
    """GymWrapper on our vector in the modes it takes, and on the single environment; true successors included."""
    pytest.importorskip("torchrl")
    from torchrl.envs.libs.gym import GymWrapper
    from torchrl.envs.utils import check_env_specs

    inner = (
        gymnasium.make(adrl.ENV_ID, task_pool=8)
        if mode is None
        else gymnasium.make_vec(adrl.ENV_ID, num_envs=3, task_pool=8, autoreset_mode=mode)
    )
    env = GymWrapper(inner)
    check_env_specs(env)
    env.set_seed(0)
    rollout = env.rollout(200, break_when_any_done=False)
    done = rollout["next", "done"].squeeze(-1)
    assert done.any()
    successor, following = rollout["next", "observation"], rollout["observation"]
    goes_on = ~done[..., :-1]
    assert (successor[..., :-1, :][goes_on] == following[..., 1:, :][goes_on]).all()
    assert (successor[..., :-1, :][~goes_on] != following[..., 1:, :][~goes_on]).any(-1).all()
