"""Every robot, scenario and guidance makes an environment that runs; new ones are tested by being listed."""

from pathlib import Path

import numpy as np
import pytest

from adrl.envs import NavVectorEnv
from adrl.rewards import FEATURES, REWARD_TERMS
from adrl.types import GUIDANCE, SPLITS, Scenario
from adrl.worlds import ROBOTS, SCENARIOS, MapScenario, SdfScenario
from map_files import write_map

EVERY_ROBOT = pytest.mark.parametrize("robot", ROBOTS)
EVERY_GUIDANCE = pytest.mark.parametrize("guidance", GUIDANCE)

SDF = """<?xml version="1.0"?>
<sdf version="1.6"><world name="yard">
  <model name="wall"><static>true</static><pose>0 0 0.5 0 0 0.3</pose><link name="link">
    <collision name="c"><geometry><box><size>4 0.3 1</size></box></geometry></collision>
  </link></model>
  <model name="far"><static>true</static><pose>4 4 0.5 0 0 0</pose><link name="link">
    <collision
    name="c"><geometry><cylinder><radius>0.5</radius><length>1</length></cylinder></geometry></collision>
  </link></model>
</world></sdf>
"""


def run(scenario: str | Scenario, robot: str, guidance: str) -> None:
    """Random driving, the expert in every other row: it moves, sees, and all is finite and in its space."""
    env = NavVectorEnv(6, scenario=scenario, robot=robot, guidance=guidance, task_pool=3)
    observation, _ = env.reset(seed=0)
    env.action_space.seed(0)
    moved, seen = np.zeros(6), 0.0
    for _ in range(40):
        action = env.action_space.sample()
        action[::2] = env.expert_actions()[::2]
        assert action in env.action_space
        observation, rewards, _, _, info = env.step(action)
        assert observation in env.observation_space
        assert np.isfinite(rewards).all()
        assert info["reward_terms"].shape == (6, len(REWARD_TERMS))
        assert info["features"].shape == (6, len(FEATURES))
        assert np.isfinite(info["reward_terms"]).all()
        assert ((info["features"] >= 0.0) & (info["features"] <= 1.0)).all()
        moved += np.abs(env.sim.b["twist"][:, 0])
        seen = max(seen, float(np.ptp(observation[:, : env.sim.encoder.config.num_sectors], axis=1).max()))
    assert (moved[::2] > 0.0).all()
    assert seen > 0.1


@EVERY_GUIDANCE
@EVERY_ROBOT
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_registered_scenarios(scenario: str, robot: str, guidance: str) -> None:
    run(scenario, robot, guidance)


@EVERY_GUIDANCE
@EVERY_ROBOT
def test_map_scenario(robot: str, guidance: str, tmp_path: Path) -> None:
    pixels = np.full((200, 200), 254)
    pixels[[0, -1]] = pixels[:, [0, -1]] = 0
    pixels[90:110, 60:140] = 0
    run(MapScenario(write_map(tmp_path, pixels)), robot, guidance)


@EVERY_GUIDANCE
@EVERY_ROBOT
def test_sdf_scenario(robot: str, guidance: str, tmp_path: Path) -> None:
    path = tmp_path / "yard.world"
    path.write_text(SDF)
    run(SdfScenario(path), robot, guidance)


def test_splits_do_not_share_tasks() -> None:
    starts = set()
    for split in SPLITS:
        env = NavVectorEnv(8, split=split, task_pool=8)
        env.reset(seed=0)
        starts |= {task.start for task in env.sim.tasks if task is not None}
        assert starts, split
    pools = [{NavVectorEnv(1, split=split)._pool[i].start for i in range(5)} for split in SPLITS]
    assert len(set.union(*pools)) == 15
