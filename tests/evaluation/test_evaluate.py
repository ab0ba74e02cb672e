"""Laws of an evaluation on another robot than the policy was trained for: it is the drive that the runtime makes."""

from dataclasses import fields, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from adrl.deploy.another_robot import as_trained
from adrl.deploy.lidar import LidarAdapter
from adrl.deploy.messages import Scan
from adrl.envs import Setting
from adrl.errors import ConfigError
from adrl.evaluation.evaluate import evaluate
from adrl.evaluation.metrics import Episodes
from adrl.observation import ObservationEncoder
from adrl.types import LidarConfig, RobotConfig
from adrl.worlds import get_scenario, task_set

OWN = RobotConfig(lidar=LidarConfig(noise_std_m=0.0))


class Wary:
    """As fast as the nearest sector is far, turning to the goal."""

    robot = OWN

    def act(self, observation):
        nearest = observation[:, :36].min(axis=1)
        return np.stack([2.0 * nearest - 1.0, observation[:, 37]], axis=1).astype(np.float32)


@pytest.mark.parametrize("guidance", ["goal", "replan"])
def test_farther_sight_and_a_reverse_gear_that_the_policy_knows_nothing_of_change_no_drive(guidance):
    other = replace(OWN, name="other", min_speed_mps=-0.6, lidar=replace(OWN.lidar, max_range_m=30.0))
    tasks = task_set(get_scenario("clutter"), OWN, "validation", 12)
    own, others = (
        evaluate(Wary(), robot=robot, tasks=tasks, guidance=guidance).rollout.episodes
        for robot in (OWN, other)
    )
    for field in fields(Episodes):
        assert_array_equal(getattr(own, field.name), getattr(others, field.name), field.name)


@pytest.mark.parametrize("reach_m", [3.0, 6.0, 25.0])
def test_simulator_and_runtime_show_a_policy_the_same_of_another_robot(reach_m):
    driven = replace(OWN, radius_m=0.3, min_speed_mps=-0.4, lidar=replace(OWN.lidar, max_range_m=reach_m))
    taken_as = as_trained(driven, OWN)
    sim = Setting(robot=driven, taken_as=taken_as).simulate(8)
    tasks = task_set(get_scenario("clutter"), driven, "validation", 8)
    sim.reset(np.arange(8), tasks, np.arange(8, dtype=np.uint64), np.random.default_rng(0))
    _, goal, twist, last_action, _ = sim.measured()
    adapter = LidarAdapter(taken_as.lidar)
    scans = [
        Scan(
            ranges=ranges,
            angle_min_rad=driven.lidar.angle_min_rad,
            angle_increment_rad=driven.lidar.angle_increment_rad,
            range_max_m=reach_m,
            stamp_s=0.0,
        )
        for ranges in sim.b["ranges"]
    ]
    seen = ObservationEncoder(taken_as).encode(np.stack([*map(adapter, scans)]), goal, twist, last_action)
    assert_allclose(sim.observe(), seen, atol=1e-5)


@pytest.mark.parametrize("last", ["episodes.parquet", "traces.safetensors"])
def test_a_save_that_was_killed_between_two_files_is_made_anew(tmp_path, last):
    """The summary is the last to come, and what came before it is not taken for somebody's files."""
    tasks = task_set(get_scenario("clutter"), OWN, "validation", 2)
    evaluate(Wary(), tasks=tasks, out=tmp_path / "whole")
    kept = {path.name for path in (tmp_path / "whole").iterdir()}
    left = tmp_path / "left"
    left.mkdir()
    for name in sorted(kept - {"summary.json"}):
        (left / name).write_bytes((tmp_path / "whole" / name).read_bytes())
        if name == last:
            break
    evaluate(Wary(), tasks=tasks, out=left)
    assert {path.name for path in left.iterdir()} == kept
    (left / "summary.json").unlink()
    (left / "thesis.txt").touch()
    with pytest.raises(ConfigError, match="something else"):
        evaluate(Wary(), tasks=tasks, out=left)
